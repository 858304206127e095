//! Writing a run.

use std::path::Path;
use std::time::Duration;

use control::{Config, InertialState, Input, JOINTS, Mode, Output, Snapshot, Velocity, VelocityCommand, resolution};
use gait::{Gait, LEGS};
use recorder::{BagError, Qos, Recorder, RecorderOptions, RecorderStatus, Summary, Topic};
use tandem_msgs::builtin_interfaces::Time;
use tandem_msgs::geometry_msgs::{Point, Quaternion, Vector3, WrenchStamped};
use tandem_msgs::nav_msgs::Odometry;
use tandem_msgs::sensor_msgs::JointState;
use tandem_msgs::std_msgs::Header;
use tandem_msgs::{ControlCycle, ControllerState, JointCommand};

use crate::names::{self, request_word};

/// How often `controller_state` is written while the mode stays.
const STATE_PERIOD: Duration = Duration::from_millis(20);

/// What a run is about.
#[derive(Clone, Copy, Debug)]
pub struct RunInfo<'a> {
    /// The configuration that the controller was made with.
    pub config: &'a Config,
    /// The robot's URDF.
    pub robot_description: &'a str,
    /// Names of the legs, in order: they name the ground forces' topics.
    pub leg_names: [&'a str; LEGS],
    /// Nanoseconds from the recording clock's epoch to the controller clock's zero: 0 in simulation; on a robot, where
    /// the controller runs on monotonic time, what wall time was at that zero.
    pub epoch_ns: u64,
}

/// The base and the ground, where they are known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BodySample {
    /// On the controller's clock.
    pub time: Duration,
    /// Base origin in the world, m.
    pub position_m: [f64; 3],
    /// Base orientation, world from base, (x, y, z, w).
    pub quaternion_xyzw: [f64; 4],
    /// Velocity of the base origin in the base's axes, m/s (as in nav_msgs/Odometry).
    pub linear_velocity_body: [f64; 3],
    /// Angular velocity in the base's axes, rad/s.
    pub angular_velocity_body: [f64; 3],
    /// Ground forces on the toes, world axes, N; `None` where they are not measured.
    pub ground_force_n: Option<[[f64; 3]; LEGS]>,
}

/// Records a run, from its first cycle on: a run that is to be verified is recorded whole.
#[derive(Debug)]
pub struct RunRecorder {
    recorder: Recorder,
    epoch_ns: u64,
    /// The bag's stamp of what came last; none before the first cycle.
    last_stamp_ns: Option<u64>,
    joint_names: Vec<String>,
    joint_states: Topic,
    joint_command: Topic,
    control_cycle: Topic,
    controller_state: Topic,
    gait_file: Topic,
    odom: Topic,
    ground_force: [Topic; LEGS],
    last_state: Option<Duration>,
    /// What the cycle recorded last saw of the inertial unit.
    last_inertial: Option<InertialState>,
    /// What velocity it was asked for.
    last_velocity: Option<VelocityCommand>,
    last_written_state: Option<(Duration, Mode)>,
    gaits: u32,
    gait_name: String,
    /// What was sent before the first cycle, which alone gives the time.
    before: Vec<(Topic, String)>,
}

impl RunRecorder {
    /// Begins a bag in `folder`, which must be empty or not there.
    ///
    /// # Errors
    /// As [`Recorder::start`].
    pub fn start(folder: impl AsRef<Path>, info: &RunInfo, options: RecorderOptions) -> Result<RunRecorder, BagError> {
        let recorder = Recorder::start(folder, options)?;
        let force =
            |leg: &str| recorder.topic_of::<WrenchStamped>(&format!("/{}/{leg}", names::GROUND_FORCE), Qos::sensor(1));
        let [a, b, c, d] = info.leg_names;
        let full = |name: &str| format!("/{name}");
        let mut run = RunRecorder {
            epoch_ns: info.epoch_ns,
            last_stamp_ns: None,
            joint_names: info.config.joint_names.to_vec(),
            joint_states: recorder.topic_of::<JointState>(&full(names::JOINT_STATES), Qos::sensor(1))?,
            joint_command: recorder.topic_of::<JointCommand>(&full(names::JOINT_COMMAND), Qos::sensor(1))?,
            control_cycle: recorder.topic_of::<ControlCycle>(&full(names::CONTROL_CYCLE), Qos::sensor(1))?,
            controller_state: recorder
                .topic_of::<ControllerState>(&full(names::CONTROLLER_STATE), Qos::reliable(10))?,
            gait_file: recorder.topic_of::<tandem_msgs::std_msgs::String>(&full(names::GAIT_FILE), Qos::latched())?,
            odom: recorder.topic_of::<Odometry>(&full(names::ODOM), Qos::sensor(1))?,
            ground_force: [force(a)?, force(b)?, force(c)?, force(d)?],
            last_state: None,
            last_inertial: None,
            last_velocity: None,
            last_written_state: None,
            gaits: 0,
            gait_name: String::new(),
            before: Vec::new(),
            recorder,
        };
        let config = serde_json::to_string(info.config).map_err(|error| BagError::Cdr {
            name: names::CONTROLLER_CONFIG.into(),
            action: "written as",
            reason: error.to_string(),
        })?;
        for (name, text) in
            [(names::CONTROLLER_CONFIG, config.as_str()), (names::ROBOT_DESCRIPTION, info.robot_description)]
        {
            let topic = run.recorder.topic_of::<tandem_msgs::std_msgs::String>(&full(name), Qos::latched())?;
            run.text(&topic, text)?;
        }
        Ok(run)
    }

