//! `tandem adapt`: another robot's, or another framework's, topics under Tandem's names.

mod messages;
mod rules;

use crate::robots::{self, RobotArguments};
use anyhow::{Context, Result, bail};
use messages::{CommandAdapter, StateAdapter};
use ros::{Node, Publisher, Qos};
use rules::Rules;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use tandem_msgs::builtin_interfaces::Time;
use tandem_msgs::geometry_msgs::Twist;
use tandem_msgs::sensor_msgs::{Imu, JointState};
use tandem_msgs::{JointCommand, Message};

/// Put another robot's, or another framework's, topics under Tandem's names
///
/// Reads a file of rules: joint_states (names, order, signs and zeros of joints), imu and twist are handed on,
/// joint_commands (sensor_msgs/JointState, as topic_based_ros2_control publishes them) become joint_command with the
/// robot's gains. A file without joint_commands commands nothing. Until Ctrl-C.
///
///   tandem adapt config/adapters/vision60.toml
///   tandem adapt config/adapters/ros2_control.toml
#[derive(clap::Args)]
#[command(verbatim_doc_comment)]
pub struct Arguments {
    /// The rules; those that come with Tandem are in config/adapters
    #[arg(value_name = "FILE")]
    rules: PathBuf,
    #[command(flatten)]
    robot: RobotArguments,
    /// --ros-args and what ROS 2 allows after it (remapping, namespace, log level)
    #[arg(trailing_var_arg = true, allow_hyphen_values = true, value_name = "--ros-args ...")]
    ros: Vec<String>,
}

/// Runs the subcommand.
pub fn run(arguments: &Arguments) -> Result<ExitCode> {
    if let Some(first) = arguments.ros.first()
        && first != "--ros-args"
    {
        bail!("'{first}' is not known; expected options as in --help, or --ros-args");
    }
    let robot = arguments.robot.load()?;
    let rules = read(&robots::file(&arguments.rules))?;
    let line = std::iter::once("tandem".to_owned()).chain(arguments.ros.iter().cloned());
    let (ros_arguments, _) = ros::Arguments::from_line(line)?;
    let node = Node::start("adapter", &ros_arguments)?;
    for rule in &rules.joint_states {
        let adapter = StateAdapter::new(rule, &robot.joint_names())?;
        hand_on(&node, &rule.from, &rule.to, move |message: JointState| adapter.adapt(&message))?;
    }
    for rule in &rules.imu {
        let frame = rule.frame_id.clone();
        hand_on(&node, &rule.from, &rule.to, move |mut message: Imu| {
            if let Some(frame) = &frame {
                message.header.frame_id.clone_from(frame);
            }
            Ok(message)
        })?;
    }
    for rule in &rules.twist {
        hand_on(&node, &rule.from, &rule.to, Ok::<Twist, String>)?;
    }
    for rule in &rules.joint_commands {
        let (mut adapter, clock) = (CommandAdapter::new(&robot), node.clock());
        hand_on(&node, &rule.from, &rule.to, move |mut message: JointState| -> Result<JointCommand, String> {
            // The simulation takes a command whose stamp it has seen for the one that it has: it would damp.
            if message.header.stamp == Time::default() {
                message.header.stamp = clock.now();
            }
            adapter.adapt(&message)
        })?;
    }
    say!("handing on {}; Ctrl-C ends it", rules.summary())?;
    node.run();
    Ok(ExitCode::SUCCESS)
}

fn read(file: &Path) -> Result<Rules> {
    let text = std::fs::read_to_string(file).with_context(|| format!("{}", file.display()))?;
    Rules::from_toml(&text).with_context(|| format!("{}", file.display()))
}

/// Publishes what becomes of each message. What cannot be handed on is reported at its 1st, 2nd, 4th, … time.
fn hand_on<A: Message, B: Message>(
    node: &Node,
    from: &str,
    to: &str,
    mut adapt: impl FnMut(A) -> Result<B, String> + Send + 'static,
) -> Result<()> {
    let publisher: Publisher<B> = node.publisher(to, Qos::reliable(10))?;
    let mut refused = 0_u64;
    let topic = from.to_owned();
    node.subscribe(from, Qos::best_effort(10), move |message: A| {
        let sent = adapt(message).and_then(|message| publisher.publish(message).map_err(|error| error.to_string()));
        if let Err(reason) = sent {
            refused += 1;
            if refused.is_power_of_two() {
                tracing::warn!("{refused} messages of {topic} not handed on; the last: {reason}");
            }
        }
    })?;
    Ok(())
}
