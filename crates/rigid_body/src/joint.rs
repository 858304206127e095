//! Joints, the bodies that they move, and frames fixed to those.

use nalgebra::{Matrix3, Vector3};

use crate::inertia::Inertia;

/// Names of the six joints of a floating base, in the order of their coordinates.
pub(crate) const BASE_JOINTS: [&str; 6] = ["base_x", "base_y", "base_z", "base_roll", "base_pitch", "base_yaw"];

/// A frame of a [`Model`](crate::Model): a link of its URDF. The same in a model and in every model cut from it by
/// [`Model::subtree`](crate::Model::subtree).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct FrameId(pub(crate) usize);

/// How a joint moves.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum JointKind {
    /// Turns about its axis; coordinate in radians.
    Revolute,
    /// Slides along its axis; coordinate in metres.
    Prismatic,
}

/// A joint and the body that it moves.
#[derive(Debug, Clone)]
pub(crate) struct Joint {
    pub name: String,
    /// The joint that it hangs from; none for the world.
    pub parent: Option<usize>,
    /// Its coordinate's place in q.
    pub dof: usize,
    pub kind: JointKind,
    /// Placement of the body's frame in the parent body's frame at q = 0.
    pub rotation: Matrix3<f64>,
    pub translation: Vector3<f64>,
    /// Unit axis, in the body's frame (a joint leaves its own axis where it is).
    pub axis: Vector3<f64>,
    /// Mass properties of the body with all that is fixed to it, in the body's frame.
    pub inertia: Inertia,
    /// Which link of the URDF moves with it.
    pub link: String,
    pub turn: Turn,
}

/// The rotation of a body in its parent, R(q) = fixed + cos q · cosine + sin q · sine (Rodrigues).
#[derive(Debug, Clone)]
pub(crate) struct Turn {
    pub fixed: Matrix3<f64>,
    pub cosine: Matrix3<f64>,
    pub sine: Matrix3<f64>,
}

impl Joint {
    pub fn new(
        name: &str,
        parent: Option<usize>,
        dof: usize,
        kind: JointKind,
        (rotation, translation): (Matrix3<f64>, Vector3<f64>),
        axis: Vector3<f64>,
        link: &str,
    ) -> Self {
        let along = axis * axis.transpose();
        let turn = Turn {
            fixed: rotation * along,
            cosine: rotation * (Matrix3::identity() - along),
            sine: rotation * axis.cross_matrix(),
        };
        Self {
            name: name.to_owned(),
            parent,
            dof,
            kind,
            rotation,
            translation,
            axis,
            inertia: Inertia::zero(),
            link: link.to_owned(),
            turn,
        }
    }
}

#[derive(Debug, Clone)]
pub(crate) struct Frame {
    pub name: String,
    /// The body it is fixed to: none if fixed to the world or not part of this model.
    pub body: Option<usize>,
    pub rotation: Matrix3<f64>,
    pub translation: Vector3<f64>,
}