    /// The bag's folder.
    pub fn folder(&self) -> &Path {
        self.recorder.folder()
    }

    /// Says where the controller was before the first cycle that is recorded. Without it the recording must begin with
    /// the controller's first cycle. Gives whether it was taken.
    ///
    /// # Errors
    /// [`BagError`] if it has no JSON or CDR form, which no snapshot lacks.
    pub fn snapshot(&mut self, snapshot: &Snapshot) -> Result<bool, BagError> {
        let topic = self.topic::<tandem_msgs::std_msgs::String>(names::CONTROLLER_SNAPSHOT, Qos::latched())?;
        let text = serde_json::to_string(snapshot).map_err(|error| BagError::Cdr {
            name: names::CONTROLLER_SNAPSHOT.into(),
            action: "written as",
            reason: error.to_string(),
        })?;
        self.text(&topic, &text)
    }

    /// Declares a topic for messages from elsewhere: `name` without the slash in front.
    ///
    /// # Errors
    /// As [`Recorder::topic_of`].
    pub fn topic<M: tandem_msgs::Message>(&self, name: &str, qos: Qos) -> Result<Topic, BagError> {
        self.recorder.topic_of::<M>(&format!("/{}", name.trim_start_matches('/')), qos)
    }

    /// A message from elsewhere, already in CDR. Its place in the bag is after the cycle recorded last; before the
    /// first cycle it has none and is left out. Gives whether it was taken.
    pub fn other(&mut self, topic: &Topic, cdr: Vec<u8>) -> bool {
        self.last_stamp_ns.is_none_or(|stamp_ns| self.recorder.push(topic, stamp_ns, cdr))
    }

    fn text(&mut self, topic: &Topic, text: &str) -> Result<bool, BagError> {
        let Some(stamp_ns) = self.last_stamp_ns else {
            self.before.push((topic.clone(), text.to_owned()));
            return Ok(true);
        };
        let message = tandem_msgs::std_msgs::String { data: text.to_owned() };
        self.recorder.push_message(topic, stamp_ns, &message)
    }

    /// The bag's stamp of something at `time`. It never falls, so that a bag is read in the order in which it was
    /// written even if the clock went backwards; the message's own stamp is right. At the first time that is
    /// told, everything that was sent before is written.
    fn stamp_ns(&mut self, time: Duration) -> Result<u64, BagError> {
        let stamp_ns = self.epoch_ns.saturating_add(time.as_nanos().try_into().unwrap_or(u64::MAX));
        let stamp_ns = self.last_stamp_ns.unwrap_or(0).max(stamp_ns);
        self.last_stamp_ns = Some(stamp_ns);
        for (topic, data) in std::mem::take(&mut self.before) {
            let message = tandem_msgs::std_msgs::String { data };
            self.recorder.push_message(&topic, stamp_ns, &message)?;
        }
        Ok(stamp_ns)
    }

    /// A gait that is about to be handed to the controller: before the cycle whose input holds it. Gives whether it was
    /// taken.
    ///
    /// # Errors
    /// [`BagError`] if it has no CDR form, which no gait lacks.
    pub fn gait(&mut self, gait: &Gait) -> Result<bool, BagError> {
        self.gaits += 1;
        self.gait_name.clone_from(&gait.name);
        self.text(&self.gait_file.clone(), &gait.to_json())
    }

