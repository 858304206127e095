//! Mass properties of a body.

use nalgebra::{Matrix3, Vector3};

/// Mass, centre of mass and rotational inertia of one body, in that body's axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Inertia {
    /// Mass, kg.
    pub mass_kg: f64,
    /// Centre of mass from the body's origin, m.
    pub center_m: Vector3<f64>,
    /// Rotational inertia about the centre of mass, kg m², symmetric.
    pub rotational_kg_m2: Matrix3<f64>,
}

impl Inertia {
    /// No mass at all.
    pub fn zero() -> Self {
        Self { mass_kg: 0.0, center_m: Vector3::zeros(), rotational_kg_m2: Matrix3::zeros() }
    }

    /// The inertia of this body and another one fixed to it, both in the same axes.
    pub fn plus(&self, other: &Self) -> Self {
        let mass_kg = self.mass_kg + other.mass_kg;
        if mass_kg == 0.0 {
            return Self::zero();
        }
        let center_m = (self.center_m * self.mass_kg + other.center_m * other.mass_kg) / mass_kg;
        let about = |part: &Self| {
            let offset_m = part.center_m - center_m;
            part.rotational_kg_m2 + steiner(part.mass_kg, &offset_m)
        };
        Self { mass_kg, center_m, rotational_kg_m2: about(self) + about(other) }
    }

    /// The same body written in axes from which its own are displaced by `rotation` and `translation`.
    pub fn placed(&self, rotation: &Matrix3<f64>, translation: &Vector3<f64>) -> Self {
        Self {
            mass_kg: self.mass_kg,
            center_m: translation + rotation * self.center_m,
            rotational_kg_m2: rotation * self.rotational_kg_m2 * rotation.transpose(),
        }
    }

    /// The body with every kilogram counted `share` times.
    pub fn scaled(&self, share: f64) -> Self {
        Self { mass_kg: self.mass_kg * share, center_m: self.center_m, rotational_kg_m2: self.rotational_kg_m2 * share }
    }

    /// Σ m x xᵀ about the centre of mass; the rotational inertia is its trace minus itself.
    pub(crate) fn second_moment(&self) -> Matrix3<f64> {
        Matrix3::identity() * (0.5 * self.rotational_kg_m2.trace()) - self.rotational_kg_m2
    }
}

/// The parallel-axis term m (|x|² 1 − x xᵀ).
fn steiner(mass_kg: f64, x: &Vector3<f64>) -> Matrix3<f64> {
    (Matrix3::identity() * x.norm_squared() - x * x.transpose()) * mass_kg
}
