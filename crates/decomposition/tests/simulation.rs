//! The hybrid simulation against motions known in closed form and against conservation laws.

mod common;

use common::{posture, relative_error, toes, vision60};
use decomposition::simulation::{Contacts, End, Options, State, simulate_phase, simulate_step};
use decomposition::{ContactDynamics, DynamicsError};
use rigid_body::{Data, kinetic_energy, point_kinematics, potential_energy};

const NO_TORQUE: fn(f64, &[f64], &[f64], &mut [f64]) = |_, _, _, u| u.fill(0.0);
const FREE: Contacts = Contacts { stance: &[], swing: &[] };

fn tight() -> Options {
    Options { relative_tolerance: 1e-12, absolute_tolerance: 1e-12, ..Options::default() }
}

#[test]
fn free_fall_is_a_parabola_and_touchdown_comes_on_time() {
    let robot = vision60();
    let mut q = posture(&std::array::from_fn(|i| 0.4 * (3.0 * i as f64).sin()));
    q[2] = 2.0;
    let start = State { time_s: 0.3, q: q.to_vec(), v: vec![0.0; 18] };
    let phase = simulate_phase(&robot.model, &start, 0.7, FREE, &[0.45, 0.5], &tight(), NO_TORQUE).expect("regular");
    assert_eq!(phase.states.len(), 3);
    for state in &phase.states {
        let t = state.time_s - 0.3;
        assert!((state.q[2] - (2.0 - 0.5 * 9.81 * t * t)).abs() < 1e-11);
        assert!(relative_error(&state.q[3..], &q[3..], 1.0) < 1e-11, "it must not tumble");
    }
    let toe = |leg: usize| {
        let mut data = Data::new(&robot.model);
        let zero = [0.0; 18];
        point_kinematics(&robot.model, &mut data, &q, &zero, &zero, robot.legs[leg].toe).position.z
    };
    let lowest = (0..4).min_by(|&a, &b| toe(a).total_cmp(&toe(b))).expect("four legs");
    let swing: Vec<_> = robot.legs.iter().map(|leg| leg.toe).collect();
    let options = Options { ground_m: 0.0325, ..tight() };
    let contacts = Contacts { stance: &[], swing: &swing };
    let phase = simulate_phase(&robot.model, &start, 9.0, contacts, &[], &options, NO_TORQUE).expect("regular");
    assert_eq!(phase.end, End::Touchdown(lowest));
    let expected = 0.3 + (2.0 * (toe(lowest) - 0.0325) / 9.81_f64).sqrt();
    assert!((phase.last().time_s - expected).abs() < 1e-11);
}

#[test]
fn a_free_floating_swing_keeps_its_energy_and_momentum() {
    let robot = vision60();
    let q = posture(&std::array::from_fn(|i| 0.5 * (5.0 * i as f64).cos()));
    let v: Vec<f64> = (0..18).map(|i| 1.5 * (7.0 * i as f64).sin()).collect();
    let start = State { time_s: 0.0, q: q.to_vec(), v };
    let phase = simulate_phase(&robot.model, &start, 0.5, FREE, &[], &tight(), NO_TORQUE).expect("regular");
    let mut data = Data::new(&robot.model);
    let mut energy = |s: &State| {
        let kinetic = kinetic_energy(&robot.model, &mut data, &s.q, &s.v);
        kinetic + potential_energy(&robot.model, &mut data, &s.q)
    };
    let (before, after) = (energy(&start), energy(phase.last()));
    assert!((after - before).abs() < 1e-10 * before.abs(), "{before} J to {after} J");
    let mut center = |s: &State| rigid_body::center_of_mass(&robot.model, &mut data, &s.q, &s.v).velocity;
    let fall = nalgebra::Vector3::new(0.0, 0.0, -9.81 * 0.5);
    assert!((center(phase.last()) - center(&start) - fall).amax() < 1e-10);
}