    /// One cycle: what [`control::Controller::step`] read and returned. `effort_nm`: the drives' torques with the
    /// state, where they are measured. Gives whether all of it was taken.
    ///
    /// # Errors
    /// [`BagError`] if it has no CDR form, which no cycle lacks.
    pub fn cycle(
        &mut self,
        now: Duration,
        input: &Input,
        output: &Output,
        effort_nm: Option<&[f64; JOINTS]>,
    ) -> Result<bool, BagError> {
        let stamp_ns = self.stamp_ns(now)?;
        let mut taken = true;
        if let Some(state) = input.joints
            && self.last_state != Some(state.stamp)
        {
            self.last_state = Some(state.stamp);
            let message = JointState {
                header: header(state.stamp),
                name: self.joint_names.clone(),
                position: state.position_rad.to_vec(),
                velocity: state.velocity_rad_s.to_vec(),
                effort: effort_nm.map_or(Vec::new(), |effort| effort.map(resolution::measured_torque_nm).to_vec()),
            };
            taken &= self.recorder.push_message(&self.joint_states, stamp_ns, &message)?;
        }
        let message = self.command_message(output);
        taken &= self.recorder.push_message(&self.joint_command, stamp_ns, &message)?;
        let state = input.joints;
        // Ages instead of times: they hardly change from cycle to cycle, and what does not change compresses to
        // nothing.
        let age_ns = |time: Duration| {
            let ns = |time: Duration| i64::try_from(time.as_nanos()).unwrap_or(i64::MAX);
            ns(now).wrapping_sub(ns(time))
        };
        let message = ControlCycle {
            header: header(now),
            index: output.cycles,
            state_seen: state.is_some(),
            state_age_ns: state.map_or(0, |state| age_ns(state.stamp)),
            state_arrival_age_ns: state.map_or(Vec::new(), |state| match state.arrived {
                [first, ref rest @ ..] if rest.iter().all(|other| *other == first) => vec![age_ns(first)],
                all => all.map(age_ns).to_vec(),
            }),
            state_temperature_c: state
                .and_then(|state| state.temperature_c)
                .map_or(Vec::new(), |values| values.to_vec()),
            state_drive_error: state.map_or(Vec::new(), drive_errors),
            requests: input.requests.iter().map(request_word).collect(),
            emergency_stop: input.emergency_stop,
            gait: if input.gait.is_some() { self.gaits } else { 0 },
            fault: input.fault.map_or(String::new(), |report| report.fault.name().into()),
            fault_joint: input.fault.and_then(|report| report.joint).map_or(-1, |joint| joint as i32),
            fault_value: input.fault.map_or(0.0, |report| report.value),
            fault_limit: input.fault.map_or(0.0, |report| report.limit),
            mode: output.mode.name().into(),
            ..sensed_part(input, (self.last_inertial.as_ref(), self.last_velocity.as_ref()), age_ns)
        };
        taken &= self.recorder.push_message(&self.control_cycle, stamp_ns, &message)?;
        // What was not taken cannot be held.
        (self.last_inertial, self.last_velocity) = if taken { (input.inertial, input.velocity) } else { (None, None) };
        let due = self
            .last_written_state
            .is_none_or(|(time, mode)| mode != output.mode || now.saturating_sub(time) >= STATE_PERIOD);
        if due {
            self.last_written_state = Some((now, output.mode));
            let message = self.state_message(now, output);
            taken &= self.recorder.push_message(&self.controller_state, stamp_ns, &message)?;
        }
        Ok(taken)
    }

    fn command_message(&self, output: &Output) -> JointCommand {
        let command = &output.command;
        JointCommand {
            header: header(output.answered.unwrap_or_default()),
            name: self.joint_names.clone(),
            position: command.position_rad.to_vec(),
            velocity: command.velocity_rad_s.to_vec(),
            kp: command.kp.to_vec(),
            kd: command.kd.to_vec(),
            torque: command.torque_nm.to_vec(),
        }
    }

    fn state_message(&self, now: Duration, output: &Output) -> ControllerState {
        ControllerState {
            header: header(now),
            mode: output.mode.name().into(),
            fault: output.report.map_or(String::new(), |report| report.fault.name().into()),
            gait: self.gait_name.clone(),
            step_index: output.step_index,
            step_phase: output.step_phase,
            cycles: output.cycles,
            stale_inputs: output.stale_inputs,
            tracking_error_rad: output.tracking_error_rad.to_vec(),
            commanded_torque_nm: output.torque_nm.map(resolution::torque_nm).to_vec(),
            fault_bits: output.faults.bits(),
            mode_id: output.mode.number(),
            damped_id: output.damped_number(),
            ..ControllerState::default()
        }
    }

