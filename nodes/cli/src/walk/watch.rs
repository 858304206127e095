//! Eyes on the nodes' topics: puts the robot's state together, and judges it.

use anyhow::{Context, Result};
use gait::Gait;
use robot::Robot;
use ros::{Node, Qos};
use simulator::RobotState;
use simulator::measure::{Measure, WalkFigures};
use simulator::pictures;
use std::collections::{BTreeMap, HashMap};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use tandem_msgs::geometry_msgs::{Vector3, WrenchStamped};
use tandem_msgs::nav_msgs::Odometry;
use tandem_msgs::sensor_msgs::JointState;
use tandem_msgs::{ControllerState, Message};

/// A body tilted by more than this has fallen, rad; lower than this share of its nominal height too. As the simulator
/// judges.
const FALLEN_TILT_RAD: f64 = 0.8;
const FALLEN_HEIGHT_SHARE: f64 = 0.6;
/// Stamps whose messages have not all come are given up when this many newer ones are there.
const MOST_INCOMPLETE: usize = 64;

/// How a walk ended.
#[derive(Clone, Debug, PartialEq)]
pub enum Outcome {
    /// It walked to the end.
    Upright {
        /// For so long, s.
        walked_s: f64,
    },
    /// It fell.
    Fell {
        /// Since the first step, s.
        at_s: f64,
    },
    /// The controller stopped walking by itself.
    Stopped {
        /// Since the first step, s.
        at_s: f64,
        /// The controller's mode and fault.
        why: String,
    },
}

impl Outcome {
    /// Whether it walked to the end.
    pub fn upright(&self) -> bool {
        matches!(self, Self::Upright { .. })
    }
}

impl std::fmt::Display for Outcome {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Upright { walked_s } => write!(f, "upright, walked {walked_s:.1} s"),
            Self::Fell { at_s } => write!(f, "FELL at {at_s:.2} s"),
            Self::Stopped { at_s, why } => write!(f, "STOPPED at {at_s:.2} s: {why}"),
        }
    }
}

/// What a run left.
pub struct Recorded {
    /// States with base and ground forces, in the order of time.
    pub samples: Vec<report::Sample>,
    /// When the first step began, s.
    pub walking_from_s: f64,
    /// Figures of the walk.
    pub figures: WalkFigures,
    /// The controller's last word while it walked.
    pub controller: Option<ControllerState>,
    /// Joint states that did not reach us.
    pub lost_states: u64,
}

/// Parts of the state of one stamp.
#[derive(Default)]
struct Parts {
    joints: Option<JointState>,
    odometry: Option<Odometry>,
    forces: HashMap<usize, Vector3>,
}

struct Run {
    step_duration_s: f64,
    incomplete: BTreeMap<i64, Parts>,
    samples: Vec<report::Sample>,
    measure: Option<Measure>,
    walking_from_s: Option<f64>,
    fell_at_s: Option<f64>,
    /// The controller's last state while walking, and the first after it.
    walking: Option<ControllerState>,
    after: Option<ControllerState>,
    period_ns: Option<i64>,
    lost_states: u64,
    last_walking_s: f64,
}

struct Eyes {
    run: Option<Run>,
    controller: Option<ControllerState>,
    gait: Option<tandem_msgs::Gait>,
    newest_ns: i64,
    newest_joints: Option<(i64, Instant)>,
    height_m: f64,
    base_above_toes_m: f64,
    torque_limit_nm: [f64; 12],
}

/// Eyes on the nodes' topics.
pub struct Watch {
    eyes: Arc<Mutex<Eyes>>,
    started: Instant,
}

