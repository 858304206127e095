//! What of a simulation a user may want to change: default, range, unit and text.

use settings::Setting;

/// Physics step.
pub const TIMESTEP_S: Setting =
    Setting { name: "timestep_s", default: 5e-4, least: 1e-5, greatest: 2e-3, unit: "s", text: "Physics step." };

/// Coefficient of sliding friction between toes and ground.
pub const FRICTION: Setting = Setting {
    name: "friction",
    default: 0.8,
    least: 0.01,
    greatest: 5.0,
    unit: "",
    text: "Coefficient of sliding friction between toes and ground.",
};

/// Standard deviation of every joint's offset at a reset.
pub const JOINT_NOISE_RAD: Setting = Setting {
    name: "joint_noise_rad",
    default: 0.0,
    least: 0.0,
    greatest: 0.3,
    unit: "rad",
    text: "Standard deviation of every joint's offset at a reset.",
};

/// Simulated time after which a command is too old and the drives damp.
pub const COMMAND_TIMEOUT_S: Setting = Setting {
    name: "command_timeout_s",
    default: 0.1,
    least: 1e-3,
    greatest: 10.0,
    unit: "s",
    text: "Simulated time after which a command is too old and the drives damp.",
};

/// With emulated drives: from a frame's arrival at a drive to its effect.
pub const DRIVE_LATENCY_S: Setting = Setting {
    name: "drive_latency_s",
    default: 0.0,
    least: 0.0,
    greatest: 0.015,
    unit: "s",
    text: "With emulated drives: from a frame's arrival at a drive to its effect.",
};

/// With terrain slope: inclination along +x.
pub const SLOPE_UPHILL_DEG: Setting = Setting {
    name: "slope_uphill_deg",
    default: 5.0,
    least: -45.0,
    greatest: 45.0,
    unit: "degrees",
    text: "With terrain slope: inclination along +x.",
};

/// With terrain slope: inclination along +y.
pub const SLOPE_SIDEWAYS_DEG: Setting = Setting {
    name: "slope_sideways_deg",
    default: 0.0,
    least: -45.0,
    greatest: 45.0,
    unit: "degrees",
    text: "With terrain slope: inclination along +y.",
};

/// With terrain rough: highest bump.
pub const BUMP_HEIGHT_M: Setting = Setting {
    name: "bump_height_m",
    default: 0.02,
    least: 0.001,
    greatest: 0.3,
    unit: "m",
    text: "With terrain rough: highest bump.",
};

/// With terrain rough: side of a bump.
pub const BUMP_CELL_M: Setting = Setting {
    name: "bump_cell_m",
    default: 0.1,
    least: 0.02,
    greatest: 2.0,
    unit: "m",
    text: "With terrain rough: side of a bump.",
};

/// With terrain steps: rise of a stair.
pub const STAIR_RISE_M: Setting = Setting {
    name: "stair_rise_m",
    default: 0.05,
    least: 0.005,
    greatest: 0.3,
    unit: "m",
    text: "With terrain steps: rise of a stair.",
};

/// With terrain steps: depth of a stair.
pub const STAIR_RUN_M: Setting = Setting {
    name: "stair_run_m",
    default: 0.4,
    least: 0.1,
    greatest: 2.0,
    unit: "m",
    text: "With terrain steps: depth of a stair.",
};
