//! Watching: what is measured is checked before it is believed, and held against what was commanded.

use crate::motion::Expected;
use crate::{
    Config, Fault, FaultReport, InertialState, JOINTS, JointState, Mode, Refusal, STILL_RAD, Severity, Tilted,
};
use std::time::Duration;

/// An encoder jumps if it moves more than this beyond what the velocity limit allows, rad.
const JUMP_MARGIN_RAD: f64 = 0.1;
/// Velocities this many times the limit are not believed.
const IMPLAUSIBLE_VELOCITY: f64 = 3.0;
/// A joint that was not received for longer than this many control periods may have moved away and back.
const RECEPTION_GAP_CYCLES: f64 = 10.0;

/// What was measured, and for how long what is not as it should be.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Watch {
    /// The newest state that is believed.
    pub joints: Option<JointState>,
    pub last_now: Option<Duration>,
    pub tracking_error_s: [f64; JOINTS],
    pub overspeed_s: [f64; JOINTS],
    /// What has been asked of each joint since it moved last.
    pub still: [Option<Still>; JOINTS],
    /// How the base is tilted by the present input, where that is too far.
    #[serde(default)]
    pub tilted: Option<Tilted>,
}

/// A joint that has not moved: where it is, between what it was commanded meanwhile, and when it was last received.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Still {
    position_rad: f64,
    least_rad: f64,
    most_rad: f64,
    #[serde(rename = "heard")]
    received: Duration,
}

/// Faults that were found, the first report of each, in the order in which they were found.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Found {
    reports: [Option<FaultReport>; Fault::ALL.len()],
    count: usize,
}

impl Found {
    pub fn add(&mut self, fault: Fault, joint: Option<usize>, value: f64, limit: f64) {
        if self.reports().all(|known| known.fault != fault) {
            self.reports[self.count] = Some(FaultReport { fault, joint, value, limit });
            self.count += 1;
        }
    }

    pub fn reports(&self) -> impl Iterator<Item = FaultReport> {
        self.reports[..self.count].iter().flatten().copied()
    }

    /// Nothing, again.
    pub fn clear(&mut self) {
        self.count = 0;
    }

    fn means_damping(&self) -> bool {
        self.reports().any(|report| report.fault.severity() == Severity::Damping)
    }
}

impl Watch {
    /// Nothing was measured.
    pub const NOTHING: Self = Self {
        joints: None,
        last_now: None,
        tracking_error_s: [0.0; JOINTS],
        overspeed_s: [0.0; JOINTS],
        still: [None; JOINTS],
        tilted: None,
    };

    /// Nothing is held any more: what was counted against the joints is forgotten.
    pub fn let_go(&mut self) {
        self.tracking_error_s = [0.0; JOINTS];
        self.overspeed_s = [0.0; JOINTS];
        self.still = [None; JOINTS];
    }

    /// Time since the last cycle, s; 0 where there is none or the clock went backwards.
    pub fn advance_clock(&mut self, config: &Config, mode: Mode, now: Duration, found: &mut Found) -> f64 {
        let Some(last) = self.last_now.replace(now) else {
            return 0.0;
        };
        let Some(dt) = now.checked_sub(last) else {
            if mode.drives_on() {
                found.add(Fault::ClockJump, None, -(last - now).as_secs_f64(), 0.0);
            }
            return 0.0;
        };
        let dt_s = dt.as_secs_f64();
        if mode.is_moving() && dt_s > config.overrun_s {
            found.add(Fault::Overrun, None, dt_s, config.overrun_s);
        }
        dt_s
    }

    /// Takes a joint state over if it is new and believable; true if so. While disarmed nothing is a fault: arming
    /// looks at the state again.
    pub fn take(&mut self, config: &Config, mode: Mode, joints: Option<&JointState>, found: &mut Found) -> bool {
        let Some(new) = joints else { return false };
        let last = self.joints.as_ref();
        if last.is_some_and(|last| last.stamp == new.stamp) {
            return false;
        }
        let armed = mode.drives_on();
        let mut doubts = Found::default();
        for j in 0..JOINTS {
            check_joint(config, mode, new, last, j, &mut doubts);
            if doubts.count > 0 {
                break;
            }
        }
        let believed = doubts.count == 0;
        if believed && let Some(back) = last.and_then(|last| last.stamp.checked_sub(new.stamp)) {
            doubts.add(Fault::ClockJump, None, -back.as_secs_f64(), 0.0);
        }
        if armed {
            doubts.reports().for_each(|r| found.add(r.fault, r.joint, r.value, r.limit));
        }
        if believed {
            self.joints = Some(*new);
        }
        believed
    }

