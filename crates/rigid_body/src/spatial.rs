//! Spatial algebra about the reference point in world axes: motions, forces and inertias, of one tree or of all legs at
//! once.

use std::ops::{Add, AddAssign};

use nalgebra::{Matrix3, Vector3};

use crate::lanes::{Lane, V3};
use crate::space::{Space, Square};

const ZERO: Vector3<f64> = Vector3::new(0.0, 0.0, 0.0);
const ZERO_MATRIX: Matrix3<f64> = Matrix3::new(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0);

/// A spatial motion.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Motion<V = Vector3<f64>> {
    pub angular: V,
    pub linear: V,
}

/// A spatial force.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Force<V = Vector3<f64>> {
    pub moment: V,
    pub force: V,
}

impl Motion {
    pub const ZERO: Self = Self { angular: ZERO, linear: ZERO };
}

impl<V: Space> Motion<V> {
    #[inline(always)]
    pub fn zero() -> Self {
        Self { angular: V::zero(), linear: V::zero() }
    }

    /// A turn about an axis through the reference point.
    #[inline(always)]
    pub fn turn(angular: V) -> Self {
        Self { angular, linear: V::zero() }
    }

    /// The velocity (or spatial acceleration) that this motion gives to the point p.
    #[inline(always)]
    pub fn at(&self, p: &V) -> V {
        self.linear + self.angular.cross(p)
    }

    /// self × other, the rate of `other` when carried along by `self`.
    #[inline(always)]
    pub fn cross(&self, other: &Self) -> Self {
        Self {
            angular: self.angular.cross(&other.angular),
            linear: self.angular.cross(&other.linear) + self.linear.cross(&other.angular),
        }
    }

    /// self ×* f, the rate of a force carried along by `self`.
    #[inline(always)]
    pub fn cross_force(&self, f: &Force<V>) -> Force<V> {
        Force {
            moment: self.angular.cross(&f.moment) + self.linear.cross(&f.force),
            force: self.angular.cross(&f.force),
        }
    }

    /// Power of a force on this motion.
    #[inline(always)]
    pub fn dot(&self, f: &Force<V>) -> V::Scalar {
        self.angular.dot(&f.moment) + self.linear.dot(&f.force)
    }

    #[inline(always)]
    pub fn plus_scaled(&self, other: &Self, scale: V::Scalar) -> Self {
        Self {
            angular: self.angular.plus_scaled(&other.angular, scale),
            linear: self.linear.plus_scaled(&other.linear, scale),
        }
    }

    #[inline(always)]
    pub fn add_scaled(&mut self, other: &Self, scale: V::Scalar) {
        *self = self.plus_scaled(other, scale);
    }
}

impl<V: Space> Add for Motion<V> {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self { angular: self.angular + other.angular, linear: self.linear + other.linear }
    }
}

impl<T: Lane> Motion<V3<T>> {
    /// The same in all lanes.
    #[inline(always)]
    pub fn splat(motion: &Motion<V3<f64>>) -> Self {
        Self { angular: V3::splat(&motion.angular), linear: V3::splat(&motion.linear) }
    }

    #[inline(always)]
    pub fn lane(&self, i: usize) -> Motion {
        Motion { angular: self.angular.lane(i), linear: self.linear.lane(i) }
    }
}

impl Force {
    pub const ZERO: Self = Self { moment: ZERO, force: ZERO };
}

impl<V: Space> Force<V> {
    #[inline(always)]
    pub fn zero() -> Self {
        Self { moment: V::zero(), force: V::zero() }
    }

    #[inline(always)]
    pub fn plus_scaled(&self, other: &Self, scale: V::Scalar) -> Self {
        Self {
            moment: self.moment.plus_scaled(&other.moment, scale),
            force: self.force.plus_scaled(&other.force, scale),
        }
    }
}

impl<V: Space> Add for Force<V> {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self { moment: self.moment + other.moment, force: self.force + other.force }
    }
}

impl<V: Space> AddAssign for Force<V> {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl<T: Lane> Force<V3<T>> {
    /// Sum over the lanes.
    #[inline(always)]
    pub fn sum(&self) -> Force<V3<f64>> {
        Force { moment: self.moment.sum(), force: self.force.sum() }
    }
}

/// Inertia of a body, or of a whole subtree.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Composite<V: Space = Vector3<f64>> {
    /// Σ m.
    pub mass: V::Scalar,
    /// Σ m x.
    pub first: V,
    /// Σ m x xᵀ.
    pub second: V::Symmetric,
}

