//! The controller: one pure step from what was measured and asked to what is sent.

use crate::STILL_RAD;
use crate::limits::{Limiter, LimiterMemory};
use crate::prepared_gait::Instant;
use crate::ramp::Ramp;
use crate::{
    Config, ConfigError, DriveMode, Event, Fault, FaultReport, FaultSet, Guards, JOINTS, JointCommand, Mode,
    PreparedGait, Refusal, transition,
};
use gait::StepSide;
use std::time::Duration;

/// Requests that one step takes; more are refused.
pub const MAX_REQUESTS: usize = 8;

/// What the drives, or the simulator, reported.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct JointState {
    /// The state's own time stamp: a new stamp is a new state.
    pub stamp: Duration,
    /// When each joint's values arrived, on the clock of `now`.
    pub arrived: [Duration; JOINTS],
    /// Positions, rad.
    pub position_rad: [f64; JOINTS],
    /// Velocities, rad/s.
    pub velocity_rad_s: [f64; JOINTS],
    /// Temperatures, °C, where the drives report them.
    pub temperature_c: Option<[f64; JOINTS]>,
    /// Error codes of the drives; 0 means none.
    pub drive_error: [u8; JOINTS],
}

/// The base's attitude from an inertial unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tilt {
    /// Rotation about the forward axis, rad.
    pub roll_rad: f64,
    /// Rotation about the leftward axis, rad.
    pub pitch_rad: f64,
}

/// What an operator may ask.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Request {
    /// Switch the drives on.
    Arm,
    /// Switch the drives off.
    Disarm,
    /// Stand up.
    Stand,
    /// Sit down and disarm.
    Sit,
    /// Walk: at once when standing, else as soon as it stands.
    Walk,
    /// Stop walking at the next switch.
    Stop,
    /// Clear a fault by its name.
    ClearFault(Fault),
    /// Start on the gait at its first instant. Only for simulators, which can put the robot there
    /// ([`Config::simulation_start`]).
    StartOnGait,
}

/// All that one step gets to see.
#[derive(Clone, Copy, Debug, Default)]
pub struct Input<'a> {
    /// The newest joint state; the same again is fine.
    pub joints: Option<&'a JointState>,
    /// The base's attitude, where it is measured.
    pub tilt: Option<Tilt>,
    /// What operators asked since the last step, in order.
    pub requests: &'a [Request],
    /// A gait that arrived since the last step.
    pub gait: Option<&'a PreparedGait>,
    /// The emergency stop is pressed.
    pub emergency_stop: bool,
    /// A fault that the layer below noticed: a bus or a drive.
    pub fault: Option<FaultReport>,
}

/// Why the robot is damped.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum DampingReason {
    /// It was just armed, or its faults were cleared.
    Armed,
    /// The emergency stop.
    EmergencyStop,
    /// The joint states stopped coming.
    StaleJointState,
    /// A latched fault.
    Fault,
}

impl DampingReason {
    /// The name that is published.
    pub fn name(self) -> &'static str {
        match self {
            Self::Armed => "armed",
            Self::EmergencyStop => "emergency_stop",
            Self::StaleJointState => "stale_joint_state",
            Self::Fault => "fault",
        }
    }
}

/// All that one step says.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Output {
    /// What to send.
    pub command: JointCommand,
    /// Whether the drives are to be on.
    pub drives_on: bool,
    /// What the controller is doing.
    pub mode: Mode,
    /// Why it is damped, where it is.
    pub damping_reason: Option<DampingReason>,
    /// The latched faults.
    pub faults: FaultSet,
    /// The newest fault.
    pub report: Option<FaultReport>,
    /// The stamp of the joint state that this answers.
    pub answered: Option<Duration>,
    /// For each request of the input, in order: the mode it led to, or why it was refused.
    pub replies: [Option<Result<Mode, Refusal>>; MAX_REQUESTS],
    /// Steps since walking began, counted from 0.
    pub step_index: u64,
    /// t / T, 0 where it does not walk.
    pub step_phase: f64,
    /// Commanded minus measured positions, rad; 0 where none is commanded.
    pub tracking_error_rad: [f64; JOINTS],
    /// Torques that the command gives at the measured state, N m.
    pub torque_nm: [f64; JOINTS],
    /// Steps of the controller.
    pub cycles: u64,
    /// Steps that found no new joint state.
    pub stale_inputs: u64,
}

/// What is being held or moved to.
// The cycle must not allocate, so the large variant is not boxed.
#[allow(clippy::large_enum_variant)]
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
enum Motion {
    /// Nothing: off or damping.
    None,
    /// A ramp, then its end is held. `then` follows it.
    Ramp { ramp: Ramp, start: Duration, then: Then },
    /// The gait.
    Gait(GaitClock),
}

/// What follows a ramp.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
enum Then {
    /// Rise from the folded posture.
    Rise,
    /// Let go.
    LetGo,
    /// The mode's posture is reached.
    Done,
}

