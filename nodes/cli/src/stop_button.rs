//! `tandem stop-button`: an emergency stop in a person's hand, by a key or a joystick's button, that says all the time
//! that it is there.

mod input;

use anyhow::{Result, bail};
use input::{Event, Input};
use ros::{Node, Qos};
use std::io::Write;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;
use tandem_msgs::std_msgs::Bool;

/// Time between two messages: ten within the heartbeat of 0.5 s that the hardware launch file asks for.
const PERIOD: Duration = Duration::from_millis(50);

/// Publish the emergency stop, 20 times a second, from keys or from a joystick's button
///
/// Space or Enter presses, r releases, q leaves. A joystick's button presses while it is held, and stays pressed after
/// that until r is typed or, without a terminal, until --release-button is pressed. Releasing moves nothing: the robot
/// stays damped until it is asked to stand.
///
/// Its silence is a press where the controller asks for a heartbeat (emergency_stop_heartbeat_s, as hardware.launch.py
/// and the systemd unit do): ending this program, losing its terminal, its joystick or the network stops the robot. It
/// is no replacement for a switch that cuts the drives' power.
///
///   tandem stop-button
///   tandem stop-button --joystick /dev/input/js0 --button 1 --release-button 7
#[derive(clap::Args)]
#[command(verbatim_doc_comment)]
pub struct Arguments {
    /// Joystick to listen to, such as /dev/input/js0
    #[arg(long, value_name = "DEVICE")]
    joystick: Option<PathBuf>,
    /// Its button that presses, counted from 0
    #[arg(long, value_name = "N", default_value_t = 0)]
    button: u8,
    /// Its button that releases, counted from 0
    #[arg(long, value_name = "N")]
    release_button: Option<u8>,
    /// Options of ROS 2, after --ros-args, such as -r __ns:=/robot
    #[arg(trailing_var_arg = true, allow_hyphen_values = true, value_name = "--ros-args ...")]
    ros: Vec<String>,
}

/// Runs the subcommand.
pub fn run(arguments: &Arguments) -> Result<ExitCode> {
    let ros_arguments = node_arguments(&arguments.ros)?;
    if arguments.release_button == Some(arguments.button) {
        bail!("--release-button is {}, as --button; expected another one", arguments.button);
    }
    let joystick = arguments.joystick.as_deref().map(|path| (path, arguments.button, arguments.release_button));
    let input = Input::open(joystick)?;
    let node = Node::start("stop_button", &ros_arguments.supervised())?;
    let publisher = node.publisher::<Bool>("emergency_stop", Qos::reliable(100))?;
    say(input.help());
    let left = publish(&node, input, |pressed| publisher.publish(Bool { data: pressed }).map_err(Into::into));
    if let Some(failure) = node.stop().failure() {
        bail!("{failure}");
    }
    // Leaves in order: a controller that does not ask for a heartbeat learns nothing by this.
    node.shutdown();
    say("gone. A controller that asks for a heartbeat has stopped the robot, unless another stop button runs.");
    left.map(|()| ExitCode::SUCCESS)
}

/// The options of ROS 2 that stand at the end of a command line.
pub fn node_arguments(line: &[String]) -> Result<ros::Arguments> {
    if let Some(first) = line.first()
        && first != "--ros-args"
    {
        bail!("'{first}' is not known; expected options as in --help, or --ros-args");
    }
    Ok(ros::Arguments::from_line(std::iter::once("tandem".to_owned()).chain(line.iter().cloned()))?.0)
}

/// A terminal in raw mode wants the carriage's return.
fn say(words: &str) {
    // A terminal that is gone is no reason to fall silent.
    let _ = write!(std::io::stderr(), "stop-button: {words}\r\n");
}

/// Publishes until a person or a signal ends it. What is lost is pressed.
fn publish(node: &Node, mut input: Input, send: impl Fn(bool) -> Result<()>) -> Result<()> {
    let mut pressed = false;
    let mut failed = 0_u64;
    while !node.stop().is_requested() {
        let before = pressed;
        // Every change is published at once; nothing for a while: the same again.
        match input.wait(PERIOD) {
            Event::Nothing => {}
            Event::Press => pressed = true,
            Event::Release if input.is_lost() => say("not released: the input is lost; repair it and start anew"),
            Event::Release => pressed = false,
            Event::Leave => return Ok(()),
            Event::Lost(what) => {
                pressed = true;
                say(&format!("{what} is lost: pressed"));
            }
        }
        if before != pressed {
            say(if pressed { "PRESSED" } else { "released; the robot stays damped until it is asked to stand" });
        }
        if let Err(error) = send(pressed) {
            failed += 1;
            if failed.is_power_of_two() {
                say(&format!("{failed} messages not sent, the last: {error}"));
            }
        }
    }
    Ok(())
}
