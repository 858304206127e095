//! `tandem drive`: a velocity from keys or a joystick, with the emergency stop under the same input.

mod display;
mod steer;

use crate::operator_input::{InputEvent, OperatorInput};
use crate::stop_button::node_arguments;
use anyhow::{Result, bail};
use display::Display;
use ros::{Node, Publisher, Qos};
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::{Duration, Instant};
use steer::{Buttons, Steer};
use tandem_msgs::geometry_msgs::{Twist, TwistStamped, Vector3};
use tandem_msgs::std_msgs::{Bool, Header};

/// Time between two messages: ten within the timeout and within the heartbeat, of 0.5 s each.
const PERIOD: Duration = Duration::from_millis(50);

/// Drive the robot from keys or a joystick, with the emergency stop on the space bar
///
/// Publishes cmd_vel and emergency_stop 20 times a second, and shows in one line what is asked for, what odom says, the
/// controller's mode and its faults. The controller's parameter balance must be true; with cmd_vel_walks a robot that
/// stands with a gait begins to walk by a key. Arming, standing up and sitting down stay requests of their own.
///
/// Keys are teleop_twist_keyboard's: i ahead, comma back, j and l turn, u o m . both; with shift sideways. k and any
/// other key: stand still. q z, w x, e c: both limits, the speed's, the turning's up and down by a tenth. A key that is
/// not repeated for --hold counts as let go. Space: emergency stop. r: release it. Ctrl-C: leave.
///
/// A joystick's left stick goes, its right stick turns, while button --enable is held.
///
///   tandem drive
///   tandem drive --joystick /dev/input/js0 --button 1 --release-button 7
#[derive(clap::Args)]
#[command(verbatim_doc_comment)]
pub struct Arguments {
    /// Greatest speed at the start, m/s
    #[arg(long, value_name = "M_S", default_value_t = 0.3)]
    speed: f64,
    /// Greatest turning at the start, rad/s
    #[arg(long, value_name = "RAD_S", default_value_t = 0.5)]
    turn: f64,
    /// A key counts for so long after it came, s
    #[arg(long, value_name = "S", default_value_t = 0.7)]
    hold: f64,
    /// cmd_vel is a TwistStamped, as the controller's cmd_vel_stamped
    #[arg(long)]
    stamped: bool,
    /// Joystick to listen to, such as /dev/input/js0
    #[arg(long, value_name = "DEVICE")]
    joystick: Option<PathBuf>,
    /// Its button that presses the emergency stop, counted from 0
    #[arg(long, value_name = "N", default_value_t = 0)]
    button: u8,
    /// Its button that releases it, counted from 0
    #[arg(long, value_name = "N")]
    release_button: Option<u8>,
    /// Its button that is held while the sticks are to count, counted from 0
    #[arg(long, value_name = "N", default_value_t = 4)]
    enable: u8,
    /// Options of ROS 2, after --ros-args, such as -r __ns:=/robot
    #[arg(trailing_var_arg = true, allow_hyphen_values = true, value_name = "--ros-args ...")]
    ros: Vec<String>,
}

impl Arguments {
    fn steer(&self) -> Result<Steer> {
        for (name, value, most) in [("speed", self.speed, 10.0), ("turn", self.turn, 10.0), ("hold", self.hold, 60.0)] {
            // Written so that NaN is refused too.
            if !(value > 0.0 && value <= most) {
                bail!("--{name} is {value}, expected more than 0, at most {most}");
            }
        }
        let buttons = Buttons { press: self.button, release: self.release_button, enable: self.enable };
        if buttons.release == Some(buttons.press)
            || buttons.release == Some(buttons.enable)
            || buttons.press == buttons.enable
        {
            bail!("--button, --release-button and --enable name one button twice");
        }
        Ok(Steer::new(self.speed, self.turn, Duration::from_secs_f64(self.hold), buttons))
    }
}

/// Runs the subcommand.
pub fn run(arguments: &Arguments) -> Result<ExitCode> {
    let ros_arguments = node_arguments(&arguments.ros)?;
    let mut steer = arguments.steer()?;
    let mut input = OperatorInput::open(arguments.joystick.as_deref())?;
    if !input.has_keys() && (input.joystick().is_none() || arguments.release_button.is_none()) {
        bail!(
            "standard input is no terminal, so no key can be read; run it in a terminal, or name a joystick with --joystick and --release-button"
        );
    }
    let node = Node::start("drive", &ros_arguments.supervised())?;
    let display = Display::new(&node)?;
    let publishers = CommandPublishers::new(&node, arguments.stamped)?;
    display.say("i , j l u o m . drive (shift: sideways), k stands still, q z w x e c change the limits, SPACE is the emergency stop, r releases it, Ctrl-C leaves");
    drive(&node, &mut input, &mut steer, &display, &publishers);
    // The last message, whatever ended it; then silence, which is a press where the controller asks for a heartbeat.
    publishers.publish(&node, [0.0; 3], steer.pressed());
    if let Some(failure) = node.stop().failure() {
        bail!("{failure}");
    }
    node.shutdown();
    display.say("gone. A controller that asks for a heartbeat has stopped the robot, unless a stop button runs.");
    Ok(ExitCode::SUCCESS)
}

/// Until a signal ends it. Every change is published at once; nothing for a while: the same again.
fn drive(node: &Node, input: &mut OperatorInput, steer: &mut Steer, display: &Display, publishers: &CommandPublishers) {
    let mut due = Instant::now();
    while !node.stop().is_requested() {
        let event = input.wait(due);
        let pressed = steer.pressed();
        steer.take(&event, Instant::now());
        if let InputEvent::Lost(what) = &event {
            display.say(&format!("{what} is lost: the emergency stop is pressed; repair it and start anew"));
        }
        let now = Instant::now();
        if pressed == steer.pressed() && now < due {
            continue;
        }
        due = now + PERIOD;
        publishers.publish(node, steer.velocity(now), steer.pressed());
        display.show(steer, now);
    }
}

/// What is published.
struct CommandPublishers {
    stop: Publisher<Bool>,
    velocity: Velocity,
}

enum Velocity {
    Plain(Publisher<Twist>),
    Stamped(Publisher<TwistStamped>),
}

impl CommandPublishers {
    fn new(node: &Node, stamped: bool) -> Result<Self> {
        let velocity = if stamped {
            Velocity::Stamped(node.publisher("cmd_vel", Qos::reliable(10))?)
        } else {
            Velocity::Plain(node.publisher("cmd_vel", Qos::reliable(10))?)
        };
        Ok(Self { stop: node.publisher("emergency_stop", Qos::reliable(100))?, velocity })
    }

    /// What is not sent is silence, which stops the robot: the next one is tried all the same.
    fn publish(&self, node: &Node, [x, y, turning]: [f64; 3], pressed: bool) {
        let _ = self.stop.publish(Bool { data: pressed });
        let twist = Twist { linear: Vector3 { x, y, z: 0.0 }, angular: Vector3 { x: 0.0, y: 0.0, z: turning } };
        let _ = match &self.velocity {
            Velocity::Plain(publisher) => publisher.publish(twist),
            Velocity::Stamped(publisher) => {
                let header = Header { stamp: node.clock().now(), frame_id: "base_link".into() };
                publisher.publish(TwistStamped { header, twist })
            }
        };
    }
}
