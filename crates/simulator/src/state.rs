//! What the simulated robot does.

use joints::{JOINTS, LEGS};

/// The robot at one instant. Legs and joints in the project's order.
#[derive(Clone, Debug, PartialEq)]
pub struct RobotState {
    /// Physics steps since the reset.
    pub step: u64,
    /// Simulated time since the reset, s.
    pub time_s: f64,
    /// Base origin in the world, m.
    pub base_position_m: [f64; 3],
    /// Base orientation in the world, (x, y, z, w).
    pub base_quaternion_xyzw: [f64; 4],
    /// Velocity of the base origin in world axes, m/s.
    pub base_linear_velocity_world: [f64; 3],
    /// Angular velocity of the base in its own axes, rad/s.
    pub base_angular_velocity_body: [f64; 3],
    /// What an accelerometer at the base origin reads, in base axes, m/s².
    pub base_specific_force_body: [f64; 3],
    /// Joint positions, rad.
    pub joint_position_rad: [f64; JOINTS],
    /// Joint velocities, rad/s.
    pub joint_velocity_rad_s: [f64; JOINTS],
    /// Torques that the drives gave during the last physics step, Nm.
    pub joint_torque_nm: [f64; JOINTS],
    /// Ground forces on the toes during the last physics step, in world axes, N.
    pub toe_force_n: [[f64; 3]; LEGS],
}

impl RobotState {
    /// Velocity of the base origin in the base's own axes, m/s.
    pub fn base_linear_velocity_body(&self) -> [f64; 3] {
        let [x, y, z, w] = self.base_quaternion_xyzw;
        let to_body = nalgebra::UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(w, x, y, z)).inverse();
        (to_body * nalgebra::Vector3::from(self.base_linear_velocity_world)).into()
    }

    /// Roll, pitch and yaw of the base, rad, with R = Rz(yaw) Ry(pitch) Rx(roll).
    pub fn roll_pitch_yaw(&self) -> [f64; 3] {
        let [x, y, z, w] = self.base_quaternion_xyzw;
        [
            (2.0 * (w * x + y * z)).atan2(1.0 - 2.0 * (x * x + y * y)),
            (2.0 * (w * y - z * x)).clamp(-1.0, 1.0).asin(),
            (2.0 * (w * z + x * y)).atan2(1.0 - 2.0 * (y * y + z * z)),
        ]
    }
}