/// Time within the gait. Switches lie at `start` + `base_s` + k T, so that a step that is no multiple of the control
/// period carries its remainder over exactly, for any number of steps.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
struct GaitClock {
    start: Duration,
    /// From `start` to the first instant of the gait now walked, s.
    base_s: f64,
    /// Steps walked before that instant.
    base_index: u64,
    /// Steps of the gait now walked that have ended.
    steps: u64,
    /// What continuity at a change of gait asks for: old minus new plan at the switch.
    offset: Option<Offset>,
    /// It began out of standing: the motion grows to the whole gait's ([`Controller::share`]).
    grows: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
struct Offset {
    position_rad: [f64; JOINTS],
    velocity_rad_s: [f64; JOINTS],
}

/// A joint that has not moved: where it is, between what it was commanded meanwhile, and when it was last heard.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
struct Still {
    position_rad: f64,
    least_rad: f64,
    most_rad: f64,
    heard: Duration,
}

/// Rounding in now − start must not put a switch one cycle late.
const SWITCH_TOLERANCE: f64 = 1e-9;
/// A change of gait is smoothed out over this share of its first step.
const CHANGE_SHARE: f64 = 0.5;
/// An encoder jumps if it moves more than this beyond what the velocity limit allows, rad.
const JUMP_MARGIN_RAD: f64 = 0.1;
/// Velocities this many times the limit are not believed.
const IMPLAUSIBLE_VELOCITY: f64 = 3.0;
/// A joint that was not heard for longer than this many control periods may have moved away and back.
const HEARD_CYCLES: f64 = 10.0;
/// From nearer to the standing posture than this (each joint, rad), it is gone to directly; else by way of sitting.
const NEAR_STAND_RAD: f64 = 0.4;

/// The controller. Pure: what [`Controller::step`] returns depends on the configuration and on the inputs so far, on
/// nothing else; it reads no clock, allocates nothing, and takes no lock.
#[derive(Clone, Debug)]
pub struct Controller {
    config: Config,
    limiter: Limiter,
    mode: Mode,
    damping_reason: Option<DampingReason>,
    faults: FaultSet,
    report: Option<FaultReport>,
    walk_wanted: bool,
    motion: Motion,
    gait: Option<PreparedGait>,
    /// A gait that waits for a switch or for standing.
    pending: Option<PreparedGait>,
    joints: Option<JointState>,
    command: JointCommand,
    last_now: Option<Duration>,
    tracking_error_s: [f64; JOINTS],
    overspeed_s: [f64; JOINTS],
    /// What has been asked of each joint since it moved last.
    still: [Option<Still>; JOINTS],
    step_index: u64,
    step_phase: f64,
    cycles: u64,
    stale_inputs: u64,
}

/// A controller's memory at one moment: [`Controller::snapshot`].
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Snapshot {
    limiter: LimiterMemory,
    mode: Mode,
    damping_reason: Option<DampingReason>,
    faults: FaultSet,
    report: Option<FaultReport>,
    walk_wanted: bool,
    motion: Motion,
    gait: Option<PreparedGait>,
    pending: Option<PreparedGait>,
    joints: Option<JointState>,
    command: JointCommand,
    last_now: Option<Duration>,
    tracking_error_s: [f64; JOINTS],
    overspeed_s: [f64; JOINTS],
    still: [Option<Still>; JOINTS],
    step_index: u64,
    step_phase: f64,
    cycles: u64,
    stale_inputs: u64,
}

impl Snapshot {
    /// Steps of the controller until then.
    pub fn cycles(&self) -> u64 {
        self.cycles
    }
}

impl Controller {
    /// A disarmed controller.
    pub fn new(config: Config) -> Result<Self, ConfigError> {
        config.validate()?;
        Ok(Self {
            limiter: Limiter::new(&config),
            config,
            mode: Mode::Disarmed,
            damping_reason: None,
            faults: FaultSet::default(),
            report: None,
            walk_wanted: false,
            motion: Motion::None,
            gait: None,
            pending: None,
            joints: None,
            command: JointCommand::LIMP,
            last_now: None,
            tracking_error_s: [0.0; JOINTS],
            overspeed_s: [0.0; JOINTS],
            still: [None; JOINTS],
            step_index: 0,
            step_phase: 0.0,
            cycles: 0,
            stale_inputs: 0,
        })
    }

    /// Everything that the next step depends on besides the configuration and its input: a recording that begins now
    /// can be run again from here. `Copy`: taking it allocates nothing.
    pub fn snapshot(&self) -> Snapshot {
        // Written out, so that a new field cannot be forgotten.
        let Self {
            config: _,
            limiter,
            mode,
            damping_reason,
            faults,
            report,
            walk_wanted,
            motion,
            gait,
            pending,
            joints,
            command,
            last_now,
            tracking_error_s,
            overspeed_s,
            still,
            step_index,
            step_phase,
            cycles,
            stale_inputs,
        } = self;
        Snapshot {
            limiter: limiter.memory(),
            mode: *mode,
            damping_reason: *damping_reason,
            faults: *faults,
            report: *report,
            walk_wanted: *walk_wanted,
            motion: *motion,
            gait: *gait,
            pending: *pending,
            joints: *joints,
            command: *command,
            last_now: *last_now,
            tracking_error_s: *tracking_error_s,
            overspeed_s: *overspeed_s,
            still: *still,
            step_index: *step_index,
            step_phase: *step_phase,
            cycles: *cycles,
            stale_inputs: *stale_inputs,
        }
    }

