//! The robot's day: its mode, what is latched, and what is wanted.

use crate::{DampingReason, Event, Fault, FaultReport, FaultSet, Guards, Mode, Refusal, Severity, transition};
use std::time::Duration;

/// What is remembered of the velocities that were asked for.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Heed {
    /// A velocity other than zero is asked for now.
    pub asked: bool,
    /// Since when none is, counted from the operator's last request.
    pub rests_since: Option<Duration>,
    /// It was so for long enough: the next one begins a walk.
    pub may_begin: bool,
}

impl Heed {
    /// Nothing was asked for, and what will be does not begin a walk yet.
    pub const NOT_YET: Self = Self { asked: false, rests_since: None, may_begin: false };
}

/// Where the robot's day is.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Day {
    pub mode: Mode,
    pub damping_reason: Option<DampingReason>,
    pub faults: FaultSet,
    pub report: Option<FaultReport>,
    pub walk_wanted: bool,
    /// What the present input reports of the emergency stop.
    pub emergency_stop: bool,
    /// Whether a velocity begins a walk.
    #[serde(default)]
    pub heed: Heed,
}

impl Day {
    /// Disarmed.
    pub const BEGINNING: Self = Self {
        mode: Mode::Disarmed,
        damping_reason: None,
        faults: FaultSet::NONE,
        report: None,
        walk_wanted: false,
        emergency_stop: false,
        heed: Heed::NOT_YET,
    };

    /// Something happened: the mode that it leads to, or why it is refused. The mode is changed here and nowhere else.
    pub fn take(&mut self, event: Event, guards: &Guards) -> Result<Mode, Refusal> {
        let to = transition(self.mode, event, guards)?;
        if to != self.mode {
            self.mode = to;
            self.damping_reason = matches!(to, Mode::Damping | Mode::Fault).then_some(match event {
                Event::EmergencyStop => DampingReason::EmergencyStop,
                Event::Stale => DampingReason::StaleJointState,
                Event::FaultLatched => DampingReason::Fault,
                _ => DampingReason::Armed,
            });
            if !to.is_moving() {
                self.walk_wanted = false;
            }
        }
        Ok(to)
    }

    /// Latches a fault; what that means for the mode.
    pub fn latch(&mut self, report: FaultReport) -> Event {
        if self.faults.insert(report.fault) {
            self.report = Some(report);
        }
        match report.fault.severity() {
            Severity::Damping => Event::FaultLatched,
            Severity::ControlledStop => {
                self.walk_wanted = false;
                Event::Stop
            }
        }
    }

    /// Clears a fault; what that means for the mode, if anything.
    pub fn clear(&mut self, fault: Fault) -> Result<Option<Event>, Refusal> {
        if !self.faults.remove(fault) {
            return Err(Refusal::FaultNotLatched);
        }
        if self.report.is_some_and(|r| r.fault == fault) {
            self.report = None;
        }
        Ok((!self.faults.any_damping()).then_some(Event::FaultsCleared))
    }
}
