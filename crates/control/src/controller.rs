//! The controller: one pure step from what was measured and asked to what is sent.

use crate::body_pose::Body;
use crate::law::Law;
use crate::limits::Limits;
use crate::memory::Snapshot;
use crate::progress::Progress;
use crate::watch::{Found, Seen, watch_inertial};
use crate::{
    Config, ConfigError, DampingReason, DriveMode, Event, Fault, FaultReport, Guards, Input, JOINTS, JointCommand,
    MAX_REQUESTS, Mode, Output, PreparedGait, Refusal, Request, Tilted,
};
use std::time::Duration;

/// The controller. Pure: what [`Controller::step`] returns depends on the configuration and on the inputs so far, on
/// nothing else; it reads no clock, allocates nothing, and takes no lock.
#[derive(Clone, Debug)]
pub struct Controller {
    config: Config,
    memory: Snapshot,
}

impl Controller {
    /// A disarmed controller.
    pub fn new(config: Config) -> Result<Self, ConfigError> {
        config.validate()?;
        Ok(Self { config, memory: Snapshot::BEGINNING })
    }

    /// Everything that the next step depends on besides the configuration and its input: a recording that begins now
    /// can be run again from here. `Copy`: taking it allocates nothing.
    pub fn snapshot(&self) -> Snapshot {
        self.memory
    }

    /// A controller that goes on where another with the same configuration was. For running a recording again, not for
    /// robots: those begin disarmed.
    ///
    /// # Errors
    /// As [`Controller::new`].
    pub fn resume(config: Config, snapshot: &Snapshot) -> Result<Self, ConfigError> {
        Ok(Self { memory: *snapshot, ..Self::new(config)? })
    }

    /// The configuration.
    pub fn config(&self) -> &Config {
        &self.config
    }

    /// What the controller is doing.
    pub fn mode(&self) -> Mode {
        self.memory.day.mode
    }

    /// The gait that is loaded.
    pub fn gait(&self) -> Option<&PreparedGait> {
        self.memory.motion.loaded()
    }

    /// One control cycle at time `now`, on a clock that does not go backwards.
    ///
    /// Order: clock, measurements, emergency stop, staleness, the operator's requests, the motion, the limits.
    pub fn step(&mut self, input: &Input, now: Duration) -> Output {
        self.memory.cycles += 1;
        self.memory.day.emergency_stop = input.emergency_stop;
        let dt_s = self.measure(input, now);
        if input.emergency_stop {
            self.event(Event::EmergencyStop, now);
            if self.mode() == Mode::Damping {
                self.memory.day.damping_reason = Some(DampingReason::EmergencyStop);
            }
        }
        if self.mode().is_moving() && !self.memory.watch.is_fresh(&self.config, now) {
            self.event(Event::Stale, now);
        }
        if let Some(gait) = input.gait {
            self.memory.motion.pending = Some(*gait);
        }
        let mut replies = [None; MAX_REQUESTS];
        for (reply, request) in replies.iter_mut().zip(input.requests) {
            *reply = Some(self.request(*request, now));
        }
        self.memory.ask_velocity(&self.config, input, now);
        if let Some(event) = self.memory.heed_velocity(&self.config, input, now) {
            self.event(event, now);
        }
        let body_pose_answer = input.body_pose.map(|pose| self.memory.ask_body_pose(&self.config, &pose, now));
        self.progress(now, dt_s);
        self.balance(now, dt_s);
        let torque_nm = self.command(now, dt_s);
        Output {
            body_pose_answer,
            ..self.output(torque_nm, replies, input.requests.len().saturating_sub(MAX_REQUESTS), now)
        }
    }

    // ── what is measured ────────────────────────────────────────────────────────────────────────────────────────────

    /// Looks at everything that was measured; the time since the last cycle, s.
    fn measure(&mut self, input: &Input, now: Duration) -> f64 {
        let mut found = Found::default();
        let dt_s = self.memory.watch.advance_clock(&self.config, self.mode(), now, &mut found);
        self.latch_found(&mut found, now);
        if let Some(report) = input.fault {
            self.latch(report, now);
        }
        let is_new = self.memory.watch.take(&self.config, self.mode(), input.joints, &mut found);
        self.latch_found(&mut found, now);
        if is_new {
            let Snapshot { day, command, .. } = &self.memory;
            let expected = self.memory.expected(&self.config, now);
            let seen = Seen::new(&self.config, day.mode, expected, command.position_rad, now, dt_s);
            self.memory.watch.watch_joints(&seen, &mut found);
            self.latch_found(&mut found, now);
        } else {
            self.memory.stale_inputs += 1;
        }
        let inertial = input.inertial.as_ref();
        self.memory.watch.tilted = Tilted::beyond(self.config.tilt_limit_rad, inertial);
        watch_inertial(&self.config, self.mode(), inertial, &mut found);
        self.memory.estimate_base(&self.config, input, now, dt_s);
        self.memory.watch_estimate(&self.config, &mut found);
        self.latch_found(&mut found, now);
        dt_s
    }

