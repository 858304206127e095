//! `tandem show`: what 3D views need beside the nodes' own topics: every link's frame, and shapes.

use crate::robots::RobotArguments;
use anyhow::{Context, Result, bail};
use gait::{Gait, JOINTS, LEGS, StepSide};
use rigid_body::{Data, FrameId, forward_kinematics, frame_position, frame_rotation};
use robot::Robot;
use ros::{Node, Qos};
use std::process::ExitCode;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;
use tandem_msgs::builtin_interfaces::Time;
use tandem_msgs::geometry_msgs::{Point, Pose, Quaternion, Transform, TransformStamped, Vector3, WrenchStamped};
use tandem_msgs::nav_msgs::Odometry;
use tandem_msgs::sensor_msgs::JointState;
use tandem_msgs::std_msgs::{ColorRGBA, Header};
use tandem_msgs::text::{SENTENCE_CHARS, printable};
use tandem_msgs::tf2_msgs::TFMessage;
use tandem_msgs::visualization_msgs::{Marker, MarkerArray};
use tandem_msgs::{ControllerState, std_msgs};

/// Publish every link's frame and shapes for RViz and Foxglove
///
/// Listens to joint_states, odom, ground_force/LEG, gait and controller_state, of running nodes or of a bag that is played, and
/// publishes /tf (base_link to every link), markers (visualization_msgs/MarkerArray: feet, ground forces, the planned paths of
/// the swinging feet) and robot_description (latched). Until Ctrl-C.
///
///   tandem show &
///   rviz2 -d config/rviz/tandem.rviz
#[derive(clap::Args)]
#[command(verbatim_doc_comment)]
pub struct Arguments {
    /// Pictures a second, 1 to 100
    #[arg(long, value_name = "HZ", default_value_t = 30.0)]
    rate: f64,
    #[command(flatten)]
    robot: RobotArguments,
    /// --ros-args and what ROS 2 allows after it (remapping, namespace, log level)
    #[arg(trailing_var_arg = true, allow_hyphen_values = true, value_name = "--ros-args ...")]
    ros: Vec<String>,
}

/// Length of a ground force's arrow, m/N: the robot's weight on one foot is about half a metre.
const ARROW_M_PER_N: f64 = 0.0013;
/// A foot stands where it carries more than this, N.
const STANDS_N: f64 = 10.0;
/// Points of a planned path.
const PATH_POINTS: usize = 25;
/// Of the four feet's paths those are swinging that rise by at least this share of the highest.
const SWING_SHARE: f64 = 0.5;

