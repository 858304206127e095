//! The pair of bipeds, coupled by the connection wrench λc.

use nalgebra::Vector3;
use rigid_body::{Data, FrameId, Model, bias_forces, crba, forward_kinematics, last_point_kinematics};
use robot::{Robot, RobotError};

use crate::DynamicsError;
use crate::elimination::Elimination;
use crate::pairing::Pairing;

/// Largest system: both bipeds' accelerations, four toes' forces, the connection wrench.
const MAX_SIZE: usize = 24 + 12 + 6;

/// A contradiction of this size (equations scaled to entries of order one) is an error of the caller,
/// not of rounding.
const CONTRADICTION: f64 = 1e-6;

/// Front biped f (legs 0 and 2) or rear biped r (legs 1 and 3).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// Legs 0 and 2.
    Front,
    /// Legs 1 and 3.
    Rear,
}

impl Side {
    /// Which biped a leg belongs to.
    pub fn of_leg(leg: usize) -> Self {
        if leg.is_multiple_of(2) { Side::Front } else { Side::Rear }
    }

    fn other(self) -> Self {
        match self {
            Side::Front => Side::Rear,
            Side::Rear => Side::Front,
        }
    }
}

/// Solution of the open-loop pair, OL-Dyn (paper eqs. 3–7).
#[derive(Debug, Clone)]
pub struct PairMotion {
    /// q̈_f.
    pub front: [f64; 12],
    /// q̈_r.
    pub rear: [f64; 12],
    /// λ by leg, N, world axes; zero where the leg does not stand.
    pub forces: [Vector3<f64>; 4],
    /// λc: the generalised force along the torso's coordinates that f gives to r.
    pub connection: [f64; 6],
}

/// Solution of the pair's impact.
#[derive(Debug, Clone)]
pub struct PairImpact {
    /// q̇_f⁺.
    pub front: [f64; 12],
    /// q̇_r⁺.
    pub rear: [f64; 12],
    /// Λ by leg, N s, world axes; zero where the leg does not land.
    pub impulses: [Vector3<f64>; 4],
    /// Λc.
    pub connection: [f64; 6],
}

/// Solution of a closed-loop biped, CL-Dyn-f or CL-Dyn-r.
#[derive(Debug, Clone)]
pub struct ClosedLoop {
    /// q̈ of the leading biped.
    pub acceleration: [f64; 12],
    /// Torques of the leading biped's six joints, N m.
    pub torque: [f64; 6],
    /// Torques of the following biped's six joints, N m. The paper bounds only the leading biped's.
    pub follower_torque: [f64; 6],
    /// λ by leg, N, world axes; zero where the leg does not stand.
    pub forces: [Vector3<f64>; 4],
    /// λc, with the sign of [`PairMotion::connection`].
    pub connection: [f64; 6],
}

/// Front and rear biped of a quadruped, with workspaces.
#[derive(Debug, Clone)]
pub struct Bipeds {
    front: Model,
    rear: Model,
    toes: [FrameId; 4],
    front_data: Data,
    rear_data: Data,
    system: Elimination,
    zero: [f64; 12],
}

impl Bipeds {
    /// The two bipeds of a robot; the front one has `torso_share` of the torso's mass and inertia, the
    /// rear one the rest. Accelerations, ground forces and torques do not depend on the share, only
    /// λc does.
    ///
    /// # Errors
    ///
    /// If the share is not from 0 to 1.
    pub fn new(robot: &Robot, torso_share: f64) -> Result<Self, RobotError> {
        let front = robot.biped([0, 2], torso_share)?;
        let rear = robot.biped([1, 3], 1.0 - torso_share)?;
        Ok(Self {
            toes: std::array::from_fn(|leg| robot.legs[leg].toe),
            front_data: Data::new(&front),
            rear_data: Data::new(&rear),
            front,
            rear,
            system: Elimination::with_capacity(MAX_SIZE),
            zero: [0.0; 12],
        })
    }

