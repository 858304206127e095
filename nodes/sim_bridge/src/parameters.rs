//! The table of the node's parameters: name, type, default, range, unit and text of each.

use ros::Parameter;
use ros::table::{choice, flag, integer, number, prefix, setting, string};
use simulator::setting as limit;

ros::parameters! {
    /// The bridge's parameters: set when the node is started, and two at any time.
    pub struct Table {
        mode: String = choice("realtime", &["realtime", "lockstep"],
            "realtime: on the wall clock. lockstep: every step waits for the command that answers the last joint state."),
        robot: String = string(robot::DEFAULT_FOLDER, robot::FOLDER_TEXT),
        joint_prefix: String = prefix(
            "Stands before every joint's name on topics, to tell the joints of several robots apart, such as left_."),
        frame_prefix: String = prefix(
            "Stands before the names of the frames odom, base_link and imu_link, such as left/."),
        bus_file: String = string("config/hardware/vision60_can.toml",
            "With --can: the wiring file of the emulated drives; looked for as robot is."),
        drive_latency_s: f64 = setting(&limit::DRIVE_LATENCY_S),
        timestep_s: f64 = setting(&limit::TIMESTEP_S),
        control_period_s: f64 = number(1e-3, 1e-4..=0.02, "s",
            "Time between two joint states, a multiple of timestep_s."),
        terrain: String = choice("flat", &["flat", "slope", "rough", "steps"],
            "The ground. A slope turns gravity: the world's x-y plane stays the ground."),
        slope_uphill_deg: f64 = setting(&limit::SLOPE_UPHILL_DEG),
        slope_sideways_deg: f64 = setting(&limit::SLOPE_SIDEWAYS_DEG),
        bump_height_m: f64 = setting(&limit::BUMP_HEIGHT_M),
        bump_cell_m: f64 = setting(&limit::BUMP_CELL_M),
        stair_rise_m: f64 = setting(&limit::STAIR_RISE_M),
        stair_run_m: f64 = setting(&limit::STAIR_RUN_M),
        seed: i64 = integer(0, 0..=i64::MAX, "Names the random terrain and the random start."),
        friction: f64 = setting(&limit::FRICTION),
        joint_noise_rad: f64 = setting(&limit::JOINT_NOISE_RAD),
        command_timeout_s: f64 = setting(&limit::COMMAND_TIMEOUT_S),
        start_paused: bool = flag(false, "Time stands still until the service pause lets it go."),
        real_time_factor: f64 = number(1.0, 0.01..=100.0, "", "In realtime: simulated seconds per wall second."),
        lockstep_timeout_s: f64 = number(10.0, 0.1..=3600.0, "s",
            "In lockstep: how long to wait for a command before giving up with an error, by the wall clock."),
        imu_rate_hz: f64 = number(200.0, 0.1..=1e4, "Hz", "Rate of imu, in simulated time."),
        odometry_rate_hz: f64 = number(50.0, 0.1..=1e4, "Hz",
            "Rate of odom, /tf and each ground_force, in simulated time."),
        ground_truth: bool = flag(false,
            "The true pose goes out on ground_truth/odom, and not on odom and /tf, which are a controller's in balance."),
        initial_posture: Parameter<String> = choice("sit", &["stand", "sit"],
            "How the robot is put down at the start and at a reset."),
        push_duration_s: Parameter<f64> = number(0.1, 0.001..=60.0, "s",
            "How long the force of a message on push acts."),
    }
}
