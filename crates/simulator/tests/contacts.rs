//! The estimate of which feet carry weight against the simulation's own forces.

mod common;

use common::{Day, Shelf};
use control::ContactEstimator;

/// Walking each gait: the share of instants in which the estimate differs from the truth, and the longest time in which
/// it does without a break.
#[test]
fn the_feet_that_carry_weight_are_those_that_the_torques_tell() {
    let shelf = Shelf::new();
    let weight_n = shelf.robot.model.total_mass() * 9.81;
    for (name, _) in &shelf.gaits {
        let gait = shelf.plan_gait(name, None);
        let mut day = Day::on_gait(&shelf, (*name).into(), &gait);
        let mut estimator = ContactEstimator::new(&shelf.robot).unwrap();
        let (mut wrong, mut all, mut longest) = (0, 0, 0);
        let mut since = [0; 4];
        for n in 0..8000 {
            day.run(0.001);
            let state = day.simulator.state();
            let [roll_rad, pitch_rad, _] = state.roll_pitch_yaw();
            let (q, torque) = (&state.joint_position_rad, &state.joint_torque_nm);
            let contacts = estimator.step(q, torque, [roll_rad, pitch_rad], 1e-3);
            for leg in 0..4 {
                let differs = contacts.touches[leg] != (state.toe_force_n[leg][2] > 0.05 * weight_n);
                since[leg] = if differs { since[leg] + 1 } else { 0 };
                if n > 500 {
                    (wrong, all, longest) = (wrong + i32::from(differs), all + 1, longest.max(since[leg]));
                }
            }
        }
        let share = f64::from(wrong) / f64::from(all);
        println!("{name}: {:.1} % of the time differs, {longest} ms at most", 100.0 * share);
        assert!(share < 0.08, "{name}: {share}");
    }
}