fn lock(eyes: &Mutex<Eyes>) -> MutexGuard<'_, Eyes> {
    // What is there was put there whole.
    eyes.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Watch {
    /// Subscribes to everything.
    pub fn new(node: &Node, robot: &Robot) -> Result<Self> {
        let eyes = Arc::new(Mutex::new(Eyes {
            run: None,
            controller: None,
            gait: None,
            newest_ns: 0,
            newest_joints: None,
            height_m: robot.nominal.height_m,
            base_above_toes_m: robot.toe_radius_m,
            torque_limit_nm: std::array::from_fn(|j| robot.limits.drive_torque_nm[j % 3]),
        }));
        let watch = Self { eyes, started: Instant::now() };
        let sensor = Qos::best_effort(64);
        watch.see(node, "joint_states", sensor, |eyes: &mut Eyes, message: &JointState| eyes.joints(message))?;
        watch.see(node, "odom", sensor, |eyes: &mut Eyes, message: &Odometry| {
            let stamp = message.header.stamp.nanoseconds();
            eyes.part(stamp, |parts| parts.odometry = Some(message.clone()));
        })?;
        for (leg, name) in robot.legs.iter().map(|leg| leg.name.as_str()).enumerate() {
            let topic = format!("ground_force/{name}");
            watch.see(node, &topic, sensor, move |eyes: &mut Eyes, message: &WrenchStamped| {
                let stamp = message.header.stamp.nanoseconds();
                eyes.part(stamp, |parts| {
                    parts.forces.insert(leg, message.wrench.force);
                });
            })?;
        }
        watch.see(node, "controller_state", Qos::reliable(64), |eyes: &mut Eyes, message: &ControllerState| {
            eyes.controller_state(message);
        })?;
        watch.see(node, "gait", Qos::latched(), |eyes: &mut Eyes, message: &tandem_msgs::Gait| {
            eyes.gait = Some(message.clone());
        })?;
        Ok(watch)
    }

    /// Subscribes to one topic.
    fn see<M: Message>(
        &self,
        node: &Node,
        topic: &str,
        qos: Qos,
        look: impl Fn(&mut Eyes, &M) + Send + 'static,
    ) -> Result<()> {
        let eyes = Arc::clone(&self.eyes);
        node.subscribe(topic, qos, move |message: M| look(&mut lock(&eyes), &message))?;
        Ok(())
    }

    /// Begins a run.
    pub fn begin(&self, gait: &Gait) {
        let mut eyes = lock(&self.eyes);
        eyes.run = Some(Run {
            step_duration_s: gait.step_duration_s,
            incomplete: BTreeMap::new(),
            samples: Vec::new(),
            measure: None,
            walking_from_s: None,
            fell_at_s: None,
            walking: None,
            after: None,
            period_ns: None,
            lost_states: 0,
            last_walking_s: 0.0,
        });
        eyes.newest_joints = None;
    }

    /// Ends the run.
    pub fn end(&self) -> Result<Recorded> {
        let run = lock(&self.eyes).run.take().context("no run has begun")?;
        let measure = run.measure.context("the robot never walked, or odom and ground_force were never received")?;
        let mut samples = run.samples;
        if let Some(after) = &run.after {
            // The pictures are of the walk; stopping and sitting down are in the bag.
            let end_s = after.header.stamp.seconds();
            samples.truncate(samples.partition_point(|sample| sample.time_s < end_s));
        }
        Ok(Recorded {
            samples,
            walking_from_s: run.walking_from_s.unwrap_or_default(),
            figures: measure.figures(),
            controller: run.walking,
            lost_states: run.lost_states,
        })
    }

    /// The controller's last word.
    pub fn controller(&self) -> Option<ControllerState> {
        lock(&self.eyes).controller.clone()
    }

    /// The newest gait on its topic.
    pub fn gait(&self) -> Option<tandem_msgs::Gait> {
        lock(&self.eyes).gait.clone()
    }

    /// How long no new joint state has come.
    pub fn silence(&self) -> Option<Duration> {
        let newest = lock(&self.eyes).newest_joints.map(|(_, when)| when);
        Some(newest.unwrap_or(self.started).elapsed())
    }

    /// For how long it has walked, s.
    pub fn walked_s(&self) -> f64 {
        let eyes = lock(&self.eyes);
        let from = eyes.run.as_ref().and_then(|run| run.walking_from_s);
        from.map_or(0.0, |from| eyes.newest_ns as f64 * 1e-9 - from)
    }

    /// How the walk ended, once it has.
    pub fn outcome(&self, seconds: f64) -> Option<Outcome> {
        let walked_s = self.walked_s();
        let eyes = lock(&self.eyes);
        let run = eyes.run.as_ref()?;
        if let Some(at_s) = run.fell_at_s {
            return Some(Outcome::Fell { at_s });
        }
        if let Some(after) = &run.after {
            let why =
                if after.fault.is_empty() { after.mode.clone() } else { format!("{}: {}", after.mode, after.fault) };
            return Some(Outcome::Stopped { at_s: walked_s, why });
        }
        (walked_s >= seconds).then_some(Outcome::Upright { walked_s })
    }
}

impl Eyes {
    fn joints(&mut self, message: &JointState) {
        let stamp = message.header.stamp.nanoseconds();
        let last = self.newest_joints.map(|(last, _)| last);
        if last == Some(stamp) {
            return; // published again while time stands still
        }
        self.newest_joints = Some((stamp, Instant::now()));
        self.newest_ns = self.newest_ns.max(stamp);
        if let (Some(run), Some(last)) = (&mut self.run, last) {
            let gap = stamp - last;
            if gap > 0 {
                let period = *run.period_ns.get_or_insert(gap);
                if gap < period {
                    run.period_ns = Some(gap);
                }
                run.lost_states += u64::try_from(gap / period - 1).unwrap_or_default();
            }
        }
        self.part(stamp, |parts| parts.joints = Some(message.clone()));
    }

