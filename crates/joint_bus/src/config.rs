//! Which joint hangs on which drive: read from a file's text, checked.

use crate::{DriveLimits, InertialFrames, Ranges};
use joints::{CommandRange, JOINTS};
use serde::Deserialize;

/// `format` of every bus file.
const FORMAT: &str = "tandem-bus";
const VERSION: u64 = 1;
/// Where the file names no other: as long as the drives' own.
const WATCHDOG_S: f64 = 0.02;
/// A watchdog has to outlast cycles that come late: so many periods.
const WATCHDOG_PERIODS: f64 = 3.0;

/// What the drives speak.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ProtocolName {
    /// [`crate::Mit`].
    Mit,
    /// [`crate::Registers`].
    Registers,
}

/// How a joint is driven. q_joint = sign · q_motor / gear + zero, with velocities, torques and gains accordingly.
#[derive(Clone, Debug, PartialEq)]
pub struct JointWiring {
    /// The joint's name.
    pub name: String,
    /// Which of the interfaces.
    pub interface: usize,
    /// The drive's number on its bus.
    pub id: u8,
    /// 1 or −1: whether the motor turns with the joint or against it.
    pub sign: f64,
    /// Motor turns per joint turn, beyond what the drive itself reckons with.
    pub gear_ratio: f64,
    /// The joint's position where the drive says zero, rad.
    pub zero_rad: f64,
    /// Ranges of the drive's numbers, motor side.
    pub ranges: Ranges,
    /// What goes with every command, motor side.
    pub limits: DriveLimits,
}

/// Where an inertial unit hangs whose frames are [`InertialFrames`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct InertialWiring {
    /// Which of the interfaces.
    pub interface: usize,
    /// Its frames.
    pub frames: InertialFrames,
}

/// All joints.
#[derive(Clone, Debug, PartialEq)]
pub struct BusConfig {
    /// The robot's name.
    pub robot: String,
    /// What the drives speak.
    pub protocol: ProtocolName,
    /// Identifier of replies.
    pub host_id: u32,
    /// Whether drives whose protocol has no query are commanded to rest, which they answer, before anybody has armed.
    pub ask_before_arming: bool,
    /// Names of the interfaces, such as `can0`.
    pub interfaces: Vec<String>,
    /// The inertial unit, where one hangs on an interface.
    pub inertial: Option<InertialWiring>,
    /// In the robot's order of joints.
    pub joints: [JointWiring; JOINTS],
}

/// A bus file that cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum BusConfigError {
    /// Not TOML, or a field missing, unknown or of another type.
    #[error("bus file: {0}")]
    Syntax(#[from] toml::de::Error),
    /// A value that cannot be.
    #[error("bus file: {key} {problem}")]
    Value {
        /// Which.
        key: String,
        /// What it is and what was expected.
        problem: String,
    },
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    format: String,
    version: u64,
    robot: String,
    protocol: ProtocolName,
    host_id: u32,
    #[serde(default)]
    ask_before_arming: bool,
    interfaces: Vec<String>,
    ranges: FileRanges,
    limits: Option<FileLimits>,
    inertial: Option<FileInertial>,
    joints: Vec<FileJoint>,
}

/// Only with registers: MIT frames have no room for limits.
#[derive(Clone, Copy, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct FileLimits {
    max_torque_nm: Option<f64>,
    watchdog_s: Option<f64>,
}

#[derive(Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
struct FileInertial {
    interface: usize,
    id: u32,
}

#[derive(Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
struct FileRanges {
    position_rad: f64,
    velocity_rad_s: f64,
    kp_nm_per_rad: f64,
    kd_nm_s_per_rad: f64,
    torque_nm: f64,
}

impl From<FileRanges> for Ranges {
    fn from(r: FileRanges) -> Self {
        Self {
            position_rad: r.position_rad,
            velocity_rad_s: r.velocity_rad_s,
            kp: r.kp_nm_per_rad,
            kd: r.kd_nm_s_per_rad,
            torque_nm: r.torque_nm,
        }
    }
}

