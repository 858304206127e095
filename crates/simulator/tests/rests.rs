//! Where a walk's last step leaves the feet, the robot rests; what is asked of it from there ends in no fault.

mod common;

use common::{Day, Shelf};
use control::{Mode, Request};
use gait::Gait;

/// In these steps, of one side or the other, at this phase, a stop is asked for.
const STOPS: [(bool, f64); 2] = [(false, 0.1), (true, 0.6)];

/// A walk of this gait, stopped in a step of either side.
fn rested(shelf: &Shelf, gait: &Gait, (mirrored, phase): (bool, f64)) -> Day {
    let title = format!("{} at {:.2} m/s, mirrored: {mirrored}, stopped at phase {phase}", gait.name, gait.speed_m_s());
    let mut day = Day::on_gait(shelf, title, gait);
    day.run(0.8);
    day.until("in that step", 2.0, |o| (o.step_index % 2 == 1) == mirrored && o.step_phase > phase);
    day.cycle(&[Request::Stop], None);
    day.until("standing", 2.0, |output| output.mode == Mode::Standing);
    (day.error_rad, day.tilt_rad) = (0.0, 0.0);
    day
}

fn sit(day: &mut Day) {
    day.cycle(&[Request::Sit], None);
    day.until("disarmed", 10.0, |output| output.mode == Mode::Disarmed);
}

/// The feet stand where the long step left them: going to the sitting posture joint by joint dragged them, until a hip
/// pitch was 0.38 rad from its command.
#[test]
fn tracking_error_when_it_sits_at_once_after_a_stop_out_of_a_long_step() {
    let shelf = Shelf::new();
    let mut worst_rad = 0.0_f64;
    for (name, _) in &shelf.gaits {
        for speed_m_s in [-0.2, 0.3, 0.45] {
            let gait = shelf.plan_gait(name, Some(speed_m_s));
            for stop in STOPS {
                let mut day = rested(&shelf, &gait, stop);
                sit(&mut day);
                println!("{}: joints within {:.3} rad, tilt {:.3} rad", day.title, day.error_rad, day.tilt_rad);
                worst_rad = worst_rad.max(day.error_rad);
            }
        }
    }
    assert!(worst_rad < 0.3, "{worst_rad}");
}

/// Up again half way down, off again at once, stopped before the first step: then it sits.
#[test]
fn from_feet_that_a_long_step_left_apart_every_request_is_followed() {
    let shelf = Shelf::new();
    for (name, speed_m_s) in [("gait1", 0.45), ("gait3", 0.3), ("amble", 0.45), ("amble", -0.2)] {
        let gait = shelf.plan_gait(name, Some(speed_m_s));
        for stop in STOPS {
            let mut day = rested(&shelf, &gait, stop);
            for seconds in [0.3, 0.9, 2.2] {
                day.cycle(&[Request::Sit], None);
                day.run(seconds);
                if day.controller.mode() == Mode::Disarmed {
                    day.cycle(&[Request::Arm], None);
                }
                day.cycle(&[Request::Stand], None);
                day.until("standing again", 10.0, |output| output.mode == Mode::Standing);
            }
            day.cycle(&[Request::Walk], None);
            day.run(0.4);
            day.cycle(&[Request::Stop], None);
            day.run(0.3);
            day.cycle(&[Request::Walk], None);
            day.until("walking", 5.0, |output| output.mode == Mode::Walking);
            day.run(1.0);
            day.cycle(&[Request::Stop], None);
            day.until("standing", 2.0, |output| output.mode == Mode::Standing);
            sit(&mut day);
            println!("{}: joints within {:.3} rad, tilt {:.3} rad", day.title, day.error_rad, day.tilt_rad);
        }
    }
}
