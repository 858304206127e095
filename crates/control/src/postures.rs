//! Postures as commands, and how long the way to them takes.

use crate::{Config, JOINTS, JointCommand, Posture};

/// A posture held with the gains and torques that carry the robot in it.
pub(crate) fn posture(config: &Config, posture: &Posture) -> JointCommand {
    JointCommand {
        position_rad: posture.position_rad,
        velocity_rad_s: [0.0; JOINTS],
        kp: config.posture_kp,
        kd: config.posture_kd,
        torque_nm: posture.support_torque_nm,
    }
}

/// The sitting posture with the hips as wide as they will stand.
pub(crate) fn folded(config: &Config) -> JointCommand {
    let mut folded = posture(config, &config.sit);
    for leg in 0..gait::LEGS {
        let roll = leg * gait::JOINTS_PER_LEG;
        folded.position_rad[roll] = config.stand.position_rad[roll];
    }
    folded
}

/// At the configuration's mean speed of the fastest joint, s.
pub(crate) fn posture_duration_s(config: &Config, from: &[f64; JOINTS], to: &[f64; JOINTS]) -> f64 {
    let farthest = (0..JOINTS).fold(0.0_f64, |m, j| m.max((to[j] - from[j]).abs()));
    (farthest / config.posture_speed_rad_s).max(config.posture_min_s)
}