    /// The base and the ground forces, as often as they are known. Gives whether all of it was taken.
    ///
    /// # Errors
    /// [`BagError`] if it has no CDR form, which no sample lacks.
    pub fn body(&mut self, sample: &BodySample) -> Result<bool, BagError> {
        let stamp_ns = self.stamp_ns(sample.time)?;
        let header = || Header { stamp: time_message(sample.time), frame_id: "odom".into() };
        let vector = |value: [f64; 3], resolution: fn(f64) -> f64| {
            let [x, y, z] = value.map(resolution);
            Vector3 { x, y, z }
        };
        let [x, y, z] = sample.position_m.map(resolution::length_m);
        let [qx, qy, qz, qw] = sample.quaternion_xyzw.map(resolution::quaternion);
        let mut odometry = Odometry { header: header(), child_frame_id: "base_link".into(), ..Odometry::default() };
        odometry.pose.pose.position = Point { x, y, z };
        odometry.pose.pose.orientation = Quaternion { x: qx, y: qy, z: qz, w: qw };
        odometry.twist.twist.linear = vector(sample.linear_velocity_body, resolution::velocity_m_s);
        odometry.twist.twist.angular = vector(sample.angular_velocity_body, resolution::velocity_rad_s);
        let mut taken = self.recorder.push_message(&self.odom, stamp_ns, &odometry)?;
        for (topic, force) in self.ground_force.iter().zip(sample.ground_force_n.iter().flatten()) {
            let mut message = WrenchStamped { header: header(), ..WrenchStamped::default() };
            message.wrench.force = vector(*force, resolution::force_n);
            taken &= self.recorder.push_message(topic, stamp_ns, &message)?;
        }
        Ok(taken)
    }

    /// How the recording fares; a fault belongs in diagnostics.
    pub fn status(&self) -> RecorderStatus {
        self.recorder.status()
    }

    /// Writes what was taken and closes the bag.
    ///
    /// # Errors
    /// As [`Recorder::finish`].
    pub fn finish(mut self) -> Result<Summary, BagError> {
        if self.last_stamp_ns.is_none() {
            self.stamp_ns(Duration::ZERO)?; // no cycle came; the configuration is in the bag all the same
        }
        self.recorder.finish()
    }
}

/// None where there is no error.
fn drive_errors(state: &control::JointState) -> Vec<u8> {
    if state.drive_error == [0; JOINTS] { Vec::new() } else { state.drive_error.to_vec() }
}

fn header(time: Duration) -> Header {
    Header { stamp: time_message(time), frame_id: String::new() }
}

/// Lossless up to 68 years.
fn time_message(time: Duration) -> Time {
    Time { sec: i32::try_from(time.as_secs()).unwrap_or(i32::MAX), nanosec: time.subsec_nanos() }
}

/// What a cycle reports of the inertial unit after one that saw `last`; `age_ns` gives the age of a time at the cycle.
fn inertial_part(
    unit: Option<&InertialState>,
    last: Option<&InertialState>,
    age_ns: impl Fn(Duration) -> i64,
) -> ControlCycle {
    let Some(unit) = unit else { return ControlCycle::default() };
    if last.is_some_and(|last| bits(last) == bits(unit)) {
        return ControlCycle { inertial_held: true, ..ControlCycle::default() };
    }
    ControlCycle {
        inertial_age_ns: vec![age_ns(unit.stamp), age_ns(unit.arrived)],
        inertial_attitude: unit.attitude_xyzw.map_or(Vec::new(), Vec::from),
        inertial_angular_velocity: unit.angular_velocity_rad_s.map_or(Vec::new(), Vec::from),
        inertial_acceleration: unit.acceleration_m_s2.map_or(Vec::new(), Vec::from),
        ..ControlCycle::default()
    }
}

/// What a cycle reports of the inertial unit and of the velocity asked for after one that saw `last`.
fn sensed_part(
    input: &Input,
    (last_unit, last_velocity): (Option<&InertialState>, Option<&VelocityCommand>),
    age_ns: impl Fn(Duration) -> i64,
) -> ControlCycle {
    let unit = inertial_part(input.inertial.as_ref(), last_unit, &age_ns);
    let unit = ControlCycle { body_pose: input.body_pose.map_or(Vec::new(), |pose| pose.numbers().into()), ..unit };
    let Some(command) = &input.velocity else { return unit };
    let numbers = |command: &VelocityCommand| {
        let Velocity { forward_m_s, left_m_s, yaw_rad_s } = command.velocity;
        [forward_m_s, left_m_s, yaw_rad_s]
    };
    let bits = |command: &VelocityCommand| (command.arrived, numbers(command).map(f64::to_bits));
    if last_velocity.is_some_and(|last| bits(last) == bits(command)) {
        return ControlCycle { velocity_held: true, ..unit };
    }
    ControlCycle { velocity_age_ns: vec![age_ns(command.arrived)], velocity: numbers(command).to_vec(), ..unit }
}

/// To the bit: −0 is not 0, and NaN is itself.
fn bits(unit: &InertialState) -> impl PartialEq + use<> {
    let vector = |value: Option<[f64; 3]>| value.map(|value| value.map(f64::to_bits));
    let attitude = unit.attitude_xyzw.map(|value| value.map(f64::to_bits));
    (unit.stamp, unit.arrived, attitude, vector(unit.angular_velocity_rad_s), vector(unit.acceleration_m_s2))
}
