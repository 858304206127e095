//! What walks the robot in a trial.

use control::balanced::{Balance, BalanceConfig, Cycle};
use control::{Config, InertialState, JointCommand, JointState, PreparedGait, Velocity};
use estimator::{Estimator, Health};
use gait::{Gait, StepSide};
use robot::{Robot, RobotError};
use std::time::Duration;

/// Why a trial cannot begin.
#[derive(Debug, thiserror::Error)]
pub enum BrainError {
    /// The robot's legs.
    #[error(transparent)]
    Robot(#[from] RobotError),
    /// The gait.
    #[error(transparent)]
    Gait(#[from] gait::GaitError),
    /// The simulator.
    #[error(transparent)]
    Simulator(#[from] crate::simulator::SimulatorError),
}

/// The law, and what it remembers.
pub struct Brain {
    config: Config,
    balance_config: BalanceConfig,
    gait: PreparedGait,
    balanced: bool,
    estimate: Estimator,
    balance: Option<Balance>,
    last: Option<Duration>,
}

impl Brain {
    /// A walk of `gait` that begins on it.
    pub fn new(robot: &Robot, gait: &Gait, balanced: bool) -> Result<Self, BrainError> {
        let config = Config::for_robot(robot);
        Ok(Self {
            balance_config: BalanceConfig::for_robot(robot)?,
            gait: PreparedGait::new(gait, &config)?,
            config,
            balanced,
            estimate: Estimator::default(),
            balance: None,
            last: None,
        })
    }

    /// The estimate, and the pace.
    pub fn watched(&self) -> (&Estimator, f64) {
        (&self.estimate, self.balance.as_ref().map_or(1.0, |balance| balance.report().pace))
    }

    /// One cycle.
    pub fn cycle(
        &mut self,
        joints: &JointState,
        inertial: &InertialState,
        asked: Option<Velocity>,
        now: Duration,
    ) -> Result<JointCommand, String> {
        let dt_s = self.last.map_or(0.0, |last| (now - last).as_secs_f64());
        self.last = Some(now);
        let (q, v) = (&joints.position_rad, &joints.velocity_rad_s);
        let (side, at) = if self.balanced {
            let swings = self.balance.as_ref().map_or([true, false, false, true], Balance::swings);
            let phase = self.balance.as_ref().map_or(0.0, Balance::phase);
            let inertial = inertial.for_estimator(now);
            self.balance_config.estimate(&mut self.estimate, (q, v), inertial, swings, Some(phase), dt_s);
            if self.estimate.health() != Health::Good {
                return Err(format!("estimator {}", self.estimate.health().name()));
            }
            let cycle = Cycle {
                config: &self.balance_config,
                gait: &self.gait,
                position_rad: q,
                velocity_limit_rad_s: &self.config.velocity_limit_rad_s,
                estimate: &self.estimate,
                share: 1.0,
                dt_s,
            };
            let balance = self.balance.get_or_insert_with(|| Balance::start(&cycle, true));
            balance.advance(&cycle);
            let asked = asked.unwrap_or(balance.own_velocity());
            let at = balance.step(&cycle, &asked);
            (balance.side(), at)
        } else {
            let t = now.as_secs_f64() / self.gait.step_duration_s();
            let side = StepSide::of_step(t.floor() as u64);
            (side, self.gait.at(side, t.fract()))
        };
        Ok(JointCommand {
            position_rad: at.position_rad,
            velocity_rad_s: at.velocity_rad_s,
            kp: self.gait.kp(side),
            kd: self.gait.kd(side),
            torque_nm: at.torque_nm,
        })
    }
}
