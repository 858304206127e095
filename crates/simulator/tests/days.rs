//! Days of the robot in the simulator: up, walk, one gait after another, stop, sit. What an operator may ask ends in no
//! fault.

mod common;

use common::{Day, Shelf};
use control::{Mode, PreparedGait, Request};

/// Feet that carry the robot are dragged while it sits down: on a rough ground joints lag by 0.2 rad, which is no stuck
/// joint.
#[test]
fn after_any_walk_it_stops_and_sits_down_on_smooth_and_rough_ground() {
    let shelf = Shelf::new();
    for (name, gait) in &shelf.gaits {
        for (friction, seconds) in [(0.4, 3.0), (0.8, 3.4), (1.2, 3.8)] {
            let mut day = Day::new(&shelf, format!("{name}, friction {friction}"), friction);
            day.walk(gait);
            day.run(seconds);
            day.cycle(&[Request::Stop], None);
            day.until("standing", 2.0, |output| output.mode == Mode::Standing);
            day.run(0.6);
            day.cycle(&[Request::Sit], None);
            day.until("disarmed", 10.0, |output| output.mode == Mode::Disarmed);
            assert!(day.tilt_rad < 0.25, "{}: tilted by {}", day.title, day.tilt_rad);
        }
    }
}

/// At a switch or, where the gaits are too far apart, through standing.
#[test]
fn every_gait_follows_every_other() {
    let shelf = Shelf::new();
    let mut odd = false;
    for (from, first) in &shelf.gaits {
        for (to, second) in shelf.gaits.iter().filter(|(to, _)| to != from) {
            odd = !odd;
            let mut day = Day::new(&shelf, format!("{from}, then {to}"), 0.8);
            day.walk(first);
            day.run(3.0);
            day.until("in a step of that side", 2.0, |o| (o.step_index % 2 == 1) == odd && o.step_phase > 0.5);
            let mut last = day.cycle(&[], Some(second));
            let (mut stood, mut jump) = (false, 0.0_f64);
            for _ in 0..8000 {
                let output = day.cycle(&[], None);
                stood |= output.mode != Mode::Walking;
                for j in 0..12 {
                    let moved = (output.command.position_rad[j] - last.command.position_rad[j]).abs();
                    jump = jump.max(moved / shelf.config.velocity_limit_rad_s[j] * 1e3);
                }
                last = output;
            }
            println!(
                "{}: {}, joints within {:.3} rad, tilted by at most {:.3} rad, commands at {:.2} of the velocity limit",
                day.title,
                if stood { "through standing" } else { "at a switch" },
                day.error_rad,
                day.tilt_rad,
                jump
            );
            assert_eq!(last.mode, Mode::Walking, "{}", day.title);
            assert_eq!(day.controller.gait().map(PreparedGait::name), Some(second.name()), "{}", day.title);
            assert!(jump < 0.6 && day.tilt_rad < 0.25, "{}", day.title);
        }
    }
}