    /// A controller that goes on where another with the same configuration was. For running a recording again, not for
    /// robots: those begin disarmed.
    ///
    /// # Errors
    /// As [`Controller::new`].
    pub fn resume(config: Config, snapshot: &Snapshot) -> Result<Self, ConfigError> {
        let Self { config, mut limiter, .. } = Self::new(config)?;
        limiter.remember(&snapshot.limiter);
        Ok(Self {
            config,
            limiter,
            mode: snapshot.mode,
            damping_reason: snapshot.damping_reason,
            faults: snapshot.faults,
            report: snapshot.report,
            walk_wanted: snapshot.walk_wanted,
            motion: snapshot.motion,
            gait: snapshot.gait,
            pending: snapshot.pending,
            joints: snapshot.joints,
            command: snapshot.command,
            last_now: snapshot.last_now,
            tracking_error_s: snapshot.tracking_error_s,
            overspeed_s: snapshot.overspeed_s,
            still: snapshot.still,
            step_index: snapshot.step_index,
            step_phase: snapshot.step_phase,
            cycles: snapshot.cycles,
            stale_inputs: snapshot.stale_inputs,
        })
    }

    /// The configuration.
    pub fn config(&self) -> &Config {
        &self.config
    }

    /// What the controller is doing.
    pub fn mode(&self) -> Mode {
        self.mode
    }

    /// The gait that is loaded.
    pub fn gait(&self) -> Option<&PreparedGait> {
        self.pending.as_ref().or(self.gait.as_ref())
    }

    /// One control cycle at time `now`, on a clock that does not go backwards.
    ///
    /// Order: clock, measurements, emergency stop, staleness, the operator's requests, the motion, the limits.
    pub fn step(&mut self, input: &Input, now: Duration) -> Output {
        self.cycles += 1;
        let dt_s = self.advance_clock(now);
        if let Some(report) = input.fault {
            self.latch(report, now);
        }
        let new_state = self.take_joints(input.joints, now);
        if !new_state {
            self.stale_inputs += 1;
        } else {
            self.watch_joints(now, dt_s);
        }
        self.watch_tilt(input.tilt, now);
        if input.emergency_stop {
            self.event(Event::EmergencyStop, input.emergency_stop, now);
            if self.mode == Mode::Damping {
                self.damping_reason = Some(DampingReason::EmergencyStop);
            }
        }
        if self.mode.is_moving() && !self.is_fresh(now) {
            self.event(Event::Stale, input.emergency_stop, now);
        }
        if let Some(gait) = input.gait {
            self.pending = Some(*gait);
        }
        let mut replies = [None; MAX_REQUESTS];
        for (n, request) in input.requests.iter().enumerate() {
            let reply = if n < MAX_REQUESTS {
                self.request(*request, input.emergency_stop, now)
            } else {
                Err(Refusal::TooMany)
            };
            replies[n.min(MAX_REQUESTS - 1)] = Some(reply);
        }
        self.progress(input.emergency_stop, now);
        self.produce(now, dt_s, replies)
    }

    // ── what is measured ────────────────────────────────────────────────────────────────────────────────────────────

    fn advance_clock(&mut self, now: Duration) -> f64 {
        let Some(last) = self.last_now.replace(now) else {
            return 0.0;
        };
        let Some(dt) = now.checked_sub(last) else {
            if self.mode.drives_on() {
                self.latch(
                    FaultReport {
                        fault: Fault::ClockJump,
                        joint: None,
                        value: -(last - now).as_secs_f64(),
                        limit: 0.0,
                    },
                    now,
                );
            }
            return 0.0;
        };
        let dt_s = dt.as_secs_f64();
        if self.mode.is_moving() && dt_s > self.config.overrun_s {
            self.latch(
                FaultReport { fault: Fault::Overrun, joint: None, value: dt_s, limit: self.config.overrun_s },
                now,
            );
        }
        dt_s
    }

    /// Takes a joint state over if it is new and believable; true if so. While disarmed nothing latches: arming looks
    /// at the state again.
    fn take_joints(&mut self, joints: Option<&JointState>, now: Duration) -> bool {
        let Some(new) = joints else { return false };
        let last = self.joints;
        if last.is_some_and(|last| last.stamp == new.stamp) {
            return false;
        }
        let armed = self.mode.drives_on();
        let mut believed = true;
        let mut problem = |fault, joint, value, limit| {
            believed = false;
            FaultReport { fault, joint, value, limit }
        };
        let mut found = None;
        for j in 0..JOINTS {
            let (q, v) = (new.position_rad[j], new.velocity_rad_s[j]);
            let temperature = new.temperature_c.map_or(0.0, |t| t[j]);
            if !(q.is_finite() && v.is_finite() && temperature.is_finite()) {
                let bad = [q, v, temperature].into_iter().find(|x| !x.is_finite());
                found = Some(problem(Fault::InvalidInput, Some(j), bad.unwrap_or(f64::NAN), f64::MAX));
                break;
            }
            if !armed {
                continue;
            }
            let c = &self.config;
            let outside = (c.position_min_rad[j] - q).max(q - c.position_max_rad[j]);
            let fastest = IMPLAUSIBLE_VELOCITY * c.velocity_limit_rad_s[j];
            // Joints that nothing holds rest where their mechanical stops are, beyond the limits of commands: no fault
            // of the encoder's. Until they are back, arming and standing up are refused (`posture_problem`).
            if outside > c.position_fault_rad && self.mode.is_moving() {
                found = Some(problem(
                    Fault::PositionOutOfRange,
                    Some(j),
                    q,
                    if q < c.position_min_rad[j] {
                        c.position_min_rad[j] - c.position_fault_rad
                    } else {
                        c.position_max_rad[j] + c.position_fault_rad
                    },
                ));
            } else if v.abs() > fastest {
                found = Some(problem(Fault::VelocityOutOfRange, Some(j), v, fastest));
            } else if let Some(last) = &last {
                let dt_s = new.stamp.saturating_sub(last.stamp).as_secs_f64();
                let step = (q - last.position_rad[j]).abs();
                let allowed = 1.5 * c.velocity_limit_rad_s[j] * dt_s + JUMP_MARGIN_RAD;
                if step > allowed {
                    found = Some(problem(Fault::EncoderJump, Some(j), step, allowed));
                }
            }
            if found.is_some() {
                break;
            }
        }
        if armed
            && found.is_none()
            && let Some(last) = last
            && new.stamp < last.stamp
        {
            found = Some(FaultReport {
                fault: Fault::ClockJump,
                joint: None,
                value: -(last.stamp - new.stamp).as_secs_f64(),
                limit: 0.0,
            });
        }
        if let Some(report) = found
            && armed
        {
            self.latch(report, now);
        }
        if believed {
            self.joints = Some(*new);
        }
        believed
    }