    fn controller_state(&mut self, message: &ControllerState) {
        self.controller = Some(message.clone());
        let Some(run) = &mut self.run else { return };
        if message.mode == "walking" {
            run.walking.get_or_insert_default().clone_from(message);
            run.walking_from_s.get_or_insert_with(|| {
                // The message may come a little after the first step has begun; it says how far the step is.
                message.header.stamp.seconds() - (message.step_index as f64 + message.step_phase) * run.step_duration_s
            });
        } else if run.walking_from_s.is_some() && run.after.is_none() {
            run.after = Some(message.clone());
        }
    }

    /// Takes a part of a stamp's state; the whole state becomes a sample.
    fn part(&mut self, stamp: i64, put: impl FnOnce(&mut Parts)) {
        let Some(run) = &mut self.run else { return };
        let parts = run.incomplete.entry(stamp).or_default();
        put(parts);
        if let (Some(joints), Some(odometry), 4) = (&parts.joints, &parts.odometry, parts.forces.len()) {
            let forces = std::array::from_fn(|leg| parts.forces[&leg]);
            if let Some(state) = robot_state(joints, odometry, forces) {
                run.incomplete.remove(&stamp);
                self.whole(state);
            } else {
                run.incomplete.remove(&stamp);
            }
            return;
        }
        while run.incomplete.len() > MOST_INCOMPLETE {
            run.incomplete.pop_first();
        }
    }

    fn whole(&mut self, state: RobotState) {
        let Some(run) = &mut self.run else { return };
        if run.samples.last().is_some_and(|last| last.time_s >= state.time_s) {
            return;
        }
        run.samples.push(pictures::sample(&state));
        let Some(from) = run.walking_from_s else { return };
        if run.after.is_some() || run.fell_at_s.is_some() || state.time_s < from {
            return;
        }
        let [roll, pitch, _] = state.roll_pitch_yaw();
        let height_m = state.base_position_m[2] - self.base_above_toes_m;
        // Written so that a value that is not a number is a fall.
        let up = roll.abs().max(pitch.abs()) <= FALLEN_TILT_RAD && height_m >= FALLEN_HEIGHT_SHARE * self.height_m;
        if !up {
            run.fell_at_s = Some(state.time_s - from);
            return;
        }
        run.last_walking_s = state.time_s;
        run.measure
            .get_or_insert_with(|| Measure::new(run.step_duration_s, self.torque_limit_nm))
            .sample(&state, height_m);
    }
}

/// The state out of its messages; None where a joint state is not of twelve joints.
fn robot_state(joints: &JointState, odometry: &Odometry, forces: [Vector3; 4]) -> Option<RobotState> {
    let (p, q) = (&odometry.pose.pose.position, &odometry.pose.pose.orientation);
    let (linear, angular) = (&odometry.twist.twist.linear, &odometry.twist.twist.angular);
    let quaternion = [q.x, q.y, q.z, q.w];
    Some(RobotState {
        step: 0,
        time_s: joints.header.stamp.seconds(),
        base_position_m: [p.x, p.y, p.z],
        base_quaternion_xyzw: quaternion,
        base_linear_velocity_world: rotate(quaternion, [linear.x, linear.y, linear.z]),
        base_angular_velocity_body: [angular.x, angular.y, angular.z],
        base_specific_force_body: [0.0; 3],
        joint_position_rad: joints.position.as_slice().try_into().ok()?,
        joint_velocity_rad_s: joints.velocity.as_slice().try_into().ok()?,
        joint_torque_nm: joints.effort.as_slice().try_into().ok()?,
        toe_force_n: forces.map(|f| [f.x, f.y, f.z]),
    })
}

/// A vector in body axes, in world axes: v + 2 w (u × v) + 2 u × (u × v), with q = (u, w).
fn rotate([x, y, z, w]: [f64; 4], v: [f64; 3]) -> [f64; 3] {
    let cross =
        |a: [f64; 3], b: [f64; 3]| [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
    let u = [x, y, z];
    let once = cross(u, v);
    let twice = cross(u, once);
    std::array::from_fn(|i| v[i] + 2.0 * (w * once[i] + twice[i]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_quarter_turn_about_z_turns_x_into_y() {
        let half = std::f64::consts::FRAC_1_SQRT_2;
        let turned = rotate([0.0, 0.0, half, half], [1.0, 0.0, 0.5]);
        for (found, expected) in turned.into_iter().zip([0.0, 1.0, 0.5]) {
            assert!((found - expected).abs() < 1e-12, "{turned:?}");
        }
    }
}
