//! The algorithms for a floating torso with two or four legs of three revolute joints.
//!
//! The recursions are those of the general tree (see [`crate::dynamics`], [`crate::derivatives`],
//! [`crate::forward`]; the tests hold the two against each other), with three things taken from the
//! structure:
//!
//! - all legs are computed at once, one to a lane of a vector register;
//! - body axes are turned so that every joint turns about its z axis;
//! - the reference moves with the torso (the laws of motion do not mind), so the torso's linear
//!   velocity is zero and the three sliding joints drop out.

use nalgebra::{Matrix3, Vector3};
use wide::{f64x2, f64x4};

use crate::data::Body;
use crate::lanes::{Lane, M3, S3, V3};
use crate::model::{Joint, JointKind};
use crate::spatial::Motion as OuterMotion;

/// Coordinates of the torso's turning joints in the order of the chain: yaw, pitch, roll.
const TURNS: [usize; 3] = [5, 4, 3];

/// Constants of the legs' k-th joints and links.
#[derive(Debug, Clone)]
struct LimbJoint<T> {
    /// Axes of the link above to this link's, at q = 0.
    fixed: M3<T>,
    /// The joint in the axes of the link above.
    offset: V3<T>,
    link: Link<T>,
    dof: [usize; 4],
    /// Places in the model's list of joints.
    place: [usize; 4],
    /// This link's axes to the URDF's, per leg.
    to_urdf: [Matrix3<f64>; 4],
}

/// Mass properties in link axes.
#[derive(Debug, Clone)]
struct Link<T> {
    mass: T,
    center: V3<T>,
    /// About the centre of mass.
    rotational: S3<T>,
    /// Σ m x and Σ m x xᵀ about the link's origin.
    first: V3<T>,
    second: S3<T>,
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
}

/// A torso and its legs, T::WIDTH of them.
#[derive(Debug, Clone)]
pub(crate) struct LimbModel<T> {
    torso: Link<f64>,
    joints: [LimbJoint<T>; 3],
}

/// The structure, where a model has it.
#[derive(Debug, Clone)]
pub(crate) enum Limbs {
    Two(Box<LimbModel<f64x2>>),
    Four(Box<LimbModel<f64x4>>),
}

impl Limbs {
    /// The torso and legs of a floating-base model, if that is what it consists of.
    pub fn find(joints: &[Joint], torso: Option<usize>) -> Option<Self> {
        let torso = torso.filter(|&torso| torso == 5)?;
        let children =
            |of: usize| -> Vec<usize> { (0..joints.len()).filter(|&i| joints[i].parent == Some(of)).collect() };
        let mut legs = Vec::new();
        for hip in children(torso) {
            let [pitch] = children(hip)[..] else { return None };
            let [knee] = children(pitch)[..] else { return None };
            if !children(knee).is_empty() {
                return None;
            }
            legs.push([hip, pitch, knee]);
        }
        if joints[6..].iter().any(|joint| joint.kind != JointKind::Revolute) {
            return None;
        }
        match legs.len() {
            2 => Some(Self::Two(Box::new(LimbModel::new(joints, torso, &legs)))),
            4 => Some(Self::Four(Box::new(LimbModel::new(joints, torso, &legs)))),
            _ => None,
        }
    }
}

impl<T: Lane> LimbModel<T> {
    fn new(joints: &[Joint], torso: usize, legs: &[[usize; 3]]) -> Self {
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
}

#[derive(Debug, Clone, Copy)]
struct Motion<T> {
    angular: V3<T>,
    linear: V3<T>,
}

#[derive(Debug, Clone, Copy)]
struct Force<T> {
    moment: V3<T>,
    force: V3<T>,
}

impl<T: Lane> Motion<T> {
    #[inline(always)]
    fn zero() -> Self {
        Self { angular: V3::zero(), linear: V3::zero() }
    }

    #[inline(always)]
    fn cross(&self, o: &Self) -> Self {
        Self {
            angular: self.angular.cross(&o.angular),
            linear: self.angular.cross(&o.linear) + self.linear.cross(&o.angular),
        }
    }

    #[inline(always)]
    fn cross_force(&self, f: &Force<T>) -> Force<T> {
        Force {
            moment: self.angular.cross(&f.moment) + self.linear.cross(&f.force),
            force: self.angular.cross(&f.force),
        }
    }

    #[inline(always)]
    fn dot(&self, f: &Force<T>) -> T {
        self.angular.dot(&f.moment) + self.linear.dot(&f.force)
    }