    /// What a new state says of drives and joints.
    fn watch_joints(&mut self, now: Duration, dt_s: f64) {
        let Some(state) = self.joints else { return };
        if !self.mode.drives_on() {
            return;
        }
        let moving = self.mode.is_moving();
        for j in 0..JOINTS {
            let (v, q) = (state.velocity_rad_s[j], state.position_rad[j]);
            if state.drive_error[j] != 0 {
                self.latch_joint(Fault::DriveError, j, state.drive_error[j].into(), 0.0, now);
            }
            if let Some(t) = state.temperature_c.map(|t| t[j]) {
                if t > self.config.over_temperature_c {
                    let limit = self.config.over_temperature_c;
                    self.latch_joint(Fault::OverTemperature, j, t, limit, now);
                } else if t > self.config.hot_c {
                    self.latch_joint(Fault::DriveHot, j, t, self.config.hot_c, now);
                }
            }
            let limit = self.config.velocity_limit_rad_s[j];
            self.overspeed_s[j] = if moving && v.abs() > limit { self.overspeed_s[j] + dt_s } else { 0.0 };
            if self.overspeed_s[j] > self.config.overspeed_s {
                self.latch_joint(Fault::Overspeed, j, v, limit, now);
            }
            let error = (q - self.command.position_rad[j]).abs();
            // While the gains are low the joint is not expected to follow.
            let held = moving && self.held(j);
            self.tracking_error_s[j] =
                if held && error > self.config.tracking_error_rad { self.tracking_error_s[j] + dt_s } else { 0.0 };
            if self.tracking_error_s[j] > self.config.tracking_error_s {
                let limit = self.config.tracking_error_rad;
                self.latch_joint(Fault::TrackingError, j, error, limit, now);
            }
            self.watch_stillness(j, q, now);
        }
    }

    /// A joint that does not move with its command is stuck. Only in a whole walk, where every foot is lifted once in
    /// two steps: friction may hold a foot that carries the robot from posture to posture, or that hardly leaves the
    /// ground.
    fn watch_stillness(&mut self, joint: usize, q: f64, now: Duration) {
        let commanded = self.command.position_rad[joint];
        let mut still = Still { position_rad: q, least_rad: commanded, most_rad: commanded, heard: now };
        // What was commanded while nothing was heard of the joint is not held against it.
        let gap = Duration::from_secs_f64(HEARD_CYCLES * self.config.control_period_s);
        if let Some(last) = self.still[joint]
            && (q - last.position_rad).abs() < STILL_RAD
            && now.saturating_sub(last.heard) <= gap
        {
            still.position_rad = last.position_rad;
            still.least_rad = last.least_rad.min(commanded);
            still.most_rad = last.most_rad.max(commanded);
        }
        let walks = matches!(&self.motion, Motion::Gait(clock) if self.share(clock, now).0 >= 1.0);
        self.still[joint] = walks.then_some(still);
        let ranged = still.most_rad - still.least_rad;
        if walks && ranged > self.config.stuck_rad {
            self.latch_joint(Fault::JointStuck, joint, ranged, self.config.stuck_rad, now);
        }
    }

    /// Whether the motion asks for full gains at this joint (in torque mode the command itself has none).
    fn held(&self, joint: usize) -> bool {
        match &self.motion {
            Motion::None => false,
            Motion::Gait(_) => true,
            Motion::Ramp { ramp, start, .. } => {
                let elapsed = self.last_now.map_or(0.0, |now| now.saturating_sub(*start).as_secs_f64());
                ramp.at(elapsed).kp[joint] >= 0.5 * self.config.posture_kp[joint]
            }
        }
    }

    fn watch_tilt(&mut self, tilt: Option<Tilt>, now: Duration) {
        let Some(tilt) = tilt else { return };
        if !self.mode.drives_on() {
            return;
        }
        let limit = self.config.tilt_limit_rad;
        for value in [tilt.roll_rad, tilt.pitch_rad] {
            let fault = if !value.is_finite() {
                Fault::InvalidInput
            } else if value.abs() > limit {
                Fault::Tilt
            } else {
                continue;
            };
            self.latch(FaultReport { fault, joint: None, value, limit }, now);
        }
    }

    fn is_fresh(&self, now: Duration) -> bool {
        let timeout = Duration::from_secs_f64(self.config.state_timeout_s);
        self.joints.is_some_and(|s| s.arrived.iter().all(|arrived| now.saturating_sub(*arrived) <= timeout))
    }

    // ── what happens ────────────────────────────────────────────────────────────────────────────────────────────────

