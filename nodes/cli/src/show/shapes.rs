//! The robot's shape of what was received: places of its links, and markers for views of ROS.

use super::Received;
use anyhow::{Context, Result};
use gait::{JOINTS, LEGS};
use rigid_body::{Data, FrameId, forward_kinematics, frame_position, frame_rotation};
use robot::Robot;
use tandem_msgs::builtin_interfaces::Time;
use tandem_msgs::geometry_msgs::{Point, Pose, Quaternion, Transform, TransformStamped, Vector3};
use tandem_msgs::std_msgs::{ColorRGBA, Header};
use tandem_msgs::tf2_msgs::TFMessage;
use tandem_msgs::visualization_msgs::{Marker, MarkerArray};

/// Length of a ground force's arrow, m/N: the robot's weight on one foot is about half a metre.
const ARROW_M_PER_N: f64 = 0.0013;
/// A foot stands where it carries more than this, N.
pub const STANDS_N: f64 = 10.0;
/// Points of a planned path.
const PATH_POINTS: usize = 25;
/// Of the four feet's paths those are swinging that rise by at least this share of the highest.
const SWING_SHARE: f64 = 0.5;

/// The robot, and room for its kinematics. Everything is in the axes of base_link.
pub struct Shapes {
    /// The robot.
    pub robot: Robot,
    data: Data,
    links: Vec<(String, FrameId)>,
    names: [String; JOINTS],
}

impl Shapes {
    /// Room for this robot.
    pub fn new(robot: Robot) -> Result<Self> {
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

    /// The joints' positions in the robot's order. None before all were received.
    fn joints(&self, received: &Received) -> Option<[f64; JOINTS]> {
        let message = received.joints.as_ref()?;
        let mut joints = [0.0; JOINTS];
        for (joint, name) in joints.iter_mut().zip(&self.names) {
            *joint = *message.position.get(message.name.iter().position(|n| n == name)?)?;
        }
        Some(joints)
    }

    /// Hip, upper leg, lower leg and toe of each leg. None before all joints were received.
    pub fn leg_points(&mut self, received: &Received) -> Option<[[f64; 3]; 4 * LEGS]> {
        let joints = self.joints(received)?;
        self.place(&joints);
        // The legs' links come first.
        Some(std::array::from_fn(|n| frame_position(&self.robot.model, &self.data, self.links[n].1).into()))
    }

    /// What views of ROS show of what was received.
    pub fn picture(&mut self, received: &Received) -> Option<(TFMessage, MarkerArray)> {
        let joints = self.joints(received)?;
        let stamp = received.joints.as_ref()?.header.stamp;
        let mut markers = swing_markers(&self.swing_paths(received), stamp);
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
                color: if stands { ORANGE } else { GREY },
                ..marker("feet", leg, stamp)
            });
            // World axes to the base's: the inverse of the base's rotation.
            let q = received.base_orientation();
            let arrow = rotate([-q[0], -q[1], -q[2], q[3]], force);
            markers.push(Marker {
                r#type: ARROW,
                action: if stands && received.odometry.is_some() { ADD } else { DELETE },
                points: vec![point(toe), point(std::array::from_fn(|i| toe[i] + ARROW_M_PER_N * arrow[i]))],
                scale: Vector3 { x: 0.012, y: 0.03, z: 0.04 },
                color: VERMILION,
                ..marker("ground_force", leg, stamp)
            });
        }
        Some((TFMessage { transforms }, MarkerArray { markers }))
    }

    /// The paths that the swinging toes are planned to go in this step, as seen from the base; empty for the others.
    pub fn swing_paths(&mut self, received: &Received) -> [Vec<[f64; 3]>; LEGS] {
        let walking = received.state.as_ref().filter(|state| state.mode == "walking");
        let mut paths: [Vec<[f64; 3]>; LEGS] = Default::default();
        if let (Some(state), Some(gait)) = (walking, &received.gait) {
            let domain = gait.domain_of_step(state.step_index);
            for n in 0..PATH_POINTS {
                let (joints, _) = domain.planned(n as f64 / (PATH_POINTS - 1) as f64);
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
        for path in &mut paths {
            if highest <= 0.0 || rise(path) < SWING_SHARE * highest {
                path.clear();
            }
        }
        paths
    }
}

fn swing_markers(paths: &[Vec<[f64; 3]>; LEGS], stamp: Time) -> Vec<Marker> {
    paths
        .iter()
        .enumerate()
        .map(|(leg, path)| Marker {
            r#type: LINE_STRIP,
            action: if path.is_empty() { DELETE } else { ADD },
            points: path.iter().map(|p| point(*p)).collect(),
            scale: Vector3 { x: 0.006, ..Vector3::default() },
            color: BLUE,
            ..marker("swing_path", leg, stamp)
        })
        .collect()
}

const ARROW: i32 = 0;
const SPHERE: i32 = 2;
const LINE_STRIP: i32 = 4;
const ADD: i32 = 0;
const DELETE: i32 = 2;
// Those of Okabe and Ito, which the colour-blind tell apart.
const ORANGE: ColorRGBA = ColorRGBA { r: 0.90, g: 0.62, b: 0.0, a: 1.0 };
const GREY: ColorRGBA = ColorRGBA { r: 0.6, g: 0.6, b: 0.6, a: 1.0 };
const VERMILION: ColorRGBA = ColorRGBA { r: 0.84, g: 0.37, b: 0.0, a: 1.0 };
const BLUE: ColorRGBA = ColorRGBA { r: 0.0, g: 0.45, b: 0.70, a: 1.0 };

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
pub fn rotate([x, y, z, w]: [f64; 4], v: [f64; 3]) -> [f64; 3] {
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
    use gait::Gait;
    use tandem_msgs::ControllerState;
    use tandem_msgs::nav_msgs::Odometry;
    use tandem_msgs::sensor_msgs::JointState;

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
        let text = include_str!("../../../../tests/gaits/amble.json");
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
            odometry: Some(Odometry::default()),
            force_n: [Some([0.0, 0.0, 190.0]), None, Some([0.0; 3]), Some([1.0, 2.0, 180.0])],
            gait: Some(gait),
            state: Some(ControllerState { mode: "walking".into(), ..ControllerState::default() }),
            ..Received::default()
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
