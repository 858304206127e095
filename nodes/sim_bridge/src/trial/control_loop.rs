//! What walks the robot in a trial: the controller's own step.

use control::balanced::{BalanceConfig, BalanceReport};
use control::{
    Config, Controller, InertialState, Input, JointCommand, JointState, Mode, Output, PreparedGait, Request, Velocity,
    VelocityCommand,
};
use estimator::Estimator;
use gait::Gait;
use robot::{Robot, RobotError};
use std::time::Duration;

/// Why a trial cannot begin.
#[derive(Debug, thiserror::Error)]
pub enum ControlLoopError {
    /// The robot's legs.
    #[error(transparent)]
    Robot(#[from] RobotError),
    /// The gait.
    #[error(transparent)]
    Gait(#[from] gait::GaitError),
    /// The controller's configuration.
    #[error(transparent)]
    Config(#[from] control::ConfigError),
    /// The simulator.
    #[error(transparent)]
    Simulator(#[from] crate::simulator::SimulatorError),
}

/// The controller, and its last output.
pub struct ControlLoop {
    controller: Controller,
    gait: PreparedGait,
    begun: bool,
    estimate: Estimator,
    report: BalanceReport,
}

impl ControlLoop {
    /// A walk of `gait` that begins on it.
    pub fn new(robot: &Robot, gait: &Gait, balanced: bool, watched: bool) -> Result<Self, ControlLoopError> {
        let balance = balanced.then(|| BalanceConfig::for_robot(robot)).transpose()?;
        let mut config = Config { simulation_start: true, balance, ..Config::for_robot(robot) };
        if !watched {
            (config.tracking_error_rad, config.tracking_error_s) = (2.0, 1.0);
            (config.stuck_rad, config.overspeed_s, config.tilt_limit_rad) = (2.0, 1.0, 1.5);
            config.position_fault_rad = 1.0;
        }
        Ok(Self {
            gait: PreparedGait::new(gait, &config)?,
            controller: Controller::new(config)?,
            begun: false,
            estimate: Estimator::WAITING,
            report: BalanceReport { pace: 1.0, ..BalanceReport::default() },
        })
    }

    /// The estimate, and what the balanced law did.
    pub fn watched(&self) -> (&Estimator, &BalanceReport) {
        (&self.estimate, &self.report)
    }

    /// One cycle.
    pub fn cycle(
        &mut self,
        joints: &JointState,
        inertial: &InertialState,
        asked: Option<Velocity>,
        now: Duration,
    ) -> Result<JointCommand, String> {
        let first = !std::mem::replace(&mut self.begun, true);
        let input = Input {
            joints: Some(joints),
            inertial: Some(*inertial),
            velocity: asked.map(|velocity| VelocityCommand { velocity, arrived: now }),
            requests: if first { &[Request::StartOnGait] } else { &[] },
            gait: first.then_some(&self.gait),
            ..Input::default()
        };
        let output = self.controller.step(&input, now);
        self.estimate = output.estimate.unwrap_or(Estimator::WAITING);
        self.report = output.balance.unwrap_or(self.report);
        if output.mode == Mode::Walking { Ok(output.command) } else { Err(self.why(&output)) }
    }

    fn why(&self, output: &Output) -> String {
        let names = &self.controller.config().joint_names;
        if let Some(Err(refusal)) = output.reply(0) {
            return refusal.to_string();
        }
        output.report.map_or_else(
            || format!("it is {}", output.mode.name()),
            |report| report.joint.map_or(String::new(), |j| format!("{} ", names[j])) + report.fault.name(),
        )
    }
}