impl File {
    /// Everything but the joints' and the inertial unit's own values.
    fn check(&self, robot: &str) -> Result<(), BusConfigError> {
        let refuse = |key: &str, problem: String| Err(BusConfigError::Value { key: key.into(), problem });
        if self.format != FORMAT || self.version != VERSION {
            return refuse(
                "format and version",
                format!("are \"{}\" and {}, expected \"{FORMAT}\" and {VERSION}", self.format, self.version),
            );
        }
        if self.robot != robot {
            return refuse("robot", format!("is \"{}\", this robot is \"{robot}\"", self.robot));
        }
        if self.interfaces.is_empty() || self.interfaces.len() > JOINTS {
            let problem = format!("has {} entries, expected 1 to {JOINTS}", self.interfaces.len());
            return refuse("interfaces", problem);
        }
        let highest = self.protocol.largest_host_id();
        if self.host_id > highest {
            return refuse("host_id", format!("is {}, expected 0 to {highest}", self.host_id));
        }
        if self.joints.len() != JOINTS {
            return refuse("joints", format!("has {} entries, expected {JOINTS}", self.joints.len()));
        }
        Ok(())
    }

    /// How the joint of that name is driven; `others` are those before it.
    fn wiring(&self, name: &str, others: &[JointWiring]) -> Result<JointWiring, BusConfigError> {
        let Some(joint) = self.joints.iter().find(|joint| joint.name == name) else {
            return Err(BusConfigError::Value { key: "joints".into(), problem: format!("lack \"{name}\"") });
        };
        let refuse =
            |field: &str, problem: String| Err(BusConfigError::Value { key: format!("{field} of {name}"), problem });
        if joint.interface >= self.interfaces.len() {
            let last = self.interfaces.len() - 1;
            return refuse("interface", format!("is {}, there are interfaces 0 to {last}", joint.interface));
        }
        if joint.id == 0 || joint.id > 127 || u32::from(joint.id) == self.host_id {
            return refuse("id", format!("is {}, expected 1 to 127 and not host_id", joint.id));
        }
        if joint.sign.abs() != 1.0 {
            return refuse("sign", format!("is {}, expected 1 or -1", joint.sign));
        }
        if !(0.01..=1000.0).contains(&joint.gear_ratio) {
            return refuse("gear_ratio", format!("is {}, expected 0.01 to 1000", joint.gear_ratio));
        }
        if !(-7.0..=7.0).contains(&joint.zero_rad) {
            return refuse("zero_rad", format!("is {}, expected -7 to 7", joint.zero_rad));
        }
        let r = joint.ranges.unwrap_or(self.ranges);
        for (field, value) in [
            ("ranges.position_rad", r.position_rad),
            ("ranges.velocity_rad_s", r.velocity_rad_s),
            ("ranges.kp_nm_per_rad", r.kp_nm_per_rad),
            ("ranges.kd_nm_s_per_rad", r.kd_nm_s_per_rad),
            ("ranges.torque_nm", r.torque_nm),
        ] {
            if !(value > 0.0 && value <= 1e5) {
                return refuse(field, format!("is {value}, expected more than 0, at most 1e5"));
            }
        }
        if let Some(twin) = others.iter().find(|w| w.interface == joint.interface && w.id == joint.id) {
            return refuse("id", format!("is {}, as that of {} on the same interface", joint.id, twin.name));
        }
        Ok(JointWiring {
            name: name.to_owned(),
            interface: joint.interface,
            id: joint.id,
            sign: joint.sign,
            gear_ratio: joint.gear_ratio,
            zero_rad: joint.zero_rad,
            ranges: r.into(),
            limits: self.limits(r.torque_nm)?,
        })
    }

    fn inertial(&self) -> Result<Option<InertialWiring>, BusConfigError> {
        let Some(FileInertial { interface, id }) = self.inertial else { return Ok(None) };
        let refuse = |key: &str, problem: String| Err(BusConfigError::Value { key: key.into(), problem });
        if interface >= self.interfaces.len() {
            let last = self.interfaces.len() - 1;
            return refuse("inertial.interface", format!("is {interface}, there are interfaces 0 to {last}"));
        }
        if id > 0x1fff_fffc || id % 4 != 0 {
            return refuse("inertial.id", format!("is {id:#x}, expected a multiple of 4 of at most 29 bits"));
        }
        Ok(Some(InertialWiring { interface, frames: InertialFrames { id } }))
    }

