//! Forward dynamics: the articulated-body algorithm.

use nalgebra::Vector3;

use super::links::LimbModel;
use super::pass::{LimbData, TURNS, Torso};
use crate::lanes::{Lane, M3, S3, V3};
use crate::spatial::{Articulated, Composite, Force, Motion};

/// What the way back down the legs needs of the way up, for the legs' k-th joints.
#[derive(Clone, Copy)]
struct Drive<T> {
    /// U = I S.
    reaction: Force<V3<T>>,
    /// 1 / Sᵀ U.
    inverse: T,
    /// τ − Sᵀ bias.
    drive: T,
}

impl<T: Lane> LimbData<T> {
    /// a of M a + h = τ from the last forward pass, of order 1; leaves the accelerations of all links.
    #[inline(always)]
    pub fn forward_dynamics(
        &mut self,
        model: &LimbModel<T>,
        gravity: &Vector3<f64>,
        v: &[f64],
        tau: &[f64],
        acceleration: &mut [f64],
    ) {
        let gravity = V3::new(gravity.x, gravity.y, gravity.z);
        let (drives, legs) = self.gather_legs(model, &V3::splat(&gravity), v, tau);
        let torso = &mut self.torso;
        let spin = Motion::turn(torso.spin[2]);
        let inertia = model.torso.composite(&torso.rotation, &V3::zero());
        let own = articulated(&inertia, &spin, &gravity);
        let total = legs.map_or(own, |legs| own.plus(&legs.sum()));
        let spin_rate = torso.drive(&total, v, tau, acceleration);
        self.carrier[2] = self.torso.acceleration;
        self.drive_legs(model, &drives, &spin_rate, v, acceleration);
    }

    /// From the shanks up: what each joint needs, and the articulated inertia that the legs are to the torso.
    #[inline(always)]
    fn gather_legs(
        &self,
        model: &LimbModel<T>,
        fall: &V3<T>,
        v: &[f64],
        tau: &[f64],
    ) -> ([Drive<T>; 3], Option<Articulated<V3<T>>>) {
        let zero = T::splat(0.0);
        let mut drives = [Drive { reaction: Force::zero(), inverse: zero, drive: zero }; 3];
        let mut sum: Option<Articulated<V3<T>>> = None;
        for k in (0..3).rev() {
            let (joint, link) = (&model.joints[k], &self.links[k]);
            let lanes = |x: &[f64]| T::build(|leg| x[joint.dof[leg]]);
            let inertia = joint.link.composite(&link.rotation, &link.position);
            let own = articulated(&inertia, &link.velocity, fall);
            let art = sum.map_or(own, |below| own.plus(&below));
            let u = art.times(&link.axis);
            let inverse = link.axis.dot(&u).inverse();
            let drive = lanes(tau) - link.axis.dot(&art.bias);
            drives[k] = Drive { reaction: u, inverse, drive };
            let scaled = u.moment.scaled(inverse);
            let mut passed = Articulated {
                rotational: art.rotational.minus_square(&u.moment, inverse),
                coupling: M3 {
                    a: art.coupling.a.plus_scaled(&scaled, -u.force.x),
                    b: art.coupling.b.plus_scaled(&scaled, -u.force.y),
                    c: art.coupling.c.plus_scaled(&scaled, -u.force.z),
                },
                translational: art.translational.minus_square(&u.force, inverse),
                bias: art.bias,
            };
            let drift = passed.times(&Motion::zero().plus_scaled(&link.axis_rate, lanes(v)));
            passed.bias = (passed.bias + drift).plus_scaled(&u, inverse * drive);
            sum = Some(passed);
        }
        (drives, sum)
    }

    /// From the hips down: the joints' accelerations, given the torso's.
    #[inline(always)]
    fn drive_legs(
        &mut self,
        model: &LimbModel<T>,
        drives: &[Drive<T>; 3],
        spin_rate: &V3<f64>,
        v: &[f64],
        acceleration: &mut [f64],
    ) {
        let mut above = Motion { angular: V3::splat(spin_rate), linear: V3::splat(&self.torso.acceleration) };
        for k in 0..3 {
            let (joint, link) = (&model.joints[k], &mut self.links[k]);
            let Drive { reaction, inverse, drive } = &drives[k];
            let rate = T::build(|leg| v[joint.dof[leg]]);
            above = above.plus_scaled(&link.axis_rate, rate);
            let found = (*drive - above.dot(reaction)) * *inverse;
            above = above.plus_scaled(&link.axis, found);
            link.acceleration = above;
            for leg in 0..T::WIDTH {
                acceleration[joint.dof[leg]] = found.lane(leg);
            }
        }
    }
}

