//! Reading a run for a report: from a bag that [`run_recorder::RunRecorder`] wrote, or one recorded from the topics of
//! the nodes.

use std::path::{Path, PathBuf};

use bag::{Bag, BagTopic, from_cdr};
use gait::{Gait, JOINTS, LEG_NAMES, LEGS};
use report::Sample;
use run_recorder::{Continuity, names};
use tandem_msgs::geometry_msgs::WrenchStamped;
use tandem_msgs::nav_msgs::Odometry;
use tandem_msgs::sensor_msgs::JointState;

use crate::ReplayError;
use crate::continuity::cycle_time;
use crate::cycle::{control_cycle, controller_state};

/// A time between two cycles that is worth telling: an overrun on CAN (docs/safety.md).
const HOLE: std::time::Duration = std::time::Duration::from_millis(10);

/// A run out of a bag. Times are seconds since the bag's first message.
#[derive(Clone, Debug)]
pub struct BehaviourRun {
    /// The bag.
    pub path: PathBuf,
    /// The gait that was walked last, if the bag holds one.
    pub gait: Option<Gait>,
    /// One sample for each joint state; parts that the bag does not hold are zero.
    pub samples: Vec<Sample>,
    /// The bag's first stamp, s since the epoch; of a simulation that begins its time at zero: since its own beginning.
    pub begun_s: f64,
    /// Whether base position, orientation and velocity are known.
    pub has_body: bool,
    /// Whether they are the truth, and not the controller's estimate.
    pub has_truth: bool,
    /// Whether ground forces are known.
    pub has_ground: bool,
    /// Whether torques are known.
    pub has_torque: bool,
    /// When the robot began to walk; the first sample's time if the bag does not say.
    pub walking_from_s: f64,
    /// When it stopped walking after that; the last sample's time if it did not.
    pub walking_to_s: f64,
    /// What happened: mode changes, requests, gaits, faults.
    pub events: Vec<(f64, String)>,
    /// Time and largest |commanded minus measured position| over the joints, rad, by the controller's own account.
    pub tracking_error: Vec<(f64, f64)>,
    /// Times between one control cycle and the next, s, on the controller's clock.
    pub cycle_intervals_s: Vec<f64>,
    /// Control cycles that are missing between the first and the last recorded.
    pub missing_cycles: u64,
    /// The robot's URDF, if the bag holds one.
    pub robot_description: Option<String>,
}

/// What became known at one moment, in the order in which the one leads to the other.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Kind {
    /// What came in: requests, gaits, and cycles that did not.
    Came,
    Fault,
    Mode,
}

type Event = (f64, Kind, String);

#[derive(Default)]
struct Found {
    joints: Vec<(f64, JointState)>,
    body: Vec<(f64, Odometry)>,
    truth: Vec<(f64, Odometry)>,
    ground: [Vec<(f64, f64)>; LEGS],
    gait: Option<Gait>,
    modes: Vec<(f64, String)>,
    events: Vec<Event>,
    tracking_error: Vec<(f64, f64)>,
    cycle_times_s: Vec<f64>,
    continuity: Continuity,
    robot_description: Option<String>,
}

/// Reads a run.
///
/// # Errors
/// [`ReplayError::NoRun`] if the bag holds no joint states of twelve joints; [`ReplayError::BadMessage`].
pub fn read_run(path: impl AsRef<Path>) -> Result<BehaviourRun, ReplayError> {
    let path = path.as_ref();
    let bag = Bag::open(path)?;
    let start_ns = bag.span_ns().map_or(0, |(start, _)| start);
    let mut found = Found::default();
    for message in bag.messages()? {
        let message = message?;
        let topic = &bag.topics()[message.topic];
        let time_s = (message.stamp_ns - start_ns) as f64 * 1e-9;
        found.take(topic, time_s, &message.data).map_err(|problem| ReplayError::BadMessage {
            path: path.to_owned(),
            topic: topic.name.clone(),
            time_s,
            problem,
        })?;
    }
    let problem = "there is no joint state of twelve joints in it; expected a recording of a walking robot";
    if found.joints.is_empty() {
        return Err(ReplayError::NoRun { path: path.to_owned(), problem: problem.into() });
    }
    Ok(found.into_run(path, start_ns as f64 * 1e-9))
}

