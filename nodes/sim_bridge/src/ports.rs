//! Messages to and from the simulator's own types: the one place where the two meet.

use control::{InertialState, JointCommand, resolution};
use simulator::RobotState;
use tandem_msgs::builtin_interfaces::Time;
use tandem_msgs::geometry_msgs::{Point, Pose, Quaternion, Transform, TransformStamped, Twist, Vector3, WrenchStamped};
use tandem_msgs::nav_msgs::Odometry;
use tandem_msgs::sensor_msgs::{Imu, JointState};
use tandem_msgs::std_msgs::Header;
use tandem_msgs::tf2_msgs::TFMessage;

/// The frames' names.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Frames {
    /// Of the odometry: where the robot was put down.
    pub odom: String,
    /// Of the base.
    pub base: String,
    /// Of the inertial measurement unit.
    pub imu: String,
}

impl Frames {
    /// REP 105's names with something in front.
    pub fn new(prefix: &str) -> Self {
        Self { odom: format!("{prefix}odom"), base: format!("{prefix}base_link"), imu: format!("{prefix}imu_link") }
    }
}

fn header(stamp: Time, frame: &str) -> Header {
    Header { stamp, frame_id: frame.into() }
}

/// What is published of the base and the ground is rounded far below what any sensor resolves: the rest is the noise
/// of computing, and most of a recording's bytes.
fn vector(value: [f64; 3], resolution: fn(f64) -> f64) -> Vector3 {
    let [x, y, z] = value.map(resolution);
    Vector3 { x, y, z }
}

fn quaternion(value: [f64; 4]) -> Quaternion {
    let [x, y, z, w] = value.map(resolution::quaternion);
    Quaternion { x, y, z, w }
}

/// The joints, with the torques of the last physics step as effort.
pub fn joint_state(state: &RobotState, names: &[String; 12], stamp: Time) -> JointState {
    JointState {
        header: header(stamp, ""),
        name: names.to_vec(),
        position: state.joint_position_rad.to_vec(),
        velocity: state.joint_velocity_rad_s.to_vec(),
        effort: state.joint_torque_nm.to_vec(),
    }
}

/// What an inertial measurement unit at the base reports: its orientation is against the true vertical, its
/// acceleration the mean since the message before.
pub fn imu(measured: &InertialState, frames: &Frames, stamp: Time) -> Imu {
    Imu {
        header: header(stamp, &frames.imu),
        orientation: quaternion(measured.attitude_xyzw.unwrap_or_default()),
        angular_velocity: vector(measured.angular_velocity_rad_s.unwrap_or_default(), resolution::velocity_rad_s),
        linear_acceleration: vector(measured.acceleration_m_s2.unwrap_or_default(), resolution::acceleration_m_s2),
        ..Imu::default()
    }
}

/// The base's true pose in the world and its velocity in its own axes (REP 105).
pub fn odometry(state: &RobotState, frames: &Frames, stamp: Time) -> Odometry {
    let [x, y, z] = state.base_position_m.map(resolution::length_m);
    let mut message =
        Odometry { header: header(stamp, &frames.odom), child_frame_id: frames.base.clone(), ..Odometry::default() };
    message.pose.pose = Pose { position: Point { x, y, z }, orientation: quaternion(state.base_quaternion_xyzw) };
    message.twist.twist = Twist {
        linear: vector(state.base_linear_velocity_body(), resolution::velocity_m_s),
        angular: vector(state.base_angular_velocity_body, resolution::velocity_rad_s),
    };
    message
}

/// The base in the odometry frame.
pub fn transform(state: &RobotState, frames: &Frames, stamp: Time) -> TFMessage {
    TFMessage {
        transforms: vec![TransformStamped {
            header: header(stamp, &frames.odom),
            child_frame_id: frames.base.clone(),
            transform: Transform {
                translation: vector(state.base_position_m, resolution::length_m),
                rotation: quaternion(state.base_quaternion_xyzw),
            },
        }],
    }
}

/// The ground's force on one toe, in the odometry frame's axes.
pub fn ground_force(force_n: [f64; 3], frames: &Frames, stamp: Time) -> WrenchStamped {
    let mut message = WrenchStamped { header: header(stamp, &frames.odom), ..WrenchStamped::default() };
    message.wrench.force = vector(force_n, resolution::force_n);
    message
}

