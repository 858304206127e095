//! Numbers from Pinocchio (see `tests/pinocchio/golden.py`) and how far ours are from them.

use decomposition::ContactDynamics;
use rigid_body::{Data, aba, bias_forces, crba, point_kinematics, rnea, rnea_derivatives};
use robot::Robot;
use serde::Deserialize;

#[derive(Deserialize)]
pub struct Golden {
    pub robot: String,
    made_by: String,
    joints: Vec<String>,
    toes: Vec<String>,
    states: Vec<State>,
}

#[derive(Deserialize)]
struct State {
    q: Vec<f64>,
    v: Vec<f64>,
    a: Vec<f64>,
    mass: Vec<f64>,
    bias: Vec<f64>,
    tau: Vec<f64>,
    dtau_dq: Vec<f64>,
    dtau_dv: Vec<f64>,
    forward: Vec<f64>,
    toes: Vec<Toe>,
    impact: Vec<f64>,
}

#[derive(Deserialize)]
struct Toe {
    position: Vec<f64>,
    velocity: Vec<f64>,
    acceleration: Vec<f64>,
    jacobian: Vec<f64>,
}

/// What was compared, and the largest difference relative to the larger of 1 and the largest entry.
pub type Worst = Vec<(&'static str, f64)>;

/// The worst differences over all states.
pub fn compare(robot: &Robot, golden: &Golden) -> Worst {
    let model = &robot.model;
    assert_eq!(golden.joints, robot.joint_names(), "{}", golden.made_by);
    for (leg, toe) in robot.legs.iter().zip(&golden.toes) {
        assert_eq!(model.frame_name(leg.toe), toe);
    }
    assert!(!golden.states.is_empty());
    let mut data = Data::new(model);
    let mut contacts = ContactDynamics::new(model, 2);
    let landing = [0, 3].map(|leg: usize| robot.legs[leg].toe);
    let mut worst: Worst = Vec::new();
    let mut note = |what: &'static str, found: &[f64], expected: &[f64]| {
        assert_eq!(found.len(), expected.len(), "{what}");
        let scale = expected.iter().fold(1.0_f64, |m, x| m.max(x.abs()));
        let error = found.iter().zip(expected).fold(0.0_f64, |m, (f, e)| m.max((f - e).abs())) / scale;
        // NaN must not pass for small.
        let error = if error.is_nan() { f64::INFINITY } else { error };
        match worst.iter_mut().find(|(name, _)| *name == what) {
            Some((_, so_far)) => *so_far = so_far.max(error),
            None => worst.push((what, error)),
        }
    };
    for s in &golden.states {
        note("mass matrix", crba(model, &mut data, &s.q).as_slice(), &s.mass);
        note("bias forces", bias_forces(model, &mut data, &s.q, &s.v).as_slice(), &s.bias);
        note("inverse dynamics", rnea(model, &mut data, &s.q, &s.v, &s.a, &[]).as_slice(), &s.tau);
        note("forward dynamics", aba(model, &mut data, &s.q, &s.v, &s.a, &[]).as_slice(), &s.forward);
        rnea_derivatives(model, &mut data, &s.q, &s.v, &s.a, &[]);
        note("derivatives by q", data.dtau_dq.as_slice(), &s.dtau_dq);
        note("derivatives by v", data.dtau_dv.as_slice(), &s.dtau_dv);
        note("derivatives by a", data.mass_matrix.as_slice(), &s.mass);
        for (leg, toe) in robot.legs.iter().zip(&s.toes) {
            let point = point_kinematics(model, &mut data, &s.q, &s.v, &s.a, leg.toe);
            note("toe positions", point.position.as_slice(), &toe.position);
            note("toe velocities", point.velocity.as_slice(), &toe.velocity);
            note("toe accelerations", point.acceleration.as_slice(), &toe.acceleration);
            note("toe Jacobians", point.jacobian.as_slice(), &toe.jacobian);
        }
        let impact = contacts.impact(model, &s.q, &s.v, &landing).expect("the golden postures are regular");
        note("impact of toes 0 and 3", impact.velocity.as_slice(), &s.impact);
    }
    worst
}