#[test]
fn stance_toes_stay_where_they_are_and_passive_legs_do_no_work() {
    let robot = vision60();
    let q = posture(&[0.1; 18]);
    let stance = [robot.legs[1].toe, robot.legs[2].toe];
    // A velocity with the toes at rest: that after a plastic impact.
    let v: Vec<f64> = (0..18).map(|i| (11.0 * i as f64).sin()).collect();
    let mut dynamics = ContactDynamics::new(&robot.model, 2);
    let impact = dynamics.impact(&robot.model, &q, &v, &stance).expect("regular");
    let v = impact.velocity.as_slice().to_vec();
    let start = State { time_s: 0.0, q: q.to_vec(), v };
    let contacts = Contacts { stance: &stance, swing: &[] };
    let phase = simulate_phase(&robot.model, &start, 0.2, contacts, &[], &tight(), NO_TORQUE).expect("regular");
    let mut data = Data::new(&robot.model);
    let mut place = |s: &State, toe| point_kinematics(&robot.model, &mut data, &s.q, &s.v, &[0.0; 18], toe).position;
    for toe in stance {
        assert!((place(phase.last(), toe) - place(&start, toe)).amax() < 1e-9);
    }
    let (jacobian, _) = toes(&robot, &phase.last().q, &phase.last().v, &[1, 2]);
    let slip = jacobian * nalgebra::DVector::from_column_slice(&phase.last().v);
    assert!(slip.amax() < 1e-9);
    let mut energy = |s: &State| {
        let kinetic = kinetic_energy(&robot.model, &mut data, &s.q, &s.v);
        kinetic + potential_energy(&robot.model, &mut data, &s.q)
    };
    let (before, after) = (energy(&start), energy(phase.last()));
    assert!((after - before).abs() < 1e-9 * before.abs(), "{before} J to {after} J");
}

#[test]
fn tighter_tolerances_converge() {
    let robot = vision60();
    let q = posture(&[0.2; 18]);
    let start = State { time_s: 0.0, q: q.to_vec(), v: vec![0.3; 18] };
    let hold = |_: f64, q: &[f64], v: &[f64], u: &mut [f64]| {
        for k in 0..12 {
            u[k] = 100.0 * (1.2 - q[6 + k]) - 5.0 * v[6 + k];
        }
    };
    let end = |tolerance: f64| {
        let options = Options {
            relative_tolerance: tolerance,
            absolute_tolerance: tolerance,
            longest_step_s: 1.0,
            ..Options::default()
        };
        let phase = simulate_phase(&robot.model, &start, 0.3, FREE, &[], &options, hold);
        let phase = phase.expect("regular");
        (phase.last().q.clone(), phase.steps)
    };
    let (fine, fine_steps) = end(1e-12);
    let (coarse, coarse_steps) = end(1e-6);
    assert!(coarse_steps * 4 < fine_steps, "{coarse_steps} and {fine_steps} steps");
    assert!(relative_error(&fine, &coarse, 1.0) < 1e-5);
    assert!(relative_error(&fine, &end(1e-9).0, 1.0) < 1e-8);
}

#[test]
fn a_step_ends_with_the_landing_toes_at_rest() {
    let robot = vision60();
    let q = posture(&[0.1; 18]);
    let stance = [robot.legs[1].toe, robot.legs[2].toe];
    let swing = [robot.legs[0].toe, robot.legs[3].toe];
    let start = State { time_s: 0.0, q: q.to_vec(), v: vec![0.0; 18] };
    let contacts = Contacts { stance: &stance, swing: &swing };
    let options = Options::default();
    let step = simulate_step(&robot.model, &start, 0.1, contacts, &[], &options, NO_TORQUE).expect("regular");
    assert_eq!(step.after.q, step.phase.last().q);
    let (jacobian, _) = toes(&robot, &step.after.q, &step.after.v, &[0, 3]);
    let slip = jacobian * nalgebra::DVector::from_column_slice(&step.after.v);
    assert!(slip.amax() < 1e-10);
}

#[test]
fn what_cannot_be_simulated_is_reported() {
    let robot = vision60();
    let start = State { time_s: 0.0, q: posture(&[0.1; 18]).to_vec(), v: vec![0.0; 18] };
    let run = |options: Options, controller: fn(f64, &[f64], &[f64], &mut [f64])| {
        simulate_phase(&robot.model, &start, 0.1, FREE, &[], &options, controller)
    };
    let bad = Options { relative_tolerance: f64::NAN, ..Options::default() };
    let error = run(bad, NO_TORQUE).expect_err("NaN tolerance");
    assert!(matches!(error, DynamicsError::BadOption { name: "relative_tolerance", .. }));
    let error = run(Options::default(), |_, _, _, u| u.fill(f64::NAN)).expect_err("NaN torque");
    assert!(matches!(error, DynamicsError::BadTorque { joint: 0, .. }), "{error}");
    let error = run(Options { most_steps: 3, ..Options::default() }, NO_TORQUE);
    assert!(matches!(error, Err(DynamicsError::TooManySteps { steps: 3, .. })), "{error:?}");
}
