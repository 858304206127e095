//! `tandem show`: what 3D views need beside the nodes' own topics, every link's frame and shapes; or a view in a
//! browser.

mod shapes;
mod web;

use crate::robots::RobotArguments;
use anyhow::{Result, bail};
use gait::{Gait, LEGS};
use robot::Robot;
use ros::{Node, Qos};
use shapes::Shapes;
use std::collections::BTreeMap;
use std::process::ExitCode;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};
use tandem_msgs::diagnostic_msgs::DiagnosticArray;
use tandem_msgs::geometry_msgs::WrenchStamped;
use tandem_msgs::nav_msgs::Odometry;
use tandem_msgs::sensor_msgs::JointState;
use tandem_msgs::text::{NAME_CHARS, SENTENCE_CHARS, printable};
use tandem_msgs::tf2_msgs::TFMessage;
use tandem_msgs::visualization_msgs::MarkerArray;
use tandem_msgs::{ControllerState, std_msgs};

/// Publish every link's frame and shapes for RViz and Foxglove, or show the robot in a browser
///
/// Listens to joint_states, odom, ground_force/LEG, gait and controller_state, of running nodes or of a bag that is
/// played, and publishes /tf (base_link to every link), markers (visualization_msgs/MarkerArray: feet, ground forces,
/// the planned paths of the swinging feet) and robot_description (latched). Until Ctrl-C.
///
/// With --web it publishes none of these and serves a page instead, on this machine alone: the robot as it moves, its
/// feet, forces, mode and faults, and a stop button. The button says nothing before it is pressed: an open page is no
/// heartbeat of the stop. From the first press on it publishes emergency_stop 20 times a second, as stop-button does.
///
///   tandem show &
///   rviz2 -d config/rviz/tandem.rviz
///   tandem show --web
#[derive(clap::Args)]
#[command(verbatim_doc_comment)]
pub struct Arguments {
    /// Pictures a second, 1 to 100
    #[arg(long, value_name = "HZ", default_value_t = 30.0)]
    rate: f64,
    /// Serve a page on http://127.0.0.1:PORT; 0: a port that is free
    #[arg(long, value_name = "PORT", num_args = 0..=1, require_equals = true, default_missing_value = "8642")]
    web: Option<u16>,
    #[command(flatten)]
    robot: RobotArguments,
    /// --ros-args and what ROS 2 allows after it (remapping, namespace, log level)
    #[arg(trailing_var_arg = true, allow_hyphen_values = true, value_name = "--ros-args ...")]
    ros: Vec<String>,
}

/// Parts of a machine whose diagnostics are kept, at most.
const DIAGNOSTICS: usize = 64;

/// What was received last.
#[derive(Default)]
struct Received {
    joints: Option<JointState>,
    odometry: Option<Odometry>,
    force_n: [Option<[f64; 3]>; LEGS],
    gait: Option<Gait>,
    state: Option<ControllerState>,
    /// Level and message of each part, and when it was received.
    diagnostics: BTreeMap<String, (u8, String, Instant)>,
    at: Arrivals,
}

/// When the last of each came.
#[derive(Default)]
struct Arrivals {
    joints: Option<Instant>,
    odometry: Option<Instant>,
    forces: Option<Instant>,
    state: Option<Instant>,
}

impl Received {
    /// The base's orientation in the world, (x, y, z, w); none turned before odometry was received.
    fn base_orientation(&self) -> [f64; 4] {
        self.odometry.as_ref().map_or([0.0, 0.0, 0.0, 1.0], |odometry| {
            let q = odometry.pose.pose.orientation;
            [q.x, q.y, q.z, q.w]
        })
    }
}

/// Runs the subcommand.
pub fn run(arguments: &Arguments) -> Result<ExitCode> {
    if !(1.0..=100.0).contains(&arguments.rate) {
        bail!("--rate is {}; expected 1 to 100 Hz", arguments.rate);
    }
    if let Some(first) = arguments.ros.first()
        && first != "--ros-args"
    {
        bail!("'{first}' is not known; expected options as in --help, or --ros-args");
    }
    let robot = arguments.robot.load()?;
    let mut shapes = Shapes::new(robot)?;
    let line = std::iter::once("tandem".to_owned()).chain(arguments.ros.iter().cloned());
    let (ros_arguments, _) = ros::Arguments::from_line(line)?;
    let node = Node::start("show", &ros_arguments)?;
    let received = Arc::new(Mutex::new(Received::default()));
    listen(&node, &received, &shapes.robot)?;
    let period = Duration::from_secs_f64(1.0 / arguments.rate);
    match arguments.web {
        Some(port) => web::serve(&node, &received, &mut shapes, port, period)?,
        None => publish(&node, &received, &mut shapes, period)?,
    }
    node.shutdown();
    Ok(ExitCode::SUCCESS)
}

