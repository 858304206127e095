//! CL-Dyn-f and CL-Dyn-r: on the virtual constraint they are the whole robot, for any pairing.

mod common;

use common::{flat, generalised, numbers, posture, relative_error, scaled, toes, vision60};
use decomposition::{Bipeds, ContactDynamics, DynamicsError, Pairing, Side};
use proptest::prelude::*;
use robot::Robot;

/// Pairings and stance legs: the diagonal gait, leaned too, a pace, a bound, and an arbitrary one.
fn gaits(robot: &Robot) -> Vec<(&'static str, Pairing, [usize; 2])> {
    let stand = robot.stand_rad();
    let (front, rear) = Bipeds::split_joints(&stand);
    let diagonal = Pairing::diagonal(robot.mirror.sign);
    vec![
        ("diagonal", diagonal, [1, 2]),
        ("diagonal, next step", diagonal, [0, 3]),
        ("leaned", diagonal.with_offset_rad([0.0, 0.2, -0.3, 0.05, 0.2, -0.3]), [1, 2]),
        ("pace", Pairing::pace(), [2, 3]),
        ("bound, on the rear legs", Pairing::bound(front, rear), [1, 3]),
        ("bound, on the front legs", Pairing::bound(front, rear), [0, 2]),
        (
            "arbitrary",
            Pairing::new([2, 0, 4, 1, 5, 3], [1.0, -1.0, 1.0, -1.0, -1.0, 1.0], [0.4; 6])
                .expect("a signed permutation"),
            [1, 2],
        ),
    ]
}

/// The front biped's velocity nearest to `wish` with the stance toes at rest.
fn standing(robot: &Robot, pairing: &Pairing, q_f: &[f64; 12], wish: [f64; 12], stance: [usize; 2]) -> [f64; 12] {
    let q = pairing.recompose_position(q_f);
    let (jacobian, _) = toes(robot, &q, &[0.0; 18], &stance);
    let mut rows = nalgebra::DMatrix::zeros(6, 12);
    for i in 0..12 {
        let unit: [f64; 12] = std::array::from_fn(|k| if k == i { 1.0 } else { 0.0 });
        let rate = nalgebra::DVector::from_column_slice(&pairing.recompose_rate(&unit));
        rows.set_column(i, &(&jacobian * rate));
    }
    let wish = nalgebra::DVector::from_column_slice(&wish);
    let inverse = rows.clone().pseudo_inverse(1e-9).expect("a positive tolerance");
    let nearest = &wish - inverse * (rows * &wish);
    std::array::from_fn(|i| nearest[i])
}

/// The front biped's joint accelerations nearest to `wish` that keep the stance toes' distance.
fn consistent(
    robot: &Robot,
    pairing: &Pairing,
    q_f: &[f64; 12],
    v_f: &[f64; 12],
    wish: [f64; 6],
    stance: [usize; 2],
) -> [f64; 6] {
    let (q, v) = (pairing.recompose_position(q_f), pairing.recompose_rate(v_f));
    let (jacobian, drift) = toes(robot, &q, &v, &stance);
    let mut data = rigid_body::Data::new(&robot.model);
    let zero = [0.0; 18];
    let mut place = |leg: usize| {
        let toe = robot.legs[leg].toe;
        rigid_body::point_kinematics(&robot.model, &mut data, &q, &v, &zero, toe).position
    };
    let line = (place(stance[0]) - place(stance[1])).normalize();
    let along = |column: &[f64]| -> f64 { (0..3).map(|axis| line[axis] * (column[axis] - column[3 + axis])).sum() };
    let slope: [f64; 6] = std::array::from_fn(|k| {
        let unit: [f64; 12] = std::array::from_fn(|i| if i == 6 + k { 1.0 } else { 0.0 });
        let rate = nalgebra::DVector::from_column_slice(&pairing.recompose_rate(&unit));
        along((&jacobian * rate).as_slice())
    });
    let length: f64 = slope.iter().map(|x| x * x).sum();
    let excess = along(drift.as_slice()) + wish.iter().zip(&slope).map(|(a, s)| a * s).sum::<f64>();
    if length < 1e-20 {
        // Legs that do the same, as a pace's, keep their toes' distance whatever they do.
        return wish;
    }
    std::array::from_fn(|k| wish[k] - excess * slope[k] / length)
}

