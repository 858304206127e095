//! The paper's Fig. "bi2quad": one step of the full-order quadruped, simulated from the gait's start under the
//! input–output linearising law, beside the plan of the decomposed front biped. Nothing of the decomposition is used
//! here.

use crate::recompose::PlanPoint;
use crate::tolerance::Tolerances;
use decomposition::simulation::{Contacts, Options, State, simulate_phase};
use decomposition::{ContactDynamics, DynamicsError};
use gait::{Gait, JOINTS, StepSide, bezier};
use nalgebra::{DMatrix, DVector};
use rigid_body::{Data, Model, crba, rnea};
use robot::Robot;

mod between;
pub use between::{BetweenPoints, between_points};
pub(crate) use between::{DomainPlan, between_points_of_domain};

/// How far the simulated step departs from the plan.
#[derive(Clone, Debug, PartialEq)]
pub struct StepComparison {
    /// Largest difference of a joint position over the points, rad.
    pub joint_error_rad: f64,
    /// Largest difference of the body's position, m.
    pub body_position_error_m: f64,
    /// Largest difference of the body's roll, pitch or yaw, rad.
    pub body_orientation_error_rad: f64,
    /// Largest difference of a stance toe's normal force, as a fraction of the robot's weight.
    pub normal_force_error: f64,
    /// Heights of the swing toes above the floor when the step ends, m.
    pub landing_height_m: [f64; 2],
    /// The stance legs.
    pub stance_legs: [usize; 2],
    /// What counts as following the plan.
    pub tolerances: Tolerances,
    /// The robot's weight, N.
    pub weight_n: f64,
    /// The simulated step, five times finer than the plan's points.
    pub simulated: Vec<SimulatedPoint>,
}

/// The simulated robot at one instant of the step.
#[derive(Clone, Debug, PartialEq)]
pub struct SimulatedPoint {
    /// Time since the step began, s.
    pub time_s: f64,
    /// Positions of the twelve joints, rad.
    pub joint_position_rad: [f64; JOINTS],
    /// Normal forces on the stance legs' toes, in the order of [`StepComparison::stance_legs`], N.
    pub normal_force_n: [f64; 2],
}

/// Proportional and derivative gains of the linearised outputs, 1/s² and 1/s.
const OUTPUT_GAINS: (f64, f64) = (900.0, 60.0);

/// How much finer than the plan's points a simulated step is kept.
const SIMULATED_FINER: usize = 5;

/// The law under which a planned step is simulated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StepLaw {
    /// Input–output linearising about the planned joints' polynomials: for joints that are prescribed.
    Linearising,
    /// The tracking law about the gait's reference, for a reference that was planned with it
    /// ([`crate::Reference::InProgram`]).
    Tracking,
}