impl Torso {
    /// The base's accelerations, given the whole robot's articulated inertia; returns the angular one.
    #[inline(always)]
    fn drive(&mut self, total: &Articulated<V3<f64>>, v: &[f64], tau: &[f64], acceleration: &mut [f64]) -> V3<f64> {
        // The turning joints' torques as a moment n: axis_i · n = τ_i.
        let [yaw, pitch, roll] = self.axis;
        let dual = [pitch.cross(&roll), roll.cross(&yaw), yaw.cross(&pitch)];
        let volume = 1.0 / yaw.dot(&dual[0]);
        let mut wrench = Force { moment: V3::zero(), force: V3::new(tau[0], tau[1], tau[2]) - total.bias.force };
        for i in 0..3 {
            wrench.moment = wrench.moment.plus_scaled(&dual[i], tau[TURNS[i]] * volume);
        }
        wrench.moment = wrench.moment - total.bias.moment;
        let (spin_rate, linear) = total.solve(&wrench);
        self.acceleration = linear;
        let mut turning = spin_rate;
        for i in 0..3 {
            turning = turning.plus_scaled(&self.axis_rate[i], -v[TURNS[i]]);
        }
        let turns: [f64; 3] = std::array::from_fn(|i| dual[i].dot(&turning) * volume);
        self.accelerate(v, turns);
        acceleration[..3].copy_from_slice(&[linear.x, linear.y, linear.z]);
        for i in 0..3 {
            acceleration[TURNS[i]] = turns[i];
        }
        spin_rate
    }
}

#[inline(always)]
fn articulated<T: Lane>(inertia: &Composite<V3<T>>, velocity: &Motion<V3<T>>, gravity: &V3<T>) -> Articulated<V3<T>> {
    let (s, f, zero) = (&inertia.second, &inertia.first, T::splat(0.0));
    let gyroscopic = velocity.cross_force(&inertia.times(velocity));
    Articulated {
        rotational: S3 { xx: s.yy + s.zz, xy: -s.xy, xz: -s.xz, yy: s.xx + s.zz, yz: -s.yz, zz: s.xx + s.yy },
        coupling: M3 { a: V3::new(zero, f.z, -f.y), b: V3::new(-f.z, zero, f.x), c: V3::new(f.y, -f.x, zero) },
        translational: S3 { xx: inertia.mass, xy: zero, xz: zero, yy: inertia.mass, yz: zero, zz: inertia.mass },
        bias: Force {
            moment: gyroscopic.moment - f.cross(gravity),
            force: gyroscopic.force.plus_scaled(gravity, -inertia.mass),
        },
    }
}

impl Articulated<V3<f64>> {
    /// The acceleration (angular, linear) that a wrench gives, bias left out: by Cholesky's
    /// factorisation of the 6 × 6 inertia.
    #[inline(always)]
    fn solve(&self, wrench: &Force<V3<f64>>) -> (V3<f64>, V3<f64>) {
        let (r, c, t) = (&self.rotational, &self.coupling, &self.translational);
        let mut l = [
            [t.xx, 0.0, 0.0, 0.0, 0.0, 0.0],
            [t.xy, t.yy, 0.0, 0.0, 0.0, 0.0],
            [t.xz, t.yz, t.zz, 0.0, 0.0, 0.0],
            [c.a.x, c.b.x, c.c.x, r.xx, 0.0, 0.0],
            [c.a.y, c.b.y, c.c.y, r.xy, r.yy, 0.0],
            [c.a.z, c.b.z, c.c.z, r.xz, r.yz, r.zz],
        ];
        let (f, m) = (&wrench.force, &wrench.moment);
        let mut x = [f.x, f.y, f.z, m.x, m.y, m.z];
        let mut inverse = [0.0; 6];
        for j in 0..6 {
            for k in 0..j {
                l[j][j] -= l[j][k] * l[j][k];
            }
            inverse[j] = 1.0 / l[j][j].sqrt();
            for i in j + 1..6 {
                for k in 0..j {
                    l[i][j] -= l[i][k] * l[j][k];
                }
                l[i][j] *= inverse[j];
            }
            // Forward substitution on the way.
            for k in 0..j {
                x[j] -= l[j][k] * x[k];
            }
            x[j] *= inverse[j];
        }
        for j in (0..6).rev() {
            for i in j + 1..6 {
                x[j] -= l[i][j] * x[i];
            }
            x[j] *= inverse[j];
        }
        (V3::new(x[3], x[4], x[5]), V3::new(x[0], x[1], x[2]))
    }
}
