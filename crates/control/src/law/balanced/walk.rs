//! The balanced law in the controller's step: the gait's clock owns the phase, and the law says how fast it runs.

use super::{Balance, BalanceConfig, BalanceReport, Cycle, Velocity};
use crate::gait_clock::Place;
use crate::step::Step;
use crate::{JOINTS, JointCommand};
use estimator::Health;

/// A body that is further than this from where the plan has it is caught, of z0.
const CAUGHT_SHARE: f64 = 0.1;

/// The law and what it asked for last.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Balanced {
    balance: Balance,
    /// Of the clock: it changes where another gait is taken up.
    base_index: u64,
    /// What is to be walked; none: the gait's own velocity.
    asked: Option<Velocity>,
    reference: JointCommand,
    /// For so long the estimate has not been good, s.
    lost_s: f64,
    /// For so long placement or hurrying have been at their limits, s.
    limited_s: f64,
    /// For so long no step had to be caught, s.
    calm_s: f64,
}

/// Why it cannot go on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Trouble {
    /// There has been no good estimate for so long, s.
    EstimateLost { for_s: f64 },
    /// Placement or hurrying have been at their limits for so long, s.
    AtLimits { for_s: f64 },
}

impl Balanced {
    /// At the beginning of a walk. `moving`: the robot already moves as the gait does.
    pub fn start(cycle: &Cycle, moving: bool) -> Self {
        Self {
            balance: Balance::start(cycle, moving),
            base_index: 0,
            asked: None,
            reference: JointCommand::LIMP,
            lost_s: 0.0,
            limited_s: 0.0,
            calm_s: 0.0,
        }
    }

    /// How fast the phase runs, in units of 1 / T.
    pub fn pace(&self) -> f64 {
        self.balance.report().pace
    }

    /// What the last step asked for.
    pub fn reference(&self) -> JointCommand {
        self.reference
    }

    /// What the last step did.
    pub fn report(&self) -> &BalanceReport {
        self.balance.report()
    }

    /// From the next step on it walks `asked`; none: the gait's own velocity.
    pub fn ask(&mut self, asked: Option<Velocity>) {
        self.asked = asked;
    }

    /// One cycle at this place of the gait, which began after `base_index` steps and is in step `step_index`.
    pub fn step(&mut self, cycle: &Cycle, place: &Place, base_index: u64, step_index: u64) {
        if base_index == self.base_index {
            self.balance.follow(cycle, step_index, place.phase);
        } else {
            self.base_index = base_index;
            let by_lead = place.step == Step::Lead(0);
            self.balance.change(cycle, step_index, by_lead, place.phase, self.reference.position_rad);
        }
        let own = self.balance.own_velocity();
        let asked = self.asked.unwrap_or(Velocity {
            forward_m_s: cycle.share * own.forward_m_s,
            left_m_s: cycle.share * own.left_m_s,
            yaw_rad_s: cycle.share * own.yaw_rad_s,
        });
        let at = self.balance.step(cycle, &asked);
        self.reference = JointCommand {
            position_rad: at.position_rad,
            velocity_rad_s: at.velocity_rad_s,
            kp: cycle.gait.kp(place.step),
            kd: cycle.gait.kd(place.step),
            torque_nm: at.torque_nm,
        };
        let good = cycle.estimate.health() == Health::Good;
        self.lost_s = if good { 0.0 } else { self.lost_s + cycle.dt_s };
        let report = self.balance.report();
        let limited = report.placement_limited || report.hurry_limited;
        self.limited_s = if limited { self.limited_s + cycle.dt_s } else { 0.0 };
        let [ahead, left] = report.error_m;
        let caught = report.pace > 1.0 || ahead.hypot(left) > CAUGHT_SHARE * self.balance.height_m();
        self.calm_s = if caught { 0.0 } else { self.calm_s + cycle.dt_s };
    }

    /// Why it cannot go on, if it cannot.
    pub fn trouble(&self, config: &BalanceConfig, health: Health) -> Option<Trouble> {
        if self.lost_s > config.estimate_patience_s || matches!(health, Health::OutOfBounds | Health::Waiting) {
            Some(Trouble::EstimateLost { for_s: self.lost_s })
        } else if self.limited_s > config.limited_patience_s {
            Some(Trouble::AtLimits { for_s: self.limited_s })
        } else {
            None
        }
    }

    /// Whether a step is caught, or one was within the last `period_s`: its feet may be held by the ground.
    pub fn catches(&self, period_s: f64) -> bool {
        self.calm_s < period_s
    }

    /// Where a walk that ends at a switch comes to rest from: positions and velocities of the new step's beginning.
    pub fn at_switch(&self) -> ([f64; JOINTS], [f64; JOINTS]) {
        (self.reference.position_rad, self.reference.velocity_rad_s)
    }
}
