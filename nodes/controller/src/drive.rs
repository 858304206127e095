//! Balance and driving: the node's parameters for them, and `cmd_vel`.

use crate::cycle::TimedVelocity;
use crate::inputs::{InputProblems, Topic};
use control::balanced::{BalanceConfig, default};
use control::{Config, Velocity};
use realtime::monotonic_now;
use robot::{Robot, RobotError};
use ros::{Node, Qos, RosError};
use rtrb::Producer;
use std::sync::Arc;
use tandem_msgs::geometry_msgs::{Twist, TwistStamped};

/// Velocities that may wait for the cycle, which takes the newest.
pub const DEPTH: usize = 64;

/// What the parameters say of balance and driving.
#[derive(Clone, Debug)]
pub struct DriveParameters {
    /// The balanced law is walked, where an inertial unit is heard.
    pub balance: bool,
    /// `cmd_vel` is a TwistStamped.
    pub stamped: bool,
    /// A velocity older than this counts as none, s.
    pub timeout_s: f64,
    /// Messages of odometry a second.
    pub odometry_rate_hz: f64,
    /// Stands before the frames' names.
    pub frame_prefix: String,
}

impl DriveParameters {
    /// Declares them and reads their values.
    ///
    /// # Errors
    /// The first parameter whose value is of another type or out of its range.
    pub fn declare(node: &Node) -> Result<Self, RosError> {
        let flag = |name: &str, text: &str| {
            node.parameter(name, false).description(text).read_only().declare().map(|p| p.get())
        };
        let number = |name: &str, default: f64, low: f64, high: f64, text: &str| {
            node.parameter(name, default).description(text).range(low, high).read_only().declare().map(|p| p.get())
        };
        Ok(Self {
            balance: flag(
                "balance",
                "Walk in balance where an inertial unit is heard, obey cmd_vel, and publish odom and /tf; false: the paper's law.",
            )?,
            stamped: flag("cmd_vel_stamped", "cmd_vel is a geometry_msgs/TwistStamped; false: a Twist.")?,
            timeout_s: number(
                "cmd_vel_timeout_s",
                default::COMMAND_TIMEOUT_S,
                0.05,
                10.0,
                "A cmd_vel older than this counts as none, s: it steps in place.",
            )?,
            odometry_rate_hz: number(
                "odometry_rate_hz",
                50.0,
                0.1,
                1000.0,
                "With balance: messages on odom and /tf a second.",
            )?,
            frame_prefix: node
                .parameter("frame_prefix", String::new())
                .description("With balance: stands before the names of the frames odom and base_link, such as left/.")
                .validate(ros::PREFIX_RULE, ros::check_prefix)
                .read_only()
                .declare()?
                .get(),
        })
    }

    /// The controller's configuration with what they ask for.
    ///
    /// # Errors
    /// If it is to walk in balance, and the robot's legs are of another shape than the law knows.
    pub fn apply(&self, robot: &Robot, config: Config) -> Result<Config, RobotError> {
        let balance = self.balance.then(|| BalanceConfig::for_robot(robot)).transpose()?;
        let balance = balance.map(|balance| BalanceConfig { command_timeout_s: self.timeout_s, ..balance });
        Ok(Config { balance, ..config })
    }

    /// Hears `cmd_vel`, where it is to be obeyed.
    ///
    /// # Errors
    /// What the middleware refuses.
    pub fn listen(
        &self,
        node: &Node,
        mut velocities: Producer<TimedVelocity>,
        problems: Arc<InputProblems>,
    ) -> Result<(), RosError> {
        if !self.balance {
            return Ok(());
        }
        let mut hear = move |twist: &Twist| {
            let velocity =
                Velocity { forward_m_s: twist.linear.x, left_m_s: twist.linear.y, yaw_rad_s: twist.angular.z };
            if velocity.is_finite() {
                problems.is_fine(Topic::CmdVel);
                // A full buffer: no cycle runs, and what waits will be too old for the next one.
                let _ = velocities.push(TimedVelocity { velocity, wall: monotonic_now() });
            } else {
                let text = format!(
                    "refused: linear.x {}, linear.y {}, angular.z {}: expected finite numbers",
                    velocity.forward_m_s, velocity.left_m_s, velocity.yaw_rad_s
                );
                problems.note(Topic::CmdVel, text, monotonic_now());
            }
        };
        // Whoever publishes best effort or reliably is heard.
        let qos = Qos::best_effort(10);
        if self.stamped {
            node.subscribe("cmd_vel", qos, move |message: TwistStamped| hear(&message.twist))
        } else {
            node.subscribe("cmd_vel", qos, move |message: Twist| hear(&message))
        }
    }
}