    /// What a new state reports of drives and joints, beside what was commanded.
    pub fn watch_joints(&mut self, seen: &Seen, found: &mut Found) {
        if !seen.mode.drives_on() {
            return;
        }
        let mut seen = *seen;
        // What was commanded while nothing was received of a joint is not held against it.
        let gap = Duration::from_secs_f64(RECEPTION_GAP_CYCLES * seen.config.control_period_s);
        for j in 0..JOINTS {
            let Some(state) = &self.joints else { return };
            let (q, v) = (state.position_rad[j], state.velocity_rad_s[j]);
            watch_drive(seen.config, state, j, found);
            self.let_go_once(&mut seen, found);
            self.watch_speed(&seen, j, v, found);
            self.let_go_once(&mut seen, found);
            self.watch_tracking(&seen, j, q, found);
            self.let_go_once(&mut seen, found);
            self.watch_stillness(&seen, j, q, gap, found);
            self.let_go_once(&mut seen, found);
        }
    }

    /// From a fault that means damping on nothing is held any more, also for the joints that are looked at after it.
    fn let_go_once(&mut self, seen: &mut Seen, found: &Found) {
        if !seen.let_go && found.means_damping() {
            self.let_go();
            seen.let_go = true;
            seen.expected = Expected::default();
        }
    }

    fn watch_speed(&mut self, seen: &Seen, joint: usize, v: f64, found: &mut Found) {
        let limit = seen.config.velocity_limit_rad_s[joint];
        let over_s = &mut self.overspeed_s[joint];
        *over_s = if seen.mode.is_moving() && v.abs() > limit { *over_s + seen.dt_s } else { 0.0 };
        if *over_s > seen.config.overspeed_s {
            found.add(Fault::Overspeed, Some(joint), v, limit);
        }
    }

    /// While the gains are low a joint is not expected to follow.
    fn watch_tracking(&mut self, seen: &Seen, joint: usize, q: f64, found: &mut Found) {
        let (limit, longest_s) = seen.tracking_bound();
        let error = (q - seen.commanded_rad[joint]).abs();
        let off_s = &mut self.tracking_error_s[joint];
        let held = seen.mode.is_moving() && seen.expected.held[joint];
        *off_s = if held && error > limit { *off_s + seen.dt_s } else { 0.0 };
        if *off_s > longest_s {
            found.add(Fault::TrackingError, Some(joint), error, limit);
        }
    }

    /// A joint that does not move with its command is stuck. Only in a whole walk, where every foot is lifted once
    /// in a stride: friction may hold a foot that carries the robot from posture to posture, or that hardly leaves the
    /// ground.
    fn watch_stillness(&mut self, seen: &Seen, joint: usize, q: f64, gap: Duration, found: &mut Found) {
        let commanded = seen.commanded_rad[joint];
        let mut still = Still { position_rad: q, least_rad: commanded, most_rad: commanded, received: seen.now };
        if let Some(last) = self.still[joint]
            && (q - last.position_rad).abs() < STILL_RAD
            && seen.now.saturating_sub(last.received) <= gap
        {
            still.position_rad = last.position_rad;
            still.least_rad = last.least_rad.min(commanded);
            still.most_rad = last.most_rad.max(commanded);
        }
        let walks = seen.expected.walks;
        self.still[joint] = walks.then_some(still);
        let ranged = still.most_rad - still.least_rad;
        if walks && ranged > seen.config.stuck_rad {
            found.add(Fault::JointStuck, Some(joint), ranged, seen.config.stuck_rad);
        }
    }

    /// Whether every joint was received lately.
    pub fn is_fresh(&self, config: &Config, now: Duration) -> bool {
        let timeout = Duration::from_secs_f64(config.state_timeout_s);
        self.joints.is_some_and(|s| s.arrived.iter().all(|arrived| now.saturating_sub(*arrived) <= timeout))
    }

    /// What keeps the robot from being armed or from standing up, if a joint does.
    pub fn posture_problem(&self, config: &Config) -> Option<Refusal> {
        let s = self.joints.as_ref()?;
        (0..JOINTS).find_map(|joint| {
            if s.drive_error[joint] != 0 {
                Some(Refusal::JointDrive { joint })
            } else if outside_rad(config, joint, s.position_rad[joint]) > config.position_fault_rad {
                Some(Refusal::JointOutside { joint })
            } else if s.velocity_rad_s[joint].abs() > config.rest_velocity_rad_s {
                Some(Refusal::JointMoves { joint })
            } else {
                None
            }
        })
    }
}

