//! `body_pose`: where the body of a robot that stands is to be, against the posture that it holds.

use crate::inputs::{InputProblems, Topic};
use crate::lease::Gate;
use control::{BodyPose, BodyPoseAnswer, Output, is_unit_length};
use realtime::monotonic_now;
use ros::{Node, Qos, RosError};
use rtrb::{Consumer, Producer, RingBuffer};
use std::time::Duration;
use tandem_msgs::geometry_msgs::Pose;

/// Poses that may wait for the cycle, which takes the newest.
const DEPTH: usize = 64;
/// A pose that waited for its cycle for longer is not heeded: the robot does not move when nobody expects it.
const PATIENCE: Duration = Duration::from_millis(500);
/// What counts as none: rounding of programs that compute a pose.
const NOTHING_M: f64 = 1e-6;

/// A pose and when it came in, on the monotonic clock.
type Timed = (BodyPose, Duration);

/// The cycle's end.
pub struct BodyPoses(Consumer<Timed>);

impl Default for BodyPoses {
    /// Nobody asks.
    fn default() -> Self {
        Self(RingBuffer::new(1).1)
    }
}

impl BodyPoses {
    /// Subscribes to the topic.
    ///
    /// # Errors
    /// What the middleware refuses.
    pub fn listen(node: &Node, gate: Gate) -> Result<Self, RosError> {
        let (mut poses, consumer) = RingBuffer::new(DEPTH);
        // Whoever publishes best effort or reliably is received.
        let take = move |publisher, message: Pose| {
            if gate.heeds(Topic::BodyPose, publisher) {
                take(&message, &mut poses, &gate.problems, monotonic_now());
            }
        };
        node.subscribe_from("body_pose", Qos::best_effort(10), take, |_| {})?;
        Ok(Self(consumer))
    }

    /// The newest since the last cycle. In lockstep time may stand still: there none is too old.
    pub fn newest(&mut self, wall: Duration, lockstep: bool) -> Option<BodyPose> {
        let mut newest = None;
        while let Ok((pose, received)) = self.0.pop() {
            newest = (lockstep || wall.saturating_sub(received) <= PATIENCE).then_some(pose);
        }
        newest
    }
}

fn take(message: &Pose, poses: &mut Producer<Timed>, problems: &InputProblems, wall: Duration) {
    match body_pose(message) {
        // A full buffer: no cycle runs, and what waits will be too old for the next one.
        Ok(pose) => drop(poses.push((pose, wall))),
        Err(problem) => problems.note(Topic::BodyPose, format!("refused: {problem}"), wall),
    }
}

fn body_pose(message: &Pose) -> Result<BodyPose, String> {
    let (at, q) = (&message.position, &message.orientation);
    // Written so that NaN is refused too.
    if !(at.x.abs() <= NOTHING_M && at.y.abs() <= NOTHING_M && at.z.is_finite()) {
        return Err(format!(
            "position x {}, y {}, z {}: expected x and y 0 and a finite z, the height against the posture",
            at.x, at.y, at.z
        ));
    }
    let length = (q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w).sqrt();
    if !is_unit_length(length) {
        return Err(format!(
            "the orientation (x {}, y {}, z {}, w {}) has the length {length}: expected 1",
            q.x, q.y, q.z, q.w
        ));
    }
    let (x, y, z, w) = (q.x / length, q.y / length, q.z / length, q.w / length);
    // R = Rz(yaw) Ry(pitch) Rx(roll), as tf2 has it.
    Ok(BodyPose {
        height_m: at.z,
        roll_rad: (2.0 * (w * x + y * z)).atan2(1.0 - 2.0 * (x * x + y * y)),
        pitch_rad: (2.0 * (w * y - z * x)).clamp(-1.0, 1.0).asin(),
        yaw_rad: (2.0 * (w * z + x * y)).atan2(1.0 - 2.0 * (y * y + z * z)),
    })
}

/// Keeps what became of a pose for where a user looks.
pub fn note_answer(output: &Output, problems: &InputProblems) {
    match output.body_pose_answer {
        None => {}
        Some(BodyPoseAnswer::Taken) => problems.is_fine(Topic::BodyPose),
        Some(answer) => problems.note(Topic::BodyPose, answer.text().to_owned(), monotonic_now()),
    }
}

/// Where the body is, for diagnostics.
pub fn shown(output: &Output) -> String {
    let BodyPose { height_m, roll_rad, pitch_rad, yaw_rad } = output.body_pose;
    format!("height {height_m:.3} m, roll {roll_rad:.3}, pitch {pitch_rad:.3}, yaw {yaw_rad:.3} rad")
}

#[cfg(test)]
mod tests {
    use super::*;
    use tandem_msgs::geometry_msgs::{Point, Quaternion};

    #[test]
    fn a_pose_is_taken_apart_as_tf2_does_and_what_cannot_be_is_refused_by_what_it_is() {
        // Rz(0.3) Ry(−0.2) Rx(0.1).
        let q = Quaternion { x: 0.064071348, y: -0.091157549, z: 0.153439302, w: 0.981856173 };
        let message = Pose { position: Point { x: 0.0, y: 0.0, z: -0.05 }, orientation: q };
        let pose = body_pose(&message).unwrap();
        for (found, expected) in pose.numbers().into_iter().zip([-0.05, 0.1, -0.2, 0.3]) {
            assert!((found - expected).abs() < 1e-6, "{pose:?}");
        }
        let of = |position: Point, orientation: Quaternion| body_pose(&Pose { position, orientation }).unwrap_err();
        let still = Quaternion { x: 0.0, y: 0.0, z: 0.0, w: 1.0 };
        assert!(of(Point { x: 0.1, y: 0.0, z: 0.0 }, still).contains("expected x and y 0"));
        assert!(of(Point { x: 0.0, y: 0.0, z: f64::NAN }, still).contains("a finite z"));
        let none = Quaternion { w: 0.0, ..still };
        assert!(of(Point::default(), none).contains("has the length 0: expected 1"));
        assert!(of(Point::default(), Quaternion { x: f64::NAN, ..still }).contains("expected 1"));
    }

    #[test]
    fn a_pose_that_waited_while_no_cycle_ran_is_not_heeded() {
        let problems = InputProblems::default();
        let received = Duration::from_secs(100);
        let at = |waited: Duration, lockstep: bool| {
            let (mut producer, consumer) = RingBuffer::new(2);
            let still = Quaternion { x: 0.0, y: 0.0, z: 0.0, w: 1.0 };
            let position = Point { x: 0.0, y: 0.0, z: 0.01 };
            take(&Pose { position, orientation: still }, &mut producer, &problems, received);
            BodyPoses(consumer).newest(received + waited, lockstep)
        };
        let pose = BodyPose { height_m: 0.01, ..BodyPose::default() };
        assert_eq!(at(Duration::from_millis(400), false), Some(pose));
        assert_eq!(at(Duration::from_millis(600), false), None);
        assert_eq!(at(Duration::from_secs(60), true), Some(pose));
    }
}
