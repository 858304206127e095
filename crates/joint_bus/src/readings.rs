//! What the joints have reported.

use joints::{JOINTS, JointState};
use std::time::Duration;

/// What was read from the joints so far.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Readings {
    /// The stamp of the state as a whole, where its source gives one; else the newest joint's arrival stands for it.
    pub stamp: Option<Duration>,
    /// rad.
    pub position_rad: [f64; JOINTS],
    /// rad/s.
    pub velocity_rad_s: [f64; JOINTS],
    /// N m, as the drives report it.
    pub torque_nm: [f64; JOINTS],
    /// Whether they do.
    pub torque_reported: bool,
    /// °C, where the drives report it.
    pub temperature_c: Option<[f64; JOINTS]>,
    /// V that each drive is fed with, where they report it.
    pub supply_v: Option<[f64; JOINTS]>,
    /// A, motor side, where the drives report it.
    pub current_a: Option<[f64; JOINTS]>,
    /// Error codes of the drives, 0 for none.
    pub drive_error: [u8; JOINTS],
    /// When each joint was received last, on the clock of `now`; `None`: never.
    pub arrived: [Option<Duration>; JOINTS],
}

impl Default for Readings {
    fn default() -> Self {
        Self {
            stamp: None,
            position_rad: [0.0; JOINTS],
            velocity_rad_s: [0.0; JOINTS],
            torque_nm: [0.0; JOINTS],
            torque_reported: false,
            temperature_c: None,
            supply_v: None,
            current_a: None,
            drive_error: [0; JOINTS],
            arrived: [None; JOINTS],
        }
    }
}

impl Readings {
    /// The controller's input, once every joint has been received.
    pub fn joint_state(&self) -> Option<JointState> {
        let mut arrived = [Duration::ZERO; JOINTS];
        for (to, from) in arrived.iter_mut().zip(self.arrived) {
            *to = from?;
        }
        Some(JointState {
            stamp: self.stamp.unwrap_or_else(|| arrived.iter().copied().max().unwrap_or_default()),
            arrived,
            position_rad: self.position_rad,
            velocity_rad_s: self.velocity_rad_s,
            temperature_c: self.temperature_c,
            drive_error: self.drive_error,
        })
    }
}
