//! The file of rules.

use anyhow::{Result, bail};
use serde::Deserialize;

/// What is handed on.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rules {
    format: String,
    version: u32,
    /// Measured joints.
    #[serde(default)]
    pub joint_states: Vec<StateRule>,
    /// Inertial units.
    #[serde(default)]
    pub imu: Vec<ImuRule>,
    /// Velocities.
    #[serde(default)]
    pub twist: Vec<Rule>,
    /// Commands of another framework.
    #[serde(default)]
    pub joint_commands: Vec<Rule>,
}

/// From a topic to another.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rule {
    /// The topic that is listened to.
    pub from: String,
    /// The topic that is published.
    pub to: String,
}

/// As [`Rule`], for an inertial unit.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ImuRule {
    /// The topic that is listened to.
    pub from: String,
    /// The topic that is published.
    pub to: String,
    /// The frame's name, where it is another.
    pub frame_id: Option<String>,
}

/// As [`Rule`], for measured joints.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StateRule {
    /// The topic that is listened to.
    pub from: String,
    /// The topic that is published.
    pub to: String,
    /// In the order of their message.
    pub joints: Vec<JointRule>,
}

/// One joint: ours = sign · theirs + offset.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JointRule {
    /// Its name in their message.
    pub theirs: String,
    /// Its name here.
    pub ours: String,
    /// 1 or −1.
    #[serde(default = "plus")]
    pub sign: f64,
    /// rad.
    #[serde(default)]
    pub offset_rad: f64,
}

fn plus() -> f64 {
    1.0
}

impl Rules {
    /// Reads and checks them.
    ///
    /// # Errors
    /// What is wrong, and what was expected.
    pub fn from_toml(text: &str) -> Result<Self> {
        let rules: Self = toml::from_str(text)?;
        if (rules.format.as_str(), rules.version) != ("tandem-adapter", 1) {
            bail!("format \"{}\", version {}: expected \"tandem-adapter\", 1", rules.format, rules.version);
        }
        for joint in rules.joint_states.iter().flat_map(|rule| &rule.joints) {
            if joint.sign.abs() != 1.0 || !joint.offset_rad.is_finite() {
                bail!(
                    "joint {}: sign {}, offset_rad {}: expected 1 or -1, and a number",
                    joint.theirs,
                    joint.sign,
                    joint.offset_rad
                );
            }
        }
        let observed = rules.observed().map(|(_, to)| to);
        for to in observed {
            // Whoever only looks must not be able to move anything by a slip in a file.
            let commands = ["joint_command", "emergency_stop", "push"].contains(&to.rsplit('/').next().unwrap_or(to));
            if commands || to.contains("/command/") {
                bail!("{to} moves a robot: joint_states, imu and twist are handed on to be looked at");
            }
        }
        if rules.observed().next().is_none() && rules.joint_commands.is_empty() {
            bail!("there is no rule: expected [[joint_states]], [[imu]], [[twist]] or [[joint_commands]]");
        }
        Ok(rules)
    }

    fn observed(&self) -> impl Iterator<Item = (&str, &str)> {
        let states = self.joint_states.iter().map(|rule| (rule.from.as_str(), rule.to.as_str()));
        let imu = self.imu.iter().map(|rule| (rule.from.as_str(), rule.to.as_str()));
        let twist = self.twist.iter().map(|rule| (rule.from.as_str(), rule.to.as_str()));
        states.chain(imu).chain(twist)
    }

    /// All of it in a line.
    pub fn summary(&self) -> String {
        let commands = self.joint_commands.iter().map(|rule| (rule.from.as_str(), rule.to.as_str()));
        self.observed().chain(commands).map(|(from, to)| format!("{from} to {to}")).collect::<Vec<_>>().join(", ")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_files_that_come_with_it_are_read_and_the_vision_60s_commands_nothing() {
        let vision60 = Rules::from_toml(include_str!("../../../../config/adapters/vision60.toml")).unwrap();
        assert!(vision60.joint_commands.is_empty() && vision60.joint_states[0].joints.len() == 12);
        let ros2_control = Rules::from_toml(include_str!("../../../../config/adapters/ros2_control.toml")).unwrap();
        assert_eq!(ros2_control.joint_commands.len(), 1);
    }

    #[test]
    fn what_would_move_a_robot_is_no_rule_for_observers() {
        let of = |rest: &str| Rules::from_toml(&format!("format = \"tandem-adapter\"\nversion = 1\n{rest}"));
        for to in ["joint_command", "/left/joint_command", "/mcu/command/manual_twist", "emergency_stop"] {
            let error = of(&format!("[[twist]]\nfrom = \"a\"\nto = \"{to}\"")).unwrap_err().to_string();
            assert!(error.contains(to) && error.contains("moves a robot"), "{error}");
        }
        assert!(of("").unwrap_err().to_string().contains("no rule"));
        assert!(of("[[imu]]\nfrom = \"a\"\nto = \"b\"\nrate = 3").is_err(), "an unknown key");
        let joint = "joints = [{theirs = \"a\", ours = \"b\", sign = 2.0}]";
        assert!(of(&format!("[[joint_states]]\nfrom = \"a\"\nto = \"b\"\n{joint}")).is_err());
    }
}