/// What the joints are held against in one cycle.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Seen<'a> {
    config: &'a Config,
    mode: Mode,
    expected: Expected,
    commanded_rad: [f64; JOINTS],
    now: Duration,
    dt_s: f64,
    let_go: bool,
}

impl<'a> Seen<'a> {
    /// At `now`, `dt_s` after the last cycle, in which `commanded_rad` was commanded.
    pub fn new(
        config: &'a Config,
        mode: Mode,
        expected: Expected,
        commanded_rad: [f64; JOINTS],
        now: Duration,
        dt_s: f64,
    ) -> Self {
        Self { config, mode, expected, commanded_rad, now, dt_s, let_go: false }
    }

    /// How far a joint may be from its command, rad, and for how long, s.
    fn tracking_bound(&self) -> (f64, f64) {
        let Config { tracking_error_rad: rad, tracking_error_s: seconds, balance, .. } = self.config;
        match balance {
            Some(balance) if self.expected.caught => {
                (rad.max(balance.caught_tracking_error_rad), seconds.max(balance.caught_tracking_error_s))
            }
            _ => (*rad, *seconds),
        }
    }
}

/// How far a position lies outside of its joint's limits, rad; negative inside.
fn outside_rad(config: &Config, joint: usize, q: f64) -> f64 {
    (config.position_min_rad[joint] - q).max(q - config.position_max_rad[joint])
}

/// Whether a joint's values can be believed; what of them cannot.
fn check_joint(config: &Config, mode: Mode, new: &JointState, last: Option<&JointState>, j: usize, doubts: &mut Found) {
    let (q, v) = (new.position_rad[j], new.velocity_rad_s[j]);
    let temperature = new.temperature_c.map_or(0.0, |t| t[j]);
    if let Some(bad) = [q, v, temperature].into_iter().find(|x| !x.is_finite()) {
        doubts.add(Fault::InvalidInput, Some(j), bad, f64::MAX);
        return;
    }
    if !mode.drives_on() {
        return;
    }
    let fastest = IMPLAUSIBLE_VELOCITY * config.velocity_limit_rad_s[j];
    // Joints that nothing holds rest where their mechanical stops are, beyond the limits of commands: no fault
    // of the encoder's. Until they are back, arming and standing up are refused (`posture_problem`).
    if mode.is_moving() && outside_rad(config, j, q) > config.position_fault_rad {
        let allowed = if q < config.position_min_rad[j] {
            config.position_min_rad[j] - config.position_fault_rad
        } else {
            config.position_max_rad[j] + config.position_fault_rad
        };
        doubts.add(Fault::PositionOutOfRange, Some(j), q, allowed);
    } else if v.abs() > fastest {
        doubts.add(Fault::VelocityOutOfRange, Some(j), v, fastest);
    } else if let Some(last) = last {
        let dt_s = new.stamp.saturating_sub(last.stamp).as_secs_f64();
        let step = (q - last.position_rad[j]).abs();
        let allowed = 1.5 * config.velocity_limit_rad_s[j] * dt_s + JUMP_MARGIN_RAD;
        if step > allowed {
            doubts.add(Fault::EncoderJump, Some(j), step, allowed);
        }
    }
}

fn watch_drive(config: &Config, state: &JointState, joint: usize, found: &mut Found) {
    if state.drive_error[joint] != 0 {
        found.add(Fault::DriveError, Some(joint), state.drive_error[joint].into(), 0.0);
    }
    let Some(t) = state.temperature_c.map(|t| t[joint]) else { return };
    if t > config.over_temperature_c {
        found.add(Fault::OverTemperature, Some(joint), t, config.over_temperature_c);
    } else if t > config.hot_c {
        found.add(Fault::DriveHot, Some(joint), t, config.hot_c);
    }
}

/// What the inertial unit reports.
pub(crate) fn watch_inertial(config: &Config, mode: Mode, inertial: Option<&InertialState>, found: &mut Found) {
    let Some(state) = inertial.filter(|_| mode.drives_on()) else { return };
    let limit = config.tilt_limit_rad;
    if let Some(bad) = state.not_finite() {
        found.add(Fault::InvalidInput, None, bad, limit);
    }
    for value in state.tilt().into_iter().flat_map(|tilt| [tilt.roll_rad, tilt.pitch_rad]) {
        if !value.is_finite() {
            found.add(Fault::InvalidInput, None, value, limit);
        } else if value.abs() > limit {
            found.add(Fault::Tilt, None, value, limit);
        }
    }
}