/// Simulates a step of a plan, that of `points`, with the full-order model and compares. For a plan on a slope, `robot`
/// is [`crate::on_slope`]'s.
///
/// # Errors
///
/// If the robot leaves the postures in which its dynamics can be solved.
pub fn simulate_planned_step(
    robot: &Robot,
    gait: &Gait,
    points: &[PlanPoint],
    law: StepLaw,
) -> Result<StepComparison, DynamicsError> {
    let model = &robot.model;
    let t = gait.step_duration_s;
    let (side, legs, swing) = step_of(points);
    let [stance, swing] = [legs, swing].map(|legs| legs.map(|leg| robot.legs[leg].toe));
    let rolls = legs.map(|leg| 6 + 3 * leg);
    let start = State { time_s: 0.0, q: points[0].q.to_vec(), v: points[0].v.to_vec() };
    let instants = SIMULATED_FINER * (points.len() - 1);
    let times: Vec<f64> = (0..=instants).map(|k| k as f64 / instants as f64 * t).collect();
    let mut data = Data::new(model);
    // The joints' torques under the law.
    let mut act = |time: f64, q: &[f64], v: &[f64]| -> [f64; JOINTS] {
        match law {
            StepLaw::Linearising => {
                let wanted = output_acceleration(gait, side, time, q, v);
                linearise(model, &mut data, stance, rolls, q, v, &wanted)
            }
            StepLaw::Tracking => {
                let (position, velocity) = gait.reference(side, (time / t).clamp(0.0, 1.0));
                std::array::from_fn(|j| {
                    gait.gains.kp[j] * (position[j] - q[6 + j]) + gait.gains.kd[j] * (velocity[j] - v[6 + j])
                })
            }
        }
    };
    let phase = simulate_phase(
        model,
        &start,
        t,
        // The step ends by time, as the walking controller's does.
        Contacts { stance: &stance, swing: &[] },
        &times,
        &Options { relative_tolerance: 1e-7, absolute_tolerance: 1e-7, ..Options::default() },
        |time, q, v, torque| torque.copy_from_slice(&act(time, q, v)),
    )?;

    let mut comparison = StepComparison {
        joint_error_rad: 0.0,
        body_position_error_m: 0.0,
        body_orientation_error_rad: 0.0,
        normal_force_error: 0.0,
        landing_height_m: [0.0; 2],
        stance_legs: legs,
        tolerances: Tolerances::of_gait(robot, gait),
        weight_n: model.total_mass() * model.gravity.norm(),
        simulated: Vec::with_capacity(times.len()),
    };
    // The start is the first state unless it was asked for.
    let states: Vec<&State> = std::iter::once(&start).chain(phase.states.iter().filter(|s| s.time_s > 0.0)).collect();
    let mut dynamics = ContactDynamics::new(model, stance.len());
    let mut tau = vec![0.0; model.dof()];
    for state in &states {
        tau[6..].copy_from_slice(&act(state.time_s, &state.q, &state.v));
        let forces = &dynamics.motion(model, &state.q, &state.v, &tau, &stance)?.forces;
        comparison.simulated.push(SimulatedPoint {
            time_s: state.time_s,
            joint_position_rad: std::array::from_fn(|j| state.q[6 + j]),
            normal_force_n: [forces[0].z, forces[1].z],
        });
    }
    for point in points {
        let time = point.phase * t;
        let (state, simulated) = (states.iter().zip(&comparison.simulated))
            .min_by(|a, b| (a.0.time_s - time).abs().total_cmp(&(b.0.time_s - time).abs()))
            .expect("the start at least");
        let forces = simulated.normal_force_n;
        let largest =
            |range: std::ops::Range<usize>| range.map(|i| (state.q[i] - point.q[i]).abs()).fold(0.0, f64::max);
        comparison.body_position_error_m = comparison.body_position_error_m.max(largest(0..3));
        comparison.body_orientation_error_rad = comparison.body_orientation_error_rad.max(largest(3..6));
        comparison.joint_error_rad = comparison.joint_error_rad.max(largest(6..18));
        for (force, leg) in forces.into_iter().zip(legs) {
            let error = (force - point.ground_force_n[leg][2]).abs() / comparison.weight_n;
            comparison.normal_force_error = comparison.normal_force_error.max(error);
        }
    }
    let end = phase.last();
    rigid_body::forward_kinematics(model, &mut data, &end.q, &end.v, &end.v);
    comparison.landing_height_m = swing.map(|toe| rigid_body::frame_position(model, &data, toe).z);
    Ok(comparison)
}

/// θ̈ that makes the outputs y = θ − B(t) decay: ÿ = −k1 ẏ − k2 y.
fn output_acceleration(gait: &Gait, side: StepSide, time: f64, q: &[f64], v: &[f64]) -> [f64; JOINTS] {
    let t = gait.step_duration_s;
    let s = (time / t).clamp(0.0, 1.0);
    let (value, slope, second) =
        (bezier::basis(s), bezier::basis_first_derivative(s), bezier::basis_second_derivative(s));
    let (stiffness, damping) = OUTPUT_GAINS;
    let polynomials = gait.planned_coefficients(side);
    std::array::from_fn(|j| {
        let c = &polynomials[j];
        let y = q[6 + j] - bezier::combine(c, &value);
        let dy = v[6 + j] - bezier::combine(c, &slope) / t;
        bezier::combine(c, &second) / (t * t) - damping * dy - stiffness * y
    })
}