    #[inline(always)]
    fn plus_scaled(&self, o: &Self, s: T) -> Self {
        Self { angular: self.angular.plus_scaled(&o.angular, s), linear: self.linear.plus_scaled(&o.linear, s) }
    }
}

impl<T: Lane> Force<T> {
    #[inline(always)]
    fn plus(&self, o: &Self) -> Self {
        Self { moment: self.moment + o.moment, force: self.force + o.force }
    }

    #[inline(always)]
    fn plus_scaled(&self, o: &Self, s: T) -> Self {
        Self { moment: self.moment.plus_scaled(&o.moment, s), force: self.force.plus_scaled(&o.force, s) }
    }

    #[inline(always)]
    fn sum(&self) -> Force<f64> {
        Force { moment: self.moment.sum(), force: self.force.sum() }
    }
}

/// Inertia about the reference point in world axes, as [`crate::spatial::Composite`].
#[derive(Debug, Clone, Copy)]
struct Composite<T> {
    mass: T,
    first: V3<T>,
    second: S3<T>,
}

impl<T: Lane> Composite<T> {
    #[inline(always)]
    fn of(link: &Link<T>, rotation: &M3<T>, position: &V3<T>) -> Self {
        let turned = rotation.times(&link.first);
        let half = turned.plus_scaled(position, link.mass * T::splat(0.5));
        Self {
            mass: link.mass,
            first: turned.plus_scaled(position, link.mass),
            second: link.second.turned(rotation).plus_symmetric(position, &half),
        }
    }

    #[inline(always)]
    fn times(&self, u: &Motion<T>) -> Force<T> {
        Force {
            moment: u.angular.scaled(self.second.trace()) - self.second.times(&u.angular) + self.first.cross(&u.linear),
            force: u.angular.cross(&self.first).plus_scaled(&u.linear, self.mass),
        }
    }

    #[inline(always)]
    fn plus(&self, o: &Self) -> Self {
        Self { mass: self.mass + o.mass, first: self.first + o.first, second: self.second.plus(&o.second) }
    }

