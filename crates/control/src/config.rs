//! What the controller has to know of the robot, and its thresholds: plain data, checked once.

use crate::balance_config::BalanceConfig;
use crate::{BodyRange, STILL_RAD, setting};
use gait::LEGS;
use joints::{CommandRange, JOINTS};
use nalgebra::{Matrix3, Matrix3x4, Vector3};
use rigid_body::{Data, center_of_mass, frame_position, rnea};
use robot::{LegKinematics, Robot};

/// A posture to hold on four feet.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Posture {
    /// Joint positions, rad.
    pub position_rad: [f64; JOINTS],
    /// Torques that carry the robot in this posture, N m: sent as feed-forward so that the posture does not sag.
    pub support_torque_nm: [f64; JOINTS],
}

/// Where the law is closed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DriveMode {
    /// At the drive: the whole tuple goes out.
    #[default]
    Impedance,
    /// In the controller: kp = kd = 0 goes out and the torque carries the law. Damping still goes out as kd, because
    /// the drive must damp without us.
    Torque,
}

/// The controller's configuration. [`Config::validate`] is called by [`crate::Controller::new`].
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// The robot's name; a gait for another robot is refused.
    pub robot: String,
    /// The joints' names.
    pub joint_names: [String; JOINTS],
    /// Where the law is closed.
    pub drive_mode: DriveMode,
    /// Allows [`crate::Request::StartOnGait`]. Never for a real robot.
    pub simulation_start: bool,

    /// Smallest joint positions, rad.
    pub position_min_rad: [f64; JOINTS],
    /// Largest joint positions, rad.
    pub position_max_rad: [f64; JOINTS],
    /// Width of the zone inside each position limit in which torque towards the limit fades out, rad.
    pub soft_stop_rad: f64,
    /// Largest joint velocities, rad/s.
    pub velocity_limit_rad_s: [f64; JOINTS],
    /// Largest torques, N m: the drives' own limit, not the plan's.
    pub torque_limit_nm: [f64; JOINTS],
    /// Fastest growth of a torque's magnitude, N m / s. A torque may shrink at once. A planned switch of stance legs
    /// raises a knee's torque by about 50 N m from one millisecond to the next.
    pub torque_rate_nm_s: f64,

    /// The standing posture.
    pub stand: Posture,
    /// The sitting posture, from which standing up starts.
    pub sit: Posture,
    /// Position gains while standing up, standing, and sitting down, N m / rad.
    pub posture_kp: [f64; JOINTS],
    /// Velocity gains likewise, N m s / rad.
    pub posture_kd: [f64; JOINTS],
    /// Velocity gains while damping, N m s / rad.
    pub damping_kd: [f64; JOINTS],
    /// Largest damping torque, N m.
    pub damping_torque_nm: f64,

    /// Gains go from 0 to full in this time when a posture is first held, s.
    pub gain_ramp_s: f64,
    /// Mean speed of the fastest joint while moving from posture to posture, rad/s.
    pub posture_speed_rad_s: f64,
    /// Shortest time for moving from posture to posture, s.
    pub posture_min_s: f64,
    /// From standing to the walk's first posture, s.
    pub start_blend_s: f64,
    /// Out of standing, the walk begins with this share of the gait's motion about its middle posture …
    pub start_share: f64,
    /// … and has grown to the whole of it after this time, s.
    pub start_growth_s: f64,
    /// From the switch at which walking ends to rest, s.
    pub stop_blend_s: f64,
    /// A new gait is taken at a switch if every joint's planned position there differs by less, rad.
    pub gait_change_position_rad: f64,
    /// And every joint's planned velocity by less, rad/s.
    pub gait_change_velocity_rad_s: f64,

    /// Period of the control cycle, s.
    pub control_period_s: f64,
    /// Joint states older than this mean damping, s.
    pub state_timeout_s: f64,
    /// Two cycles further apart than this are a fault, s.
    pub overrun_s: f64,
    /// Allowed distance of a joint from its command, rad …
    pub tracking_error_rad: f64,
    /// … for at most this long, s.
    pub tracking_error_s: f64,
    /// In a walk that has grown to the whole gait, a joint whose command ranged over this while it stood still is
    /// stuck, rad.
    pub stuck_rad: f64,
    /// A joint may exceed its velocity limit for at most this long, s.
    pub overspeed_s: f64,
    /// A measured position further outside its limits than this is a fault, rad.
    pub position_fault_rad: f64,
    /// Largest roll or pitch of the base, rad, where an inertial unit reports it.
    pub tilt_limit_rad: f64,
    /// A drive this hot means a controlled stop, °C.
    pub hot_c: f64,
    /// A drive this hot means damping, °C.
    pub over_temperature_c: f64,
    /// Joints slower than this count as at rest, rad/s.
    pub rest_velocity_rad_s: f64,
    /// The legs' kinematics, where they can be inverted: feet that carry the robot stay where they are while it sits
    /// down.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub legs: Option<[LegKinematics; LEGS]>,
    /// How far the body may be moved while the robot stands.
    #[serde(default)]
    pub body_range: BodyRange,
    /// The balanced law, which is walked where inertial data is received; none: the paper's law.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub balance: Option<BalanceConfig>,
}

