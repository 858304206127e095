//! What the recursions for any tree know of one joint and its body.

use nalgebra::{Matrix3, Vector3};

use crate::spatial::{Articulated, Composite, Force, Motion};

/// Its motion and its inertia. World axes, about the reference point.
#[derive(Debug, Clone)]
pub(crate) struct Body {
    /// Body axes to world axes.
    pub rotation: Matrix3<f64>,
    /// The body's origin from the reference point.
    pub position: Vector3<f64>,
    /// S: the motion of the body for a unit joint rate.
    pub axis: Motion,
    /// v of the body.
    pub velocity: Motion,
    /// Spatial acceleration of the body, gravity not included.
    pub acceleration: Motion,
    /// Ṡ = v_parent × S.
    pub axis_rate: Motion,
    /// S̈-like term (a_parent − g) × S + v_parent × Ṡ, with gravity included.
    pub axis_rate_2: Motion,
    /// I a + v ×* I v − I g, of the body, then of its subtree.
    pub force: Force,
    /// Inertia of the body, then of its subtree.
    pub composite: Composite,
    /// Σ m ṗ pᵀ and Σ m ṗ of the body, then of its subtree.
    pub moment_rate: Matrix3<f64>,
    pub momentum: Vector3<f64>,
}

impl Body {
    /// At rest at the reference point.
    pub const ZERO: Self = Self {
        rotation: Matrix3::new(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0),
        position: Vector3::new(0.0, 0.0, 0.0),
        axis: Motion::ZERO,
        velocity: Motion::ZERO,
        acceleration: Motion::ZERO,
        axis_rate: Motion::ZERO,
        axis_rate_2: Motion::ZERO,
        force: Force::ZERO,
        composite: Composite::ZERO,
        moment_rate: Matrix3::new(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        momentum: Vector3::new(0.0, 0.0, 0.0),
    };
}

/// What the articulated-body algorithm knows of one joint and its body.
#[derive(Debug, Clone)]
pub(crate) struct ArticulatedBody {
    pub inertia: Articulated,
    /// U = I S.
    pub reaction: Force,
    /// 1 / Sᵀ U.
    pub inverse: f64,
    /// τ − Sᵀ bias.
    pub drive: f64,
}

impl ArticulatedBody {
    pub const ZERO: Self = Self { inertia: Articulated::ZERO, reaction: Force::ZERO, inverse: 0.0, drive: 0.0 };
}