/// What was received last.
#[derive(Default)]
struct Received {
    joints: Option<JointState>,
    odometry: bool,
    base: Quaternion,
    force_n: [Option<[f64; 3]>; LEGS],
    gait: Option<Gait>,
    state: Option<ControllerState>,
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
    let frames = node.publisher::<TFMessage>("/tf", Qos::reliable(100))?;
    let markers = node.publisher::<MarkerArray>("markers", Qos::reliable(10))?;
    let description = node.publisher::<std_msgs::String>("robot_description", Qos::latched())?;
    description.publish(std_msgs::String { data: shapes.robot.urdf.clone() })?;
    say!("publishing /tf, markers and robot_description; Ctrl-C ends it")?;
    let period = Duration::from_secs_f64(1.0 / arguments.rate);
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
    node.shutdown();
    Ok(ExitCode::SUCCESS)
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
    subscribe(node, "joint_states", sensor, received, |received, message: JointState| received.joints = Some(message))?;
    subscribe(node, "odom", sensor, received, |received, message: Odometry| {
        (received.odometry, received.base) = (true, message.pose.pose.orientation);
    })?;
    for (leg, name) in robot.legs.iter().map(|leg| leg.name.as_str()).enumerate() {
        subscribe(node, &format!("ground_force/{name}"), sensor, received, move |received, message: WrenchStamped| {
            let force = message.wrench.force;
            received.force_n[leg] = Some([force.x, force.y, force.z]);
        })?;
    }
    subscribe(node, "controller_state", Qos::best_effort(1), received, |received, message: ControllerState| {
        received.state = Some(message);
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

/// The robot, and room for its kinematics. Everything is in the axes of base_link.
struct Shapes {
    robot: Robot,
    data: Data,
    links: Vec<(String, FrameId)>,
    names: [String; JOINTS],
}

impl Shapes {
    fn new(robot: Robot) -> Result<Self> {
        let mut links = Vec::new();
        for leg in &robot.legs {
            for part in ["hip", "upper", "lower", "toe"] {
                let name = format!("{}_{part}", leg.name);
                let frame = robot.model.frame_id(&name).with_context(|| format!("the robot has no link '{name}'"))?;
                links.push((name, frame));
            }
        }
        for fixed in ["torso", "imu_link"] {
            links.extend(robot.model.frame_id(fixed).map(|frame| (fixed.to_owned(), frame)));
        }
        Ok(Self { data: Data::new(&robot.model), names: robot.joint_names(), robot, links })
    }

    fn place(&mut self, joints: &[f64; JOINTS]) {
        let mut q = [0.0; 6 + JOINTS];
        q[6..].copy_from_slice(joints);
        forward_kinematics(&self.robot.model, &mut self.data, &q, &[0.0; 6 + JOINTS], &[0.0; 6 + JOINTS]);
    }

    fn toe(&self, leg: usize) -> [f64; 3] {
        frame_position(&self.robot.model, &self.data, self.robot.legs[leg].toe).into()
    }

    fn picture(&mut self, received: &Received) -> Option<(TFMessage, MarkerArray)> {
        let message = received.joints.as_ref()?;
        let mut joints = [0.0; JOINTS];
        for (joint, name) in joints.iter_mut().zip(&self.names) {
            *joint = *message.position.get(message.name.iter().position(|n| n == name)?)?;
        }
        let stamp = message.header.stamp;
        let mut markers = self.swing_paths(received, stamp);
        self.place(&joints);
        let transforms = self
            .links
            .iter()
            .map(|(name, frame)| {
                let [x, y, z]: [f64; 3] = frame_position(&self.robot.model, &self.data, *frame).into();
                let rotation = frame_rotation(&self.robot.model, &self.data, *frame);
                let rotation = quaternion(std::array::from_fn(|i| std::array::from_fn(|j| rotation[(i, j)])));
                TransformStamped {
                    header: header(stamp),
                    child_frame_id: name.clone(),
                    transform: Transform { translation: Vector3 { x, y, z }, rotation },
                }
            })
            .collect();
        for leg in 0..LEGS {
            let toe = self.toe(leg);
            let force = received.force_n[leg].unwrap_or_default();
            let stands = force[2] > STANDS_N;
            let radius = 2.0 * self.robot.toe_radius_m;
            markers.push(Marker {
                r#type: SPHERE,
                pose: Pose { position: point(toe), orientation: Quaternion { w: 1.0, ..Quaternion::default() } },
                scale: Vector3 { x: radius, y: radius, z: radius },
                color: if stands { GREEN } else { GREY },
                ..marker("feet", leg, stamp)
            });
            // World axes to the base's: the inverse of the base's rotation.
            let q = received.base;
            let arrow = rotate([-q.x, -q.y, -q.z, q.w], force);
            markers.push(Marker {
                r#type: ARROW,
                action: if stands && received.odometry { ADD } else { DELETE },
                points: vec![point(toe), point(std::array::from_fn(|i| toe[i] + ARROW_M_PER_N * arrow[i]))],
                scale: Vector3 { x: 0.012, y: 0.03, z: 0.04 },
                color: RED,
                ..marker("ground_force", leg, stamp)
            });
        }
        Some((TFMessage { transforms }, MarkerArray { markers }))
    }

    /// The paths that the toes are planned to go in this step, as seen from the base.
    fn swing_paths(&mut self, received: &Received, stamp: Time) -> Vec<Marker> {
        let walking = received.state.as_ref().filter(|state| state.mode == "walking");
        let mut paths: [Vec<[f64; 3]>; LEGS] = Default::default();
        if let (Some(state), Some(gait)) = (walking, &received.gait) {
            let side = StepSide::of_step(state.step_index);
            for n in 0..PATH_POINTS {
                let (joints, _) = gait.planned(side, n as f64 / (PATH_POINTS - 1) as f64);
                self.place(&joints);
                for leg in 0..LEGS {
                    paths[leg].push(self.toe(leg));
                }
            }
        }
        // How far a path bulges upwards over the line from its beginning to its end.
        let rise = |path: &Vec<[f64; 3]>| match (path.first(), path.last()) {
            (Some(first), Some(last)) => path.iter().fold(0.0_f64, |most, p| most.max(p[2] - first[2].max(last[2]))),
            _ => 0.0,
        };
        let highest = paths.iter().map(rise).fold(0.0, f64::max);
        paths
            .iter()
            .enumerate()
            .map(|(leg, path)| Marker {
                r#type: LINE_STRIP,
                action: if highest > 0.0 && rise(path) >= SWING_SHARE * highest { ADD } else { DELETE },
                points: path.iter().map(|p| point(*p)).collect(),
                scale: Vector3 { x: 0.006, ..Vector3::default() },
                color: BLUE,
                ..marker("swing_path", leg, stamp)
            })
            .collect()
    }
}

const ARROW: i32 = 0;
const SPHERE: i32 = 2;
const LINE_STRIP: i32 = 4;
const ADD: i32 = 0;
const DELETE: i32 = 2;
const GREEN: ColorRGBA = ColorRGBA { r: 0.18, g: 0.62, b: 0.31, a: 1.0 };
const GREY: ColorRGBA = ColorRGBA { r: 0.6, g: 0.6, b: 0.6, a: 1.0 };
const RED: ColorRGBA = ColorRGBA { r: 0.82, g: 0.12, b: 0.18, a: 1.0 };
const BLUE: ColorRGBA = ColorRGBA { r: 0.17, g: 0.37, b: 0.72, a: 1.0 };

fn header(stamp: Time) -> Header {
    Header { stamp, frame_id: "base_link".into() }
}

fn marker(namespace: &str, leg: usize, stamp: Time) -> Marker {
    let pose = Pose { orientation: Quaternion { w: 1.0, ..Quaternion::default() }, ..Pose::default() };
    Marker { header: header(stamp), ns: namespace.into(), id: leg as i32, pose, ..Marker::default() }
}

fn point([x, y, z]: [f64; 3]) -> Point {
    Point { x, y, z }
}

/// v + 2 w (u × v) + 2 u × (u × v), with q = (u, w).
fn rotate([x, y, z, w]: [f64; 4], v: [f64; 3]) -> [f64; 3] {
    let cross =
        |a: [f64; 3], b: [f64; 3]| [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
    let once = cross([x, y, z], v);
    let twice = cross([x, y, z], once);
    std::array::from_fn(|i| v[i] + 2.0 * (w * once[i] + twice[i]))
}

/// The quaternion of a rotation matrix, by its largest component, which is far from zero.
fn quaternion(m: [[f64; 3]; 3]) -> Quaternion {
    let squares = [
        1.0 + m[0][0] - m[1][1] - m[2][2],
        1.0 - m[0][0] + m[1][1] - m[2][2],
        1.0 - m[0][0] - m[1][1] + m[2][2],
        1.0 + m[0][0] + m[1][1] + m[2][2],
    ];
    let largest = (0..4).fold(0, |best, i| if squares[i] > squares[best] { i } else { best });
    let s = 2.0 * squares[largest].sqrt();
    let d = [m[2][1] - m[1][2], m[0][2] - m[2][0], m[1][0] - m[0][1]];
    let sum = |i: usize, j: usize| m[i][j] + m[j][i];
    let [x, y, z, w] = match largest {
        0 => [s * s / 4.0, sum(0, 1), sum(0, 2), d[0]],
        1 => [sum(0, 1), s * s / 4.0, sum(1, 2), d[1]],
        2 => [sum(0, 2), sum(1, 2), s * s / 4.0, d[2]],
        _ => [d[0], d[1], d[2], s * s / 4.0],
    }
    .map(|value| value / s);
    Quaternion { x, y, z, w }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rotation_s_quaternion_turns_as_the_rotation_does() {
        // About each axis, small and almost half a turn.
        for (axis, angle) in [(0, 0.3), (1, -1.2), (2, 2.0), (0, 3.1), (1, -3.1), (2, 3.13), (2, 0.0)] {
            let (s, c) = f64::sin_cos(angle);
            let (j, k) = ((axis + 1) % 3, (axis + 2) % 3);
            let mut m = [[0.0; 3]; 3];
            m[axis][axis] = 1.0;
            (m[j][j], m[j][k], m[k][j], m[k][k]) = (c, -s, s, c);
            let q = quaternion(m);
            for v in [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.3, -0.2, 0.9]] {
                let turned = rotate([q.x, q.y, q.z, q.w], v);
                for i in 0..3 {
                    let expected: f64 = (0..3).map(|n| m[i][n] * v[n]).sum();
                    assert!((turned[i] - expected).abs() < 1e-12, "axis {axis}, {angle}: {turned:?}");
                }
            }
        }
    }

    #[test]
    fn a_walking_robot_has_feet_forces_paths_and_frames() {
        let robot =
            Robot::load(std::path::Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../config/robots/vision60")))
                .unwrap();
        let text = include_str!("../../../tests/gaits/amble.json");
        let gait = Gait::from_json(text).unwrap();
        let mut shapes = Shapes::new(robot).unwrap();
        assert!(shapes.picture(&Received::default()).is_none(), "nothing was received");
        let names = shapes.robot.joint_names();
        let mut received = Received {
            // Another order of the joints, as other publishers have it.
            joints: Some(JointState {
                name: names.iter().rev().cloned().collect(),
                position: gait.initial.joint_position_rad.iter().rev().copied().collect(),
                ..JointState::default()
            }),
            odometry: true,
            base: Quaternion { w: 1.0, ..Quaternion::default() },
            force_n: [Some([0.0, 0.0, 190.0]), None, Some([0.0; 3]), Some([1.0, 2.0, 180.0])],
            gait: Some(gait),
            state: Some(ControllerState { mode: "walking".into(), ..ControllerState::default() }),
        };
        let (tf, array) = shapes.picture(&received).unwrap();
        assert_eq!(tf.transforms.len(), 18, "four links a leg, torso and inertial unit");
        assert!(tf.transforms.iter().all(|t| t.header.frame_id == "base_link"));
        let toe = tf.transforms.iter().find(|t| t.child_frame_id == "front_left_toe").unwrap().transform.translation;
        assert!(toe.z < -0.4 && toe.x > 0.2 && toe.y > 0.1, "{toe:?}");
        let shown = |array: &MarkerArray, ns: &str| -> Vec<i32> {
            array.markers.iter().filter(|m| m.ns == ns && m.action == ADD).map(|m| m.id).collect()
        };
        assert_eq!(shown(&array, "feet"), [0, 1, 2, 3]);
        assert_eq!(shown(&array, "ground_force"), [0, 3]);
        let first = shown(&array, "swing_path");
        assert_eq!(first.len(), 2, "two feet swing: {first:?}");
        received.state.as_mut().unwrap().step_index = 1;
        let second = shown(&shapes.picture(&received).unwrap().1, "swing_path");
        assert!(second.len() == 2 && second.iter().all(|leg| !first.contains(leg)), "then the other two: {second:?}");
        received.state.as_mut().unwrap().mode = "standing".into();
        assert!(shown(&shapes.picture(&received).unwrap().1, "swing_path").is_empty());
    }
}