    /// The model of one biped.
    pub fn model(&self, side: Side) -> &Model {
        match side {
            Side::Front => &self.front,
            Side::Rear => &self.rear,
        }
    }

    /// (q_f, q_r) of q, or the same of a velocity or an acceleration.
    pub fn split(whole: &[f64; 18]) -> ([f64; 12], [f64; 12]) {
        let front = std::array::from_fn(|i| if i < 9 { whole[i] } else { whole[i + 3] });
        let rear = std::array::from_fn(|i| match i {
            0..6 => whole[i],
            6..9 => whole[i + 3],
            _ => whole[i + 6],
        });
        (front, rear)
    }

    /// (u_f, u_r) of u, or of any twelve numbers in the order leg·3 + joint.
    pub fn split_joints(whole: &[f64; 12]) -> ([f64; 6], [f64; 6]) {
        let front = std::array::from_fn(|i| if i < 3 { whole[i] } else { whole[i + 3] });
        let rear = std::array::from_fn(|i| if i < 3 { whole[i + 3] } else { whole[i + 6] });
        (front, rear)
    }

    /// (q_b, θ0, θ1, θ2, θ3) of a front and a rear biped that share the torso.
    pub fn join(front: &[f64; 12], rear: &[f64; 12]) -> [f64; 18] {
        crate::pairing::join(front, rear)
    }

    /// The open-loop pair OL-Dyn (paper eqs. 3–7, with J_c = [I₆ 0] for both):
    ///
    /// > D_f q̈_f + H_f = Σ J_fᵀλ + B u_f − J_cᵀ λc,   J_f q̈_f + J̇_f q̇_f = 0,
    /// > D_r q̈_r + H_r = Σ J_rᵀλ + B u_r + J_cᵀ λc,   J_r q̈_r + J̇_r q̇_r = 0,   q̈_bf = q̈_br,
    ///
    /// for the whole robot's q, q̇, u and any stance legs.
    ///
    /// # Errors
    ///
    /// [`DynamicsError::Singular`] if the stance toes or the posture are singular.
    ///
    /// # Panics
    ///
    /// If a leg is not 0 to 3, or is named twice.
    pub fn motion(
        &mut self,
        q: &[f64; 18],
        v: &[f64; 18],
        u: &[f64; 12],
        stance: &[usize],
    ) -> Result<PairMotion, DynamicsError> {
        check_legs(stance);
        let size = 24 + 3 * stance.len() + 6;
        self.system.reset(size);
        self.assemble_pair(q, stance);
        let ((q_f, q_r), (v_f, v_r)) = (Self::split(q), Self::split(v));
        let (u_f, u_r) = Self::split_joints(u);
        let Self { front, rear, front_data, rear_data, system, zero, .. } = self;
        for (first, model, data, q, v, u) in
            [(0, &*front, &mut *front_data, &q_f, &v_f, &u_f), (12, &*rear, &mut *rear_data, &q_r, &v_r, &u_r)]
        {
            let bias = bias_forces(model, data, q, v);
            for i in 0..12 {
                system.add_right(first + i, if i < 6 { 0.0 } else { u[i - 6] } - bias[i]);
            }
            forward_kinematics(model, data, q, v, zero);
        }
        for (k, &leg) in stance.iter().enumerate() {
            let (model, data) = match Side::of_leg(leg) {
                Side::Front => (&*front, &mut *front_data),
                Side::Rear => (&*rear, &mut *rear_data),
            };
            let drift = last_point_kinematics(model, data, self.toes[leg]).acceleration;
            for axis in 0..3 {
                system.add_right(24 + 3 * k + axis, -drift[axis]);
            }
        }
        let (front, rear, forces, connection) = self.solve_pair("the two bipeds", stance)?;
        Ok(PairMotion { front, rear, forces, connection })
    }