proptest! {
    #![proptest_config(common::cases(25))]

    #[test]
    fn the_recomposed_robot_moves_as_the_closed_loop_bipeds(
        x in numbers::<18>(), v in numbers::<12>(), wish in numbers::<6>(),
    ) {
        let robot = vision60();
        let mut whole = ContactDynamics::new(&robot.model, 2);
        let (q_f, _) = Bipeds::split(&posture(&x));
        for (name, pairing, stance) in gaits(&robot) {
            let v_f = standing(&robot, &pairing, &q_f, scaled(&v, 3.0), stance);
            let wish = scaled(&wish, 30.0);
            let joints = consistent(&robot, &pairing, &q_f, &v_f, wish, stance);
            for share in [0.0, 0.3, 0.5, 1.0] {
                let mut bipeds = Bipeds::new(&robot, share).expect("a valid share");
                let front = bipeds
                    .closed_loop(Side::Front, &pairing, &q_f, &v_f, &joints, &stance)
                    .expect("consistent");
                // CL-Dyn-r, given the same motion, finds the same.
                let (q_r, v_r) = (pairing.position(&q_f), pairing.rate(&v_f));
                let a_r = pairing.rate(&front.acceleration);
                let joints_r = std::array::from_fn(|k| a_r[6 + k]);
                let rear = bipeds
                    .closed_loop(Side::Rear, &pairing, &q_r, &v_r, &joints_r, &stance)
                    .expect("consistent");
                prop_assert!(relative_error(&rear.acceleration, &a_r, 1.0) < 1e-9, "{name}");
                prop_assert!(
                    relative_error(&flat(&rear.forces), &flat(&front.forces), 10.0) < 1e-9
                );
                prop_assert!(relative_error(&rear.torque, &front.follower_torque, 10.0) < 1e-9);
                prop_assert!(relative_error(&rear.follower_torque, &front.torque, 10.0) < 1e-9);
                prop_assert!(relative_error(&rear.connection, &front.connection, 10.0) < 1e-9);

                let (f, r) = (front.torque, front.follower_torque);
                let u: [f64; 12] = std::array::from_fn(|i| match i {
                    0..3 => f[i],
                    3..6 => r[i - 3],
                    6..9 => f[i - 3],
                    _ => r[i - 6],
                });
                let (q, v) = (pairing.recompose_position(&q_f), pairing.recompose_rate(&v_f));
                let toes = stance.map(|leg| robot.legs[leg].toe);
                let expected = whole
                    .motion(&robot.model, &q, &v, &generalised(&u), &toes)
                    .expect("bent legs are regular");
                let found = pairing.recompose_rate(&front.acceleration);
                let error = relative_error(&found, &expected.acceleration, 1.0);
                prop_assert!(error < 1e-9, "{name}: acceleration {error:e}");
                let error = relative_error(&flat(&stance.map(|leg| front.forces[leg])), &flat(&expected.forces), 10.0);
                prop_assert!(error < 1e-9, "{name}: forces {error:e}");
            }
        }
    }
}

#[test]
fn nothing_squeezes_along_the_line_between_the_toes() {
    let robot = vision60();
    let pairing = Pairing::diagonal(robot.mirror.sign);
    let stand = robot.stand_rad();
    let mut q_f = [0.0; 12];
    q_f[6..9].copy_from_slice(&stand[..3]);
    q_f[9..12].copy_from_slice(&stand[6..9]);
    let mut bipeds = Bipeds::new(&robot, 0.5).expect("a valid share");
    let rest = bipeds
        .closed_loop(Side::Front, &pairing, &q_f, &[0.0; 12], &[0.0; 6], &[1, 2])
        .expect("standing still is consistent");
    let mut data = rigid_body::Data::new(&robot.model);
    let q = pairing.recompose_position(&q_f);
    let zero = [0.0; 18];
    let mut place = |leg: usize| {
        let toe = robot.legs[leg].toe;
        rigid_body::point_kinematics(&robot.model, &mut data, &q, &zero, &zero, toe).position
    };
    let line = (place(2) - place(1)).normalize();
    let squeeze = (rest.forces[2] - rest.forces[1]).dot(&line);
    assert!(squeeze.abs() < 1e-9, "{squeeze} N");
    let weight = rest.forces[1].z + rest.forces[2].z;
    let fall = 38.0 * (9.81 + rest.acceleration[2]);
    assert!((weight - fall).abs() < 0.05 * fall, "{weight} N against {fall} N");
}

#[test]
fn joints_that_tear_the_stance_toes_apart_are_refused() {
    let robot = vision60();
    let pairing = Pairing::diagonal(robot.mirror.sign);
    let (q_f, _) = Bipeds::split(&posture(&[0.2; 18]));
    let mut bipeds = Bipeds::new(&robot, 0.5).expect("a valid share");
    let stretch = [0.0, 0.0, 0.0, 5.0, 9.0, -7.0];
    let error = bipeds
        .closed_loop(Side::Front, &pairing, &q_f, &[0.0; 12], &stretch, &[1, 2])
        .expect_err("the toes' distance would change");
    assert!(matches!(error, DynamicsError::Inconsistent { .. }), "{error}");
}

#[test]
fn pairings_invert_and_are_checked() {
    let pairing =
        Pairing::new([2, 0, 4, 1, 5, 3], [1.0, -1.0, 1.0, -1.0, -1.0, 1.0], [0.4; 6]).expect("a signed permutation");
    let q_f: [f64; 12] = std::array::from_fn(|i| (i as f64).sin());
    let back = pairing.inverse().position(&pairing.position(&q_f));
    assert!(relative_error(&back, &q_f, 1.0) < 1e-15);
    for (source, sign, offset, word) in [
        ([0, 0, 2, 3, 4, 5], [1.0; 6], [0.0; 6], "joint 1"),
        ([0, 1, 2, 3, 4, 6], [1.0; 6], [0.0; 6], "joint 5"),
        ([0, 1, 2, 3, 4, 5], [0.5; 6], [0.0; 6], "sign 0"),
        ([0, 1, 2, 3, 4, 5], [1.0; 6], [f64::NAN; 6], "offset 0"),
    ] {
        let error = Pairing::new(source, sign, offset).expect_err("not a pairing").to_string();
        assert!(error.contains(word), "{error}");
    }
}
