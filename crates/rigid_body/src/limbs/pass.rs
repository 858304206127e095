//! The forward pass: where torso and links are, how they move and accelerate.

use wide::f64x4;

use super::links::LimbModel;
use crate::lanes::{Lane, M3, V3};
use crate::spatial::Motion;

/// Coordinates of the torso's turning joints in the order of the chain: yaw, pitch, roll.
pub(crate) const TURNS: [usize; 3] = [5, 4, 3];

/// The torso's state: rotation, and of its turning joints yaw, pitch, roll in turn the axis, its rate,
/// and the angular velocity and acceleration below it. No gravity, no linear velocity.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Torso {
    pub rotation: M3<f64>,
    pub axis: [V3<f64>; 3],
    pub axis_rate: [V3<f64>; 3],
    pub spin: [V3<f64>; 3],
    pub spin_rate: [V3<f64>; 3],
    /// Linear acceleration of its origin.
    pub acceleration: V3<f64>,
}

/// The state of the legs' k-th links.
#[derive(Debug, Clone, Copy)]
pub(crate) struct LinkState<T> {
    pub rotation: M3<T>,
    pub position: V3<T>,
    pub axis: Motion<V3<T>>,
    pub axis_rate: Motion<V3<T>>,
    pub velocity: Motion<V3<T>>,
    pub acceleration: Motion<V3<T>>,
}

/// Workspace for a [`LimbModel`].
#[derive(Debug, Clone)]
pub(crate) struct LimbData<T> {
    pub torso: Torso,
    pub links: [LinkState<T>; 3],
    /// Position, velocity and acceleration of the torso's origin, taken out of the recursions.
    pub carrier: [V3<f64>; 3],
}

impl<T: Lane> LimbData<T> {
    pub fn new() -> Self {
        let zero = V3::new(0.0, 0.0, 0.0);
        let matrix = M3 { a: zero, b: zero, c: zero };
        let torso = Torso {
            rotation: matrix,
            axis: [zero; 3],
            axis_rate: [zero; 3],
            spin: [zero; 3],
            spin_rate: [zero; 3],
            acceleration: zero,
        };
        let link = LinkState {
            rotation: M3::splat(&matrix),
            position: V3::zero(),
            axis: Motion::zero(),
            axis_rate: Motion::zero(),
            velocity: Motion::zero(),
            acceleration: Motion::zero(),
        };
        Self { torso, links: [link; 3], carrier: [zero; 3] }
    }

    /// Placements, then with ORDER ≥ 1 velocities, then with ORDER ≥ 2 accelerations.
    #[inline(always)]
    pub fn forward<const ORDER: u8>(&mut self, model: &LimbModel<T>, q: &[f64], v: &[f64], a: &[f64]) {
        self.place_torso::<ORDER>(q, v, a);
        self.place_links::<ORDER>(model, q, v, a);
    }

    #[inline(always)]
    fn place_torso<const ORDER: u8>(&mut self, q: &[f64], v: &[f64], a: &[f64]) {
        let (sine, cosine) = f64x4::new([q[3], q[4], q[5], 0.0]).sin_cos();
        let ([sr, sp, sy, _], [cr, cp, cy, _]) = (sine.to_array(), cosine.to_array());
        let torso = &mut self.torso;
        // R_z(yaw) R_y(pitch) R_x(roll).
        torso.rotation = M3 {
            a: V3::new(cy * cp, sy * cp, -sp),
            b: V3::new(cy * sp * sr - sy * cr, sy * sp * sr + cy * cr, cp * sr),
            c: V3::new(cy * sp * cr + sy * sr, sy * sp * cr - cy * sr, cp * cr),
        };
        torso.axis = [V3::new(0.0, 0.0, 1.0), V3::new(-sy, cy, 0.0), torso.rotation.a];
        self.carrier[0] = V3::new(q[0], q[1], q[2]);
        if ORDER >= 1 {
            self.carrier[1] = V3::new(v[0], v[1], v[2]);
            let mut spin = V3::zero();
            for i in 0..3 {
                torso.axis_rate[i] = spin.cross(&torso.axis[i]);
                spin = spin.plus_scaled(&torso.axis[i], v[TURNS[i]]);
                torso.spin[i] = spin;
            }
        }
        if ORDER >= 2 {
            self.carrier[2] = V3::new(a[0], a[1], a[2]);
            torso.acceleration = self.carrier[2];
            torso.accelerate(v, [a[5], a[4], a[3]]);
        }
    }

    #[inline(always)]
    fn place_links<const ORDER: u8>(&mut self, model: &LimbModel<T>, q: &[f64], v: &[f64], a: &[f64]) {
        let torso = &self.torso;
        let mut rotation = M3::splat(&torso.rotation);
        let mut position = V3::zero();
        let (mut velocity, mut acceleration) = (Motion::zero(), Motion::zero());
        if ORDER >= 1 {
            velocity.angular = V3::splat(&torso.spin[2]);
        }
        if ORDER >= 2 {
            acceleration = Motion { angular: V3::splat(&torso.spin_rate[2]), linear: V3::splat(&torso.acceleration) };
        }
        for k in 0..3 {
            let (joint, link) = (&model.joints[k], &mut self.links[k]);
            let lanes = |x: &[f64]| T::build(|leg| x[joint.dof[leg]]);
            position += rotation.times(&joint.offset);
            let start = rotation.product(&joint.fixed);
            let (sine, cosine) = lanes(q).sin_cos();
            rotation = M3 {
                a: start.a.scaled(cosine).plus_scaled(&start.b, sine),
                b: start.b.scaled(cosine).plus_scaled(&start.a, -sine),
                c: start.c,
            };
            link.rotation = rotation;
            link.position = position;
            link.axis = Motion { angular: start.c, linear: position.cross(&start.c) };
            if ORDER >= 1 {
                let rate = lanes(v);
                link.axis_rate = velocity.cross(&link.axis);
                velocity = velocity.plus_scaled(&link.axis, rate);
                link.velocity = velocity;
                if ORDER >= 2 {
                    acceleration = acceleration.plus_scaled(&link.axis, lanes(a)).plus_scaled(&link.axis_rate, rate);
                    link.acceleration = acceleration;
                }
            }
        }
    }
}

impl Torso {
    /// Angular accelerations from those of yaw, pitch, roll.
    #[inline(always)]
    pub fn accelerate(&mut self, v: &[f64], turns: [f64; 3]) {
        let mut spin_rate = V3::zero();
        for i in 0..3 {
            spin_rate = spin_rate.plus_scaled(&self.axis[i], turns[i]).plus_scaled(&self.axis_rate[i], v[TURNS[i]]);
            self.spin_rate[i] = spin_rate;
        }
    }
}