    fn latch_joint(&mut self, fault: Fault, joint: usize, value: f64, limit: f64, now: Duration) {
        let joint = Some(joint);
        self.latch(FaultReport { fault, joint, value, limit }, now);
    }

    fn latch(&mut self, report: FaultReport, now: Duration) {
        if self.faults.insert(report.fault) {
            self.report = Some(report);
        }
        match report.fault.severity() {
            crate::Severity::Damping => {
                self.event(Event::FaultLatched, false, now);
            }
            crate::Severity::ControlledStop => {
                self.walk_wanted = false;
                self.event(Event::Stop, false, now);
            }
        }
    }

    fn request(&mut self, request: Request, emergency_stop: bool, now: Duration) -> Result<Mode, Refusal> {
        let event = match request {
            Request::ClearFault(fault) => {
                if !self.faults.remove(fault) {
                    return Err(Refusal::FaultNotLatched);
                }
                if self.report.is_some_and(|r| r.fault == fault) {
                    self.report = None;
                }
                if self.faults.any_damping() {
                    return Ok(self.mode);
                }
                return self.try_event(Event::FaultsCleared, emergency_stop, now);
            }
            Request::Arm => Event::Arm,
            Request::Disarm => Event::Disarm,
            Request::Stand => Event::Stand,
            Request::Sit => Event::Sit,
            Request::Walk => Event::Walk,
            Request::Stop => Event::Stop,
            Request::StartOnGait => Event::StartOnGait,
        };
        let mode = self.try_event(event, emergency_stop, now).map_err(|refusal| match refusal {
            Refusal::PostureUnsafe => self.posture_problem().unwrap_or(refusal),
            other => other,
        })?;
        match request {
            Request::Walk | Request::StartOnGait => self.walk_wanted = true,
            Request::Stop | Request::Sit | Request::Stand | Request::Disarm => {
                self.walk_wanted = false;
            }
            Request::Arm | Request::ClearFault(_) => {}
        }
        Ok(mode)
    }

    /// What keeps the robot from being armed or from standing up, if a joint does.
    fn posture_problem(&self) -> Option<Refusal> {
        let (s, c) = (self.joints.as_ref()?, &self.config);
        (0..JOINTS).find_map(|joint| {
            let q = s.position_rad[joint];
            let outside = (c.position_min_rad[joint] - q).max(q - c.position_max_rad[joint]);
            if s.drive_error[joint] != 0 {
                Some(Refusal::JointDrive { joint })
            } else if outside > c.position_fault_rad {
                Some(Refusal::JointOutside { joint })
            } else if s.velocity_rad_s[joint].abs() > c.rest_velocity_rad_s {
                Some(Refusal::JointMoves { joint })
            } else {
                None
            }
        })
    }

    fn guards(&self, emergency_stop: bool, now: Duration) -> Guards {
        let c = &self.config;
        Guards {
            fresh: self.is_fresh(now),
            posture_safe: self.joints.is_some() && self.posture_problem().is_none(),
            gait_loaded: self.gait().is_some(),
            any_fault: !self.faults.is_empty(),
            emergency_stop,
            start_on_gait_allowed: c.simulation_start,
        }
    }

    /// An event of the controller's own; these are never refused.
    fn event(&mut self, event: Event, emergency_stop: bool, now: Duration) {
        let before = self.mode;
        let result = self.try_event(event, emergency_stop, now);
        debug_assert!(result.is_ok(), "{event:?} in {before:?}: {result:?}");
    }

    fn try_event(&mut self, event: Event, emergency_stop: bool, now: Duration) -> Result<Mode, Refusal> {
        let from = self.mode;
        let to = transition(from, event, &self.guards(emergency_stop, now))?;
        if to != from {
            self.mode = to;
            self.enter(from, event, now);
        }
        Ok(to)
    }

    // ── what is done ────────────────────────────────────────────────────────────────────────────────────────────────

    /// Sets the motion of the mode that was just entered.
    fn enter(&mut self, from: Mode, event: Event, now: Duration) {
        self.damping_reason = None;
        match self.mode {
            Mode::Disarmed => self.let_go(),
            Mode::Damping | Mode::Fault => {
                self.let_go();
                self.damping_reason = Some(match event {
                    Event::EmergencyStop => DampingReason::EmergencyStop,
                    Event::Stale => DampingReason::StaleJointState,
                    Event::FaultLatched => DampingReason::Fault,
                    _ => DampingReason::Armed,
                });
            }
            Mode::StandingUp => self.stand_up(now),
            Mode::Standing => match from {
                // The posture is reached: its ramp goes on holding it.
                Mode::StandingUp => {}
                Mode::Stopping => self.come_to_rest(now),
                _ => {
                    let to = self.posture(&self.config.stand);
                    self.ramp_from_command(to, self.config.stop_blend_s, Then::Done, now);
                }
            },
            Mode::Starting => self.start(now),
            Mode::Walking => match event {
                Event::StartOnGait => self.walk_from(now, Duration::ZERO, false),
                Event::PostureReached => {
                    // The gait's first instant is the ramp's end, not the cycle that noticed it.
                    let late = match self.motion {
                        Motion::Ramp { ramp, start, .. } => {
                            now.saturating_sub(start).saturating_sub(Duration::from_secs_f64(ramp.duration_s))
                        }
                        _ => Duration::ZERO,
                    };
                    self.walk_from(now, late, true);
                }
                // Out of stopping: the gait goes on.
                _ => {}
            },
            Mode::Stopping => {}
            Mode::SittingDown => {
                let to = self.posture(&self.config.sit);
                let duration = self.posture_duration_s(&self.command.position_rad, &to.position_rad);
                self.ramp_from_command(to, duration, Then::LetGo, now);
            }
        }
    }

