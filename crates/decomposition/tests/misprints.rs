//! The paper's misprints, pinned: what the project implements holds, and the printed form fails.

mod common;

use common::{numbers, posture, relative_error, scaled, toes, vision60};
use decomposition::{Bipeds, ClosedLoop, ContactDynamics, Pairing, Side};
use nalgebra::{DMatrix, DVector};
use proptest::prelude::*;
use rigid_body::{Data, bias_forces, crba, point_kinematics};
use robot::Robot;

struct Biped {
    mass: DMatrix<f64>,
    bias: DVector<f64>,
    jacobian: [DMatrix<f64>; 2],
}

/// D, H and the Jacobians of both toes of one biped.
fn biped(robot: &Robot, bipeds: &Bipeds, side: Side, q: &[f64; 12], v: &[f64; 12]) -> Biped {
    let model = bipeds.model(side);
    let mut data = Data::new(model);
    let legs = if side == Side::Front { [0, 2] } else { [1, 3] };
    let jacobian = legs.map(|leg| {
        let toe = robot.legs[leg].toe;
        let point = point_kinematics(model, &mut data, q, v, &[0.0; 12], toe);
        DMatrix::from_column_slice(3, 12, point.jacobian.as_slice())
    });
    Biped { mass: crba(model, &mut data, q).clone(), bias: bias_forces(model, &mut data, q, v).clone(), jacobian }
}

fn vector(x: &[f64]) -> DVector<f64> {
    DVector::from_column_slice(x)
}

/// A state of the whole robot on the diagonal gait's surface, with its closed-loop solution for
/// joints that do not accelerate relative to what keeps the toes' distance.
fn closed_loop_at_rest(robot: &Robot, bipeds: &mut Bipeds) -> ([f64; 12], ClosedLoop, Pairing) {
    let pairing = Pairing::diagonal(robot.mirror.sign);
    let (q_f, _) = Bipeds::split(&posture(&std::array::from_fn(|i| 0.4 * (i as f64).sin())));
    let solution = bipeds
        .closed_loop(Side::Front, &pairing, &q_f, &[0.0; 12], &[0.0; 6], &[1, 2])
        .expect("joints at rest keep the toes' distance");
    (q_f, solution, pairing)
}

/// Section II-B defines J_c = ∂(q_br − q_bf)/∂q_f = −[I 0], its proof uses +[I 0]. The proof's sign is
/// the one for which λc is the wrench that f gives to r.
#[test]
fn the_connection_jacobian_has_the_sign_of_the_proof() {
    let robot = vision60();
    let mut bipeds = Bipeds::new(&robot, 0.5).expect("a valid share");
    let q = posture(&std::array::from_fn(|i| 0.5 * (i as f64).cos()));
    let (v, u) = ([0.4; 18], [7.0; 12]);
    let pair = bipeds.motion(&q, &v, &u, &[1, 2]).expect("regular");
    let ((q_f, q_r), (v_f, v_r)) = (Bipeds::split(&q), Bipeds::split(&v));
    let f = biped(&robot, &bipeds, Side::Front, &q_f, &v_f);
    let r = biped(&robot, &bipeds, Side::Rear, &q_r, &v_r);
    let connection = vector(&pair.connection);
    let front = (&f.mass * vector(&pair.front) + &f.bias - f.jacobian[1].tr_mul(&vector(pair.forces[2].as_slice())))
        .rows(0, 6)
        .into_owned();
    let rear = (&r.mass * vector(&pair.rear) + &r.bias - r.jacobian[0].tr_mul(&vector(pair.forces[1].as_slice())))
        .rows(0, 6)
        .into_owned();
    assert!((&front + &connection).amax() < 1e-9 * connection.amax());
    assert!((&rear - &connection).amax() < 1e-9 * connection.amax());
    // With the printed definition the same equations ask for the opposite.
    assert!((&front - &connection).amax() > connection.amax());
}

