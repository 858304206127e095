//! What the balanced law has to know of the robot, and its constants.

use crate::{of_leg, setting};
use estimator::Estimator;
use robot::{LegKinematics, Robot, RobotError};

/// Constants of the balanced law. Lengths and times that depend on the robot's size are shares of the height z0 of
/// its hips over its toes and of 1/λ, λ = √(g/z0).
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BalanceConfig {
    /// The legs' kinematics.
    pub legs: [LegKinematics; 4],
    /// The estimator's constants.
    pub estimator: estimator::Config,
    /// The robot's mass, kg.
    pub mass_kg: f64,
    /// Share of the error at the switch that the next stance is placed by. From 0.35 to 0.5 it serves alike.
    pub placement_gain: f64,
    /// Longest placement, of z0.
    pub placement_limit_share: f64,
    /// The step is hurried so that the error across the stance line does not grow beyond this, of z0.
    pub hurry_share: f64,
    /// The shortest rest of a step, of 1/λ.
    pub hurry_rest_share: f64,
    /// A step never goes faster than this many times its own pace.
    pub hurry_limit: f64,
    /// Share of the swing toes' horizontal and vertical distance from level that is levelled out.
    pub level_gain: [f64; 2],
    /// Share of the difference that the ground's estimate changes by at each switch.
    pub ground_gain: f64,
    /// Steepest ground that is believed, as rise over run.
    pub ground_limit: f64,
    /// How far the body is shifted over its toes on a slope, of z0 times the slope's rise over run. A body that stands
    /// still needs about 1. Walking, from 0.75 to 0.85 serves alike: with 1 the default amble slides down on 10°.
    #[serde(default = "whole")]
    pub slope_shift_share: f64,
    /// The body goes lower on ground that is steeper than `slope_lowering_from`, a rise over run: by this share of z0
    /// times what it is steeper. Recordings that are older say nothing of it.
    #[serde(default)]
    pub slope_lowering_share: f64,
    /// The rise over run up to which it keeps its height.
    #[serde(default)]
    pub slope_lowering_from: f64,
    /// What a leg has no room for of that shift, to its side, the other leg of its pair takes. Recordings that are
    /// older say nothing of it, and shift all legs alike.
    #[serde(default)]
    pub pairs_share_shift: bool,
    /// Fastest shift of the body over a slope, of z0 a second.
    pub shift_rate_share: f64,
    /// Fastest change of the commanded velocity, m/s², and of the commanded turning, rad/s².
    pub acceleration_m_s2: f64,
    /// See [`Self::acceleration_m_s2`].
    pub angular_acceleration_rad_s2: f64,
    /// Rate of the integral of the speed's error, 1/s.
    pub speed_integral_rate_s: f64,
    /// Share of the speed's error that is answered at once, by the legs that stand.
    #[serde(default)]
    pub speed_gain: f64,
    /// … where the error is small against this, m/s. Recordings that are older answer none.
    #[serde(default)]
    pub speed_gain_range_m_s: f64,
    /// Velocity for each m that a driven robot is away from where its commands have led to, 1/s.
    #[serde(default)]
    pub path_gain_s: f64,
    /// Turning for each rad of heading error, 1/s.
    pub heading_gain_s: f64,
    /// Velocity for each m from the place to be held, 1/s.
    pub position_gain_s: f64,
    /// A velocity command older than this counts as none: it steps in place, s.
    pub command_timeout_s: f64,
    /// A velocity begins a walk of a robot that stands, and without one for this long it stands again, s; none: only
    /// requests begin and end a walk.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stand_after_s: Option<f64>,
    /// Without a good estimate it walks on for this long, s.
    pub estimate_patience_s: f64,
    /// With placement or hurrying at their limits it walks on for this long, s.
    pub limited_patience_s: f64,
    /// While a step is caught the body is thrown off its standing legs, and a joint may be this far from its command,
    /// rad, where the controller allows less. 0: as ever; recordings that are older say nothing of it.
    #[serde(default)]
    pub caught_tracking_error_rad: f64,
    /// … for at most this long, s.
    #[serde(default)]
    pub caught_tracking_error_s: f64,
    /// Over this last share below a joint's velocity limit, torque that makes it faster turns into damping; 0: it does
    /// not. Recordings that are older say nothing of it.
    #[serde(default)]
    pub speed_fade_share: f64,
    /// Largest commanded speed ahead, backward and to a side, m/s, and turning, rad/s.
    pub velocity_limit: VelocityLimit,
}