impl Found {
    fn take(&mut self, topic: &BagTopic, time_s: f64, data: &[u8]) -> Result<(), String> {
        let text = |error: bag::BagError| error.to_string();
        let is = |name: &str, type_name: &str| names::is(&topic.name, name) && topic.type_name == type_name;
        if is(names::JOINT_STATES, "sensor_msgs/msg/JointState") {
            let state: JointState = from_cdr(&topic.type_name, data).map_err(text)?;
            if state.position.len() == JOINTS && state.velocity.len() == JOINTS {
                self.joints.push((time_s, state));
            }
        } else if is(names::GROUND_TRUTH, "nav_msgs/msg/Odometry") {
            self.truth.push((time_s, from_cdr(&topic.type_name, data).map_err(text)?));
        } else if is(names::ODOM, "nav_msgs/msg/Odometry") {
            self.body.push((time_s, from_cdr(&topic.type_name, data).map_err(text)?));
        } else if is(names::CONTROL_CYCLE, "tandem_msgs/msg/ControlCycle") {
            let cycle = control_cycle(topic, data).map_err(text)?;
            let now = cycle_time(&cycle)?;
            self.cycle_times_s.push(now.as_secs_f64());
            let (hole, missing) = self.continuity.cycle(now, cycle.index);
            if missing > 0 {
                self.events.push((
                    time_s,
                    Kind::Came,
                    format!("{missing} cycles not recorded, {:.3} s", hole.as_secs_f64()),
                ));
            } else if hole > HOLE {
                self.events.push((time_s, Kind::Came, format!("no control cycle for {:.3} s", hole.as_secs_f64())));
            }
            self.mode(time_s, &cycle.mode);
            self.events
                .extend(cycle.requests.iter().map(|request| (time_s, Kind::Came, format!("asked to {request}"))));
            if !cycle.fault.is_empty() {
                self.events.push((time_s, Kind::Fault, format!("fault below: {}", cycle.fault)));
            }
        } else if is(names::CONTROLLER_STATE, "tandem_msgs/msg/ControllerState") {
            let state = controller_state(topic, data).map_err(text)?;
            self.mode(time_s, &state.mode);
            let largest = state.tracking_error_rad.iter().fold(0.0_f64, |largest, error| largest.max(error.abs()));
            self.tracking_error.push((time_s, largest));
            if !state.fault.is_empty()
                && !self.events.iter().any(|(_, kind, event)| *kind == Kind::Fault && event.ends_with(&state.fault))
            {
                self.events.push((time_s, Kind::Fault, format!("fault: {}", state.fault)));
            }
        } else if is(names::GAIT_FILE, "std_msgs/msg/String") {
            let message: tandem_msgs::std_msgs::String = from_cdr(&topic.type_name, data).map_err(text)?;
            self.gait(time_s, Gait::from_json(&message.data).map_err(|error| error.to_string())?);
        } else if is("gait", "tandem_msgs/msg/Gait") {
            let message = crate::cycle::gait(topic, data).map_err(text)?;
            self.gait(time_s, message.to_gait().map_err(|error| error.to_string())?);
        } else if is(names::ROBOT_DESCRIPTION, "std_msgs/msg/String") {
            let message: tandem_msgs::std_msgs::String = from_cdr(&topic.type_name, data).map_err(text)?;
            self.robot_description = Some(message.data);
        } else if topic.type_name == "geometry_msgs/msg/WrenchStamped" {
            for (leg, name) in LEG_NAMES.iter().enumerate() {
                if names::is(&topic.name, &format!("{}/{name}", names::GROUND_FORCE)) {
                    let message: WrenchStamped = from_cdr(&topic.type_name, data).map_err(text)?;
                    self.ground[leg].push((time_s, message.wrench.force.z));
                }
            }
        }
        Ok(())
    }

    fn mode(&mut self, time_s: f64, mode: &str) {
        if self.modes.last().is_none_or(|(_, last)| last != mode) {
            self.modes.push((time_s, mode.to_owned()));
            self.events.push((time_s, Kind::Mode, mode.replace('_', " ")));
        }
    }

    fn gait(&mut self, time_s: f64, gait: Gait) {
        self.events.push((time_s, Kind::Came, format!("gait {}", gait.name)));
        self.gait = Some(gait);
    }

