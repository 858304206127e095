//! Balance and driving: what the node's parameters say of them, and `cmd_vel`.

use crate::command_gait::{CommandGaits, Rule};
use crate::cycle::TimedVelocity;
use crate::inputs::Topic;
use crate::lease::Gate;
use crate::parameters::Table;
use control::balanced::BalanceConfig;
use control::{Config, Velocity};
use realtime::monotonic_now;
use robot::{Robot, RobotError};
use ros::{Node, Qos, RosError};
use rtrb::{Consumer, RingBuffer};
use std::sync::Arc;
use tandem_msgs::geometry_msgs::{Twist, TwistStamped};

/// Velocities that may wait for the cycle, which takes the newest.
const DEPTH: usize = 64;

/// What the parameters say of balance and driving.
#[derive(Clone, Debug)]
pub struct DriveParameters {
    /// The balanced law is walked, where inertial data is received.
    pub balance: bool,
    /// `cmd_vel` is a TwistStamped.
    pub stamped: bool,
    /// A velocity older than this counts as none, s.
    pub timeout_s: f64,
    /// A velocity begins a walk; without one for this long the robot stands again, s.
    pub stand_after_s: Option<f64>,
    /// A gait is planned for a velocity that stays further than this from the gait's own, m/s, for so long, s.
    pub plan_for: Option<(f64, f64)>,
    /// Messages of odometry a second.
    pub odometry_rate_hz: f64,
    /// Stands before the frames' names.
    pub frame_prefix: String,
}

impl DriveParameters {
    /// What the table reports of them.
    pub fn new(table: &Table) -> Self {
        Self {
            balance: table.balance,
            stamped: table.cmd_vel_stamped,
            timeout_s: table.cmd_vel_timeout_s,
            stand_after_s: table.cmd_vel_walks.then_some(table.cmd_vel_stand_s),
            plan_for: (table.balance && table.plan_for_cmd_vel)
                .then_some((table.plan_for_cmd_vel_far_m_s, table.plan_for_cmd_vel_held_s)),
            odometry_rate_hz: table.odometry_rate_hz,
            frame_prefix: table.frame_prefix.clone(),
        }
    }

    /// The controller's configuration with what they ask for.
    ///
    /// # Errors
    /// If it is to walk in balance, and the robot's legs are of another shape than the law knows.
    pub fn apply(&self, robot: &Robot, config: Config) -> Result<Config, RobotError> {
        let balance = self.balance.then(|| BalanceConfig::for_robot(robot)).transpose()?;
        let balance = balance.map(|balance| BalanceConfig {
            command_timeout_s: self.timeout_s,
            stand_after_s: self.stand_after_s,
            ..balance
        });
        Ok(Config { balance, ..config })
    }

    /// Gaits for the command, where they are asked for.
    pub fn command_gaits(&self, config: &Config) -> Option<Arc<CommandGaits>> {
        let ((far_m_s, held_s), balance) = (self.plan_for?, config.balance.as_ref()?);
        Some(Arc::new(CommandGaits::new(Rule::new(far_m_s, held_s, config, balance), config.clone())))
    }

    /// Subscribes to `cmd_vel`, where it is to be obeyed; the cycle's end of what it asks for.
    ///
    /// # Errors
    /// What the middleware refuses.
    pub fn listen(
        &self,
        node: &Node,
        gate: Gate,
        gaits: Option<Arc<CommandGaits>>,
    ) -> Result<Consumer<TimedVelocity>, RosError> {
        let (mut velocities, consumer) = RingBuffer::new(DEPTH);
        if !self.balance {
            return Ok(consumer);
        }
        let mut take = move |publisher, twist: &Twist| {
            if !gate.heeds(Topic::CmdVel, publisher) {
                return;
            }
            let velocity =
                Velocity { forward_m_s: twist.linear.x, left_m_s: twist.linear.y, yaw_rad_s: twist.angular.z };
            if velocity.is_finite() {
                gate.problems.is_fine(Topic::CmdVel);
                gaits.iter().for_each(|gaits| gaits.hear(velocity.forward_m_s));
                // A full buffer: no cycle runs, and what waits will be too old for the next one.
                let _ = velocities.push(TimedVelocity { velocity, wall: monotonic_now() });
            } else {
                let text = format!(
                    "refused: linear.x {}, linear.y {}, angular.z {}: expected finite numbers",
                    velocity.forward_m_s, velocity.left_m_s, velocity.yaw_rad_s
                );
                gate.problems.note(Topic::CmdVel, text, monotonic_now());
            }
        };
        // Whoever publishes best effort or reliably is received.
        let qos = Qos::best_effort(10);
        if self.stamped {
            let stamped = move |publisher, message: TwistStamped| take(publisher, &message.twist);
            node.subscribe_from("cmd_vel", qos, stamped, |_| {})?;
        } else {
            node.subscribe_from("cmd_vel", qos, move |publisher, message: Twist| take(publisher, &message), |_| {})?;
        }
        Ok(consumer)
    }
}