    fn latch_found(&mut self, found: &mut Found, now: Duration) {
        found.reports().for_each(|report| self.latch(report, now));
        found.clear();
    }

    fn latch(&mut self, report: FaultReport, now: Duration) {
        let event = self.memory.day.latch(report);
        self.event(event, now);
    }

    // ── what happens ────────────────────────────────────────────────────────────────────────────────────────────────

    fn request(&mut self, request: Request, now: Duration) -> Result<Mode, Refusal> {
        self.memory.operator_asked();
        let event = match request {
            Request::ClearFault(fault) => {
                return match self.memory.day.clear(fault)? {
                    Some(cleared) => self.try_event(cleared, now),
                    None => Ok(self.mode()),
                };
            }
            Request::Arm => Event::Arm,
            Request::Disarm => Event::Disarm,
            Request::Stand => Event::Stand,
            Request::Sit => Event::Sit,
            Request::Walk => Event::Walk,
            Request::Stop => Event::Stop,
            Request::StartOnGait => Event::StartOnGait,
        };
        let mode = self.try_event(event, now).map_err(|refusal| match refusal {
            Refusal::PostureUnsafe => self.memory.watch.posture_problem(&self.config).unwrap_or(refusal),
            other => other,
        })?;
        if request == Request::Stand && mode == Mode::Standing {
            self.memory.motion.body.go_back();
        }
        match request {
            Request::Walk | Request::StartOnGait => self.memory.day.walk_wanted = true,
            Request::Stop | Request::Sit | Request::Stand | Request::Disarm => {
                self.memory.day.walk_wanted = false;
            }
            Request::Arm | Request::ClearFault(_) => {}
        }
        Ok(mode)
    }

    fn guards(&self, now: Duration) -> Guards {
        let Snapshot { day, watch, motion, .. } = &self.memory;
        Guards {
            fresh: watch.is_fresh(&self.config, now),
            posture_safe: watch.joints.is_some() && watch.posture_problem(&self.config).is_none(),
            gait_loaded: motion.loaded().is_some(),
            tilted: watch.tilted,
            any_fault: !day.faults.is_empty(),
            emergency_stop: day.emergency_stop,
            start_on_gait_allowed: self.config.simulation_start,
            estimate_usable: self.memory.estimate_is_usable(&self.config),
            velocity_heeded: self.memory.velocity_heeded(&self.config),
        }
    }

    /// An event of the controller's own; these are never refused.
    fn event(&mut self, event: Event, now: Duration) {
        let before = self.mode();
        let result = self.try_event(event, now);
        debug_assert!(result.is_ok(), "{event:?} in {before:?}: {result:?}");
    }

    fn try_event(&mut self, event: Event, now: Duration) -> Result<Mode, Refusal> {
        let (from, guards) = (self.mode(), self.guards(now));
        let to = self.memory.day.take(event, &guards)?;
        if to != from {
            self.enter(from, event, now);
        }
        Ok(to)
    }

    /// Sets the motion of the mode that was just entered.
    fn enter(&mut self, from: Mode, event: Event, now: Duration) {
        // In torque mode the command carries no gains: what goes on from here is the motion's setpoint.
        let setpoint = self.setpoint(now);
        if (self.mode(), from) == (Mode::Standing, Mode::Stopping) {
            // Where the new step begins is where the walk comes to rest from.
            self.memory.walk_in_balance(&self.config, now, 0.0);
        }
        let Self { config, memory } = self;
        let Snapshot { day, watch, motion, law, limits, command, .. } = memory;
        match (day.mode, from) {
            (Mode::Starting, Mode::Standing) if !motion.body.is_neutral() => return motion.start_from_posture(),
            (Mode::Standing, Mode::Starting) if motion.stand_on() => return,
            // What goes on from the setpoint has the body's pose in it.
            _ => motion.body = Body::NEUTRAL,
        }
        match (day.mode, from) {
            (Mode::Disarmed | Mode::Damping | Mode::Fault, _) => {
                motion.let_go();
                *law = Law::Paper;
                watch.let_go();
                limits.let_go();
            }
            (Mode::StandingUp, Mode::SittingDown) => motion.stand_again(config, setpoint, &command.position_rad, now),
            (Mode::StandingUp, _) => {
                if let Some(state) = &watch.joints {
                    motion.stand_up(config, state, now);
                }
            }
            // The posture is reached: its ramp goes on holding it.
            (Mode::Standing, Mode::StandingUp) => {}
            (Mode::Standing, Mode::Stopping) => {
                motion.come_to_rest(law, config, now);
                *law = Law::Paper;
            }
            (Mode::Standing, _) => motion.stand(config, setpoint, now),
            (Mode::Starting, _) => motion.start(config, setpoint, now),
            (Mode::Walking, _) => match event {
                Event::StartOnGait => {
                    motion.walk_at_once(now);
                    memory.begin_law(config, now, true);
                }
                Event::PostureReached => {
                    motion.walk_out_of_standing(now);
                    memory.begin_law(config, now, false);
                }
                // Out of stopping: the gait goes on.
                _ => {}
            },
            (Mode::Stopping, _) => {}
            (Mode::SittingDown, Mode::Standing) => {
                motion.sit_from_standing(config, setpoint, &command.position_rad, now);
            }
            (Mode::SittingDown, _) => motion.sit_down(config, setpoint, &command.position_rad, now),
        }
    }