    fn into_run(mut self, path: &Path, begun_s: f64) -> BehaviourRun {
        // An estimate says how sure it is.
        let mut has_truth = self.body.iter().all(|(_, body)| body.pose.covariance.0[0] == 0.0);
        if !self.truth.is_empty() {
            (self.body, has_truth) = (std::mem::take(&mut self.truth), true);
        }
        let (has_body, has_ground) = (!self.body.is_empty(), self.ground.iter().all(|leg| !leg.is_empty()));
        let has_torque = self.joints.iter().all(|(_, state)| state.effort.len() == JOINTS);
        let mut body_at = 0;
        let mut ground_at = [0; LEGS];
        let mut samples: Vec<Sample> = Vec::with_capacity(self.joints.len());
        for (time_s, state) in &self.joints {
            if samples.last().is_some_and(|last| last.time_s >= *time_s) {
                continue; // two states with one stamp: the first counts
            }
            let twelve = |values: &[f64]| std::array::from_fn(|joint| values.get(joint).copied().unwrap_or(0.0));
            let mut sample = Sample {
                time_s: *time_s,
                base_position_m: [0.0; 3],
                base_roll_pitch_yaw_rad: [0.0; 3],
                base_linear_velocity_m_s: [0.0; 3],
                joint_position_rad: twelve(&state.position),
                joint_velocity_rad_s: twelve(&state.velocity),
                joint_torque_nm: twelve(&state.effort),
                ground_force_n: [0.0; LEGS],
            };
            if let Some((_, body)) = latest(&self.body, &mut body_at, *time_s) {
                take_body(&mut sample, body);
            }
            for leg in 0..LEGS {
                if let Some((_, force)) = latest(&self.ground[leg], &mut ground_at[leg], *time_s) {
                    sample.ground_force_n[leg] = *force;
                }
            }
            samples.push(sample);
        }
        let first_s = samples.first().map_or(0.0, |sample| sample.time_s);
        let walking = self.modes.iter().find(|(_, mode)| mode == "walking").map(|(time_s, _)| *time_s);
        let last_s = samples.last().map_or(first_s, |sample| sample.time_s);
        let after =
            walking.and_then(|from_s| self.modes.iter().find(|(time_s, mode)| *time_s > from_s && mode != "walking"));
        // Causes before effects.
        self.events.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        BehaviourRun {
            path: path.to_owned(),
            gait: self.gait,
            samples,
            begun_s,
            has_body,
            has_truth: has_body && has_truth,
            has_ground,
            has_torque,
            walking_from_s: walking.unwrap_or(first_s),
            walking_to_s: after.map_or(last_s, |(time_s, _)| *time_s),
            events: self.events.into_iter().map(|(time_s, _, text)| (time_s, text)).collect(),
            tracking_error: self.tracking_error,
            cycle_intervals_s: self.cycle_times_s.windows(2).map(|pair| pair[1] - pair[0]).collect(),
            missing_cycles: self.continuity.missing,
            robot_description: self.robot_description,
        }
    }
}

/// The last entry at or before `time_s`; the first one if all are later. `at` goes on from call to call.
fn latest<'a, T>(entries: &'a [(f64, T)], at: &mut usize, time_s: f64) -> Option<&'a (f64, T)> {
    while entries.get(*at + 1).is_some_and(|next| next.0 <= time_s) {
        *at += 1;
    }
    entries.get(*at)
}

fn take_body(sample: &mut Sample, body: &Odometry) {
    let (p, q, v) = (&body.pose.pose.position, &body.pose.pose.orientation, &body.twist.twist.linear);
    let (x, y, z, w) = (q.x, q.y, q.z, q.w);
    sample.base_position_m = [p.x, p.y, p.z];
    sample.base_roll_pitch_yaw_rad = [
        (2.0 * (w * x + y * z)).atan2(1.0 - 2.0 * (x * x + y * y)),
        (2.0 * (w * y - z * x)).clamp(-1.0, 1.0).asin(),
        (2.0 * (w * z + x * y)).atan2(1.0 - 2.0 * (y * y + z * z)),
    ];
    // The odometry's twist is in the base's axes (REP 105): v_world = R v_base.
    let rows = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ];
    sample.base_linear_velocity_m_s = rows.map(|row| row[0] * v.x + row[1] * v.y + row[2] * v.z);
}