    /// The pair's plastic impact (paper section II-D, with the toes that land):
    ///
    /// > D_f (q̇_f⁺ − q̇_f⁻) = Σ J_fᵀΛ − J_cᵀ Λc,   J_f q̇_f⁺ = 0,
    /// > D_r (q̇_r⁺ − q̇_r⁻) = Σ J_rᵀΛ + J_cᵀ Λc,   J_r q̇_r⁺ = 0,   q̇_bf⁺ = q̇_br⁺.
    ///
    /// # Errors
    ///
    /// [`DynamicsError::Singular`] if the landing toes or the posture are singular.
    ///
    /// # Panics
    ///
    /// As [`Bipeds::motion`].
    pub fn impact(&mut self, q: &[f64; 18], v: &[f64; 18], landing: &[usize]) -> Result<PairImpact, DynamicsError> {
        check_legs(landing);
        self.system.reset(24 + 3 * landing.len() + 6);
        self.assemble_pair(q, landing);
        let (v_f, v_r) = Self::split(v);
        for (first, data, v) in [(0, &self.front_data, &v_f), (12, &self.rear_data, &v_r)] {
            for i in 0..12 {
                let momentum: f64 = (0..12).map(|k| data.mass_matrix[(i, k)] * v[k]).sum();
                self.system.add_right(first + i, momentum);
            }
        }
        let (front, rear, impulses, connection) = self.solve_pair("the two bipeds' impact", landing)?;
        Ok(PairImpact { front, rear, impulses, connection })
    }

