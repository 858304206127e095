//! What of the configuration a user may want to change, whatever the robot: default, range, unit and text.

use settings::Setting;

/// [`Config::start_blend_s`](crate::Config::start_blend_s): a robot that has just ambled still swings when it starts
/// anew. After 0.6 s gait3 fell over the amble's stance in simulation, after 1.0 s it did not.
pub const START_BLEND_S: Setting = Setting {
    name: "start_blend_s",
    default: 1.2,
    least: 0.05,
    greatest: 10.0,
    unit: "s",
    text: "From standing to the gait's first posture.",
};

/// [`Config::stop_blend_s`](crate::Config::stop_blend_s).
pub const STOP_BLEND_S: Setting = Setting {
    name: "stop_blend_s",
    default: 0.4,
    least: 0.05,
    greatest: 10.0,
    unit: "s",
    text: "From the last switch to rest.",
};

/// [`Config::posture_speed_rad_s`](crate::Config::posture_speed_rad_s).
pub const POSTURE_SPEED_RAD_S: Setting = Setting {
    name: "posture_speed_rad_s",
    default: 0.8,
    least: 0.05,
    greatest: 3.0,
    unit: "rad/s",
    text: "Mean speed of the fastest joint while standing up and sitting down.",
};

/// [`Config::state_timeout_s`](crate::Config::state_timeout_s), where joint states come every control period.
pub const STATE_TIMEOUT_S: Setting = Setting {
    name: "state_timeout_s",
    default: 0.02,
    least: 0.002,
    greatest: 1.0,
    unit: "s",
    text: "Joint states older than this mean damping.",
};

/// [`Config::overrun_s`](crate::Config::overrun_s), where joint states come every control period.
pub const OVERRUN_S: Setting = Setting {
    name: "overrun_s",
    default: 0.05,
    least: 0.002,
    greatest: 1.0,
    unit: "s",
    text: "Two cycles further apart than this are a fault.",
};

/// [`Config::tracking_error_rad`](crate::Config::tracking_error_rad).
pub const TRACKING_ERROR_RAD: Setting = Setting {
    name: "tracking_error_rad",
    default: 0.35,
    least: 0.05,
    greatest: 2.0,
    unit: "rad",
    text: "A joint further than this from its command for 40 ms is a fault.",
};

/// [`Config::tilt_limit_rad`](crate::Config::tilt_limit_rad).
pub const TILT_LIMIT_RAD: Setting = Setting {
    name: "tilt_limit_rad",
    default: 0.8,
    least: 0.1,
    greatest: 1.5,
    unit: "rad",
    text: "Roll or pitch beyond which the robot is damped, where inertial data is received.",
};

/// [`BalanceConfig::command_timeout_s`](crate::balanced::BalanceConfig::command_timeout_s).
pub const CMD_VEL_TIMEOUT_S: Setting = Setting {
    name: "cmd_vel_timeout_s",
    default: 0.5,
    least: 0.05,
    greatest: 10.0,
    unit: "s",
    text: "A cmd_vel older than this counts as none: the robot steps in place.",
};

/// [`BalanceConfig::stand_after_s`](crate::balanced::BalanceConfig::stand_after_s).
pub const CMD_VEL_STAND_S: Setting = Setting {
    name: "cmd_vel_stand_s",
    default: 2.0,
    least: 0.1,
    greatest: 600.0,
    unit: "s",
    text: "With cmd_vel_walks: after so long with a cmd_vel of zero, or none, it stands; and only then is one heeded after an operator's request.",
};