/// What recordings walked with that are older than the share.
fn whole() -> f64 {
    1.0
}

/// Largest commanded velocities.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VelocityLimit {
    /// Ahead, m/s.
    pub forward_m_s: f64,
    /// Backward, m/s.
    pub backward_m_s: f64,
    /// To either side, m/s.
    pub lateral_m_s: f64,
    /// Turning, rad/s.
    pub yaw_rad_s: f64,
}

impl BalanceConfig {
    /// The law's constants for a robot.
    ///
    /// # Errors
    ///
    /// If a leg has another shape than a roll that carries parallel pitch and knee.
    pub fn for_robot(robot: &Robot) -> Result<Self, RobotError> {
        // By dynamic similarity speeds go with √(g z0): measured on the Vision 60 at z0 = 0.55 m, g z0 = 5.4 m²/s².
        let speed_m_s = (9.81 * robot.nominal.height_m).sqrt();
        Ok(Self {
            legs: LegKinematics::all(robot)?,
            estimator: estimator::Config::new(robot.toe_radius_m),
            mass_kg: robot.model.total_mass(),
            placement_gain: 0.45,
            placement_limit_share: 0.36,
            hurry_share: 0.18,
            hurry_rest_share: 0.34,
            hurry_limit: 4.0,
            level_gain: [0.6, 0.2],
            ground_gain: 0.5,
            ground_limit: 0.4,
            slope_shift_share: 0.8,
            slope_lowering_share: 1.0,
            slope_lowering_from: 0.05,
            pairs_share_shift: true,
            shift_rate_share: 0.18,
            acceleration_m_s2: 0.26 * speed_m_s,
            angular_acceleration_rad_s2: 1.0,
            speed_integral_rate_s: 0.1,
            speed_gain: 0.6,
            speed_gain_range_m_s: 0.035 * speed_m_s,
            path_gain_s: 0.03,
            heading_gain_s: 1.0,
            position_gain_s: 0.5,
            command_timeout_s: setting::CMD_VEL_TIMEOUT_S.default,
            stand_after_s: None,
            estimate_patience_s: 0.05,
            limited_patience_s: 0.5,
            caught_tracking_error_rad: 0.5,
            caught_tracking_error_s: 0.1,
            speed_fade_share: 0.2,
            velocity_limit: VelocityLimit {
                forward_m_s: 0.43 * speed_m_s,
                backward_m_s: 0.2 * speed_m_s,
                lateral_m_s: 0.15 * speed_m_s,
                yaw_rad_s: 1.0,
            },
        })
    }

