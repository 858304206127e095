//! The two bipeds of the decomposition at one instant of the step: everything a point of the program needs, in the
//! front biped's coordinates (q_r = A q_f, Ma & Ames 2020, II-C).

use crate::terms::{Bodies, InverseDynamics, Toe, ToeMotion};
use decomposition::{Pairing, Side};
use nalgebra::{SMatrix, SVector, Vector3};
use rigid_body::{Data, FrameId, Model};
use robot::{Robot, RobotError};

/// Legs of the front biped.
pub(crate) const FRONT: [usize; 2] = [0, 2];
/// Legs of the rear biped.
pub(crate) const REAR: [usize; 2] = [1, 3];
/// Each biped's legs in the first step: one swings, one stands.
pub(crate) const FRONT_SWING: usize = 0;
pub(crate) const FRONT_STANCE: usize = 2;
pub(crate) const REAR_SWING: usize = 3;
pub(crate) const REAR_STANCE: usize = 1;
const DOF: usize = 12;

/// One biped: its inverse dynamics, rows in its own coordinates, derivatives by the front biped's.
#[derive(Clone, Debug, Default)]
pub(crate) struct BipedDynamics {
    /// D q̈ + H − Jᵀ λ of its own stance toe.
    pub tau: SVector<f64, DOF>,
    pub dtau_dq: SMatrix<f64, DOF, DOF>,
    pub dtau_dv: SMatrix<f64, DOF, DOF>,
    pub mass_matrix: SMatrix<f64, DOF, DOF>,
    pub stance: ToeMotion<DOF>,
    /// The stance toe's Jacobian by the biped's own coordinates: its transpose maps the ground force into `tau`.
    pub stance_jacobian_own: SMatrix<f64, 3, DOF>,
    pub swing: ToeMotion<DOF>,
}

/// Both bipeds at one instant.
#[derive(Clone, Debug, Default)]
pub(crate) struct PointDynamics {
    pub front: BipedDynamics,
    pub rear: BipedDynamics,
}

impl Bodies for Vec<PointDynamics> {
    fn toe(&self, point: usize, leg: usize) -> Toe<'_> {
        let PointDynamics { front, rear } = &self[point];
        [&front.swing, &rear.stance, &front.stance, &rear.swing][leg].view()
    }

    /// The front biped's is 0, the rear one's 1.
    fn dynamics(&self, point: usize, body: usize) -> InverseDynamics<'_> {
        let biped = [&self[point].front, &self[point].rear][body];
        InverseDynamics {
            tau: biped.tau.as_slice(),
            dtau_dq: biped.dtau_dq.as_slice(),
            dtau_dv: biped.dtau_dv.as_slice(),
            mass_matrix: biped.mass_matrix.as_slice(),
        }
    }

    fn force_jacobian(&self, point: usize, leg: usize) -> &[[f64; 3]] {
        let biped = if leg == FRONT_STANCE { &self[point].front } else { &self[point].rear };
        &biped.stance_jacobian_own.data.0
    }
}

struct Biped {
    model: Model,
    data: Data,
    stance: FrameId,
    swing: FrameId,
    /// For each of its coordinates, the front biped's that it follows, and the sign: A, row by row.
    follows: [(usize, f64); DOF],
}

/// The two bipeds of a robot, each with half of the torso, evaluated together in the front one's coordinates.
pub struct BipedPair {
    front: Biped,
    rear: Biped,
    pairing: Pairing,
    hip_x_m: [f64; 4],
    total_mass_kg: f64,
    /// Whether `evaluate` is to write the derivatives as well.
    pub(crate) with_derivatives: bool,
}

impl BipedPair {
    /// Splits the robot; the rear biped follows the front one by `pairing`.
    pub fn new(robot: &Robot, pairing: Pairing) -> Result<Self, RobotError> {
        // Any split of the torso gives the same accelerations, forces and torques; only λc depends on it.
        const TORSO_SHARE: f64 = 0.5;
        let bipeds = decomposition::Bipeds::new(robot, TORSO_SHARE)?;
        let biped = |side: Side, stance: usize, swing: usize, follows: [(usize, f64); DOF]| {
            let model = bipeds.model(side).clone();
            let data = Data::new(&model);
            Biped { data, model, stance: robot.legs[stance].toe, swing: robot.legs[swing].toe, follows }
        };
        Ok(Self {
            front: biped(Side::Front, 2, FRONT_SWING, std::array::from_fn(|i| (i, 1.0))),
            rear: biped(Side::Rear, 1, REAR_SWING, std::array::from_fn(|i| pairing.row(i))),
            pairing,
            hip_x_m: crate::hip_x_m(robot),
            total_mass_kg: robot.model.total_mass(),
            with_derivatives: true,
        })
    }