/// Which step a plan's points are of, its stance legs (those that the ground pushes on) and its swing legs.
pub(crate) fn step_of(points: &[PlanPoint]) -> (StepSide, [usize; 2], [usize; 2]) {
    let first = points[0].ground_force_n[1][2] > 0.0;
    let side = if first { StepSide::First } else { StepSide::Mirrored };
    (side, side.stance_legs(), side.swing_legs())
}

/// Torques that give the joints their accelerations on the ground: the base's six rows and the contacts are solved for
/// the base's acceleration and the ground forces. With all joints prescribed the contacts have one row too many, the
/// distance of the toes: the hip rolls of the stance legs give way to it, as in the program, whose stance hip roll is
/// where the toes have it and not on its polynomial. And they have one force too many, along the line between the toes:
/// the least.
fn linearise(
    model: &Model,
    data: &mut Data,
    stance: [rigid_body::FrameId; 2],
    rolls: [usize; 2],
    q: &[f64],
    v: &[f64],
    joints: &[f64; JOINTS],
) -> [f64; JOINTS] {
    let mut a = [0.0; 18];
    a[6..].copy_from_slice(joints);
    let mut jacobian = DMatrix::zeros(6, 18);
    let mut drift = DVector::zeros(6);
    let mut place = [nalgebra::Vector3::zeros(); 2];
    for (k, toe) in stance.into_iter().enumerate() {
        let point = rigid_body::point_kinematics(model, data, q, v, &a, toe);
        jacobian.fixed_view_mut::<3, 18>(3 * k, 0).copy_from(&point.jacobian);
        drift.fixed_rows_mut::<3>(3 * k).copy_from(&point.acceleration);
        place[k] = point.position;
    }
    let line = (place[1] - place[0]).normalize();
    let along = |rows: &DVector<f64>| line.dot(&(rows.fixed_rows::<3>(3) - rows.fixed_rows::<3>(0)));
    let by_roll = rolls.map(|roll| along(&jacobian.column(roll).into_owned()));
    let both = by_roll.iter().map(|by| by * by).sum::<f64>();
    // Toes in one line along the robot are not moved apart by hip rolls.
    let share = if both > 1e-9 { along(&drift) / both } else { 0.0 };
    for (roll, by) in rolls.into_iter().zip(by_roll) {
        a[roll] -= share * by;
        drift -= jacobian.column(roll) * (share * by);
    }
    let mass = crba(model, data, q).clone();
    let tau = rnea(model, data, q, v, &a, &[]).clone();
    let mut matrix = DMatrix::zeros(12, 12);
    matrix.view_mut((0, 0), (6, 6)).copy_from(&mass.view((0, 0), (6, 6)));
    matrix.view_mut((0, 6), (6, 6)).copy_from(&(-jacobian.columns(0, 6).transpose()));
    matrix.view_mut((6, 0), (6, 6)).copy_from(&jacobian.columns(0, 6));
    let mut right = DVector::zeros(12);
    right.rows_mut(0, 6).copy_from(&(-tau.rows(0, 6)));
    right.rows_mut(6, 6).copy_from(&(-&drift));
    let solution = matrix.svd(true, true).solve(&right, 1e-7).expect("both factors were asked for");
    let force = solution.rows(6, 6).into_owned();
    let torque = tau + mass.columns(0, 6) * solution.rows(0, 6) - jacobian.tr_mul(&force);
    std::array::from_fn(|j| torque[6 + j])
}

impl StepComparison {
    /// Whether the full-order step follows the plan: joints and normal forces within their tolerances, and so the
    /// swing toes' heights above the floor when the step ends.
    pub fn follows_plan(&self) -> bool {
        self.joint_error_rad <= self.tolerances.angle_rad
            && self.normal_force_error * self.weight_n <= self.tolerances.force_n
            && self.landing_height_m.iter().all(|h| h.abs() <= self.tolerances.length_m)
    }
}