    /// What goes with every command to a drive whose torques have this range.
    fn limits(&self, range_nm: f64) -> Result<DriveLimits, BusConfigError> {
        let refuse = |key: &str, problem: String| Err(BusConfigError::Value { key: key.into(), problem });
        if !self.protocol.carries_limits() {
            return match self.limits {
                Some(_) => refuse("limits", "are given, mit frames have no room for them: set the drives up".into()),
                None => Ok(DriveLimits::default()),
            };
        }
        let limits = self.limits.unwrap_or_default();
        let (max_torque_nm, watchdog_s) =
            (limits.max_torque_nm.unwrap_or(range_nm), limits.watchdog_s.unwrap_or(WATCHDOG_S));
        if !(max_torque_nm > 0.0 && max_torque_nm <= 1e5) {
            return refuse("limits.max_torque_nm", format!("is {max_torque_nm}, expected more than 0, at most 1e5"));
        }
        if !(0.001..=1.0).contains(&watchdog_s) {
            return refuse("limits.watchdog_s", format!("is {watchdog_s}, expected 0.001 to 1"));
        }
        Ok(DriveLimits { max_torque_nm: Some(max_torque_nm), watchdog_s: Some(watchdog_s) })
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct FileJoint {
    name: String,
    interface: usize,
    id: u8,
    sign: f64,
    gear_ratio: f64,
    zero_rad: f64,
    ranges: Option<FileRanges>,
}

impl BusConfig {
    /// A bus file's text, for the robot of that name with those joints.
    pub fn from_toml_str(text: &str, robot: &str, joint_names: &[String; JOINTS]) -> Result<Self, BusConfigError> {
        let file: File = toml::from_str(text)?;
        file.check(robot)?;
        let inertial = file.inertial()?;
        let mut wiring = Vec::with_capacity(JOINTS);
        for name in joint_names {
            wiring.push(file.wiring(name, &wiring)?);
        }
        let joints = wiring
            .try_into()
            .map_err(|_| BusConfigError::Value { key: "joints".into(), problem: format!("are not {JOINTS}") })?;
        Ok(Self {
            robot: file.robot,
            protocol: file.protocol,
            host_id: file.host_id,
            ask_before_arming: file.ask_before_arming,
            inertial,
            interfaces: file.interfaces,
            joints,
        })
    }

    /// Checks that the drives' numbers can carry what the controller may send: position and velocity limits, gains and
    /// torques within every drive's ranges, and that its watchdog outlasts a late cycle. A number beyond a range would
    /// be cut without anyone knowing.
    pub fn check_ranges(&self, sent: &CommandRange) -> Result<(), BusConfigError> {
        for (j, joint) in self.joints.iter().enumerate() {
            let gear = joint.gear_ratio;
            let farthest = (sent.position_min_rad[j] - joint.zero_rad)
                .abs()
                .max((sent.position_max_rad[j] - joint.zero_rad).abs());
            for (field, needed, range) in [
                ("position_rad", farthest * gear, joint.ranges.position_rad),
                ("velocity_rad_s", sent.velocity_rad_s[j] * gear, joint.ranges.velocity_rad_s),
                ("kp_nm_per_rad", sent.kp[j] / gear / gear, joint.ranges.kp),
                ("kd_nm_s_per_rad", sent.kd[j] / gear / gear, joint.ranges.kd),
                ("torque_nm", sent.torque_nm[j] / gear, joint.ranges.torque_nm),
            ] {
                if needed > range {
                    return Err(BusConfigError::Value {
                        key: format!("ranges.{field} of {}", joint.name),
                        problem: format!(
                            "is {range}, the controller sends up to {needed:.3}: give the drive a wider range"
                        ),
                    });
                }
            }
            let shortest_s = WATCHDOG_PERIODS * sent.period_s;
            if let Some(watchdog_s) = joint.limits.watchdog_s.filter(|watchdog_s| *watchdog_s < shortest_s) {
                return Err(BusConfigError::Value {
                    key: format!("limits.watchdog_s of {}", joint.name),
                    problem: format!("is {watchdog_s}, expected at least {shortest_s}: three control periods"),
                });
            }
        }
        Ok(())
    }
}