    pub(crate) fn total_mass_kg(&self) -> f64 {
        self.total_mass_kg
    }

    pub(crate) fn hip_x_m(&self, leg: usize) -> f64 {
        self.hip_x_m[leg]
    }

    /// x of every leg's hip from the base's origin, m.
    pub(crate) fn hips_x_m(&self) -> [f64; 4] {
        self.hip_x_m
    }

    /// Distance between toes 1 and 2 when each stands below its hip's x and `half_width_m` from the mid plane.
    pub(crate) fn nominal_toe_distance_m(&self, half_width_m: f64) -> f64 {
        (self.hip_x_m[2] - self.hip_x_m[1]).hypot(2.0 * half_width_m)
    }

    pub(crate) fn pairing(&self) -> &Pairing {
        &self.pairing
    }

    /// Position of a front biped's toe in the world for base coordinates and joints `q`, and its Jacobian by the leg's
    /// three joints.
    pub(crate) fn front_toe(&mut self, swing: bool, q: &[f64; DOF]) -> (Vector3<f64>, nalgebra::Matrix3<f64>) {
        let zero = [0.0; DOF];
        let b = &mut self.front;
        let (frame, first) = if swing { (b.swing, 6) } else { (b.stance, 9) };
        let toe = rigid_body::point_kinematics(&b.model, &mut b.data, q, &zero, &zero, frame);
        (toe.position, toe.jacobian.fixed_columns::<3>(first).into_owned())
    }

    /// Inverse dynamics of both bipeds and the motion of the four toes, for the front biped's q, q̇, q̈ and the ground
    /// forces λ1, λ2 in N.
    pub(crate) fn evaluate(
        &mut self,
        q: &[f64; DOF],
        v: &[f64; DOF],
        a: &[f64; DOF],
        lambda_1: Vector3<f64>,
        lambda_2: Vector3<f64>,
        out: &mut PointDynamics,
    ) {
        let (q_r, v_r, a_r) = (self.pairing.position(q), self.pairing.rate(v), self.pairing.rate(a));
        evaluate(&mut self.front, q, v, a, lambda_2, &mut out.front, self.with_derivatives);
        evaluate(&mut self.rear, &q_r, &v_r, &a_r, lambda_1, &mut out.rear, self.with_derivatives);
    }
}

fn evaluate(
    biped: &mut Biped,
    q: &[f64; DOF],
    v: &[f64; DOF],
    a: &[f64; DOF],
    force: Vector3<f64>,
    out: &mut BipedDynamics,
    with_derivatives: bool,
) {
    let Biped { model, data, stance, swing, follows } = biped;
    let forces = [(*stance, force)];
    if !with_derivatives {
        out.tau.copy_from(rigid_body::rnea(model, data, q, v, a, &forces));
        for (frame, toe) in [(*stance, &mut out.stance), (*swing, &mut out.swing)] {
            let point = rigid_body::last_point_kinematics(model, data, frame);
            (toe.position, toe.velocity, toe.acceleration) = (point.position, point.velocity, point.acceleration);
        }
        return;
    }
    rigid_body::rnea_derivatives(model, data, q, v, a, &forces);
    out.tau.copy_from(&data.tau);
    for (from, to) in [
        (&data.dtau_dq, &mut out.dtau_dq),
        (&data.dtau_dv, &mut out.dtau_dv),
        (&data.mass_matrix, &mut out.mass_matrix),
    ] {
        by_front::<DOF>(follows, from.as_slice(), to.as_mut_slice());
    }
    for (frame, toe) in [(*stance, &mut out.stance), (*swing, &mut out.swing)] {
        let point = rigid_body::last_point_kinematics_derivatives(model, data, frame);
        (toe.position, toe.velocity, toe.acceleration) = (point.position, point.velocity, point.acceleration);
        for (from, to) in [
            (&point.jacobian, &mut toe.jacobian),
            (&point.dvelocity_dq, &mut toe.dvelocity_dq),
            (&point.dacceleration_dq, &mut toe.dacceleration_dq),
            (&point.dacceleration_dv, &mut toe.dacceleration_dv),
        ] {
            by_front::<3>(follows, from.as_slice(), to.as_mut_slice());
        }
        if frame == *stance {
            out.stance_jacobian_own.as_mut_slice().copy_from_slice(point.jacobian.as_slice());
        }
    }
}

/// Columns of `ROWS` entries by the biped's own coordinates, one after the other, as columns by the front biped's.
#[inline(always)]
fn by_front<const ROWS: usize>(follows: &[(usize, f64); DOF], from: &[f64], to: &mut [f64]) {
    let (from, to) = (from.as_chunks::<ROWS>().0, to.as_chunks_mut::<ROWS>().0);
    for (from, &(column, sign)) in from.iter().zip(follows) {
        to[column] = from.map(|value| sign * value);
    }
}
