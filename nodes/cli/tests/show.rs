//! `tandem show` beside a running robot, over real DDS between two processes: this test is the nodes, the program is
//! the viewer's source.

use gait::Gait;
use ros::{Arguments, Node, Publisher, Qos};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};
use tandem_msgs::geometry_msgs::WrenchStamped;
use tandem_msgs::nav_msgs::Odometry;
use tandem_msgs::sensor_msgs::JointState;
use tandem_msgs::std_msgs::String as Text;
use tandem_msgs::tf2_msgs::TFMessage;
use tandem_msgs::visualization_msgs::{Marker, MarkerArray};
use tandem_msgs::{ControllerState, Message};

const DOMAIN: u16 = 91;
const PATIENCE: Duration = Duration::from_secs(30);
const LEGS: [&str; 4] = ["front_left", "rear_left", "front_right", "rear_right"];

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

struct Show(Child);

impl Drop for Show {
    fn drop(&mut self) {
        // Already ended is as good.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn subscribe<M: Message>(node: &Node, topic: &str, qos: Qos) -> Receiver<M> {
    let (sender, receiver) = channel();
    node.subscribe(topic, qos, move |message: M| {
        // The test may have ended.
        let _ = sender.send(message);
    })
    .unwrap();
    receiver
}

struct Robot {
    gait: Gait,
    names: Vec<String>,
    joint_states: Publisher<JointState>,
    odometry: Publisher<Odometry>,
    forces: Vec<Publisher<WrenchStamped>>,
    controller_state: Publisher<ControllerState>,
}

impl Robot {
    /// One picture's worth of topics, as the bridge and the controller publish them.
    fn publish(&self, step_index: u64) {
        let position = self.gait.initial.joint_position_rad.to_vec();
        let joints = JointState { name: self.names.clone(), position, ..JointState::default() };
        self.joint_states.publish(joints).unwrap();
        let mut odometry = Odometry::default();
        odometry.pose.pose.orientation.w = 1.0;
        self.odometry.publish(odometry).unwrap();
        for (leg, force) in self.forces.iter().enumerate() {
            let mut message = WrenchStamped::default();
            message.wrench.force.z = if leg == 0 || leg == 3 { 190.0 } else { 0.0 };
            force.publish(message).unwrap();
        }
        let state = ControllerState { mode: "walking".into(), step_index, ..ControllerState::default() };
        self.controller_state.publish(state).unwrap();
    }
}

fn shown<'a>(array: &'a MarkerArray, namespace: &str) -> Vec<&'a Marker> {
    const ADD: i32 = 0;
    array.markers.iter().filter(|marker| marker.ns == namespace && marker.action == ADD).collect()
}

#[test]
fn show_beside_running_nodes_publishes_frames_markers_and_the_description() {
    let mut show = Show(
        Command::new(env!("CARGO_BIN_EXE_tandem"))
            .args(["show", "--rate", "50", "--robot"])
            .arg(root().join("config/robots/vision60"))
            .env("ROS_DOMAIN_ID", DOMAIN.to_string())
            .env("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
            .stdout(Stdio::null())
            .spawn()
            .unwrap(),
    );
    let node = Node::start("robot", &Arguments::default().with_domain_id(DOMAIN)).unwrap();
    let frames = subscribe::<TFMessage>(&node, "/tf", Qos::reliable(100));
    let markers = subscribe::<MarkerArray>(&node, "markers", Qos::reliable(10));
    let descriptions = subscribe::<Text>(&node, "robot_description", Qos::latched());
    let sensor = Qos::best_effort(1);
    let gait = Gait::from_json(include_str!("../../../tests/gaits/amble.json")).unwrap();
    let latched = node.publisher::<tandem_msgs::Gait>("gait", Qos::latched()).unwrap();
    latched.publish(tandem_msgs::Gait::from_gait(&gait)).unwrap();
    let vision60 = robot::Robot::load(&root().join("config/robots/vision60")).unwrap();
    let robot_urdf = vision60.urdf.clone();
    let robot = Robot {
        names: vision60.joint_names().to_vec(),
        gait,
        joint_states: node.publisher("joint_states", sensor).unwrap(),
        odometry: node.publisher("odom", sensor).unwrap(),
        forces: LEGS.iter().map(|leg| node.publisher(&format!("ground_force/{leg}"), sensor).unwrap()).collect(),
        controller_state: node.publisher("controller_state", Qos::reliable(10)).unwrap(),
    };

    // Everything is seen within the patience: feet, the arrows of those that stand, the paths of those that swing.
    let begun = Instant::now();
    let mut paths: [Option<Vec<i32>>; 2] = [None, None];
    while paths.iter().any(Option::is_none) {
        assert!(begun.elapsed() < PATIENCE, "within {PATIENCE:?} only the paths {paths:?} were seen");
        let step = u64::from(paths[0].is_some());
        robot.publish(step);
        std::thread::sleep(Duration::from_millis(20));
        for array in markers.try_iter() {
            assert!(array.markers.iter().all(|marker| marker.header.frame_id == "base_link"));
            let (feet, arrows, swings) =
                (shown(&array, "feet"), shown(&array, "ground_force"), shown(&array, "swing_path"));
            let standing: Vec<i32> = arrows.iter().map(|arrow| arrow.id).collect();
            let swinging: Vec<i32> = swings.iter().map(|path| path.id).collect();
            if feet.len() == 4 && standing == [0, 3] && swinging.len() == 2 {
                assert!(arrows.iter().all(|arrow| arrow.points.len() == 2));
                let long = |arrow: &&&Marker| (arrow.points[1].z - arrow.points[0].z - 0.0013 * 190.0).abs() < 1e-9;
                assert!(arrows.iter().filter(long).count() == 2, "1.3 mm a newton: {arrows:?}");
                assert!(swings.iter().all(|path| path.points.len() > 10));
                // The other two feet swing in the next step.
                if paths[0].as_ref().is_none_or(|first| swinging.iter().all(|leg| !first.contains(leg))) {
                    paths[usize::from(paths[0].is_some())] = Some(swinging);
                }
            }
        }
    }
    let tf = frames.recv_timeout(PATIENCE).unwrap();
    assert_eq!(tf.transforms.len(), 18);
    assert!(tf.transforms.iter().all(|frame| frame.header.frame_id == "base_link"));
    let description = descriptions.recv_timeout(PATIENCE).unwrap().data;
    assert_eq!(description, robot_urdf);

    // It ends in order when it is asked to.
    let asked = Command::new("kill").args(["-INT", &show.0.id().to_string()]).status().unwrap();
    assert!(asked.success());
    let begun = Instant::now();
    let ended = loop {
        if let Some(status) = show.0.try_wait().unwrap() {
            break status;
        }
        assert!(begun.elapsed() < PATIENCE, "it did not end");
        std::thread::sleep(Duration::from_millis(50));
    };
    assert!(ended.success(), "{ended}");
    node.shutdown();
}