/// h_c is the sum of the torso rows of both bipeds: put in place of q̈_bf = q̈_br in the full pair, as
/// the text says it can be, it adds nothing and the pair is singular.
#[test]
fn the_sum_of_the_torso_rows_does_not_replace_the_connection_in_the_pair() {
    let robot = vision60();
    let bipeds = Bipeds::new(&robot, 0.5).expect("a valid share");
    let (q_f, q_r) = Bipeds::split(&posture(&[0.2; 18]));
    let f = biped(&robot, &bipeds, Side::Front, &q_f, &[0.0; 12]);
    let r = biped(&robot, &bipeds, Side::Rear, &q_r, &[0.0; 12]);
    // Unknowns q̈_f, q̈_r, λ2, λ1, λc.
    let mut system = DMatrix::zeros(36, 36);
    system.view_mut((0, 0), (12, 12)).copy_from(&f.mass);
    system.view_mut((12, 12), (12, 12)).copy_from(&r.mass);
    system.view_mut((0, 24), (12, 3)).copy_from(&-f.jacobian[1].transpose());
    system.view_mut((12, 27), (12, 3)).copy_from(&-r.jacobian[0].transpose());
    system.view_mut((24, 0), (3, 12)).copy_from(&f.jacobian[1]);
    system.view_mut((27, 12), (3, 12)).copy_from(&r.jacobian[0]);
    for i in 0..6 {
        system[(i, 30 + i)] = 1.0;
        system[(12 + i, 30 + i)] = -1.0;
    }
    let mut connected = system.clone();
    for i in 0..6 {
        connected[(30 + i, i)] = 1.0;
        connected[(30 + i, 12 + i)] = -1.0;
    }
    assert_eq!(connected.rank(1e-7), 36);
    let mut summed = system;
    for i in 0..6 {
        let sum = summed.row(i) + summed.row(12 + i);
        summed.set_row(30 + i, &sum);
    }
    assert_eq!(summed.rank(1e-7), 30);
}

/// "Leg 3 mirrors leg 0, leg 1 mirrors leg 2" is not the diagonal M that is printed for y_r = (θ1, θ3).
#[test]
fn a_diagonal_m_does_not_pair_diagonal_legs() {
    let robot = vision60();
    let [roll, pitch, knee] = robot.mirror.sign;
    let printed = Pairing::new([0, 1, 2, 3, 4, 5], [roll, pitch, knee, roll, pitch, knee], [0.0; 6])
        .expect("a signed permutation");
    let correct = Pairing::diagonal(robot.mirror.sign);
    let q_f: [f64; 12] = std::array::from_fn(|i| if i < 6 { 0.0 } else { 0.3 + 0.1 * i as f64 });
    let mirrors = |pairing: &Pairing| {
        let q = pairing.recompose_position(&q_f);
        let leg = |k: usize| [q[6 + 3 * k] * roll, q[7 + 3 * k] * pitch, q[8 + 3 * k] * knee];
        let raw = |k: usize| [q[6 + 3 * k], q[7 + 3 * k], q[8 + 3 * k]];
        leg(0) == raw(3) && leg(2) == raw(1)
    };
    assert!(mirrors(&correct));
    assert!(!mirrors(&printed));
}

/// The last line of CL-Dyn-f: D̂_r A q̈_f + Ĥ_r = J_r1,bᵀ λ1 + λc holds; printed are D̂_f and no λc.
#[test]
fn the_rear_torso_rows_have_the_rear_mass_matrix_and_the_connection_wrench() {
    let robot = vision60();
    let mut bipeds = Bipeds::new(&robot, 0.5).expect("a valid share");
    let (q_f, solution, pairing) = closed_loop_at_rest(&robot, &mut bipeds);
    let q_r = pairing.position(&q_f);
    let f = biped(&robot, &bipeds, Side::Front, &q_f, &[0.0; 12]);
    let r = biped(&robot, &bipeds, Side::Rear, &q_r, &[0.0; 12]);
    let a_r = vector(&pairing.rate(&solution.acceleration));
    let force = r.jacobian[0].tr_mul(&vector(solution.forces[1].as_slice()));
    let residual = |mass: &DMatrix<f64>, connection: f64| {
        let full = mass * &a_r + &r.bias - &force;
        (full.rows(0, 6) - vector(&solution.connection) * connection).amax()
    };
    assert!(residual(&r.mass, 1.0) < 1e-8);
    assert!(residual(&f.mass, 1.0) > 0.1, "D̂_f in place of D̂_r");
    assert!(residual(&r.mass, 0.0) > 0.1, "without λc");
    assert!(residual(&f.mass, 0.0) > 0.1, "as printed");
}

/// ÿ = −k1 ẏ − k2 y takes the output to zero; the printed ÿ = k1 ẏ + k2 y takes it away.
#[test]
fn the_output_dynamics_need_minus_signs() {
    let (k1, k2) = (20.0, 100.0);
    let zero = [0.0; 6];
    let run = |sign: f64| {
        let (mut y, mut dy) = ([0.1; 6], [0.0; 6]);
        for _ in 0..10_000 {
            let ddy = ClosedLoop::output_acceleration(sign * k1, sign * k2, (&zero, &zero, &zero), (&y, &dy));
            for k in 0..6 {
                dy[k] += 1e-4 * ddy[k];
                y[k] += 1e-4 * dy[k];
            }
        }
        y[0].abs()
    };
    assert!(run(1.0) < 1e-3);
    assert!(run(-1.0) > 1e3);
}