    fn let_go(&mut self) {
        self.motion = Motion::None;
        self.walk_wanted = false;
        self.limiter.reset();
        self.tracking_error_s = [0.0; JOINTS];
        self.overspeed_s = [0.0; JOINTS];
        self.still = [None; JOINTS];
        self.step_phase = 0.0;
    }

    fn posture(&self, posture: &crate::Posture) -> JointCommand {
        JointCommand {
            position_rad: posture.position_rad,
            velocity_rad_s: [0.0; JOINTS],
            kp: self.config.posture_kp,
            kd: self.config.posture_kd,
            torque_nm: posture.support_torque_nm,
        }
    }

    fn posture_duration_s(&self, from: &[f64; JOINTS], to: &[f64; JOINTS]) -> f64 {
        let farthest = (0..JOINTS).fold(0.0_f64, |m, j| m.max((to[j] - from[j]).abs()));
        (farthest / self.config.posture_speed_rad_s).max(self.config.posture_min_s)
    }

    fn ramp(&mut self, from: JointCommand, to: JointCommand, duration_s: f64, then: Then, now: Duration) {
        let gain_s = if from.kp.contains(&0.0) { self.config.gain_ramp_s.min(duration_s) } else { duration_s };
        self.motion = Motion::Ramp { ramp: Ramp { from, to, duration_s, gain_s }, start: now, then };
    }

    /// From what is commanded now: in torque mode the command carries no gains, so the motion is asked, not the
    /// command.
    fn ramp_from_command(&mut self, to: JointCommand, duration_s: f64, then: Then, now: Duration) {
        let from = self.setpoint(now);
        self.ramp(from, to, duration_s, then, now);
    }

    /// From wherever the joints are, gains from zero: to standing directly if that is near, else by way of sitting with
    /// the hips already as wide as they will stand, because loaded feet do not slide.
    fn stand_up(&mut self, now: Duration) {
        if let Motion::Ramp { .. } = self.motion {
            // Out of sitting down.
            let to = self.posture(&self.config.stand);
            let duration = self.posture_duration_s(&self.command.position_rad, &to.position_rad);
            self.ramp_from_command(to, duration, Then::Done, now);
            return;
        }
        let Some(state) = self.joints else { return };
        let from = JointCommand { position_rad: state.position_rad, kd: self.config.damping_kd, ..JointCommand::LIMP };
        let stand = self.posture(&self.config.stand);
        let near = (0..JOINTS).all(|j| (state.position_rad[j] - stand.position_rad[j]).abs() < NEAR_STAND_RAD);
        let (to, then) = if near { (stand, Then::Done) } else { (self.folded(), Then::Rise) };
        let duration = self.posture_duration_s(&from.position_rad, &to.position_rad);
        self.ramp(from, to, duration, then, now);
    }

    fn folded(&self) -> JointCommand {
        let mut folded = self.posture(&self.config.sit);
        for leg in 0..gait::LEGS {
            let roll = leg * gait::JOINTS_PER_LEG;
            folded.position_rad[roll] = self.config.stand.position_rad[roll];
        }
        folded
    }

    /// To the first posture of the walk on four feet, moving at its end as the walk moves at its start.
    fn start(&mut self, now: Duration) {
        self.adopt_pending();
        let Some(gait) = self.gait else { return };
        let first = shrunk(&gait, gait.at(StepSide::First, 0.0), self.config.start_share, 0.0);
        let to = JointCommand {
            position_rad: first.position_rad,
            velocity_rad_s: first.velocity_rad_s,
            kp: gait.kp(StepSide::First),
            kd: gait.kd(StepSide::First),
            // Four feet carry the robot until the gait's first instant.
            torque_nm: self.config.stand.support_torque_nm,
        };
        self.ramp_from_command(to, self.config.start_blend_s, Then::Done, now);
    }

    fn walk_from(&mut self, now: Duration, late: Duration, grows: bool) {
        self.adopt_pending();
        self.step_index = 0;
        self.motion = Motion::Gait(GaitClock {
            start: now.saturating_sub(late),
            base_s: 0.0,
            base_index: 0,
            steps: 0,
            offset: None,
            grows,
        });
    }

    /// How much of the gait's motion about its middle posture is walked at `now`, and the rate of that, 1/s. A robot
    /// that stands has no speed and its feet side by side; asked for the whole gait at once, its drives would have to
    /// make up for both.
    fn share(&self, clock: &GaitClock, now: Duration) -> (f64, f64) {
        let (first, duration_s) = (self.config.start_share, self.config.start_growth_s);
        let x = now.saturating_sub(clock.start).as_secs_f64() / duration_s;
        if !clock.grows || x >= 1.0 {
            return (1.0, 0.0);
        }
        let left = 1.0 - first;
        (first + left * x * x * (3.0 - 2.0 * x), left * 6.0 * x * (1.0 - x) / duration_s)
    }