impl Composite {
    pub const ZERO: Self = Self { mass: 0.0, first: ZERO, second: ZERO_MATRIX };
}

impl<V: Space> Composite<V> {
    /// I u: the momentum of the bodies when they move as one by u. With x the position of a particle,
    /// its moment is Σ m x × (u + ω × x) = first × u + tr(second) ω − second ω.
    #[inline(always)]
    pub fn times(&self, u: &Motion<V>) -> Force<V> {
        Force {
            moment: u.angular.scaled(self.second.trace()) - self.second.times(&u.angular) + self.first.cross(&u.linear),
            force: u.angular.cross(&self.first).plus_scaled(&u.linear, self.mass),
        }
    }

    #[inline(always)]
    pub fn plus(&self, other: &Self) -> Self {
        Self { mass: self.mass + other.mass, first: self.first + other.first, second: self.second.plus(&other.second) }
    }
}

impl<T: Lane> Composite<V3<T>> {
    /// Sum over the lanes.
    #[inline(always)]
    pub fn sum(&self) -> Composite<V3<f64>> {
        Composite { mass: self.mass.sum(), first: self.first.sum(), second: self.second.sum() }
    }
}

/// Articulated inertia [[rotational, coupling], [couplingᵀ, translational]] and bias force.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Articulated<V: Space = Vector3<f64>> {
    pub rotational: V::Symmetric,
    pub coupling: V::Matrix,
    pub translational: V::Symmetric,
    pub bias: Force<V>,
}

impl Articulated {
    pub const ZERO: Self =
        Self { rotational: ZERO_MATRIX, coupling: ZERO_MATRIX, translational: ZERO_MATRIX, bias: Force::ZERO };
}

impl<V: Space> Articulated<V> {
    /// The force that gives the acceleration u, bias left out.
    #[inline(always)]
    pub fn times(&self, u: &Motion<V>) -> Force<V> {
        Force {
            moment: self.rotational.times(&u.angular) + self.coupling.times(&u.linear),
            force: self.coupling.transpose_times(&u.angular) + self.translational.times(&u.linear),
        }
    }

    #[inline(always)]
    pub fn plus(&self, other: &Self) -> Self {
        Self {
            rotational: self.rotational.plus(&other.rotational),
            coupling: self.coupling.plus(&other.coupling),
            translational: self.translational.plus(&other.translational),
            bias: self.bias + other.bias,
        }
    }
}

impl<T: Lane> Articulated<V3<T>> {
    /// Sum over the lanes.
    #[inline(always)]
    pub fn sum(&self) -> Articulated<V3<f64>> {
        Articulated {
            rotational: self.rotational.sum(),
            coupling: self.coupling.sum(),
            translational: self.translational.sum(),
            bias: self.bias.sum(),
        }
    }
}

/// Mass, centre of mass and rotational inertia of one body, in its own axes.
#[derive(Debug, Clone, Copy)]
pub(crate) struct BodyInertia<'a, V: Space> {
    pub mass: V::Scalar,
    pub center: &'a V,
    pub rotational: &'a V::Symmetric,
}

/// I a + v ×* I v − I g of one body, whose axes are turned by `rotation` and whose origin is at `position`.
#[inline(always)]
pub(crate) fn inertial_force<V: Space>(
    inertia: BodyInertia<'_, V>,
    (rotation, position): (&V::Matrix, &V),
    velocity: &Motion<V>,
    acceleration: &Motion<V>,
    gravity: &V,
) -> Force<V> {
    let c = *position + rotation.times(inertia.center);
    let spin = &velocity.angular;
    let force = (acceleration.at(&c) + spin.cross(&velocity.at(&c)) - *gravity).scaled(inertia.mass);
    // The rotational inertia is constant in the body's own axes.
    let w = rotation.transpose_times(spin);
    let turning = inertia.rotational.times(&rotation.transpose_times(&acceleration.angular))
        + w.cross(&inertia.rotational.times(&w));
    Force { moment: rotation.times(&turning) + c.cross(&force), force }
}
