//! The joint interface: what every backend carries, and what every drive evaluates.

use crate::{JOINTS, resolution};

/// One command for every joint. The drive's law, evaluated at the drive (or in the simulator at every physics step), is
/// τ = kp (q_des − q) + kd (q̇_des − q̇) + τ_ff.
///
/// Joints are in the order leg × (hip roll, hip pitch, knee), legs front-left, rear-left, front-right, rear-right.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct JointCommand {
    /// q_des, rad.
    pub position_rad: [f64; JOINTS],
    /// q̇_des, rad/s.
    pub velocity_rad_s: [f64; JOINTS],
    /// Position gains, N m / rad.
    pub kp: [f64; JOINTS],
    /// Velocity gains, N m s / rad.
    pub kd: [f64; JOINTS],
    /// τ_ff, N m.
    pub torque_nm: [f64; JOINTS],
}

impl JointCommand {
    /// No torque whatever the joints do.
    pub const LIMP: Self = Self {
        position_rad: [0.0; JOINTS],
        velocity_rad_s: [0.0; JOINTS],
        kp: [0.0; JOINTS],
        kd: [0.0; JOINTS],
        torque_nm: [0.0; JOINTS],
    };

    /// Damping: kp = 0, q̇_des = 0, τ = −kd q̇.
    pub fn damping(kd: [f64; JOINTS]) -> Self {
        Self { kd, ..Self::LIMP }
    }

    /// The drive's law at measured positions `q` (rad) and velocities `v` (rad/s): torques in N m, before any limit.
    pub fn torque(&self, q: &[f64; JOINTS], v: &[f64; JOINTS]) -> [f64; JOINTS] {
        std::array::from_fn(|j| self.joint_torque(j, q[j], v[j]))
    }

    /// The drive's law of one joint.
    pub fn joint_torque(&self, joint: usize, q: f64, v: f64) -> f64 {
        self.kp[joint] * (self.position_rad[joint] - q)
            + self.kd[joint] * (self.velocity_rad_s[joint] - v)
            + self.torque_nm[joint]
    }

    /// Whether every number is finite.
    pub fn is_finite(&self) -> bool {
        [&self.position_rad, &self.velocity_rad_s, &self.kp, &self.kd, &self.torque_nm]
            .into_iter()
            .flatten()
            .all(|v| v.is_finite())
    }

    /// The command as it is asked for; the limits come after it and change what breaks them, exactly. Gains are left as
    /// they are.
    pub fn to_resolution(self) -> Self {
        Self {
            position_rad: self.position_rad.map(resolution::position_rad),
            velocity_rad_s: self.velocity_rad_s.map(resolution::velocity_rad_s),
            torque_nm: self.torque_nm.map(resolution::torque_nm),
            ..self
        }
    }
}

/// The largest numbers that a controller's commands carry, and how often they come.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CommandRange {
    /// Smallest positions, rad.
    pub position_min_rad: [f64; JOINTS],
    /// Largest positions, rad.
    pub position_max_rad: [f64; JOINTS],
    /// Largest velocities, rad/s.
    pub velocity_rad_s: [f64; JOINTS],
    /// Largest position gains, N m / rad.
    pub kp: [f64; JOINTS],
    /// Largest velocity gains, N m s / rad.
    pub kd: [f64; JOINTS],
    /// Largest torques, N m.
    pub torque_nm: [f64; JOINTS],
    /// From one command to the next, s.
    pub period_s: f64,
}