    #[inline(always)]
    fn sum(&self) -> Composite<f64> {
        Composite { mass: self.mass.sum(), first: self.first.sum(), second: self.second.sum() }
    }
}

/// The torso's state: rotation, and of its turning joints yaw, pitch, roll in turn the axis, its rate,
/// and the angular velocity and acceleration below it. No gravity, no linear velocity.
#[derive(Debug, Clone, Copy)]
struct Torso {
    rotation: M3<f64>,
    axis: [V3<f64>; 3],
    axis_rate: [V3<f64>; 3],
    spin: [V3<f64>; 3],
    spin_rate: [V3<f64>; 3],
    /// Linear acceleration of its origin.
    acceleration: V3<f64>,
}

/// The state of the legs' k-th links.
#[derive(Debug, Clone, Copy)]
struct LinkState<T> {
    rotation: M3<T>,
    position: V3<T>,
    axis: Motion<T>,
    axis_rate: Motion<T>,
    velocity: Motion<T>,
    acceleration: Motion<T>,
}

/// Workspace for a [`LimbModel`].
#[derive(Debug, Clone)]
pub(crate) struct LimbData<T> {
    torso: Torso,
    links: [LinkState<T>; 3],
    /// Position, velocity and acceleration of the torso's origin, taken out of the recursions.
    carrier: [V3<f64>; 3],
}

/// The workspace that belongs to [`Limbs`].
#[derive(Debug, Clone)]
pub(crate) enum LimbWork {
    Two(Box<LimbData<f64x2>>),
    Four(Box<LimbData<f64x4>>),
}

impl LimbWork {
    pub fn new(limbs: &Limbs) -> Self {
        match limbs {
            Limbs::Two(_) => Self::Two(Box::new(LimbData::new())),
            Limbs::Four(_) => Self::Four(Box::new(LimbData::new())),
        }
    }
}

/// Runs `$body` with `$m` and `$d` bound to the model's and workspace's halves of one width.
macro_rules! with_limbs {
    ($limbs:expr, $work:expr, |$m:ident, $d:ident| $body:expr) => {
        match ($limbs, $work) {
            ($crate::limbs::Limbs::Two($m), $crate::limbs::LimbWork::Two($d)) => $body,
            ($crate::limbs::Limbs::Four($m), $crate::limbs::LimbWork::Four($d)) => $body,
            _ => panic!("this Data was made for another model"),
        }
    };
}
pub(crate) use with_limbs;

impl<T: Lane> LimbData<T> {
    fn new() -> Self {
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

    /// τ = M a + h from the last forward pass, of order 2.
    #[inline(always)]
    pub fn inverse_dynamics(&self, model: &LimbModel<T>, gravity: &Vector3<f64>, tau: &mut [f64]) {
        let gravity = V3::new(gravity.x, gravity.y, gravity.z);
        let fall = V3::splat(&gravity);
        let mut sum: Option<Force<T>> = None;
        for k in (0..3).rev() {
            let (joint, link) = (&model.joints[k], &self.links[k]);
            let own =
                link_force(&joint.link, &link.rotation, &link.position, &link.velocity, &link.acceleration, &fall);
            let force = sum.map_or(own, |below| own.plus(&below));
            let torque = link.axis.dot(&force);
            for leg in 0..T::WIDTH {
                tau[joint.dof[leg]] = torque.lane(leg);
            }
            sum = Some(force);
        }
        let torso = &self.torso;
        let own = link_force(
            &model.torso,
            &torso.rotation,
            &V3::zero(),
            &Motion { angular: torso.spin[2], linear: V3::zero() },
            &Motion { angular: torso.spin_rate[2], linear: torso.acceleration },
            &gravity,
        );
        let total = sum.map_or(own, |legs| own.plus(&legs.sum()));
        tau[..3].copy_from_slice(&[total.force.x, total.force.y, total.force.z]);
        for i in 0..3 {
            tau[TURNS[i]] = torso.axis[i].dot(&total.moment);
        }
    }

    /// M(q) from the last forward pass; `mass` is column-major, n × n. Entries between legs are zero
    /// and not written.
    #[inline(always)]
    pub fn mass_matrix(&self, model: &LimbModel<T>, mass: &mut [f64]) {
        let n = 6 + 3 * T::WIDTH;
        let torso = &self.torso;
        let axes = torso.axis.map(|axis| V3::splat(&axis));
        let mut sum: Option<Composite<T>> = None;
        for k in (0..3).rev() {
            let (joint, link) = (&model.joints[k], &self.links[k]);
            let own = Composite::of(&joint.link, &link.rotation, &link.position);
            let composite = sum.map_or(own, |below| own.plus(&below));
            let momentum = composite.times(&link.axis);
            for j in 0..=k {
                let entry = self.links[j].axis.dot(&momentum);
                for leg in 0..T::WIDTH {
                    let (row, column) = (joint.dof[leg], model.joints[j].dof[leg]);
                    mass[row + n * column] = entry.lane(leg);
                    mass[column + n * row] = entry.lane(leg);
                }
            }
            let base = base_column(&axes, &momentum);
            for leg in 0..T::WIDTH {
                let dof = joint.dof[leg];
                for (row, entry) in base.iter().enumerate() {
                    mass[row + n * dof] = entry.lane(leg);
                    mass[dof + n * row] = entry.lane(leg);
                }
            }
            sum = Some(composite);
        }
        let own = Composite::of(&model.torso, &torso.rotation, &V3::zero());
        let total = sum.map_or(own, |legs| own.plus(&legs.sum()));
        torso_mass(torso, &total, mass, n);
    }

    /// τ and its derivatives from the last forward pass, of order 2, without point forces. The
    /// matrices are column-major, n × n; entries that are zero by structure are not written.
    #[inline(always)]
    pub fn inverse_dynamics_derivatives(
        &self,
        model: &LimbModel<T>,
        gravity: &Vector3<f64>,
        tau: &mut [f64],
        mass: &mut [f64],
        dtau_dq: &mut [f64],
        dtau_dv: &mut [f64],
    ) {
        let n = 6 + 3 * T::WIDTH;
        let torso = &self.torso;
        let two = T::splat(2.0);
        let lifted = torso.acceleration - V3::new(gravity.x, gravity.y, gravity.z);
        // S̈ of yaw, pitch, roll.
        let mut axis_rate_2 = [Motion::<f64>::zero(); 3];
        for i in 0..3 {
            let (spin, spin_rate) = match i {
                0 => (V3::zero(), V3::zero()),
                _ => (torso.spin[i - 1], torso.spin_rate[i - 1]),
            };
            axis_rate_2[i] = Motion {
                angular: spin_rate.cross(&torso.axis[i]) + spin.cross(&torso.axis_rate[i]),
                linear: lifted.cross(&torso.axis[i]),
            };
        }
        let axes = torso.axis.map(|axis| V3::splat(&axis));
        let rates = torso.axis_rate.map(|rate| V3::splat(&rate));
        let rates_2 = axis_rate_2.map(|r| Motion { angular: V3::splat(&r.angular), linear: V3::splat(&r.linear) });

        let fall = V3::splat(&V3::new(gravity.x, gravity.y, gravity.z));
        let mut link_rates_2 = [Motion::<T>::zero(); 3];
        for k in 0..3 {
            let (velocity, mut acceleration) = match k {
                0 => (
                    Motion { angular: V3::splat(&torso.spin[2]), linear: V3::zero() },
                    Motion { angular: V3::splat(&torso.spin_rate[2]), linear: V3::splat(&torso.acceleration) },
                ),
                _ => (self.links[k - 1].velocity, self.links[k - 1].acceleration),
            };
            acceleration.linear = acceleration.linear - fall;
            let carried = acceleration.cross(&self.links[k].axis);
            let turned = velocity.cross(&self.links[k].axis_rate);
            link_rates_2[k] =
                Motion { angular: carried.angular + turned.angular, linear: carried.linear + turned.linear };
        }

        let mut sum: Option<Subtree<T>> = None;
        for k in (0..3).rev() {
            let (joint, link) = (&model.joints[k], &self.links[k]);
            let mut lifted = link.acceleration;
            lifted.linear = lifted.linear - fall;
            let inertia = Composite::of(&joint.link, &link.rotation, &link.position);
            let own = Subtree::of(inertia, &link.velocity, &lifted);
            let subtree = sum.map_or(own, |below| own.plus(&below));
            let column = subtree.column(&link.axis, &link.axis_rate, &link_rates_2[k]);
            let torque = link.axis.dot(&subtree.force);
            for leg in 0..T::WIDTH {
                tau[joint.dof[leg]] = torque.lane(leg);
            }
            for j in 0..=k {
                let up = &self.links[j];
                let m = up.axis.dot(&column.momentum);
                let up_q = up.axis.dot(&column.q);
                let up_v = up.axis.dot(&column.v);
                let down_q = up.axis_rate.angular.dot(&column.row) + link_rates_2[j].dot(&column.momentum);
                let down_v = up.axis.angular.dot(&column.row).plus_product(up.axis_rate.dot(&column.momentum), two);
                for leg in 0..T::WIDTH {
                    let (here, above) = (joint.dof[leg], model.joints[j].dof[leg]);
                    mass[here + n * above] = m.lane(leg);
                    mass[above + n * here] = m.lane(leg);
                    dtau_dq[above + n * here] = up_q.lane(leg);
                    dtau_dv[above + n * here] = up_v.lane(leg);
                    dtau_dq[here + n * above] = down_q.lane(leg);
                    dtau_dv[here + n * above] = down_v.lane(leg);
                }
            }
            let base_m = base_column(&axes, &column.momentum);
            let base_q = base_column(&axes, &column.q);
            let base_v = base_column(&axes, &column.v);
            for leg in 0..T::WIDTH {
                let dof = joint.dof[leg];
                for row in 0..6 {
                    mass[row + n * dof] = base_m[row].lane(leg);
                    mass[dof + n * row] = base_m[row].lane(leg);
                    dtau_dq[row + n * dof] = base_q[row].lane(leg);
                    dtau_dv[row + n * dof] = base_v[row].lane(leg);
                }
            }
            for i in 0..3 {
                let down_q = rates[i].dot(&column.row) + rates_2[i].dot(&column.momentum);
                let down_v = axes[i].dot(&column.row).plus_product(rates[i].dot(&column.momentum.moment), two);
                for leg in 0..T::WIDTH {
                    dtau_dq[joint.dof[leg] + n * TURNS[i]] = down_q.lane(leg);
                    dtau_dv[joint.dof[leg] + n * TURNS[i]] = down_v.lane(leg);
                }
            }
            sum = Some(subtree);
        }

        let spin = Motion { angular: torso.spin[2], linear: V3::zero() };
        let inertia = Composite::of(&model.torso, &torso.rotation, &V3::zero());
        let lifted = Motion { angular: torso.spin_rate[2], linear: lifted };
        let own = Subtree::of(inertia, &spin, &lifted);
        let total = sum.map_or(own, |legs| own.plus(&legs.sum()));
        tau[..3].copy_from_slice(&[total.force.force.x, total.force.force.y, total.force.force.z]);
        for i in 0..3 {
            let axis = Motion { angular: torso.axis[i], linear: V3::zero() };
            let rate = Motion { angular: torso.axis_rate[i], linear: V3::zero() };
            let column = total.column(&axis, &rate, &axis_rate_2[i]);
            let dof = TURNS[i];
            tau[dof] = axis.dot(&total.force);
            for j in 0..=i {
                let above = TURNS[j];
                dtau_dq[above + n * dof] = torso.axis[j].dot(&column.q.moment);
                dtau_dv[above + n * dof] = torso.axis[j].dot(&column.v.moment);
                dtau_dq[dof + n * above] = torso.axis_rate[j].dot(&column.row) + axis_rate_2[j].dot(&column.momentum);
                dtau_dv[dof + n * above] =
                    torso.axis[j].dot(&column.row) + 2.0 * torso.axis_rate[j].dot(&column.momentum.moment);
            }
            let (q, v) = (&column.q.force, &column.v.force);
            dtau_dq[n * dof..n * dof + 3].copy_from_slice(&[q.x, q.y, q.z]);
            dtau_dv[n * dof..n * dof + 3].copy_from_slice(&[v.x, v.y, v.z]);
        }
        torso_mass(torso, &total.inertia, mass, n);
    }

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
        let fall = V3::splat(&gravity);
        let zero = Force { moment: V3::zero(), force: V3::zero() };
        let mut reaction = [zero; 3];
        let mut inverse = [T::splat(0.0); 3];
        let mut drive = [T::splat(0.0); 3];
        let mut sum: Option<Articulated<T>> = None;
        for k in (0..3).rev() {
            let (joint, link) = (&model.joints[k], &self.links[k]);
            let lanes = |x: &[f64]| T::build(|leg| x[joint.dof[leg]]);
            let inertia = Composite::of(&joint.link, &link.rotation, &link.position);
            let own = Articulated::of(&inertia, &link.velocity, &fall);
            let art = sum.map_or(own, |below| own.plus(&below));
            let u = art.times(&link.axis);
            reaction[k] = u;
            inverse[k] = link.axis.dot(&u).inverse();
            drive[k] = lanes(tau) - link.axis.dot(&art.bias);
            let scaled = u.moment.scaled(inverse[k]);
            let mut passed = Articulated {
                rotational: art.rotational.minus_square(&u.moment, inverse[k]),
                coupling: M3 {
                    a: art.coupling.a.plus_scaled(&scaled, -u.force.x),
                    b: art.coupling.b.plus_scaled(&scaled, -u.force.y),
                    c: art.coupling.c.plus_scaled(&scaled, -u.force.z),
                },
                translational: art.translational.minus_square(&u.force, inverse[k]),
                bias: art.bias,
            };
            let drift = passed.times(&Motion::zero().plus_scaled(&link.axis_rate, lanes(v)));
            passed.bias = passed.bias.plus(&drift).plus_scaled(&u, inverse[k] * drive[k]);
            sum = Some(passed);
        }
        let torso = &mut self.torso;
        let spin = Motion { angular: torso.spin[2], linear: V3::zero() };
        let inertia = Composite::of(&model.torso, &torso.rotation, &V3::zero());
        let own = Articulated::of(&inertia, &spin, &gravity);
        let total = sum.map_or(own, |legs| own.plus(&legs.sum()));

        // The turning joints' torques as a moment n: axis_i · n = τ_i.
        let [yaw, pitch, roll] = torso.axis;
        let dual = [pitch.cross(&roll), roll.cross(&yaw), yaw.cross(&pitch)];
        let volume = 1.0 / yaw.dot(&dual[0]);
        let mut wrench = Force { moment: V3::zero(), force: V3::new(tau[0], tau[1], tau[2]) - total.bias.force };
        for i in 0..3 {
            wrench.moment = wrench.moment.plus_scaled(&dual[i], tau[TURNS[i]] * volume);
        }
        wrench.moment = wrench.moment - total.bias.moment;
        let (spin_rate, linear) = total.solve(&wrench);
        torso.acceleration = linear;
        self.carrier[2] = linear;
        let mut turning = spin_rate;
        for i in 0..3 {
            turning = turning.plus_scaled(&torso.axis_rate[i], -v[TURNS[i]]);
        }
        let turns: [f64; 3] = std::array::from_fn(|i| dual[i].dot(&turning) * volume);
        torso.accelerate(v, turns);
        acceleration[..3].copy_from_slice(&[linear.x, linear.y, linear.z]);
        for i in 0..3 {
            acceleration[TURNS[i]] = turns[i];
        }

        let mut above = Motion { angular: V3::splat(&spin_rate), linear: V3::splat(&torso.acceleration) };
        for k in 0..3 {
            let (joint, link) = (&model.joints[k], &mut self.links[k]);
            let rate = T::build(|leg| v[joint.dof[leg]]);
            above = above.plus_scaled(&link.axis_rate, rate);
            let found = (drive[k] - above.dot(&reaction[k])) * inverse[k];
            above = above.plus_scaled(&link.axis, found);
            link.acceleration = above;
            for leg in 0..T::WIDTH {
                acceleration[joint.dof[leg]] = found.lane(leg);
            }
        }
    }