proptest! {
    #![proptest_config(common::cases(20))]

    /// The impact at t = T is at the toes that land, 0 and 3. With J_f2 and J_r1 as printed, the toes
    /// that stood stay, and the landing ones go on into the ground.
    #[test]
    fn the_landing_toes_are_0_and_3(x in numbers::<18>(), v in numbers::<18>()) {
        let robot = vision60();
        let (q, v) = (posture(&x), scaled(&v, 2.0));
        let mut bipeds = Bipeds::new(&robot, 0.5).expect("a valid share");
        let (jacobian, _) = toes(&robot, &q, &v, &[0, 3]);
        let speed = |impact: &decomposition::PairImpact| {
            (&jacobian * vector(&Bipeds::join(&impact.front, &impact.rear))).amax()
        };
        prop_assert!(speed(&bipeds.impact(&q, &v, &[0, 3]).expect("regular")) < 1e-10);
        prop_assert!(speed(&bipeds.impact(&q, &v, &[1, 2]).expect("regular")) > 1e-3);
    }

    /// The decomposed impact on the gait's surface has 30 equations for 24 unknowns: a general
    /// touchdown leaves the surface, a soft one (no toe velocity, no impulse) stays on it.
    #[test]
    fn only_soft_touchdowns_keep_the_symmetry(x in numbers::<18>(), v in numbers::<12>()) {
        let robot = vision60();
        let pairing = Pairing::diagonal(robot.mirror.sign);
        let (q_f, _) = Bipeds::split(&posture(&x));
        let q = pairing.recompose_position(&q_f);
        let mut bipeds = Bipeds::new(&robot, 0.5).expect("a valid share");
        let hard = pairing.recompose_rate(&scaled(&v, 2.0));
        let after = bipeds.impact(&q, &hard, &[0, 3]).expect("regular");
        let defect = relative_error(&pairing.rate(&after.front), &after.rear, 1e-3);
        prop_assert!(defect > 1e-3, "a hard touchdown that keeps the symmetry: {defect:e}");

        let (jacobian, _) = toes(&robot, &q, &hard, &[0, 3]);
        let mut rows = DMatrix::zeros(6, 12);
        for i in 0..12 {
            let unit: [f64; 12] = std::array::from_fn(|k| if k == i { 1.0 } else { 0.0 });
            rows.set_column(i, &(&jacobian * vector(&pairing.recompose_rate(&unit))));
        }
        let v_f = vector(&v);
        let inverse = rows.clone().pseudo_inverse(1e-9).expect("a positive tolerance");
        let soft = &v_f - inverse * (rows * &v_f);
        let soft: [f64; 12] = std::array::from_fn(|i| soft[i]);
        let before = pairing.recompose_rate(&soft);
        let after = bipeds.impact(&q, &before, &[0, 3]).expect("regular");
        let unchanged = Bipeds::join(&after.front, &after.rear);
        prop_assert!(relative_error(&unchanged, &before, 1.0) < 1e-10);
    }
}

/// The paper bounds u_f only. The rear torques are others, and are not bounded by that.
#[test]
fn the_rear_torques_are_not_the_front_ones() {
    let robot = vision60();
    let mut bipeds = Bipeds::new(&robot, 0.5).expect("a valid share");
    let (q_f, solution, pairing) = closed_loop_at_rest(&robot, &mut bipeds);
    let q = pairing.recompose_position(&q_f);
    let u: [f64; 12] = {
        let (f, r) = (solution.torque, solution.follower_torque);
        [f[0], f[1], f[2], r[0], r[1], r[2], f[3], f[4], f[5], r[3], r[4], r[5]]
    };
    let mut whole = ContactDynamics::new(&robot.model, 2);
    let toes = [robot.legs[1].toe, robot.legs[2].toe];
    let motion = whole.motion(&robot.model, &q, &[0.0; 18], &common::generalised(&u), &toes).expect("regular");
    let expected = pairing.recompose_rate(&solution.acceleration);
    assert!(relative_error(&motion.acceleration, &expected, 1.0) < 1e-9);
    let [roll, pitch, knee] = robot.mirror.sign;
    let (f, r) = (solution.torque, solution.follower_torque);
    // Were leg 1 to mirror leg 2 in its torques as in its angles, these would be equal.
    let mirrored = [roll * f[3], pitch * f[4], knee * f[5]];
    assert!(relative_error(&r[..3], &mirrored, 1.0) > 0.01);
}
