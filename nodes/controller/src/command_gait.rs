//! A gait for the command: where the speed ahead that is asked for stays far from the one that the gait was planned
//! for, the planner is asked for a gait of that speed, and the cycle takes it up at a switch as it does any other.
//!
//! All of this is the node's side, on a thread of its own that may wait: the cycle is handed a checked gait or nothing.
//! Without a planner, or with one that is slow, refuses or dies, the robot walks on with the gait that it has.

use control::balanced::BalanceConfig;
use control::{Config, Mode, PreparedGait, may_follow};
use gait::Gait;
use std::sync::{Mutex, MutexGuard, PoisonError};
use tandem_msgs::GenerateGaitRequest;

/// The next gait's speed is at most this share of the robot's greatest one from the walked gait's: what is further may
/// not be taken up at a switch, and the walk would have to stop for it.
const STRIDE_SHARE: f64 = 0.2;
/// What could not be had is asked for again after this, s.
const RETRY_S: f64 = 10.0;
/// Requests whose gaits may still come.
const REMEMBERED: usize = 16;

/// When another gait is wanted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rule {
    /// What is asked for is further than this from the gait's own speed, m/s …
    pub far_m_s: f64,
    /// … for so long, s.
    pub held_s: f64,
    /// A command older than this counts as none: it steps in place, s.
    pub timeout_s: f64,
    /// A walk has grown to its whole gait after this, s.
    pub grown_s: f64,
    /// Greatest speed backward and ahead, m/s.
    pub most_m_s: [f64; 2],
}

impl Rule {
    /// For a robot that walks in balance.
    pub fn new(far_m_s: f64, held_s: f64, config: &Config, balance: &BalanceConfig) -> Self {
        let limit = &balance.velocity_limit;
        Self {
            far_m_s,
            held_s,
            timeout_s: balance.command_timeout_s,
            grown_s: config.start_growth_s,
            most_m_s: [limit.backward_m_s, limit.forward_m_s],
        }
    }
}

/// A command that is held, more or less.
#[derive(Clone, Copy, Debug)]
struct Held {
    speed_m_s: f64,
    since_s: f64,
}

/// Watches the command. Times are the controller's, counted in cycles.
#[derive(Clone, Copy, Debug, Default)]
struct Watch {
    walking_since_s: Option<f64>,
    held: Option<Held>,
    /// The last speed that a gait was asked for, and when.
    asked: Option<Held>,
}

impl Watch {
    /// The speed that a gait is to be planned for now, m/s.
    fn look(&mut self, rule: &Rule, now_s: f64, heard: Option<Held>, own_m_s: f64) -> Option<f64> {
        let walking_s = now_s - *self.walking_since_s.get_or_insert(now_s);
        // Before the first command the gait's own speed is walked.
        let heard = heard?;
        let is_stale = now_s - heard.since_s > rule.timeout_s;
        let speed_m_s = if is_stale { 0.0 } else { heard.speed_m_s.clamp(-rule.most_m_s[0], rule.most_m_s[1]) };
        let near = |held: &Held| (held.speed_m_s - speed_m_s).abs() <= 0.5 * rule.far_m_s;
        let held = *self.held.insert(self.held.filter(near).unwrap_or(Held { speed_m_s, since_s: now_s }));
        let off_m_s = speed_m_s - own_m_s;
        let is_held = (now_s - held.since_s).min(walking_s - rule.grown_s) >= rule.held_s;
        let stride_m_s = STRIDE_SHARE * rule.most_m_s[1];
        let wanted_m_s = own_m_s + off_m_s.clamp(-stride_m_s, stride_m_s);
        let was_asked = |asked: &Held| {
            (asked.speed_m_s - wanted_m_s).abs() <= 0.5 * rule.far_m_s && now_s - asked.since_s < RETRY_S
        };
        if !is_held || off_m_s.abs() <= rule.far_m_s || self.asked.as_ref().is_some_and(was_asked) {
            return None;
        }
        self.asked = Some(Held { speed_m_s: wanted_m_s, since_s: now_s });
        Some(wanted_m_s)
    }
}

/// What is to be done.
#[derive(Clone, Debug)]
pub enum Task {
    /// Ask the planner.
    Plan(Box<GenerateGaitRequest>),
    /// The walk is over: the gait that somebody loaded is walked next.
    GoBack(Box<Gait>),
}

/// A request whose gait may come, and whether it is still wanted.
#[derive(Clone, Debug)]
struct Awaited {
    request: GenerateGaitRequest,
    is_wanted: bool,
}

/// What the node knows of walk, command and gaits.
#[derive(Clone, Debug, Default)]
struct State {
    now_s: f64,
    mode: Option<Mode>,
    heard: Option<Held>,
    watch: Watch,
    /// What somebody else loaded last, where the planner plans others like it.
    base: Option<Gait>,
    /// What was handed over last, and its speed, m/s.
    walked: Option<(PreparedGait, f64)>,
    /// It was planned for the command.
    is_planned: bool,
    awaited: Vec<Awaited>,
    status: String,
}

/// Gaits for the command.
#[derive(Debug)]
pub struct CommandGaits {
    rule: Rule,
    config: Config,
    state: Mutex<State>,
}