    /// Rotation of a body's URDF axes, and its position in the world.
    pub fn pose(&self, model: &LimbModel<T>, place: usize) -> (Matrix3<f64>, Vector3<f64>) {
        let origin = self.carrier[0].lane(0);
        let Some(leg) = model.leg_of(place) else {
            return (self.torso.rotation.lane(0), origin);
        };
        let k = (0..3).find(|&k| model.joints[k].place[leg] == place);
        let k = k.expect("the leg was found by this joint");
        let link = &self.links[k];
        let rotation = link.rotation.lane(leg) * model.joints[k].to_urdf[leg];
        (rotation, origin + link.position.lane(leg))
    }

    /// Writes what the last forward pass found in the form of the general tree: the torso's chain and
    /// the leg of lane `leg`.
    pub fn export(&self, model: &LimbModel<T>, leg: usize, bodies: &mut [Body], origin: &mut Vector3<f64>) {
        let outer = |v: &V3<f64>| Vector3::new(v.x, v.y, v.z);
        let torso = &self.torso;
        let [position, velocity, acceleration] = self.carrier.map(|v| outer(&v));
        *origin = position;
        // Seen from a point at rest, velocities gain the carrier's, and spatial accelerations lose
        // ω × that velocity.
        let fill = |body: &mut Body, axis: OuterMotion, v: OuterMotion, a: OuterMotion| {
            body.axis = axis;
            body.velocity = OuterMotion { linear: v.linear + velocity, ..v };
            body.acceleration = OuterMotion { linear: a.linear - v.angular.cross(&velocity), ..a };
        };
        for i in 0..3 {
            // The sliding joints: the motion so far of the chain.
            let body = &mut bodies[i];
            let so_far = |v: &Vector3<f64>| Vector3::from_fn(|k, _| if k <= i { v[k] } else { 0.0 });
            body.position = Vector3::zeros();
            body.axis = OuterMotion { linear: Vector3::ith(i, 1.0), ..OuterMotion::ZERO };
            body.velocity = OuterMotion { linear: so_far(&velocity), ..OuterMotion::ZERO };
            body.acceleration = OuterMotion { linear: so_far(&acceleration), ..OuterMotion::ZERO };
        }
        for i in 0..3 {
            let body = &mut bodies[3 + i];
            body.position = Vector3::zeros();
            let turning = |v: &V3<f64>| OuterMotion { angular: outer(v), ..OuterMotion::ZERO };
            let a = OuterMotion { angular: outer(&torso.spin_rate[i]), linear: acceleration };
            fill(body, turning(&torso.axis[i]), turning(&torso.spin[i]), a);
        }
        bodies[5].rotation = torso.rotation.lane(0);
        for k in 0..3 {
            let (joint, link) = (&model.joints[k], &self.links[k]);
            let body = &mut bodies[joint.place[leg]];
            let motion = |m: &Motion<T>| OuterMotion { angular: m.angular.lane(leg), linear: m.linear.lane(leg) };
            body.rotation = link.rotation.lane(leg) * joint.to_urdf[leg];
            body.position = link.position.lane(leg);
            let (v, a) = (motion(&link.velocity), motion(&link.acceleration));
            fill(body, motion(&link.axis), v, a);
        }
    }
}

impl<T: Lane> LimbModel<T> {
    /// The lane of the leg that a body belongs to; none for the torso.
    pub fn leg_of(&self, place: usize) -> Option<usize> {
        (0..T::WIDTH).find(|&leg| self.joints.iter().any(|joint| joint.place[leg] == place))
    }
}

impl Torso {
    /// Angular accelerations from those of yaw, pitch, roll.
    #[inline(always)]
    fn accelerate(&mut self, v: &[f64], turns: [f64; 3]) {
        let mut spin_rate = V3::zero();
        for i in 0..3 {
            spin_rate = spin_rate.plus_scaled(&self.axis[i], turns[i]).plus_scaled(&self.axis_rate[i], v[TURNS[i]]);
            self.spin_rate[i] = spin_rate;
        }
    }
}

/// I a + v ×* I v − I g of one link about the reference point.
#[inline(always)]
fn link_force<T: Lane>(
    link: &Link<T>,
    rotation: &M3<T>,
    position: &V3<T>,
    velocity: &Motion<T>,
    acceleration: &Motion<T>,
    gravity: &V3<T>,
) -> Force<T> {
    let c = *position + rotation.times(&link.center);
    let spin = &velocity.angular;
    let speed = velocity.linear + spin.cross(&c);
    let lifted = acceleration.linear + acceleration.angular.cross(&c) + spin.cross(&speed) - *gravity;
    let force = lifted.scaled(link.mass);
    let w = rotation.transpose_times(spin);
    let turning =
        link.rotational.times(&rotation.transpose_times(&acceleration.angular)) + w.cross(&link.rotational.times(&w));
    Force { moment: rotation.times(&turning) + c.cross(&force), force }
}

/// The torso's six rows of a column, given the generalised direction's force.
#[inline(always)]
fn base_column<T: Lane>(axes: &[V3<T>; 3], f: &Force<T>) -> [T; 6] {
    let [yaw, pitch, roll] = axes;
    let turned = [roll.dot(&f.moment), pitch.dot(&f.moment), yaw.dot(&f.moment)];
    [f.force.x, f.force.y, f.force.z, turned[0], turned[1], turned[2]]
}

/// The torso's 6 × 6 block of the mass matrix, given the whole robot's inertia.
#[inline(always)]
fn torso_mass(torso: &Torso, total: &Composite<f64>, mass: &mut [f64], n: usize) {
    for i in 0..3 {
        mass[i + n * i] = total.mass;
        let axis = Motion { angular: torso.axis[i], linear: V3::zero() };
        let momentum = total.times(&axis);
        let dof = TURNS[i];
        for (row, entry) in [momentum.force.x, momentum.force.y, momentum.force.z].iter().enumerate() {
            mass[row + n * dof] = *entry;
            mass[dof + n * row] = *entry;
        }
        for j in 0..=i {
            let entry = torso.axis[j].dot(&momentum.moment);
            mass[dof + n * TURNS[j]] = entry;
            mass[TURNS[j] + n * dof] = entry;
        }
    }
}

/// Sums over a link and all below it that the derivatives need: see [`crate::derivatives`].
#[derive(Debug, Clone, Copy)]
struct Subtree<T> {
    inertia: Composite<T>,
    force: Force<T>,
    /// Σ m ṗ pᵀ.
    moment_rate: M3<T>,
    /// Σ m ṗ.
    momentum: V3<T>,
}

/// What one joint contributes to its rows and columns.
struct Column<T> {
    /// I S.
    momentum: Force<T>,
    /// 2 B Ṡ + I S̈ + S ×* f.
    q: Force<T>,
    /// 2 B S + 2 I Ṡ.
    v: Force<T>,
    /// 2 Bᵀ S, which has no linear part.
    row: V3<T>,
}

impl<T: Lane> Subtree<T> {
    /// Of one body; `lifted` is its acceleration less gravity.
    #[inline(always)]
    fn of(inertia: Composite<T>, velocity: &Motion<T>, lifted: &Motion<T>) -> Self {
        let (v, w) = (&velocity.linear, &velocity.angular);
        let momentum = inertia.times(velocity);
        let s = &inertia.second;
        let column = |first: T, second: V3<T>| w.cross(&second).plus_scaled(v, first);
        Self {
            force: inertia.times(lifted).plus(&velocity.cross_force(&momentum)),
            moment_rate: M3 {
                a: column(inertia.first.x, V3::new(s.xx, s.xy, s.xz)),
                b: column(inertia.first.y, V3::new(s.xy, s.yy, s.yz)),
                c: column(inertia.first.z, V3::new(s.xz, s.yz, s.zz)),
            },
            momentum: momentum.force,
            inertia,
        }
    }

