//! What of a torso and its legs does not change: the links, and where they hang.

use nalgebra::{Matrix3, Vector3};

use crate::joint::Joint;
use crate::lanes::{Lane, M3, S3, V3};
use crate::spatial::{BodyInertia, Composite, Force, Motion, inertial_force};

/// Constants of the legs' k-th joints and links.
#[derive(Debug, Clone)]
pub(crate) struct LimbJoint<T> {
    /// Axes of the link above to this link's, at q = 0.
    pub fixed: M3<T>,
    /// The joint in the axes of the link above.
    pub offset: V3<T>,
    pub link: Link<T>,
    pub dof: [usize; 4],
    /// Places in the model's list of joints.
    pub place: [usize; 4],
    /// This link's axes to the URDF's, per leg.
    pub to_urdf: [Matrix3<f64>; 4],
}

/// Mass properties in link axes.
#[derive(Debug, Clone)]
pub(crate) struct Link<T> {
    pub mass: T,
    pub center: V3<T>,
    /// About the centre of mass.
    pub rotational: S3<T>,
    /// Σ m x and Σ m x xᵀ about the link's origin.
    pub first: V3<T>,
    pub second: S3<T>,
}

impl<T: Lane> Link<T> {
    fn build(f: impl Fn(usize) -> (f64, Vector3<f64>, Matrix3<f64>)) -> Self {
        let second = |i: usize| {
            let (mass, c, rotational) = f(i);
            Matrix3::identity() * (0.5 * rotational.trace()) - rotational + c * c.transpose() * mass
        };
        Self {
            mass: T::build(|i| f(i).0),
            center: V3::build(|i| f(i).1),
            rotational: S3::build(|i| f(i).2),
            first: V3::build(|i| f(i).1 * f(i).0),
            second: S3::build(second),
        }
    }

    /// The inertia about the reference point, in world axes.
    #[inline(always)]
    pub fn composite(&self, rotation: &M3<T>, position: &V3<T>) -> Composite<V3<T>> {
        let turned = rotation.times(&self.first);
        let half = turned.plus_scaled(position, self.mass * T::splat(0.5));
        Composite {
            mass: self.mass,
            first: turned.plus_scaled(position, self.mass),
            second: self.second.turned(rotation).plus_symmetric(position, &half),
        }
    }

    /// I a + v ×* I v − I g about the reference point.
    #[inline(always)]
    pub fn force(
        &self,
        place: (&M3<T>, &V3<T>),
        velocity: &Motion<V3<T>>,
        acceleration: &Motion<V3<T>>,
        gravity: &V3<T>,
    ) -> Force<V3<T>> {
        let own = BodyInertia { mass: self.mass, center: &self.center, rotational: &self.rotational };
        inertial_force(own, place, velocity, acceleration, gravity)
    }
}

/// A torso and its legs, T::WIDTH of them.
#[derive(Debug, Clone)]
pub(crate) struct LimbModel<T> {
    pub torso: Link<f64>,
    pub joints: [LimbJoint<T>; 3],
}

impl<T: Lane> LimbModel<T> {
    pub fn new(joints: &[Joint], torso: usize, legs: &[[usize; 3]]) -> Self {
        // Per leg and joint: axes whose z is the joint's axis, in URDF axes.
        let align = |place: usize| -> Matrix3<f64> {
            let z = joints[place].axis;
            let least = z.iamin();
            let x = Vector3::ith(least, 1.0).cross(&z).normalize();
            Matrix3::from_columns(&[x, z.cross(&x), z])
        };
        let above = |leg: usize, k: usize| match k {
            0 => Matrix3::identity(),
            _ => align(legs[leg][k - 1]),
        };
        let lanes =
            |f: &dyn Fn(usize) -> usize| -> [usize; 4] { std::array::from_fn(|leg| f(leg.min(legs.len() - 1))) };
        let joint = |k: usize| LimbJoint {
            fixed: M3::build(|leg| {
                let place = legs[leg][k];
                above(leg, k).transpose() * joints[place].rotation * align(place)
            }),
            offset: V3::build(|leg| above(leg, k).tr_mul(&joints[legs[leg][k]].translation)),
            link: Link::build(|leg| {
                let place = legs[leg][k];
                let (turn, body) = (align(place).transpose(), &joints[place].inertia);
                let rotational = turn * body.rotational_kg_m2 * turn.transpose();
                (body.mass_kg, turn * body.center_m, rotational)
            }),
            dof: lanes(&|leg| joints[legs[leg][k]].dof),
            place: lanes(&|leg| legs[leg][k]),
            to_urdf: std::array::from_fn(|leg| align(legs[leg.min(legs.len() - 1)][k]).transpose()),
        };
        let body = &joints[torso].inertia;
        Self {
            torso: Link::build(|_| (body.mass_kg, body.center_m, body.rotational_kg_m2)),
            joints: [joint(0), joint(1), joint(2)],
        }
    }

    /// The lane of the leg that a body belongs to; none for the torso.
    pub fn leg_of(&self, place: usize) -> Option<usize> {
        (0..T::WIDTH).find(|&leg| self.joints.iter().any(|joint| joint.place[leg] == place))
    }
}