    /// The first value that cannot be: its name, and what is wrong.
    pub fn problem(&self) -> Option<(&'static str, String)> {
        if let Some(problem) = self.estimator.problem() {
            return Some(("balance.estimator", problem));
        }
        let limit = &self.velocity_limit;
        [
            ("balance.mass_kg", self.mass_kg, 1e-3, 1e4),
            ("balance.placement_gain", self.placement_gain, 0.0, 1.5),
            ("balance.placement_limit_share", self.placement_limit_share, 0.0, 0.8),
            ("balance.hurry_share", self.hurry_share, 0.01, 10.0),
            ("balance.hurry_rest_share", self.hurry_rest_share, 0.05, 10.0),
            ("balance.hurry_limit", self.hurry_limit, 1.0, 10.0),
            ("balance.level_gain", self.level_gain[0], 0.0, 1.5),
            ("balance.level_gain", self.level_gain[1], 0.0, 1.5),
            ("balance.ground_gain", self.ground_gain, 0.0, 1.0),
            ("balance.ground_limit", self.ground_limit, 0.0, 1.0),
            ("balance.slope_shift_share", self.slope_shift_share, 0.0, 2.0),
            ("balance.slope_lowering_share", self.slope_lowering_share, 0.0, 2.0),
            ("balance.slope_lowering_from", self.slope_lowering_from, 0.0, 1.0),
            ("balance.shift_rate_share", self.shift_rate_share, 0.0, 10.0),
            ("balance.acceleration_m_s2", self.acceleration_m_s2, 0.01, 100.0),
            ("balance.angular_acceleration_rad_s2", self.angular_acceleration_rad_s2, 0.01, 100.0),
            ("balance.speed_integral_rate_s", self.speed_integral_rate_s, 0.0, 10.0),
            ("balance.speed_gain", self.speed_gain, 0.0, 10.0),
            ("balance.speed_gain_range_m_s", self.speed_gain_range_m_s, 0.0, 10.0),
            ("balance.path_gain_s", self.path_gain_s, 0.0, 10.0),
            ("balance.heading_gain_s", self.heading_gain_s, 0.0, 10.0),
            ("balance.position_gain_s", self.position_gain_s, 0.0, 10.0),
            (
                "balance.command_timeout_s",
                self.command_timeout_s,
                setting::CMD_VEL_TIMEOUT_S.least,
                setting::CMD_VEL_TIMEOUT_S.greatest,
            ),
            (
                "balance.stand_after_s",
                self.stand_after_s.unwrap_or(setting::CMD_VEL_STAND_S.default),
                setting::CMD_VEL_STAND_S.least,
                setting::CMD_VEL_STAND_S.greatest,
            ),
            ("balance.estimate_patience_s", self.estimate_patience_s, 0.0, 0.5),
            ("balance.limited_patience_s", self.limited_patience_s, 0.0, 10.0),
            ("balance.caught_tracking_error_rad", self.caught_tracking_error_rad, 0.0, 2.0),
            ("balance.caught_tracking_error_s", self.caught_tracking_error_s, 0.0, 1.0),
            ("balance.speed_fade_share", self.speed_fade_share, 0.0, 1.0),
            ("balance.velocity_limit.forward_m_s", limit.forward_m_s, 0.0, 10.0),
            ("balance.velocity_limit.backward_m_s", limit.backward_m_s, 0.0, 10.0),
            ("balance.velocity_limit.lateral_m_s", limit.lateral_m_s, 0.0, 10.0),
            ("balance.velocity_limit.yaw_rad_s", limit.yaw_rad_s, 0.0, 10.0),
        ]
        .into_iter()
        // Written so that NaN is named too.
        .find(|(_, value, low, high)| !(low..=high).contains(&value))
        .map(|(key, value, low, high)| (key, format!("is {value}, expected {low} to {high}")))
    }

    /// One step of the estimator. `swings` says which legs are planned to swing.
    pub fn estimate(
        &self,
        estimator: &mut Estimator,
        joints: (&[f64; 12], &[f64; 12]),
        inertial: Option<estimator::Inertial>,
        swings: [bool; 4],
        phase: Option<f64>,
        dt_s: f64,
    ) {
        let (position_rad, velocity_rad_s) = joints;
        let toes = std::array::from_fn(|leg| {
            if swings[leg] {
                return estimator::Toe::default();
            }
            let toe = self.legs[leg].toe(&of_leg(position_rad, leg));
            let rates = nalgebra::Vector3::from(of_leg(velocity_rad_s, leg));
            estimator::Toe {
                position_m: toe.position_m.into(),
                velocity_m_s: (toe.jacobian * rates).into(),
                shank_rad_s: (toe.axes * rates).into(),
                stands: true,
            }
        });
        estimator.step(&self.estimator, &estimator::Input { dt_s, inertial, toes, phase });
    }
}