    #[inline(always)]
    fn plus(&self, o: &Self) -> Self {
        Self {
            inertia: self.inertia.plus(&o.inertia),
            force: self.force.plus(&o.force),
            moment_rate: self.moment_rate.plus(&o.moment_rate),
            momentum: self.momentum + o.momentum,
        }
    }

    #[inline(always)]
    fn sum(&self) -> Subtree<f64> {
        Subtree {
            inertia: self.inertia.sum(),
            force: self.force.sum(),
            moment_rate: self.moment_rate.sum(),
            momentum: self.momentum.sum(),
        }
    }

    #[inline(always)]
    fn column(&self, axis: &Motion<T>, rate: &Motion<T>, rate_2: &Motion<T>) -> Column<T> {
        let two = T::splat(2.0);
        let trace = self.moment_rate.trace();
        let twice_b = |u: &V3<T>| Force {
            moment: (u.scaled(trace) - self.moment_rate.times(u)).scaled(two),
            force: u.cross(&self.momentum).scaled(two),
        };
        let row = axis.angular.scaled(trace) - self.moment_rate.transpose_times(&axis.angular)
            + self.momentum.cross(&axis.linear);
        Column {
            momentum: self.inertia.times(axis),
            q: twice_b(&rate.angular).plus(&self.inertia.times(rate_2)).plus(&axis.cross_force(&self.force)),
            v: twice_b(&axis.angular).plus_scaled(&self.inertia.times(rate), two),
            row: row.scaled(two),
        }
    }
}

/// Articulated inertia [[rotational, coupling], [couplingᵀ, translational]] and bias force.
#[derive(Debug, Clone, Copy)]
struct Articulated<T> {
    rotational: S3<T>,
    coupling: M3<T>,
    translational: S3<T>,
    bias: Force<T>,
}

impl<T: Lane> Articulated<T> {
    #[inline(always)]
    fn of(inertia: &Composite<T>, velocity: &Motion<T>, gravity: &V3<T>) -> Self {
        let (s, f, zero) = (&inertia.second, &inertia.first, T::splat(0.0));
        let gyroscopic = velocity.cross_force(&inertia.times(velocity));
        Self {
            rotational: S3 { xx: s.yy + s.zz, xy: -s.xy, xz: -s.xz, yy: s.xx + s.zz, yz: -s.yz, zz: s.xx + s.yy },
            coupling: M3 { a: V3::new(zero, f.z, -f.y), b: V3::new(-f.z, zero, f.x), c: V3::new(f.y, -f.x, zero) },
            translational: S3 { xx: inertia.mass, xy: zero, xz: zero, yy: inertia.mass, yz: zero, zz: inertia.mass },
            bias: Force {
                moment: gyroscopic.moment - f.cross(gravity),
                force: gyroscopic.force.plus_scaled(gravity, -inertia.mass),
            },
        }
    }

