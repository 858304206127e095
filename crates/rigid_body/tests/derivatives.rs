//! Analytic derivatives against central differences.

mod common;

use common::{Random, TOES, difference, random_state, relative_error, vision60};
use rigid_body::{Data, Model, point_kinematics, point_kinematics_derivatives, rnea, rnea_derivatives};

fn models() -> Vec<Model> {
    let whole = vision60();
    let biped = |legs: [&str; 2]| {
        let joints: Vec<String> =
            legs.iter().flat_map(|leg| ["hip_roll", "hip_pitch", "knee"].map(|j| format!("{leg}_{j}"))).collect();
        whole.subtree(&joints, 0.3).expect("the legs exist")
    };
    let mut tilted = whole.clone();
    tilted.gravity = nalgebra::Vector3::new(1.7, -0.4, -9.5);
    vec![biped(["front_left", "front_right"]), biped(["rear_left", "rear_right"]), tilted]
}

#[test]
fn inverse_dynamics_derivatives_match_central_differences() {
    let mut random = Random(1);
    for model in models() {
        let mut data = Data::new(&model);
        let mut other = Data::new(&model);
        for _ in 0..20 {
            let s = random_state(&model, &mut random);
            rnea_derivatives(&model, &mut data, &s.q, &s.v, &s.a, &s.forces);
            let tau = rnea(&model, &mut other, &s.q, &s.v, &s.a, &s.forces).clone();
            assert!(relative_error(&data.tau, &tau) < 1e-13);
            let mut value =
                |q: &[f64], v: &[f64], a: &[f64]| rnea(&model, &mut other, q, v, a, &s.forces).as_slice().to_vec();
            let dq = difference(&s.q, |q| value(q, &s.v, &s.a));
            let dv = difference(&s.v, |v| value(&s.q, v, &s.a));
            let da = difference(&s.a, |a| value(&s.q, &s.v, a));
            assert!(relative_error(&data.dtau_dq, &dq) < 1e-8, "{}", &data.dtau_dq - dq);
            assert!(relative_error(&data.dtau_dv, &dv) < 1e-8, "{}", &data.dtau_dv - dv);
            assert!(relative_error(&data.mass_matrix, &da) < 1e-8);
        }
    }
}

#[test]
fn point_derivatives_match_central_differences() {
    let mut random = Random(2);
    for model in models() {
        let mut data = Data::new(&model);
        let mut other = Data::new(&model);
        for toe in TOES.iter().filter_map(|toe| model.frame_id(toe)) {
            for _ in 0..10 {
                let s = random_state(&model, &mut random);
                let point = point_kinematics_derivatives(&model, &mut data, &s.q, &s.v, &s.a, toe).clone();
                let mut value = |q: &[f64], v: &[f64], a: &[f64]| {
                    let p = point_kinematics(&model, &mut other, q, v, a, toe);
                    [p.position, p.velocity, p.acceleration].concat_rows()
                };
                let dq = difference(&s.q, |q| value(q, &s.v, &s.a));
                let dv = difference(&s.v, |v| value(&s.q, v, &s.a));
                let da = difference(&s.a, |a| value(&s.q, &s.v, a));
                for (analytic, numeric, rows) in [
                    (&point.jacobian, &dq, 0),
                    (&point.dvelocity_dq, &dq, 3),
                    (&point.dacceleration_dq, &dq, 6),
                    (&point.jacobian, &dv, 3),
                    (&point.dacceleration_dv, &dv, 6),
                    (&point.jacobian, &da, 6),
                ] {
                    let numeric = numeric.rows(rows, 3);
                    assert!(relative_error(analytic, &numeric.into_owned()) < 1e-8);
                }
            }
        }
    }
}

trait ConcatRows {
    fn concat_rows(&self) -> Vec<f64>;
}

impl ConcatRows for [nalgebra::Vector3<f64>; 3] {
    fn concat_rows(&self) -> Vec<f64> {
        self.iter().flat_map(|v| v.iter().copied()).collect()
    }
}
