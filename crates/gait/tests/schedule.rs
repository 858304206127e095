//! The contact schedule against what is walked.

use gait::{Coefficients, Gait, JOINTS, LEGS, StepSide, bezier};

#[test]
fn every_leg_stands_in_one_domain_and_the_domains_are_what_is_walked() {
    let gait = Gait::from_json(include_str!("../../../tests/gaits/amble.json")).unwrap();
    let stride = gait.schedule();
    for leg in 0..LEGS {
        assert_eq!(stride.iter().filter(|domain| domain.stands[leg]).count(), 1, "leg {leg}");
    }
    for (side, domain) in StepSide::BOTH.into_iter().zip(&stride) {
        assert_eq!(side.stance_legs().map(|leg| domain.stands[leg]), [true, true]);
        assert_eq!(side.swing_legs().map(|leg| domain.stands[leg]), [false, false]);
        assert_eq!(domain.duration_s, gait.step_duration_s);
        let basis = bezier::basis(0.3);
        let at = |rows: &[Coefficients; JOINTS]| rows.map(|row| bezier::combine(&row, &basis));
        assert_eq!(at(&domain.planned_rad), gait.planned(side, 0.3).0);
        assert_eq!(at(&domain.reference_rad), gait.reference(side, 0.3).0);
    }
}