/// A value of the configuration that cannot be.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("controller configuration: {key} {problem}")]
pub struct ConfigError {
    /// Which value.
    pub key: String,
    /// What it is and what was expected.
    pub problem: String,
}

impl Config {
    /// The largest numbers of its commands: what a bus must be able to carry.
    pub fn command_range(&self) -> CommandRange {
        CommandRange {
            position_min_rad: self.position_min_rad,
            position_max_rad: self.position_max_rad,
            velocity_rad_s: self.velocity_limit_rad_s,
            kp: self.posture_kp,
            kd: std::array::from_fn(|j| self.posture_kd[j].max(self.damping_kd[j])),
            torque_nm: self.torque_limit_nm,
            period_s: self.control_period_s,
        }
    }

    /// The configuration for a robot: its limits, postures and gains, and thresholds that leave a nominal walk alone.
    pub fn for_robot(robot: &Robot) -> Self {
        let each_leg = |values: [f64; 3]| std::array::from_fn(|j| values[j % 3]);
        let posture =
            |position_rad| Posture { position_rad, support_torque_nm: support_torque_nm(robot, &position_rad) };
        Self {
            robot: robot.name.clone(),
            joint_names: robot.joint_names(),
            drive_mode: DriveMode::Impedance,
            simulation_start: false,
            position_min_rad: robot.position_min_rad(),
            position_max_rad: robot.position_max_rad(),
            soft_stop_rad: 0.04,
            velocity_limit_rad_s: each_leg(robot.limits.velocity_rad_s),
            torque_limit_nm: each_leg(robot.limits.drive_torque_nm),
            torque_rate_nm_s: 1e5,
            stand: posture(robot.stand_rad()),
            sit: posture(robot.sit_rad()),
            posture_kp: each_leg(robot.gains.kp_nm_per_rad),
            posture_kd: each_leg(robot.gains.kd_nm_s_per_rad),
            damping_kd: [8.0; JOINTS],
            damping_torque_nm: 40.0,
            gain_ramp_s: 0.25,
            posture_speed_rad_s: setting::POSTURE_SPEED_RAD_S.default,
            posture_min_s: 0.5,
            start_blend_s: setting::START_BLEND_S.default,
            start_share: 0.3,
            start_growth_s: 2.0,
            stop_blend_s: setting::STOP_BLEND_S.default,
            gait_change_position_rad: 0.08,
            gait_change_velocity_rad_s: 1.5,
            control_period_s: 0.001,
            state_timeout_s: setting::STATE_TIMEOUT_S.default,
            overrun_s: setting::OVERRUN_S.default,
            tracking_error_rad: setting::TRACKING_ERROR_RAD.default,
            tracking_error_s: 0.04,
            stuck_rad: 0.2,
            overspeed_s: 0.03,
            position_fault_rad: 0.3,
            tilt_limit_rad: setting::TILT_LIMIT_RAD.default,
            hot_c: 80.0,
            over_temperature_c: 95.0,
            rest_velocity_rad_s: 1.0,
            legs: LegKinematics::all(robot).ok(),
            body_range: BodyRange::for_height(robot.nominal.height_m),
            balance: None,
        }
    }

