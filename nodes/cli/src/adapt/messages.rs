//! What becomes of a message.

use super::rules::{JointRule, StateRule};
use anyhow::{Result, bail};
use robot::Robot;
use tandem_msgs::JointCommand;
use tandem_msgs::sensor_msgs::JointState;

/// Another robot's measured joints under our names.
pub struct StateAdapter {
    joints: Vec<JointRule>,
}

impl StateAdapter {
    /// By a rule, for a robot with these joints.
    ///
    /// # Errors
    /// A joint that the robot has not, or one that is named twice.
    pub fn new(rule: &StateRule, names: &[String]) -> Result<Self> {
        for (n, joint) in rule.joints.iter().enumerate() {
            if !names.contains(&joint.ours) {
                bail!("the robot has no joint \"{}\"; it has {}", joint.ours, names.join(", "));
            }
            let again = |other: &JointRule| other.ours == joint.ours || other.theirs == joint.theirs;
            if rule.joints[..n].iter().any(again) {
                bail!("joint \"{}\" to \"{}\": named twice", joint.theirs, joint.ours);
            }
        }
        Ok(Self { joints: rule.joints.clone() })
    }

    /// A message with names is taken by them, one without by the rule's order. Joints without a rule are left out.
    ///
    /// # Errors
    /// Lists of unequal lengths, and a joint that is not in the message.
    pub fn adapt(&self, message: &JointState) -> Result<JointState, String> {
        let count = message.position.len();
        for (list, length) in
            [("name", message.name.len()), ("velocity", message.velocity.len()), ("effort", message.effort.len())]
        {
            if length != 0 && length != count {
                return Err(format!("{list} has {length} entries, position has {count}: expected as many, or none"));
            }
        }
        let place = |n: usize, joint: &JointRule| match message.name.is_empty() {
            true => (n < count).then_some(n),
            false => message.name.iter().position(|name| *name == joint.theirs),
        };
        let places: Vec<usize> = (self.joints.iter().enumerate())
            .map(|(n, joint)| {
                place(n, joint).ok_or_else(|| format!("joint \"{}\" is not in the message", joint.theirs))
            })
            .collect::<Result<_, _>>()?;
        let taken = |list: &[f64], offset: bool| -> Vec<f64> {
            let joints = self.joints.iter().zip(&places).take(if list.is_empty() { 0 } else { usize::MAX });
            joints.map(|(joint, n)| joint.sign * list[*n] + if offset { joint.offset_rad } else { 0.0 }).collect()
        };
        Ok(JointState {
            header: message.header.clone(),
            name: self.joints.iter().map(|joint| joint.ours.clone()).collect(),
            position: taken(&message.position, true),
            velocity: taken(&message.velocity, false),
            effort: taken(&message.effort, false),
        })
    }
}

/// Another framework's commands, whole or in parts, as ours.
pub struct CommandAdapter {
    names: [String; 12],
    kp: [f64; 12],
    kd: [f64; 12],
    torque_nm: [f64; 12],
    /// Positions commanded last: nothing is sent before each joint has one.
    position: [Option<f64>; 12],
}

impl CommandAdapter {
    /// With the robot's gains and limits.
    pub fn new(robot: &Robot) -> Self {
        let each = |triple: [f64; 3]| std::array::from_fn(|j| triple[j % 3]);
        Self {
            names: robot.joint_names(),
            kp: each(robot.gains.kp_nm_per_rad),
            kd: each(robot.gains.kd_nm_s_per_rad),
            torque_nm: each(robot.limits.drive_torque_nm),
            position: [None; 12],
        }
    }