impl CommandGaits {
    /// No gait was loaded yet.
    pub fn new(rule: Rule, config: Config) -> Self {
        Self { rule, config, state: Mutex::default() }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        // What is guarded is whole after a panic elsewhere.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A command came in.
    pub fn hear(&self, forward_m_s: f64) {
        let mut state = self.state();
        state.heard = Some(Held { speed_m_s: forward_m_s, since_s: state.now_s });
    }

    /// This many cycles have ended, the last one in this mode.
    pub fn follow(&self, cycles: u64, mode: Mode) {
        let mut state = self.state();
        (state.now_s, state.mode) = (cycles as f64 * self.config.control_period_s, Some(mode));
    }

    /// What is to be done now.
    pub fn next(&self) -> Option<Task> {
        let mut state = self.state();
        if state.mode != Some(Mode::Walking) {
            state.watch = Watch::default();
            state.awaited.iter_mut().for_each(|awaited| awaited.is_wanted = false);
            let is_over = !matches!(state.mode, Some(Mode::Starting | Mode::Stopping));
            return match &state.base {
                Some(base) if is_over && state.is_planned => Some(Task::GoBack(Box::new(base.clone()))),
                _ => None,
            };
        }
        let (own_m_s, now_s, heard) = (state.walked.as_ref()?.1, state.now_s, state.heard);
        let speed_m_s = state.watch.look(&self.rule, now_s, heard, own_m_s)?;
        let request = request(state.base.as_ref()?, speed_m_s);
        state.awaited.iter_mut().for_each(|awaited| awaited.is_wanted = false);
        if state.awaited.len() >= REMEMBERED {
            state.awaited.remove(0);
        }
        state.awaited.push(Awaited { request: request.clone(), is_wanted: true });
        Some(Task::Plan(Box::new(request)))
    }

    /// There is no gait, for this reason. True where that is news.
    pub fn fail(&self, reason: &str) -> bool {
        let mut state = self.state();
        state.awaited.iter_mut().for_each(|awaited| awaited.is_wanted = false);
        let status = format!("walks on with the gait that it has: {reason}");
        let is_new = state.status != status;
        state.status = status;
        is_new
    }

    /// A gait is to be handed over: what becomes of it.
    ///
    /// # Errors
    /// It was asked for here and cannot be taken up at a switch, or is not wanted any more.
    pub fn take(&self, gait: &Gait, prepared: &PreparedGait) -> Result<(), String> {
        let mut state = self.state();
        let own = state.awaited.iter().position(|awaited| is_for(gait, &awaited.request));
        let own = own.map(|n| state.awaited.remove(n));
        let is_far = || state.walked.is_some_and(|(walked, _)| !may_follow(&walked, prepared, &self.config));
        let refusal = match &own {
            Some(awaited) if !awaited.is_wanted || state.mode != Some(Mode::Walking) => {
                Some("it was planned for a command that is none any more")
            }
            Some(_) if is_far() => Some("planned for the command, it begins too far from where the walked gait ends"),
            _ => None,
        };
        if let Some(refusal) = refusal {
            state.status = format!("walks on with the gait that it has: {refusal}");
            return Err(refusal.into());
        }
        if own.is_none() {
            // The planner's service plans the trot alone.
            state.base = gait.cycle.is_empty().then(|| gait.clone());
            state.awaited.iter_mut().for_each(|awaited| awaited.is_wanted = false);
        }
        let speed_m_s = gait.speed_m_s();
        // Commands are held anew from here.
        (state.watch.held, state.watch.asked) = (None, None);
        (state.walked, state.is_planned) = (Some((*prepared, speed_m_s)), own.is_some());
        state.status = match own {
            Some(_) => format!("walks a gait planned for {speed_m_s:.2} m/s"),
            None if prepared.has_cycle() => {
                format!(
                    "walks the gait that was loaded, planned for {speed_m_s:.2} m/s; none is planned for commands of its contact schedule"
                )
            }
            None => format!("walks the gait that was loaded, planned for {speed_m_s:.2} m/s"),
        };
        Ok(())
    }

    /// In words, for diagnostics.
    pub fn status(&self) -> String {
        self.state().status.clone()
    }
}

/// The request of a gait with another speed; what it does not say is the planner's to fill in.
fn request(base: &Gait, speed_m_s: f64) -> GenerateGaitRequest {
    let number = |key: &str| base.request[key].as_f64().into();
    let torques = base.request["torque_limit_nm"].as_array();
    GenerateGaitRequest {
        behaviour: base.request["behaviour"].as_str().unwrap_or(&base.name).to_owned(),
        step_duration_s: number("step_duration_s"),
        clearance_m: number("clearance_m"),
        speed_m_s: Some(speed_m_s).into(),
        height_m: number("height_m"),
        half_width_m: number("half_width_m"),
        slope_rad: number("slope_rad"),
        sideways_slope_rad: number("sideways_slope_rad"),
        torso_pitch_rad: number("torso_pitch_rad"),
        torso_roll_rad: number("torso_roll_rad"),
        lateral_speed_m_s: base.request["lateral_speed_m_s"].as_f64().unwrap_or(0.0),
        yaw_rate_rad_s: base.request["yaw_rate_rad_s"].as_f64().unwrap_or(0.0),
        friction: number("friction"),
        torque_limit_nm: torques.map_or_else(Vec::new, |list| list.iter().filter_map(|value| value.as_f64()).collect()),
        ..GenerateGaitRequest::default()
    }
}

/// Whether this request led to this gait.
fn is_for(gait: &Gait, asked: &GenerateGaitRequest) -> bool {
    let GenerateGaitRequest { speed_m_s, .. } = asked;
    let speed_m_s = speed_m_s.0.first().copied().unwrap_or(f64::NAN);
    let planned_for = gait.request["speed_m_s"].as_f64().unwrap_or(f64::NAN);
    // Written numbers may be off by their last digit.
    (planned_for - speed_m_s).abs() < 1e-9 && request(gait, speed_m_s) == *asked
}