    /// At a switch: all four feet are on the ground where they are to stay, so the posture of the switch is kept and
    /// only its motion runs out, over a third of the way that it would go in that time.
    fn come_to_rest(&mut self, now: Duration) {
        let (Some(gait), Motion::Gait(clock)) = (self.gait, self.motion) else {
            return;
        };
        let side = clock.side(clock.steps);
        let (share, rate) = self.share(&clock, now);
        let at = shrunk(&gait, gait.at(side, 0.0), share, rate);
        let mut from = self.posture(&self.config.stand);
        from.position_rad = at.position_rad;
        from.velocity_rad_s = at.velocity_rad_s;
        let mut to = from;
        to.velocity_rad_s = [0.0; JOINTS];
        let duration_s = self.config.stop_blend_s;
        for j in 0..JOINTS {
            to.position_rad[j] += at.velocity_rad_s[j] * duration_s / 3.0;
        }
        from.kp = gait.kp(side);
        from.kd = gait.kd(side);
        self.ramp(from, to, duration_s, Then::Done, now);
    }

    fn adopt_pending(&mut self) {
        if let Some(gait) = self.pending.take() {
            self.gait = Some(gait);
        }
    }

    /// Follows time: ends of ramps, switches of steps, changes of gait.
    fn progress(&mut self, emergency_stop: bool, now: Duration) {
        // Each turn of the loop takes one event; a motion has at most a few in one cycle.
        for _ in 0..4 {
            match self.motion {
                Motion::None => {
                    self.adopt_pending();
                    return;
                }
                Motion::Ramp { ramp, start, then } => {
                    if self.pending.is_some() && self.mode != Mode::Starting {
                        self.adopt_pending();
                    }
                    if now.saturating_sub(start) < Duration::from_secs_f64(ramp.duration_s) {
                        return;
                    }
                    match then {
                        Then::Rise => {
                            let to = self.posture(&self.config.stand);
                            let duration = self.posture_duration_s(&ramp.to.position_rad, &to.position_rad);
                            self.ramp(ramp.to, to, duration, Then::Done, now);
                        }
                        Then::LetGo => {
                            let mut from = ramp.to;
                            let mut to = ramp.to;
                            to.kp = [0.0; JOINTS];
                            to.kd = self.config.damping_kd;
                            to.torque_nm = [0.0; JOINTS];
                            from.velocity_rad_s = [0.0; JOINTS];
                            self.ramp(from, to, self.config.gain_ramp_s, Then::Done, now);
                        }
                        Then::Done => match self.mode {
                            Mode::Starting if self.pending.is_some() => {
                                // A gait that came meanwhile: blend on to its first posture.
                                self.start(now);
                            }
                            Mode::Standing => {
                                if !self.walk_wanted {
                                    return;
                                }
                                if self.try_event(Event::Walk, emergency_stop, now).is_err() {
                                    self.walk_wanted = false;
                                    return;
                                }
                            }
                            _ => {
                                let wanted = self.walk_wanted;
                                self.event(Event::PostureReached, emergency_stop, now);
                                self.walk_wanted = wanted && self.mode.is_moving();
                            }
                        },
                    }
                }
                Motion::Gait(clock) => {
                    if !self.progress_gait(clock, emergency_stop, now) {
                        return;
                    }
                }
            }
        }
    }

    /// True if the motion changed.
    fn progress_gait(&mut self, mut clock: GaitClock, emergency_stop: bool, now: Duration) -> bool {
        let Some(gait) = self.gait else { return false };
        let elapsed_s = clock.elapsed_s(now);
        let period_s = gait.step_duration_s();
        let steps = (elapsed_s / period_s + SWITCH_TOLERANCE).floor().max(0.0) as u64;
        let switched = steps != clock.steps;
        if switched {
            clock.steps = steps;
            clock.offset = None;
            self.motion = Motion::Gait(clock);
            if self.mode == Mode::Stopping {
                let wanted = self.walk_wanted;
                self.event(Event::SwitchReached, emergency_stop, now);
                self.walk_wanted = wanted;
                return true;
            }
            // What is still growing grows up first.
            if let Some(new) = self.pending
                && self.share(&clock, now).0 >= 1.0
            {
                self.change_gait(clock, &gait, &new, emergency_stop, now);
                return true;
            }
        }
        self.step_index = clock.base_index + clock.steps;
        self.step_phase = ((elapsed_s - steps as f64 * period_s) / period_s).clamp(0.0, 1.0);
        false
    }

    /// At a switch: takes the new gait if it starts near where the old one ends, else stops, stands, and starts again.
    fn change_gait(
        &mut self,
        mut clock: GaitClock,
        old: &PreparedGait,
        new: &PreparedGait,
        emergency_stop: bool,
        now: Duration,
    ) {
        let side = clock.side(clock.steps);
        let (a, b) = (old.at(side, 0.0), new.at(side, 0.0));
        let offset = Offset {
            position_rad: std::array::from_fn(|j| a.position_rad[j] - b.position_rad[j]),
            velocity_rad_s: std::array::from_fn(|j| a.velocity_rad_s[j] - b.velocity_rad_s[j]),
        };
        let within = |d: &[f64; JOINTS], limit: f64| d.iter().all(|d| d.abs() <= limit);
        if within(&offset.position_rad, self.config.gait_change_position_rad)
            && within(&offset.velocity_rad_s, self.config.gait_change_velocity_rad_s)
        {
            clock.base_s += clock.steps as f64 * old.step_duration_s();
            clock.base_index += clock.steps;
            clock.steps = 0;
            clock.offset = Some(offset);
            self.adopt_pending();
            self.motion = Motion::Gait(clock);
        } else {
            self.event(Event::Stop, emergency_stop, now);
            self.event(Event::SwitchReached, emergency_stop, now);
            self.walk_wanted = true;
        }
    }