fn publish(node: &Node, received: &Mutex<Received>, shapes: &mut Shapes, period: Duration) -> Result<()> {
    let frames = node.publisher::<TFMessage>("/tf", Qos::reliable(100))?;
    let markers = node.publisher::<MarkerArray>("markers", Qos::reliable(10))?;
    let description = node.publisher::<std_msgs::String>("robot_description", Qos::latched())?;
    description.publish(std_msgs::String { data: shapes.robot.urdf.clone() })?;
    say!("publishing /tf, markers and robot_description; Ctrl-C ends it")?;
    let mut failures = 0_u64;
    while !node.stop().is_requested() {
        std::thread::sleep(period);
        let picture = shapes.picture(&received.lock().unwrap_or_else(PoisonError::into_inner));
        let Some((tf, array)) = picture else { continue };
        for sent in [frames.publish(tf), markers.publish(array)] {
            if let Err(error) = sent {
                failures += 1;
                if failures.is_power_of_two() {
                    note!("{failures} messages not published; the last: {error}");
                }
            }
        }
    }
    Ok(())
}

fn listen(node: &Node, received: &Arc<Mutex<Received>>, robot: &Robot) -> Result<()> {
    fn subscribe<M: tandem_msgs::Message>(
        node: &Node,
        topic: &str,
        qos: Qos,
        received: &Arc<Mutex<Received>>,
        take: impl Fn(&mut Received, M) + Send + 'static,
    ) -> Result<()> {
        let received = Arc::clone(received);
        // What is there was put there whole, also by a callback that panicked later.
        node.subscribe(topic, qos, move |message: M| {
            take(&mut received.lock().unwrap_or_else(PoisonError::into_inner), message);
        })?;
        Ok(())
    }
    let sensor = Qos::best_effort(1);
    subscribe(node, "joint_states", sensor, received, |received, message: JointState| {
        (received.joints, received.at.joints) = (Some(message), Some(Instant::now()));
    })?;
    subscribe(node, "odom", sensor, received, |received, message: Odometry| {
        (received.odometry, received.at.odometry) = (Some(message), Some(Instant::now()));
    })?;
    for (leg, name) in robot.legs.iter().map(|leg| leg.name.as_str()).enumerate() {
        subscribe(node, &format!("ground_force/{name}"), sensor, received, move |received, message: WrenchStamped| {
            let force = message.wrench.force;
            received.force_n[leg] = Some([force.x, force.y, force.z]);
            received.at.forces = Some(Instant::now());
        })?;
    }
    subscribe(node, "controller_state", Qos::best_effort(1), received, |received, message: ControllerState| {
        (received.state, received.at.state) = (Some(message), Some(Instant::now()));
    })?;
    // Some nodes publish it, each of them seldom.
    subscribe(node, "/diagnostics", Qos::reliable(10), received, |received, message: DiagnosticArray| {
        for status in message.status {
            let name = printable(&status.name, NAME_CHARS).into_owned();
            if received.diagnostics.len() < DIAGNOSTICS || received.diagnostics.contains_key(&name) {
                let text = printable(&status.message, SENTENCE_CHARS).into_owned();
                received.diagnostics.insert(name, (status.level, text, Instant::now()));
            }
        }
    })?;
    subscribe(node, "gait", Qos::latched(), received, |received, message: tandem_msgs::Gait| {
        match message.to_gait() {
            Ok(gait) => received.gait = Some(gait),
            Err(error) => {
                let line = format!("gait \"{}\" is not shown: {error}", message.name);
                note!("{}", printable(&line, SENTENCE_CHARS));
            }
        }
    })?;
    // In a bag the gait is a file's text.
    subscribe(
        node,
        "gait_file",
        Qos::latched(),
        received,
        |received, message: std_msgs::String| match Gait::from_json(&message.data) {
            Ok(gait) => received.gait = Some(gait),
            Err(error) => note!("the gait is not shown: {}", printable(&error.to_string(), SENTENCE_CHARS)),
        },
    )?;
    Ok(())
}
