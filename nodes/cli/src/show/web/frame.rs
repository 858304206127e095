//! What is sent to a page, as JSON: lengths in mm, forces in N, angles in degrees.

use super::button::State;
use crate::show::Received;
use crate::show::shapes::{Shapes, rotate};
use serde_json::{Value, json};
use std::time::{Duration, Instant};

/// Diagnostics that were not repeated for so long are no longer shown.
const DIAGNOSTICS_KEPT: Duration = Duration::from_secs(10);
/// Characters of a text on the page.
const TEXT_CHARS: usize = 200;

/// Numbers the frames and gives them their time.
pub struct Frames {
    begun: Instant,
    number: u64,
}

fn age_s(at: Option<Instant>) -> Value {
    at.map_or(Value::Null, |at| json!((at.elapsed().as_secs_f64() * 100.0).round() / 100.0))
}

fn mm(point: [f64; 3]) -> [i64; 3] {
    point.map(|value| (value * 1e3).round() as i64)
}

fn short(text: &str) -> &str {
    text.char_indices().nth(TEXT_CHARS).map_or(text, |(end, _)| &text[..end])
}

/// Largest absolute value; 0 for none.
fn largest(values: &[f64]) -> f64 {
    values.iter().fold(0.0, |most, value| most.max(value.abs()))
}

impl Frames {
    /// From now on.
    pub fn new() -> Self {
        Frames { begun: Instant::now(), number: 0 }
    }

    /// The next frame.
    pub fn next(&mut self, shapes: &mut Shapes, received: &Received, stop: &State) -> String {
        self.number += 1;
        let q = received.base_orientation();
        let legs = shapes.leg_points(received);
        // Without odometry the robot stands where its lowest toe touches the floor.
        let base = received.odometry.as_ref().map_or_else(
            || [0.0, 0.0, legs.iter().flatten().fold(0.0, |height: f64, point| height.max(-point[2]))],
            |odometry| {
                let p = odometry.pose.pose.position;
                [p.x, p.y, p.z]
            },
        );
        let world = |point: [f64; 3]| {
            let turned = rotate(q, point);
            mm(std::array::from_fn(|i| base[i] + turned[i]))
        };
        let points = legs.map(|legs| std::iter::once(mm(base)).chain(legs.map(world)).flatten().collect::<Vec<_>>());
        let paths = shapes.swing_paths(received).map(|path| path.into_iter().flat_map(world).collect::<Vec<_>>());
        let forces = received.force_n.map(|force| force.map(|force| force.map(f64::round)));
        let frame = json!({
            "n": self.number,
            "t": (self.begun.elapsed().as_secs_f64() * 1e4).round() / 10.0,
            "age": {
                "joints": age_s(received.at.joints),
                "odom": age_s(received.at.odometry),
                "force": age_s(received.at.forces),
                "state": age_s(received.at.state),
            },
            "points": points,
            "force": forces,
            "path": paths,
            "body": body(received, q),
            "state": state(received),
            "diagnostics": diagnostics(received),
            "stop": { "pressed": stop.pressed, "listeners": stop.listeners, "failure": stop.failure },
        });
        frame.to_string()
    }
}

fn body(received: &Received, [x, y, z, w]: [f64; 4]) -> Value {
    let Some(odometry) = &received.odometry else { return Value::Null };
    let twist = odometry.twist.twist;
    let roll = (2.0 * (w * x + y * z)).atan2(1.0 - 2.0 * (x * x + y * y)).to_degrees();
    let pitch = (2.0 * (w * y - z * x)).clamp(-1.0, 1.0).asin().to_degrees();
    json!({
        "ahead": twist.linear.x,
        "left": twist.linear.y,
        "turn": twist.angular.z.to_degrees(),
        "height": odometry.pose.pose.position.z,
        "roll": roll,
        "pitch": pitch,
    })
}

fn state(received: &Received) -> Value {
    let Some(state) = &received.state else { return Value::Null };
    json!({
        "mode": short(&state.mode),
        "fault": short(&state.fault),
        "gait": short(&state.gait),
        "step": state.step_index,
        "phase": state.step_phase,
        "error": largest(&state.tracking_error_rad),
        "torque": largest(&state.commanded_torque_nm),
        "missed": state.missed_cycles,
        "stale": state.stale_inputs,
    })
}

fn diagnostics(received: &Received) -> Vec<Value> {
    let fresh = |at: &Instant| at.elapsed() < DIAGNOSTICS_KEPT;
    let known = received.diagnostics.iter().filter(|(_, (_, _, at))| fresh(at));
    known.map(|(name, (level, text, _))| json!([level, short(name), short(text)])).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use gait::LEGS;
    use std::path::Path;
    use tandem_msgs::nav_msgs::Odometry;
    use tandem_msgs::sensor_msgs::JointState;

    fn frame(shapes: &mut Shapes, received: &Received) -> Value {
        let stop = State { pressed: false, listeners: 1, failure: None };
        serde_json::from_str(&Frames::new().next(shapes, received, &stop)).unwrap()
    }

    #[test]
    fn a_frame_holds_the_robot_where_odometry_says_and_on_the_floor_without_it() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/robots/vision60");
        let mut shapes = Shapes::new(robot::Robot::load(&folder).unwrap()).unwrap();
        let mut received = Received::default();
        let nothing = frame(&mut shapes, &received);
        assert!(nothing["points"].is_null() && nothing["state"].is_null() && nothing["age"]["joints"].is_null());

        let name = shapes.robot.joint_names().to_vec();
        received.joints = Some(JointState { position: vec![0.0; name.len()], name, ..JointState::default() });
        let points = |frame: &Value| -> Vec<[i64; 3]> {
            let all: Vec<i64> = frame["points"].as_array().unwrap().iter().map(|n| n.as_i64().unwrap()).collect();
            all.as_chunks().0.to_vec()
        };
        let standing = points(&frame(&mut shapes, &received));
        assert_eq!(standing.len(), 1 + 4 * LEGS);
        assert_eq!(standing.iter().map(|point| point[2]).min(), Some(0), "the lowest toe is on the floor");

        // Turned to the left by a quarter, at (2, 3): what was ahead is to the left now.
        let mut odometry = Odometry::default();
        let half = std::f64::consts::FRAC_PI_4;
        (odometry.pose.pose.orientation.z, odometry.pose.pose.orientation.w) = half.sin_cos();
        (odometry.pose.pose.position.x, odometry.pose.pose.position.y) = (2.0, 3.0);
        odometry.pose.pose.position.z = standing[0][2] as f64 * 1e-3;
        received.odometry = Some(odometry);
        let turned = points(&frame(&mut shapes, &received));
        for (before, after) in standing.iter().zip(&turned) {
            let expected = [2000 - before[1], 3000 + before[0], before[2]];
            assert!(expected.iter().zip(after).all(|(a, b)| (a - b).abs() <= 2), "{before:?} {after:?}");
        }
    }
}