    /// What the motion asks for at `now`, before limits.
    fn setpoint(&self, now: Duration) -> JointCommand {
        match &self.motion {
            Motion::None => JointCommand::LIMP,
            Motion::Ramp { ramp, start, .. } => ramp.at(now.saturating_sub(*start).as_secs_f64()),
            Motion::Gait(clock) => {
                let Some(gait) = &self.gait else {
                    return JointCommand::LIMP;
                };
                let side = clock.side(clock.steps);
                let period_s = gait.step_duration_s();
                let t_s = (clock.elapsed_s(now) - clock.steps as f64 * period_s).clamp(0.0, period_s);
                let (share, rate) = self.share(clock, now);
                let at = shrunk(gait, gait.at(side, t_s / period_s), share, rate);
                let mut setpoint = JointCommand {
                    position_rad: at.position_rad,
                    velocity_rad_s: at.velocity_rad_s,
                    kp: gait.kp(side),
                    kd: gait.kd(side),
                    torque_nm: at.torque_nm,
                };
                if let Some(offset) = &clock.offset {
                    let duration_s = CHANGE_SHARE * period_s;
                    if t_s < duration_s {
                        let x = t_s / duration_s;
                        let (h00, h10) = ((1.0 + 2.0 * x) * (1.0 - x) * (1.0 - x), x * (1.0 - x) * (1.0 - x));
                        let (d00, d10) = (6.0 * x * (x - 1.0) / duration_s, (1.0 - x) * (1.0 - 3.0 * x));
                        for j in 0..JOINTS {
                            let (dq, dv) = (offset.position_rad[j], offset.velocity_rad_s[j]);
                            setpoint.position_rad[j] += h00 * dq + h10 * duration_s * dv;
                            setpoint.velocity_rad_s[j] += d00 * dq + d10 * dv;
                        }
                    }
                }
                setpoint
            }
        }
    }

    fn produce(&mut self, now: Duration, dt_s: f64, replies: [Option<Result<Mode, Refusal>>; MAX_REQUESTS]) -> Output {
        if self.mode.is_moving() && !self.setpoint(now).is_finite() {
            self.latch(FaultReport { fault: Fault::InternalError, joint: None, value: f64::NAN, limit: f64::MAX }, now);
        }
        let (q, v) = self.joints.map_or(([0.0; JOINTS], [0.0; JOINTS]), |s| (s.position_rad, s.velocity_rad_s));
        let mut torque_nm = [0.0; JOINTS];
        self.command = match (self.mode, self.joints.is_some()) {
            (Mode::Disarmed, _) => JointCommand::LIMP,
            (mode, true) if mode.is_moving() => {
                // The first cycle has no last one; the limit on the torque's growth then counts one period.
                let dt_s = dt_s.clamp(self.config.control_period_s, self.config.overrun_s);
                let (mut command, torque) = self.limiter.apply(self.setpoint(now).to_resolution(), &q, &v, dt_s);
                torque_nm = torque;
                if self.config.drive_mode == DriveMode::Torque {
                    command.kp = [0.0; JOINTS];
                    command.kd = [0.0; JOINTS];
                    command.torque_nm = torque;
                }
                command
            }
            _ => {
                let command = self.limiter.damping(&v);
                torque_nm = command.torque(&q, &v);
                command
            }
        };
        let held = self.mode.is_moving();
        Output {
            command: self.command,
            drives_on: self.mode.drives_on(),
            mode: self.mode,
            damping_reason: self.damping_reason,
            faults: self.faults,
            report: self.report,
            answered: self.joints.map(|s| s.stamp),
            replies,
            step_index: self.step_index,
            step_phase: self.step_phase,
            tracking_error_rad: if held {
                std::array::from_fn(|j| self.command.position_rad[j] - q[j])
            } else {
                [0.0; JOINTS]
            },
            torque_nm,
            cycles: self.cycles,
            stale_inputs: self.stale_inputs,
        }
    }
}

/// `share` of a gait's motion about the middle of its two switches, where that share grows at `rate` 1/s. To first
/// order the base moves over two legs like an inverted pendulum, whose motions about a posture of balance are motions
/// at any size.
fn shrunk(gait: &PreparedGait, at: Instant, share: f64, rate: f64) -> Instant {
    // To the bit the gait itself.
    if share >= 1.0 {
        return at;
    }
    let (a, b) = (gait.at(StepSide::First, 0.0).position_rad, gait.at(StepSide::Mirrored, 0.0).position_rad);
    let middle: [f64; JOINTS] = std::array::from_fn(|j| 0.5 * (a[j] + b[j]));
    Instant {
        position_rad: std::array::from_fn(|j| middle[j] + share * (at.position_rad[j] - middle[j])),
        velocity_rad_s: std::array::from_fn(|j| share * at.velocity_rad_s[j] + rate * (at.position_rad[j] - middle[j])),
        torque_nm: at.torque_nm,
    }
}

impl GaitClock {
    fn elapsed_s(&self, now: Duration) -> f64 {
        now.saturating_sub(self.start).as_secs_f64() - self.base_s
    }

    /// The side of step `steps` of the gait now walked. Sides go on alternating over a change of gait.
    fn side(&self, steps: u64) -> StepSide {
        StepSide::of_step(self.base_index + steps)
    }
}