    /// Follows time, and what it brings.
    fn progress(&mut self, now: Duration, dt_s: f64) {
        let rate = self.memory.law.phase_rate();
        self.memory.motion.run(&self.config, rate, dt_s);
        // Each turn of the loop takes one event; a motion has at most a few in one cycle.
        for _ in 0..4 {
            let begun_by = self.memory.walk_begun_by(&self.config);
            let Snapshot { day, motion, law, .. } = &mut self.memory;
            match motion.progress(law, &self.config, day.mode, begun_by, now) {
                Progress::Nothing => return,
                Progress::GoesOn => {}
                Progress::PostureReached => self.event(Event::PostureReached, now),
                Progress::SwitchReached => self.event(Event::SwitchReached, now),
                Progress::MayWalk(event) => {
                    if self.try_event(event, now) != Ok(Mode::Starting) {
                        self.memory.day.walk_wanted = false;
                        self.memory.day.heed.may_begin = false;
                        return;
                    }
                }
                Progress::GaitIsFar => {
                    // It stops, stands, and starts again with the new one.
                    self.event(Event::Stop, now);
                    self.event(Event::SwitchReached, now);
                    self.memory.day.walk_wanted = true;
                }
            }
        }
    }

    /// The balanced law, where it is walked, and whether it can go on.
    fn balance(&mut self, now: Duration, dt_s: f64) {
        self.memory.walk_in_balance(&self.config, now, dt_s);
        let mut found = Found::default();
        self.memory.watch_balance(&self.config, &mut found);
        self.latch_found(&mut found, now);
    }

    // ── what is sent ────────────────────────────────────────────────────────────────────────────────────────────────

    /// What the motion asks for, before limits.
    fn setpoint(&self, now: Duration) -> JointCommand {
        self.memory.motion.setpoint(&self.memory.law, &self.config, now)
    }

    /// Makes the command; the torques that it gives at the measured state, N m.
    fn command(&mut self, now: Duration, dt_s: f64) -> [f64; JOINTS] {
        let setpoint = self.setpoint(now);
        if self.mode().is_moving() && !setpoint.is_finite() {
            self.latch(FaultReport { fault: Fault::InternalError, joint: None, value: f64::NAN, limit: f64::MAX }, now);
        }
        let mode = self.mode();
        let Self { config, memory } = self;
        let joints = memory.watch.joints;
        let (q, v) = joints.map_or(([0.0; JOINTS], [0.0; JOINTS]), |s| (s.position_rad, s.velocity_rad_s));
        let (command, torque_nm) = match (mode, joints.is_some()) {
            (Mode::Disarmed, _) => (JointCommand::LIMP, [0.0; JOINTS]),
            (mode, true) if mode.is_moving() => {
                // The first cycle has no last one; the limit on the torque's growth then counts one period.
                let dt_s = dt_s.clamp(config.control_period_s, config.overrun_s);
                let fade = memory.speed_fade_share(config);
                let (command, torque_nm) = memory.limits.apply(config, setpoint.to_resolution(), &q, &v, fade, dt_s);
                let carried = match config.drive_mode {
                    DriveMode::Impedance => command,
                    DriveMode::Torque => JointCommand { kp: [0.0; JOINTS], kd: [0.0; JOINTS], torque_nm, ..command },
                };
                (carried, torque_nm)
            }
            _ => {
                let command = Limits::damping(config, &v);
                (command, command.torque(&q, &v))
            }
        };
        memory.command = command;
        torque_nm
    }

    fn output(
        &self,
        torque_nm: [f64; JOINTS],
        replies: [Option<Result<Mode, Refusal>>; MAX_REQUESTS],
        requests_refused_unseen: usize,
        now: Duration,
    ) -> Output {
        let Snapshot { day, watch, motion, command, cycles, stale_inputs, .. } = &self.memory;
        let (estimate, balance) = self.memory.balance_output(&self.config);
        let q = watch.joints.map_or([0.0; JOINTS], |s| s.position_rad);
        Output {
            command: *command,
            drives_on: day.mode.drives_on(),
            mode: day.mode,
            damping_reason: day.damping_reason,
            faults: day.faults,
            report: day.report,
            answered: watch.joints.map(|s| s.stamp),
            replies,
            requests_refused_unseen,
            holds_posture: motion.holds_posture(now),
            step_index: motion.step_index,
            step_phase: motion.step_phase,
            tracking_error_rad: if day.mode.is_moving() {
                std::array::from_fn(|j| command.position_rad[j] - q[j])
            } else {
                [0.0; JOINTS]
            },
            torque_nm,
            estimate,
            balance,
            body_pose: motion.body.pose(),
            body_pose_answer: None,
            cycles: *cycles,
            stale_inputs: *stale_inputs,
        }
    }
}