    /// Checks every value.
    pub fn validate(&self) -> Result<(), ConfigError> {
        for (setting, value) in [
            (setting::POSTURE_SPEED_RAD_S, self.posture_speed_rad_s),
            (setting::START_BLEND_S, self.start_blend_s),
            (setting::STOP_BLEND_S, self.stop_blend_s),
            (setting::STATE_TIMEOUT_S, self.state_timeout_s),
            (setting::OVERRUN_S, self.overrun_s),
            (setting::TRACKING_ERROR_RAD, self.tracking_error_rad),
            (setting::TILT_LIMIT_RAD, self.tilt_limit_rad),
        ] {
            setting.check(value).or_else(|wrong| refuse(setting.name, wrong.to_string()))?;
        }
        for (key, value, low, high) in [
            ("soft_stop_rad", self.soft_stop_rad, 1e-6, 0.5),
            ("torque_rate_nm_s", self.torque_rate_nm_s, 1.0, 1e9),
            ("damping_torque_nm", self.damping_torque_nm, 0.1, 1e4),
            ("gain_ramp_s", self.gain_ramp_s, 0.01, 10.0),
            ("posture_min_s", self.posture_min_s, 0.1, 60.0),
            ("start_share", self.start_share, 0.0, 1.0),
            ("start_growth_s", self.start_growth_s, 0.05, 60.0),
            ("gait_change_position_rad", self.gait_change_position_rad, 0.0, 0.2),
            ("gait_change_velocity_rad_s", self.gait_change_velocity_rad_s, 0.0, 5.0),
            ("control_period_s", self.control_period_s, 1e-4, 0.1),
            ("tracking_error_s", self.tracking_error_s, 0.001, 1.0),
            ("stuck_rad", self.stuck_rad, 2.0 * STILL_RAD, 2.0),
            ("overspeed_s", self.overspeed_s, 0.001, 1.0),
            ("position_fault_rad", self.position_fault_rad, 0.01, 1.0),
            ("hot_c", self.hot_c, 20.0, 200.0),
            ("over_temperature_c", self.over_temperature_c, self.hot_c, 200.0),
            ("rest_velocity_rad_s", self.rest_velocity_rad_s, 0.01, 10.0),
        ] {
            // Written so that NaN is refused too.
            if !(low..=high).contains(&value) {
                return refuse(key, format!("is {value}, expected {low} to {high}"));
            }
        }
        if self.overrun_s < self.control_period_s {
            let problem =
                format!("is {} s, expected at least a control period of {} s", self.overrun_s, self.control_period_s);
            return refuse("overrun_s", problem);
        }
        self.body_range.problem().map_or(Ok(()), |why| refuse("body_range", why))?;
        self.balance.as_ref().and_then(BalanceConfig::problem).map_or(Ok(()), |(key, why)| refuse(key, why))?;
        (0..JOINTS).try_for_each(|j| self.validate_joint(j))
    }