    #[inline(always)]
    fn times(&self, u: &Motion<T>) -> Force<T> {
        Force {
            moment: self.rotational.times(&u.angular) + self.coupling.times(&u.linear),
            force: self.coupling.transpose_times(&u.angular) + self.translational.times(&u.linear),
        }
    }

    #[inline(always)]
    fn plus(&self, o: &Self) -> Self {
        Self {
            rotational: self.rotational.plus(&o.rotational),
            coupling: self.coupling.plus(&o.coupling),
            translational: self.translational.plus(&o.translational),
            bias: self.bias.plus(&o.bias),
        }
    }

    #[inline(always)]
    fn sum(&self) -> Articulated<f64> {
        Articulated {
            rotational: self.rotational.sum(),
            coupling: self.coupling.sum(),
            translational: self.translational.sum(),
            bias: self.bias.sum(),
        }
    }
}

impl Articulated<f64> {
    /// The acceleration (angular, linear) that a wrench gives, bias left out: by Cholesky's
    /// factorisation of the 6 × 6 inertia.
    #[inline(always)]
    fn solve(&self, wrench: &Force<f64>) -> (V3<f64>, V3<f64>) {
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

/// self + a · b: reads better than `mul_add` where self is the longer term.
trait PlusProduct: Lane {
    #[inline(always)]
    fn plus_product(self, a: Self, b: Self) -> Self {
        a.mul_add(b, self)
    }
}
impl<T: Lane> PlusProduct for T {}