    /// A closed-loop biped: CL-Dyn-f for `Side::Front`, CL-Dyn-r for `Side::Rear`. The leading biped's
    /// joints accelerate as prescribed (ÿ on the virtual constraint, see [`output_acceleration`]), the
    /// other biped follows by the pairing, and the rest is found:
    ///
    /// > D_f q̈_f + H_f = Σ J_fᵀλ + B u_f − J_cᵀ λc,   θ̈_f as prescribed,
    /// > J_f q̈_f + J̇_f q̇_f = 0,   J_r A q̈_f + J̇_r A q̇_f = 0,
    /// > D̂_r A q̈_f + Ĥ_r = Σ J_r,bᵀ λ + λc,
    ///
    /// the hat meaning the torso's six rows (the paper prints D̂_f, and no λc, in the last line).
    ///
    /// With joints prescribed, contact at two toes has rank 5 of 6: the toes' distance is prescribed
    /// too. The joint accelerations must respect it. Then a force along the line between the toes is
    /// not determined by the motion, and of all solutions the one with the least Σ|λ|² is returned:
    /// nothing squeezes. More toes leave more free, treated alike.
    ///
    /// # Errors
    ///
    /// [`DynamicsError::Inconsistent`] if the joint accelerations contradict the contacts.
    ///
    /// # Panics
    ///
    /// As [`Bipeds::motion`].
    ///
    /// [`output_acceleration`]: ClosedLoop::output_acceleration
    pub fn closed_loop(
        &mut self,
        lead: Side,
        pairing: &Pairing,
        q: &[f64; 12],
        v: &[f64; 12],
        joint_acceleration: &[f64; 6],
        stance: &[usize],
    ) -> Result<ClosedLoop, DynamicsError> {
        check_legs(stance);
        // Unknowns: q̈ (12), u (6), λ, λc (6).
        let contact_columns = 18;
        let connection_columns = contact_columns + 3 * stance.len();
        let size = connection_columns + 6;
        // Rows: dynamics (12), outputs (6), contacts, the follower's torso rows (6).
        let contact_rows = 18;
        let follower_rows = contact_rows + 3 * stance.len();

        let follow = lead.other();
        let pairing = match lead {
            Side::Front => *pairing,
            Side::Rear => pairing.inverse(),
        };
        // On the leading biped −λc acts if it is the front one, +λc if it is the rear one.
        let sign = if lead == Side::Front { 1.0 } else { -1.0 };
        let (q_follow, v_follow) = (pairing.position(q), pairing.rate(v));
        let Self { front, rear, front_data, rear_data, system, zero, toes } = self;
        let (lead_model, lead_data, model, data) = match lead {
            Side::Front => (&*front, front_data, &*rear, rear_data),
            Side::Rear => (&*rear, rear_data, &*front, front_data),
        };
        system.reset(size);

        let mass = crba(lead_model, lead_data, q);
        for row in 0..12 {
            for column in 0..12 {
                system.add(row, column, mass[(row, column)]);
            }
        }
        let bias = bias_forces(lead_model, lead_data, q, v);
        for row in 0..12 {
            system.add_right(row, -bias[row]);
            if row < 6 {
                system.add(row, connection_columns + row, sign);
            } else {
                system.add(row, 6 + row, -1.0);
                system.add(6 + row, row, 1.0);
                system.add_right(6 + row, joint_acceleration[row - 6]);
            }
        }
        crba(model, data, &q_follow);
        bias_forces(model, data, &q_follow, &v_follow);
        for row in 0..6 {
            for column in 0..12 {
                let (column_lead, factor) = pairing.row(column);
                let entry = factor * data.mass_matrix[(row, column)];
                system.add(follower_rows + row, column_lead, entry);
            }
            system.add(follower_rows + row, connection_columns + row, -sign);
            system.add_right(follower_rows + row, -data.tau[row]);
        }
        forward_kinematics(lead_model, lead_data, q, v, zero);
        forward_kinematics(model, data, &q_follow, &v_follow, zero);
        for (k, &leg) in stance.iter().enumerate() {
            let leading = Side::of_leg(leg) == lead;
            let point = if leading {
                last_point_kinematics(lead_model, lead_data, toes[leg])
            } else {
                last_point_kinematics(model, data, toes[leg])
            };
            for axis in 0..3 {
                let (row, force) = (contact_rows + 3 * k + axis, contact_columns + 3 * k + axis);
                system.add_right(row, -point.acceleration[axis]);
                for i in 0..12 {
                    let entry = point.jacobian[(axis, i)];
                    if leading {
                        system.add(row, i, entry);
                        system.add(i, force, -entry);
                    } else {
                        let (lead_column, factor) = pairing.row(i);
                        system.add(row, lead_column, factor * entry);
                        if i < 6 {
                            system.add(follower_rows + i, force, -entry);
                        }
                    }
                }
            }
        }

        let outcome = system.solve(contact_columns..connection_columns);
        if outcome.residual > CONTRADICTION {
            return Err(DynamicsError::Inconsistent { legs: stance.to_vec(), residual: outcome.residual });
        }
        let x = system.solution();
        let acceleration: [f64; 12] = std::array::from_fn(|i| x[i]);
        let forces = by_leg(x, contact_columns, stance);
        // u_r: the last six rows of D_r A q̈_f + H_r − Σ J_rᵀ λ.
        let follower_acceleration = pairing.rate(&acceleration);
        let mut follower_torque = [0.0; 6];
        for i in 0..6 {
            let inertial: f64 = (0..12).map(|k| data.mass_matrix[(6 + i, k)] * follower_acceleration[k]).sum();
            follower_torque[i] = data.tau[6 + i] + inertial;
        }
        for &leg in stance.iter().filter(|leg| Side::of_leg(**leg) == follow) {
            let point = last_point_kinematics(model, data, toes[leg]);
            for i in 0..6 {
                follower_torque[i] -= point.jacobian.column(6 + i).dot(&forces[leg]);
            }
        }
        Ok(ClosedLoop {
            acceleration,
            torque: std::array::from_fn(|i| x[12 + i]),
            follower_torque,
            connection: std::array::from_fn(|i| x[connection_columns + i]),
            forces,
        })
    }