/// A command in the project's joint order, or what is wrong with the message.
pub fn joint_command(message: &tandem_msgs::JointCommand, names: &[String; 12]) -> Result<JointCommand, String> {
    let lists = [
        ("name", message.name.len()),
        ("position", message.position.len()),
        ("velocity", message.velocity.len()),
        ("kp", message.kp.len()),
        ("kd", message.kd.len()),
        ("torque", message.torque.len()),
    ];
    if let Some((list, found)) = lists.into_iter().find(|(_, length)| *length != names.len()) {
        return Err(format!("{list} has {found} entries, expected {}", names.len()));
    }
    // The usual case is our own order; any other order is fine too.
    let mut from = [0; 12];
    for (j, name) in names.iter().enumerate() {
        from[j] = if message.name[j] == *name {
            j
        } else {
            message
                .name
                .iter()
                .position(|n| n == name)
                .ok_or_else(|| format!("joint \"{name}\" is missing; the message has {:?}", message.name))?
        };
    }
    let pick = |field: &str, list: &[f64]| -> Result<[f64; 12], String> {
        let picked = from.map(|i| list[i]);
        match picked.iter().position(|v| !v.is_finite()) {
            Some(j) => Err(format!("{field} of {} is {}, expected a finite number", names[j], picked[j])),
            None => Ok(picked),
        }
    };
    let command = JointCommand {
        position_rad: pick("position", &message.position)?,
        velocity_rad_s: pick("velocity", &message.velocity)?,
        kp: pick("kp", &message.kp)?,
        kd: pick("kd", &message.kd)?,
        torque_nm: pick("torque", &message.torque)?,
    };
    for (gain, list) in [("kp", &command.kp), ("kd", &command.kd)] {
        if let Some(j) = list.iter().position(|v| *v < 0.0) {
            return Err(format!("{gain} of {} is {}, expected 0 or more", names[j], list[j]));
        }
    }
    Ok(command)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names() -> [String; 12] {
        std::array::from_fn(|j| format!("joint_{j}"))
    }

    fn message() -> tandem_msgs::JointCommand {
        tandem_msgs::JointCommand {
            name: names().to_vec(),
            position: (0..12).map(f64::from).collect(),
            velocity: vec![0.0; 12],
            kp: vec![1.0; 12],
            kd: vec![1.0; 12],
            torque: vec![0.0; 12],
            ..Default::default()
        }
    }

    #[test]
    fn joints_are_matched_by_name() {
        let mut reversed = message();
        reversed.name.reverse();
        let command = joint_command(&reversed, &names()).unwrap();
        assert_eq!(command.position_rad, std::array::from_fn(|j| 11.0 - j as f64));
    }

    #[test]
    fn bad_messages_are_refused_by_name() {
        type Case = (&'static str, fn(&mut tandem_msgs::JointCommand));
        let cases: [Case; 5] = [
            ("kp has 11 entries", |m| m.kp.truncate(11)),
            ("joint \"joint_3\" is missing", |m| m.name[3] = "joint_4".into()),
            ("torque of joint_2 is NaN", |m| m.torque[2] = f64::NAN),
            ("kd of joint_0 is -1", |m| m.kd[0] = -1.0),
            ("name has 0 entries", |m| *m = Default::default()),
        ];
        for (expected, spoil) in cases {
            let mut bad = message();
            spoil(&mut bad);
            let error = joint_command(&bad, &names()).unwrap_err();
            assert!(error.contains(expected), "{error}");
        }
    }

    #[test]
    fn odometry_gives_velocity_in_the_body() {
        let half = std::f64::consts::FRAC_1_SQRT_2;
        let state = RobotState {
            step: 0,
            time_s: 0.0,
            base_position_m: [1.0, 2.0, 3.0],
            // Facing +y, moving along +y: forward.
            base_quaternion_xyzw: [0.0, 0.0, half, half],
            base_linear_velocity_world: [0.0, 0.5, 0.0],
            base_angular_velocity_body: [0.0; 3],
            base_specific_force_body: [0.0; 3],
            joint_position_rad: [0.0; 12],
            joint_velocity_rad_s: [0.0; 12],
            joint_torque_nm: [0.0; 12],
            toe_force_n: [[0.0; 3]; 4],
        };
        let twist = odometry(&state, &Frames::new(""), Time::default()).twist.twist.linear;
        assert!((twist.x - 0.5).abs() < 1e-12 && twist.y.abs() < 1e-12);
    }
}