    fn validate_joint(&self, j: usize) -> Result<(), ConfigError> {
        let name = &self.joint_names[j];
        let (low, high) = (self.position_min_rad[j], self.position_max_rad[j]);
        if !(low.is_finite() && high.is_finite() && high - low > 2.0 * self.soft_stop_rad) {
            return refuse(
                "position limits",
                format!("of {name} are {low} to {high} rad, expected a range wider than both soft stops"),
            );
        }
        for (key, value, limit) in [
            ("velocity_limit_rad_s", self.velocity_limit_rad_s[j], 1e3),
            ("torque_limit_nm", self.torque_limit_nm[j], 1e4),
            ("posture_kp", self.posture_kp[j], 1e5),
            ("posture_kd", self.posture_kd[j], 1e4),
            ("damping_kd", self.damping_kd[j], 1e4),
        ] {
            if !(value > 0.0 && value <= limit) {
                return refuse(key, format!("of {name} is {value}, expected more than 0, at most {limit}"));
            }
        }
        for (key, posture) in [("stand", &self.stand), ("sit", &self.sit)] {
            let q = posture.position_rad[j];
            if !(low..=high).contains(&q) {
                return refuse(key, format!("puts {name} at {q} rad, its limits are {low} to {high}"));
            }
            let torque = posture.support_torque_nm[j];
            if torque.is_nan() || torque.abs() > self.torque_limit_nm[j] {
                return refuse(key, format!("needs {torque} N m at {name}, its limit is {}", self.torque_limit_nm[j]));
            }
        }
        Ok(())
    }
}

/// The error for a value that cannot be.
fn refuse(key: &str, problem: String) -> Result<(), ConfigError> {
    Err(ConfigError { key: key.into(), problem })
}

/// Joint torques that hold the robot still in a posture, level, on four feet that carry it by vertical forces: of all
/// forces in balance the smallest, which is a quarter of the weight each where the posture is symmetric.
fn support_torque_nm(robot: &Robot, position_rad: &[f64; JOINTS]) -> [f64; JOINTS] {
    let model = &robot.model;
    let mut data = Data::new(model);
    let mut q = vec![0.0; model.dof()];
    q[6..].copy_from_slice(position_rad);
    let zero = vec![0.0; model.dof()];
    let mass_kg = model.total_mass();
    let center = center_of_mass(model, &mut data, &q, &zero).position;
    let toes = robot.legs.each_ref().map(|leg| frame_position(model, &data, leg.toe));
    // Rows: forces add up to the weight, and their centre is below the centre of mass.
    let balance = Matrix3x4::from_fn(|row, leg| [1.0, toes[leg].x, toes[leg].y][row]);
    let weight_n = mass_kg * model.gravity.norm();
    let load = weight_n * Vector3::new(1.0, center.x, center.y);
    let gram: Matrix3<f64> = balance * balance.transpose();
    // Toes on one line carry nothing in balance: no feed-forward then, and the posture sags by what the gains allow.
    let Some(multiplier) = gram.lu().solve(&load) else {
        return [0.0; JOINTS];
    };
    let force_n = balance.transpose() * multiplier;
    let forces: [_; 4] = std::array::from_fn(|leg| (robot.legs[leg].toe, Vector3::new(0.0, 0.0, force_n[leg])));
    let torque = rnea(model, &mut data, &q, &zero, &zero, &forces);
    std::array::from_fn(|j| torque[6 + j])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn standing_torques_hold_the_vision60() {
        let robot = Robot::from_toml_str(
            include_str!("../../../config/robots/vision60/robot.toml"),
            include_str!("../../../config/robots/vision60/vision60.urdf"),
        )
        .unwrap();
        let config = Config::for_robot(&robot);
        config.validate().unwrap();
        let torque = config.stand.support_torque_nm;
        for j in 0..6 {
            let mirrored = if j % 3 == 0 { -torque[j + 6] } else { torque[j + 6] };
            assert!((torque[j] - mirrored).abs() < 1e-9, "{torque:?}");
        }
        // By hand: a quarter of 38 kg on each toe, 0.217 m outside the roll axis, less thigh and shank, which hang
        // outside it themselves; and half the thigh's horizontal reach behind the knee.
        let leg_n = 38.0 * 9.81 / 4.0;
        let roll_nm = leg_n * 0.217 - 9.81 * (2.525 + 0.375) * 0.14;
        assert!((torque[0].abs() - roll_nm).abs() < 1.0, "{torque:?}");
        assert!((torque[2].abs() - leg_n * 0.34 * 1.02839_f64.cos()).abs() < 1.0, "{torque:?}");
        assert!(torque[1].abs() < 6.0, "{torque:?}");
    }
}
