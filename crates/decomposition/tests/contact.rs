//! Constrained dynamics and impact against the equations that define them.

mod common;

use common::{generalised, numbers, posture, relative_error, scaled, toes, vision60};
use decomposition::{ContactDynamics, DynamicsError};
use nalgebra::DVector;
use proptest::prelude::*;
use rigid_body::{Data, aba, crba, kinetic_energy, rnea};

proptest! {
    #![proptest_config(common::cases(64))]

    #[test]
    fn equation_1_holds(x in numbers::<18>(), v in numbers::<18>(), u in numbers::<12>()) {
        let robot = vision60();
        let (q, v, u) = (posture(&x), scaled(&v, 4.0), scaled(&u, 50.0));
        let mut dynamics = ContactDynamics::new(&robot.model, 4);
        for stance in [&[1, 2][..], &[0, 1, 2, 3]] {
            let frames: Vec<_> = stance.iter().map(|&leg| robot.legs[leg].toe).collect();
            let motion = dynamics
                .motion(&robot.model, &q, &v, &generalised(&u), &frames)
                .expect("bent legs are regular");
            let (jacobian, drift) = toes(&robot, &q, &v, stance);
            let residual = &jacobian * &motion.acceleration + drift;
            prop_assert!(residual.amax() < 1e-9 * motion.acceleration.amax().max(1.0));
            let forces: Vec<_> =
                frames.iter().copied().zip(motion.forces.iter().copied()).collect();
            let mut data = Data::new(&robot.model);
            let a = motion.acceleration.as_slice();
            let tau = rnea(&robot.model, &mut data, &q, &v, a, &forces);
            prop_assert!(relative_error(tau, &generalised(&u), 100.0) < 1e-9);
        }
    }

    #[test]
    fn equation_2_holds_and_loses_energy(x in numbers::<18>(), v in numbers::<18>()) {
        let robot = vision60();
        let (q, v) = (posture(&x), scaled(&v, 4.0));
        let landing = [0, 3];
        let frames = landing.map(|leg| robot.legs[leg].toe);
        let mut dynamics = ContactDynamics::new(&robot.model, 2);
        let impact = dynamics.impact(&robot.model, &q, &v, &frames).expect("regular");
        let (jacobian, _) = toes(&robot, &q, &v, &landing);
        prop_assert!((&jacobian * &impact.velocity).amax() < 1e-10);
        let mut data = Data::new(&robot.model);
        let mass = crba(&robot.model, &mut data, &q).clone();
        let gained = mass * (&impact.velocity - DVector::from_column_slice(&v));
        let impulses = DVector::from_vec(common::flat(&impact.impulses));
        prop_assert!(relative_error(&gained, &(jacobian.transpose() * impulses), 1.0) < 1e-10);
        let before = kinetic_energy(&robot.model, &mut data, &q, &v);
        let after = kinetic_energy(&robot.model, &mut data, &q, impact.velocity.as_slice());
        prop_assert!(after <= before * (1.0 + 1e-12));
    }
}

#[test]
fn without_contacts_it_is_forward_dynamics() {
    let robot = vision60();
    let q = posture(&std::array::from_fn(|i| (i as f64).sin()));
    let v: [f64; 18] = std::array::from_fn(|i| (2.0 * i as f64).cos());
    let tau = generalised(&std::array::from_fn(|i| 10.0 * (i as f64).sin()));
    let mut dynamics = ContactDynamics::new(&robot.model, 0);
    let motion = dynamics.motion(&robot.model, &q, &v, &tau, &[]).expect("regular");
    let mut data = Data::new(&robot.model);
    let expected = aba(&robot.model, &mut data, &q, &v, &tau, &[]);
    assert!(relative_error(&motion.acceleration, expected, 1.0) < 1e-10);
}

#[test]
fn a_toe_named_twice_is_a_singular_contact_set() {
    let robot = vision60();
    let q = posture(&[0.3; 18]);
    let toe = robot.legs[1].toe;
    let mut dynamics = ContactDynamics::new(&robot.model, 2);
    let error =
        dynamics.motion(&robot.model, &q, &[0.0; 18], &[0.0; 18], &[toe, toe]).expect_err("the same contact twice");
    assert_eq!(
        error,
        DynamicsError::SingularContacts { toes: "(rear_left_toe, rear_left_toe)".to_owned(), rows: 6, rank: 3 }
    );
}

#[test]
fn four_stretched_legs_are_a_singular_contact_set() {
    let robot = vision60();
    // Knees straight (π), and each toe straight below its roll axis: no joint moves a toe up or down.
    let mut q = [0.0; 18];
    let outward = (0.0975_f64 / (0.34 + 0.3407)).atan();
    for leg in 0..4 {
        q[6 + 3 * leg] = if leg < 2 { -outward } else { outward };
        q[6 + 3 * leg + 1] = std::f64::consts::FRAC_PI_2;
        q[6 + 3 * leg + 2] = std::f64::consts::PI;
    }
    let frames: Vec<_> = robot.legs.iter().map(|leg| leg.toe).collect();
    let mut dynamics = ContactDynamics::new(&robot.model, 4);
    let result = dynamics.motion(&robot.model, &q, &[0.0; 18], &[0.0; 18], &frames);
    let error = result.expect_err("stretched legs");
    assert!(matches!(error, DynamicsError::SingularContacts { rows: 12, rank: 11, .. }), "{error}");
}

#[test]
fn pitch_of_a_right_angle_names_the_singularity() {
    let robot = vision60();
    let mut q = posture(&[0.1; 18]);
    q[4] = std::f64::consts::FRAC_PI_2;
    let mut dynamics = ContactDynamics::new(&robot.model, 0);
    let error = dynamics.motion(&robot.model, &q, &[0.0; 18], &[0.0; 18], &[]);
    let error = error.expect_err("Euler angles are singular there");
    assert!(error.to_string().contains("pitch is 1.57"), "{error}");
}
