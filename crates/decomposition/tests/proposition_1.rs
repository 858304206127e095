//! Proposition 1 of the paper: the pair of bipeds with the connection wrench is the quadruped, for
//! any split of the torso.

mod common;

use common::{flat, generalised, numbers, posture, relative_error, scaled, vision60};
use decomposition::{Bipeds, ContactDynamics};
use proptest::prelude::*;

const SHARES: [f64; 4] = [0.0, 0.3, 0.5, 1.0];
const STANCES: [&[usize]; 7] = [&[1, 2], &[0, 3], &[2, 1, 3], &[0, 1, 2, 3], &[2, 3], &[3], &[]];

proptest! {
    #![proptest_config(common::cases(40))]

    #[test]
    fn accelerations_and_forces_are_those_of_the_whole_robot(
        x in numbers::<18>(), v in numbers::<18>(), u in numbers::<12>(),
    ) {
        let robot = vision60();
        let mut whole = ContactDynamics::new(&robot.model, 4);
        let (q, v, u) = (posture(&x), scaled(&v, 4.0), scaled(&u, 50.0));
        for stance in STANCES {
            let toes: Vec<_> = stance.iter().map(|&leg| robot.legs[leg].toe).collect();
            let expected = whole
                .motion(&robot.model, &q, &v, &generalised(&u), &toes)
                .expect("bent legs are regular");
            let mut connections = Vec::new();
            for share in SHARES {
                let mut bipeds = Bipeds::new(&robot, share).expect("a valid share");
                let pair = bipeds.motion(&q, &v, &u, stance).expect("bent legs are regular");
                let found = Bipeds::join(&pair.front, &pair.rear);
                let error = relative_error(&found, &expected.acceleration, 1.0);
                prop_assert!(error < 1e-10, "acceleration {error:e}, {stance:?}, {share}");
                let error = relative_error(&flat(&stance.iter().map(|&leg| pair.forces[leg]).collect::<Vec<_>>()), &flat(&expected.forces), 1.0);
                prop_assert!(error < 1e-10, "forces {error:e}, {stance:?}, {share}");
                prop_assert!(relative_error(&pair.front[..6], &pair.rear[..6], 1.0) < 1e-12);
                connections.push(pair.connection);
            }
            // Only the connection wrench knows how the torso was split.
            prop_assert!(relative_error(&connections[0], &connections[3], 1.0) > 1e-6);
        }
    }

    #[test]
    fn impacts_are_those_of_the_whole_robot(x in numbers::<18>(), v in numbers::<18>()) {
        let robot = vision60();
        let mut whole = ContactDynamics::new(&robot.model, 4);
        let (q, v) = (posture(&x), scaled(&v, 4.0));
        for landing in STANCES {
            let toes: Vec<_> = landing.iter().map(|&leg| robot.legs[leg].toe).collect();
            let expected =
                whole.impact(&robot.model, &q, &v, &toes).expect("bent legs are regular");
            for share in SHARES {
                let mut bipeds = Bipeds::new(&robot, share).expect("a valid share");
                let pair = bipeds.impact(&q, &v, landing).expect("bent legs are regular");
                let found = Bipeds::join(&pair.front, &pair.rear);
                let error = relative_error(&found, &expected.velocity, 1.0);
                prop_assert!(error < 1e-10, "velocity {error:e}, {landing:?}, {share}");
                let error = relative_error(&flat(&landing.iter().map(|&leg| pair.impulses[leg]).collect::<Vec<_>>()), &flat(&expected.impulses), 1.0);
                prop_assert!(error < 1e-10, "impulses {error:e}, {landing:?}, {share}");
            }
        }
    }
}
