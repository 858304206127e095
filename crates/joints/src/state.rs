//! What the drives measured.

use crate::{JOINTS, resolution};
use std::time::Duration;

/// What the drives, or the simulator, reported.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct JointState {
    /// The state's own time stamp: a new stamp is a new state.
    pub stamp: Duration,
    /// When each joint's values arrived, on the clock of `now`.
    pub arrived: [Duration; JOINTS],
    /// Positions, rad.
    pub position_rad: [f64; JOINTS],
    /// Velocities, rad/s.
    pub velocity_rad_s: [f64; JOINTS],
    /// Temperatures, °C, where the drives report them.
    pub temperature_c: Option<[f64; JOINTS]>,
    /// Error codes of the drives; 0 means none.
    pub drive_error: [u8; JOINTS],
}

impl JointState {
    /// Of drives that report positions (rad) and velocities (rad/s) only, all at `stamp`.
    pub fn measured(stamp: Duration, position_rad: [f64; JOINTS], velocity_rad_s: [f64; JOINTS]) -> Self {
        let (arrived, temperature_c, drive_error) = ([stamp; JOINTS], None, [0; JOINTS]);
        Self { stamp, arrived, position_rad, velocity_rad_s, temperature_c, drive_error }
    }

    /// The state as the controller takes it.
    pub fn to_resolution(self) -> Self {
        Self {
            position_rad: self.position_rad.map(resolution::position_rad),
            velocity_rad_s: self.velocity_rad_s.map(resolution::velocity_rad_s),
            ..self
        }
    }
}