    /// The left-hand side that motion and impact share: unknowns are f's and r's twelve, the toes'
    /// forces, λc; rows f, r, contacts, connection.
    fn assemble_pair(&mut self, q: &[f64; 18], contacts: &[usize]) {
        let (q_f, q_r) = Self::split(q);
        let connection = 24 + 3 * contacts.len();
        let Self { front, rear, front_data, rear_data, system, zero, toes } = self;
        for (first, sign, model, data, q) in
            [(0, 1.0, &*front, &mut *front_data, &q_f), (12, -1.0, &*rear, &mut *rear_data, &q_r)]
        {
            let mass = crba(model, data, q);
            for row in 0..12 {
                for column in 0..12 {
                    system.add(first + row, first + column, mass[(row, column)]);
                }
            }
            for i in 0..6 {
                system.add(first + i, connection + i, sign);
                system.add(connection + i, first + i, sign);
            }
            forward_kinematics(model, data, q, zero, zero);
        }
        for (k, &leg) in contacts.iter().enumerate() {
            let (first, point) = match Side::of_leg(leg) {
                Side::Front => (0, last_point_kinematics(front, front_data, toes[leg])),
                Side::Rear => (12, last_point_kinematics(rear, rear_data, toes[leg])),
            };
            for axis in 0..3 {
                let row = 24 + 3 * k + axis;
                for i in 0..12 {
                    let entry = point.jacobian[(axis, i)];
                    system.add(row, first + i, entry);
                    system.add(first + i, row, -entry);
                }
            }
        }
    }

    #[allow(clippy::type_complexity)] // private, taken apart at once by its two callers
    fn solve_pair(
        &mut self,
        what: &'static str,
        contacts: &[usize],
    ) -> Result<([f64; 12], [f64; 12], [Vector3<f64>; 4], [f64; 6]), DynamicsError> {
        let size = 24 + 3 * contacts.len() + 6;
        let outcome = self.system.solve(0..0);
        if outcome.rank < size {
            return Err(DynamicsError::Singular { what, rank: outcome.rank, size });
        }
        let x = self.system.solution();
        Ok((
            std::array::from_fn(|i| x[i]),
            std::array::from_fn(|i| x[12 + i]),
            by_leg(x, 24, contacts),
            std::array::from_fn(|i| x[size - 6 + i]),
        ))
    }
}

impl ClosedLoop {
    /// The joint acceleration that makes the output y = θ − B(t) behave as ÿ = −k1 ẏ − k2 y (the
    /// paper prints plus signs, which diverges): B̈ − k1 (θ̇ − Ḃ) − k2 (θ − B).
    pub fn output_acceleration(
        k1_per_s: f64,
        k2_per_s2: f64,
        reference: (&[f64; 6], &[f64; 6], &[f64; 6]),
        joints: (&[f64; 6], &[f64; 6]),
    ) -> [f64; 6] {
        let (b, db, ddb) = reference;
        let (theta, dtheta) = joints;
        std::array::from_fn(|i| ddb[i] - k1_per_s * (dtheta[i] - db[i]) - k2_per_s2 * (theta[i] - b[i]))
    }
}

/// Forces by leg out of a solution that has them in the order of `legs` from entry `first` on.
fn by_leg(x: &[f64], first: usize, legs: &[usize]) -> [Vector3<f64>; 4] {
    let mut forces = [Vector3::zeros(); 4];
    for (k, &leg) in legs.iter().enumerate() {
        forces[leg] = Vector3::new(x[first + 3 * k], x[first + 3 * k + 1], x[first + 3 * k + 2]);
    }
    forces
}

fn check_legs(legs: &[usize]) {
    for (k, leg) in legs.iter().enumerate() {
        assert!(*leg < 4, "leg {leg} does not exist: legs are 0 to 3");
        assert!(!legs[..k].contains(leg), "leg {leg} is named twice");
    }
}
