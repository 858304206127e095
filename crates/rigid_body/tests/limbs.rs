//! The algorithms for a torso with legs against those for any tree.

mod common;

use common::{Random, TOES, random_state, relative_error, vision60};
use rigid_body::{
    Data, Model, aba, crba, frame_position, frame_rotation, last_point_kinematics_derivatives, rnea, rnea_derivatives,
};

fn models() -> Vec<Model> {
    let whole = vision60();
    let leg = |leg: &str| ["hip_roll", "hip_pitch", "knee"].map(|joint| format!("{leg}_{joint}"));
    let front = [leg("front_right"), leg("front_left")].concat();
    let mixed: Vec<String> =
        ["rear_right", "front_left", "front_right", "rear_left"].iter().flat_map(|name| leg(name)).collect();
    let mut tilted = whole.subtree(&mixed, 1.0).expect("the legs exist");
    tilted.gravity = nalgebra::Vector3::new(1.0, 2.0, -9.0);
    vec![whole.subtree(&front, 0.3).expect("the legs exist"), tilted, whole]
}

#[test]
fn agree_with_the_general_tree() {
    let mut random = Random(11);
    for model in models() {
        let tree = model.clone().as_general_tree();
        let (mut fast, mut slow) = (Data::new(&model), Data::new(&tree));
        for _ in 0..50 {
            let s = random_state(&model, &mut random);
            let expected = rnea(&tree, &mut slow, &s.q, &s.v, &s.a, &s.forces).clone();
            let tau = rnea(&model, &mut fast, &s.q, &s.v, &s.a, &s.forces);
            assert!(relative_error(tau, &expected) < 1e-13, "rnea {}", relative_error(tau, &expected));
            let mass = crba(&model, &mut fast, &s.q);
            assert!(relative_error(mass, crba(&tree, &mut slow, &s.q)) < 1e-13, "crba");

            let found = aba(&model, &mut fast, &s.q, &s.v, expected.as_slice(), &s.forces).clone();
            let a = aba(&tree, &mut slow, &s.q, &s.v, expected.as_slice(), &s.forces);
            assert!(relative_error(&found, a) < 1e-11, "aba {}", relative_error(&found, a));
            compare_points(&model, &mut fast, &tree, &mut slow, 1e-11);

            rnea_derivatives(&model, &mut fast, &s.q, &s.v, &s.a, &s.forces);
            rnea_derivatives(&tree, &mut slow, &s.q, &s.v, &s.a, &s.forces);
            assert!(relative_error(&fast.tau, &slow.tau) < 1e-13);
            assert!(relative_error(&fast.mass_matrix, &slow.mass_matrix) < 1e-13);
            assert!(relative_error(&fast.dtau_dq, &slow.dtau_dq) < 1e-13, "{:.1e}", &fast.dtau_dq - &slow.dtau_dq);
            assert!(relative_error(&fast.dtau_dv, &slow.dtau_dv) < 1e-13, "{:.1e}", &fast.dtau_dv - &slow.dtau_dv);
            compare_points(&model, &mut fast, &tree, &mut slow, 1e-13);
        }
    }
}

fn compare_points(model: &Model, fast: &mut Data, tree: &Model, slow: &mut Data, tolerance: f64) {
    for link in TOES.iter().chain(&["base_link", "front_left_hip", "front_right_upper"]) {
        let Some(frame) = model.frame_id(link) else { continue };
        let pose = frame_position(model, fast, frame);
        assert!(relative_error(&pose, &frame_position(tree, slow, frame)) < 1e-14);
        let turn = frame_rotation(model, fast, frame);
        assert!(relative_error(&turn, &frame_rotation(tree, slow, frame)) < 1e-14);
        let found = last_point_kinematics_derivatives(model, fast, frame).clone();
        let expected = last_point_kinematics_derivatives(tree, slow, frame);
        for (found, expected, what) in [
            (found.position.as_slice(), expected.position.as_slice(), "position"),
            (found.velocity.as_slice(), expected.velocity.as_slice(), "velocity"),
            (found.acceleration.as_slice(), expected.acceleration.as_slice(), "acceleration"),
            (found.jacobian.as_slice(), expected.jacobian.as_slice(), "jacobian"),
            (found.dvelocity_dq.as_slice(), expected.dvelocity_dq.as_slice(), "dvelocity_dq"),
            (found.dacceleration_dq.as_slice(), expected.dacceleration_dq.as_slice(), "dacceleration_dq"),
            (found.dacceleration_dv.as_slice(), expected.dacceleration_dv.as_slice(), "dacceleration_dv"),
        ] {
            let error = relative_error(found, expected);
            assert!(error < tolerance, "{what} of {link}: {error:e}");
        }
    }
}
