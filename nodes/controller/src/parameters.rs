//! The table of the node's parameters: name, type, default, range, unit and text of each.

use control::setting as limit;
use ros::table::{Row, choice, flag, integer, number, prefix, setting, string};
use settings::Setting;

/// A timeout whose default is shorter where the drives are on CAN.
struct Timeout {
    dds_s: f64,
    can_s: f64,
}

const STATES: Timeout = Timeout { dds_s: 0.1, can_s: 0.01 };
const CYCLES: Timeout = Timeout { dds_s: 0.1, can_s: 0.01 };
const MIDDLEWARE: Timeout = Timeout { dds_s: 0.1, can_s: 0.013 };

impl Timeout {
    fn of(&self, setting: &Setting, backend: &str) -> Row<f64> {
        self.row(ros::table::setting(setting), backend)
    }

    fn row(&self, row: Row<f64>, backend: &str) -> Row<f64> {
        row.default(if backend == "can" { self.can_s } else { self.dds_s })
            .note(&format!("Default {}; with backend can {}.", self.dds_s, self.can_s))
    }
}

ros::parameters! {
    /// The controller's parameters, all set when the node is started.
    pub struct Table {
        mode: String = choice("realtime", &["realtime", "lockstep"],
            "realtime: cycles on the wall clock. lockstep: one cycle for each new stamp of joint_states."),
        clock: String = choice("joint_states", &["joint_states", "monotonic"],
            "In realtime, the time that the gait follows: the stamps of joint_states (a simulation), or the machine's clock."),
        drive_mode: String = choice("impedance", &["impedance", "torque"],
            "impedance: the drive closes the law. torque: the controller does, and sends kp = kd = 0."),
        robot: String = string(robot::DEFAULT_FOLDER, robot::FOLDER_TEXT),
        joint_prefix: String = prefix(
            "Stands before every joint's name on topics, to tell the joints of several robots apart, such as left_."),
        backend: String = choice("dds", &["dds", "can"],
            "dds: joint_states in, joint_command out. can: the drives are on the CAN interfaces that bus_file names."),
        bus_file: String = string("config/hardware/vision60_can.toml",
            "With backend can: which joint hangs on which drive; looked for as the robot's folder is."),
        control_period_s: f64 = number(1e-3, 2e-4..=0.02, "s", "Control period in realtime."),
        state_rate_hz: f64 = number(50.0, 0.1..=1000.0, "Hz", "Rate of controller_state."),
        joint_states_rate_hz: f64 = number(1000.0, 0.1..=5000.0, "Hz",
            "With backend can: rate of joint_states, as read from the drives."),
        emergency_stop_heartbeat_s: f64 = number(0.0, 0.0..=10.0, "s",
            "The emergency stop counts as pressed when its topic is silent for so long; 0: silence means nothing."),
        priority: i64 = integer(80, 0..=99, "SCHED_FIFO priority of the control thread; 0: ordinary scheduling."),
        core: i64 = integer(-1, -1..=1023, "Processor of the control thread; -1: any."),
        lock_memory: bool = flag(true, "Lock the process's memory."),
        simulation_start_on_gait: bool = flag(false,
            "The robot is simulated and put on the gait's first instant: arm and walk as soon as a gait is there. Never for a real robot."),
        state_timeout_s: f64 = STATES.of(&limit::STATE_TIMEOUT_S, &backend),
        overrun_s: f64 = CYCLES.of(&limit::OVERRUN_S, &backend),
        middleware_timeout_s: f64 = MIDDLEWARE.row(number(0.1, 0.006..=1.0, "s",
            "In realtime, damping and the end of the process when a thread that receives the stop stands still for so long."), &backend),
        start_blend_s: f64 = setting(&limit::START_BLEND_S),
        stop_blend_s: f64 = setting(&limit::STOP_BLEND_S),
        posture_speed_rad_s: f64 = setting(&limit::POSTURE_SPEED_RAD_S),
        tracking_error_rad: f64 = setting(&limit::TRACKING_ERROR_RAD),
        tilt_limit_rad: f64 = setting(&limit::TILT_LIMIT_RAD),
        balance: bool = flag(false,
            "Walk in balance where inertial data is received, obey cmd_vel, and publish odom and /tf; false: the paper's law."),
        cmd_vel_stamped: bool = flag(false, "cmd_vel is a geometry_msgs/TwistStamped; false: a Twist."),
        cmd_vel_timeout_s: f64 = setting(&limit::CMD_VEL_TIMEOUT_S),
        cmd_vel_walks: bool = flag(false,
            "With balance: a cmd_vel other than zero begins the walk of a robot that stands with a gait; false: only walk does."),
        cmd_vel_stand_s: f64 = setting(&limit::CMD_VEL_STAND_S),
        plan_for_cmd_vel: bool = flag(false,
            "With balance: where cmd_vel stays far from the speed that the gait was planned for, the planner is asked for a gait of that speed."),
        plan_for_cmd_vel_far_m_s: f64 = number(0.15, 0.05..=2.0, "m/s",
            "With plan_for_cmd_vel: how far linear.x must be from the gait's own speed."),
        plan_for_cmd_vel_held_s: f64 = number(1.0, 0.5..=60.0, "s",
            "With plan_for_cmd_vel: for how long, within half of that distance."),
        odometry_rate_hz: f64 = number(50.0, 0.1..=1000.0, "Hz", "With balance: rate of odom and /tf."),
        frame_prefix: String = prefix(
            "With balance: stands before the names of the frames odom and base_link, such as left/."),
        record_root: String = string("",
            "The folder below which every recording lies, whoever asks for it; empty: tandem/recordings in XDG_DATA_HOME or ~/.local/share."),
        record_every_run: bool = flag(false,
            "Each start of the node begins a recording, named by the time in UTC; else they begin with start_recording."),
        record_split_mb: f64 = number(0.0, 0.0..=1e5, "MB",
            "A recording goes on in a further file after so much; 0: never."),
        record_split_s: f64 = number(0.0, 0.0..=1e5, "s",
            "A recording goes on in a further file after so long; 0: never."),
    }
}