    /// Positions are held with the robot's gains; velocities and torques where they are given, torques within limits.
    ///
    /// # Errors
    /// Lists of unequal lengths, a joint that the robot has not, a number that is none, or joints not yet commanded.
    pub fn adapt(&mut self, message: &JointState) -> Result<JointCommand, String> {
        let (mut velocity, mut torque) = ([0.0; 12], [0.0; 12]);
        let mut position = self.position;
        let lists = [("position", &message.position), ("velocity", &message.velocity), ("effort", &message.effort)];
        for (list, values) in lists {
            if !values.is_empty() && values.len() != message.name.len() {
                return Err(format!("{list} has {} entries, name has {}", values.len(), message.name.len()));
            }
        }
        for (n, name) in message.name.iter().enumerate() {
            let Some(j) = self.names.iter().position(|ours| ours == name) else {
                return Err(format!("the robot has no joint \"{name}\""));
            };
            for (list, values) in lists {
                let Some(value) = values.get(n).copied() else { continue };
                if !value.is_finite() {
                    return Err(format!("{list} of {name} is {value}: expected a number"));
                }
                match list {
                    "position" => position[j] = Some(value),
                    "velocity" => velocity[j] = value,
                    _ => torque[j] = value.clamp(-self.torque_nm[j], self.torque_nm[j]),
                }
            }
        }
        self.position = position;
        if let Some(j) = position.iter().position(Option::is_none) {
            return Err(format!("no position of {} has come yet: a robot is commanded whole", self.names[j]));
        }
        Ok(JointCommand {
            header: message.header.clone(),
            name: self.names.to_vec(),
            position: position.iter().flatten().copied().collect(),
            velocity: velocity.to_vec(),
            kp: self.kp.to_vec(),
            kd: self.kd.to_vec(),
            torque: torque.to_vec(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn adapter() -> StateAdapter {
        let joint = |theirs: &str, ours: &str, sign, offset_rad| JointRule {
            theirs: theirs.into(),
            ours: ours.into(),
            sign,
            offset_rad,
        };
        let joints = vec![joint("hip0", "a", 1.0, 0.0), joint("abd0", "b", -1.0, 0.5)];
        let rule = StateRule { from: String::new(), to: String::new(), joints };
        StateAdapter::new(&rule, &["a".into(), "b".into()]).unwrap()
    }

    #[test]
    fn joints_are_taken_by_name_or_by_place_with_sign_and_zero() {
        let mut message = JointState {
            name: ["abd0", "camera", "hip0"].map(String::from).to_vec(),
            position: vec![0.2, 9.0, 0.7],
            velocity: vec![1.0, 9.0, 2.0],
            ..JointState::default()
        };
        let ours = adapter().adapt(&message).unwrap();
        assert_eq!((ours.name, ours.position), (vec!["a".into(), "b".into()], vec![0.7, 0.3]));
        assert_eq!((ours.velocity, ours.effort), (vec![2.0, -1.0], vec![]), "effort was not given");
        message.name.clear();
        assert_eq!(adapter().adapt(&message).unwrap().position, [0.2, -8.5], "by place");
        message.velocity.pop();
        assert!(adapter().adapt(&message).unwrap_err().contains("velocity has 2 entries, position has 3"));
        let short = JointState { name: vec!["hip0".into()], position: vec![0.0], ..JointState::default() };
        assert!(adapter().adapt(&short).unwrap_err().contains("\"abd0\" is not in the message"));
    }

    #[test]
    fn a_robot_is_commanded_whole_and_within_its_drives() {
        let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../../config/robots/vision60");
        let robot = Robot::load(std::path::Path::new(folder)).unwrap();
        let mut adapter = CommandAdapter::new(&robot);
        let names = robot.joint_names().to_vec();
        let half = JointState { name: names[..6].to_vec(), position: vec![0.1; 6], ..JointState::default() };
        assert!(adapter.adapt(&half).unwrap_err().contains("a robot is commanded whole"));
        let rest =
            JointState { name: names[6..].to_vec(), position: vec![0.2; 6], effort: vec![500.0; 6], ..half.clone() };
        let command = adapter.adapt(&rest).unwrap();
        assert_eq!((command.position[0], command.position[11]), (0.1, 0.2));
        assert_eq!((command.torque[0], command.torque[11]), (0.0, 87.5));
        assert_eq!((command.kp[0], command.kp[2], command.kd[0]), (230.0, 300.0, 5.0));
        let broken = JointState { position: vec![f64::NAN; 6], ..half };
        assert!(adapter.adapt(&broken).is_err());
        assert!(adapter.adapt(&JointState { name: vec!["tail".into()], ..JointState::default() }).is_err());
    }
}
