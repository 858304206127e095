//! Plans that go to the ends of what joints may do: the controller takes every gait that is given.

use super::*;
use crate::tests::{as_steps, go_on, vision60};

/// Phases at which the controller looks at a gait before it takes it.
const LOOKED_AT: usize = 101;

/// The largest position and the largest speed of each joint type's polynomials, rad and rad/s.
fn most(gait: &Gait) -> ([f64; 3], [f64; 3]) {
    let (mut position_rad, mut velocity_rad_s) = ([f64::NEG_INFINITY; 3], [0.0_f64; 3]);
    for step in gait.schedule() {
        for n in 0..LOOKED_AT {
            let (position, velocity) = step.planned(n as f64 / (LOOKED_AT - 1) as f64);
            for j in 0..12 {
                position_rad[j % 3] = position_rad[j % 3].max(position[j]);
                velocity_rad_s[j % 3] = velocity_rad_s[j % 3].max(velocity[j].abs());
            }
        }
    }
    (position_rad, velocity_rad_s)
}

#[test]
fn a_gait_that_goes_to_the_end_of_a_joint_s_range_is_not_beyond_it_for_the_controller() {
    let free = vision60();
    let amble = as_steps("amble", &free);
    let turning = GaitRequest { yaw_rate_rad_s: 0.3, ..amble.clone() };
    let mut planned = 0;
    for request in [amble, as_steps("gait2", &free), as_steps("gait4", &free), turning] {
        let (position_rad, velocity_rad_s) = most(&plan(&free, &request, &PlanOptions::default(), go_on).unwrap().gait);
        for share in [0.98, 0.95] {
            let mut robot = free.clone();
            robot.limits.velocity_rad_s[2] = share * velocity_rad_s[2];
            for leg in &mut robot.legs {
                leg.position_max_rad[1] = leg.stand_rad[1] + share * (position_rad[1] - leg.stand_rad[1]);
            }
            let Ok(plan) = plan(&robot, &request, &PlanOptions::default(), go_on) else { continue };
            let (position_rad, velocity_rad_s) = most(&plan.gait);
            let (end_rad, limit_rad_s) = (robot.legs[0].position_max_rad[1], robot.limits.velocity_rad_s[2]);
            println!(
                "{}: {} of {end_rad} rad, {} of {limit_rad_s} rad/s",
                request.behaviour, position_rad[1], velocity_rad_s[2]
            );
            assert!(position_rad[1] <= end_rad && velocity_rad_s[2] <= limit_rad_s);
            planned += 1;
        }
    }
    assert!(planned >= 4, "only {planned} were planned at all");
}
