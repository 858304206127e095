//! Rigid-body inertia and the few spatial operations that the recursions use.

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

/// A spatial motion about the reference point, in world axes.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Motion {
    pub angular: Vector3<f64>,
    pub linear: Vector3<f64>,
}

/// A spatial force about the reference point, in world axes.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Force {
    pub moment: Vector3<f64>,
    pub force: Vector3<f64>,
}

impl Motion {
    pub const ZERO: Self = Self { angular: Vector3::new(0.0, 0.0, 0.0), linear: Vector3::new(0.0, 0.0, 0.0) };

    /// The velocity (or spatial acceleration) that this motion gives to the point p.
    #[inline(always)]
    pub fn at(&self, p: &Vector3<f64>) -> Vector3<f64> {
        self.linear + self.angular.cross(p)
    }

    /// self × other, the rate of `other` when carried along by `self`.
    #[inline(always)]
    pub fn cross(&self, other: &Motion) -> Motion {
        Motion {
            angular: self.angular.cross(&other.angular),
            linear: self.angular.cross(&other.linear) + self.linear.cross(&other.angular),
        }
    }

    /// self ×* f, the rate of a force carried along by `self`.
    #[inline(always)]
    pub fn cross_force(&self, f: &Force) -> Force {
        Force {
            moment: self.angular.cross(&f.moment) + self.linear.cross(&f.force),
            force: self.angular.cross(&f.force),
        }
    }

    /// Power of a force on this motion.
    #[inline(always)]
    pub fn dot(&self, f: &Force) -> f64 {
        self.angular.dot(&f.moment) + self.linear.dot(&f.force)
    }

    #[inline(always)]
    pub fn add_scaled(&mut self, other: &Motion, scale: f64) {
        self.angular += other.angular * scale;
        self.linear += other.linear * scale;
    }
}

impl Force {
    pub const ZERO: Self = Self { moment: Vector3::new(0.0, 0.0, 0.0), force: Vector3::new(0.0, 0.0, 0.0) };
}

impl std::ops::Add for Force {
    type Output = Force;
    #[inline(always)]
    fn add(self, other: Force) -> Force {
        Force { moment: self.moment + other.moment, force: self.force + other.force }
    }
}

impl std::ops::AddAssign for Force {
    #[inline(always)]
    fn add_assign(&mut self, other: Force) {
        *self = *self + other;
    }
}

impl std::ops::Add for Motion {
    type Output = Motion;
    #[inline(always)]
    fn add(self, other: Motion) -> Motion {
        Motion { angular: self.angular + other.angular, linear: self.linear + other.linear }
    }
}

/// Inertia of a body, or of a whole subtree, about the reference point in world axes.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Composite {
    /// Σ m.
    pub mass: f64,
    /// Σ m x.
    pub first: Vector3<f64>,
    /// Σ m x xᵀ.
    pub second: Matrix3<f64>,
}

impl Composite {
    pub const ZERO: Self = Self {
        mass: 0.0,
        first: Vector3::new(0.0, 0.0, 0.0),
        second: Matrix3::new(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    };

    /// I u: the momentum of the bodies when they move as one by u. With x the position of a particle,
    /// its moment is Σ m x × (u + ω × x) = first × u + tr(second) ω − second ω.
    #[inline(always)]
    pub fn times(&self, u: &Motion) -> Force {
        Force {
            moment: u.angular * self.second.trace() - self.second * u.angular + self.first.cross(&u.linear),
            force: u.linear * self.mass + u.angular.cross(&self.first),
        }
    }

    #[inline(always)]
    pub fn add(&mut self, other: &Self) {
        self.mass += other.mass;
        self.first += other.first;
        self.second += other.second;
    }
}
