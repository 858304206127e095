//! Tandem's own messages, services and actions, but the gait (gait_message.rs). The definition files in `msg/`, `srv/`
//! and `action/` hold the same fields.

use crate::builtin_interfaces::Time;
use crate::std_msgs::Header;
use crate::{Action, Optional};

messages! { "tandem_msgs";
    /// One command per joint, evaluated at the drive (or by the simulator's drive model) until the next one arrives:
    /// torque = kp (position - measured) + kd (velocity - measured) + torque field.
    JointCommand {
        /// stamp: that of the `JointState` that this command answers.
        header: Header,
        /// Joint names.
        name: Vec<String>,
        /// Desired position, rad.
        position: Vec<f64>,
        /// Desired velocity, rad/s.
        velocity: Vec<f64>,
        /// Stiffness, Nm/rad.
        kp: Vec<f64>,
        /// Damping, Nm s/rad.
        kd: Vec<f64>,
        /// Feed-forward torque, Nm.
        torque: Vec<f64>,
    }
    /// What the drives of a robot say of themselves, beside position, velocity and torque. NaN: no frame carries it.
    JointDiagnostics {
        /// stamp: that of the joint state answered.
        header: Header,
        /// Joint names.
        name: Vec<String>,
        /// Degrees Celsius.
        temperature_c: Vec<f64>,
        /// Voltage that the drive is fed with, V.
        supply_v: Vec<f64>,
        /// Current that makes the motor's torque (q axis), A, motor side.
        current_a: Vec<f64>,
        /// Error code of the drive, 0: none.
        drive_error: Vec<u8>,
        /// Frames sent to the drive since the start.
        requests: Vec<u64>,
        /// Of these, how many it has not answered.
        lost: Vec<u64>,
        /// Since its last answer, s; NaN: never.
        age_s: Vec<f64>,
    }
    /// Which feet carry weight, by what the drives report of their torques: an estimate.
    FootContacts {
        /// stamp: that of the joint state whose torques it is by.
        header: Header,
        /// The legs.
        name: Vec<String>,
        /// The leg carries weight.
        contact: Vec<bool>,
        /// Vertical force of the ground on the toe, N, as if the legs stood still.
        force_n: Vec<f64>,
    }
    /// One cycle of the controller: all that its step saw besides the joint state itself and the gait, so that the
    /// recorded run can be run again to the bit. Written to bags; not sent over the network.
    ControlCycle {
        /// stamp: time of the cycle on the controller's clock.
        header: Header,
        /// Cycles since the start, from 1.
        index: u64,
        /// Whether the step saw a joint state: the `JointState` recorded last.
        state_seen: bool,
        /// That state's stamp is this message's less this age, ns.
        state_age_ns: i64,
        /// Time since each joint's values arrived, ns; 12 entries, or 1 where all are the same, or none without a
        /// state.
        state_arrival_age_ns: Vec<i64>,
        /// 12 entries, degrees Celsius; none where drives do not report it.
        state_temperature_c: Vec<f64>,
        /// 12 entries, or none where all are 0 (no error).
        state_drive_error: Vec<u8>,
        /// Roll and pitch of the base, rad, in recordings of versions before the whole inertial unit was recorded.
        tilt_rad: Vec<f64>,
        /// What operators asked since the cycle before, in order: arm, disarm, stand, sit, walk, stop, `clear_fault
        /// NAME`, `start_on_gait`.
        requests: Vec<String>,
        /// The emergency stop is pressed.
        emergency_stop: bool,
        /// 0: no gait arrived since the cycle before; n: the n-th recorded gait file did.
        gait: u32,
        /// A fault that the layer below noticed: its name, or empty.
        fault: String,
        /// Its joint, 0 to 11, or -1.
        fault_joint: i32,
        /// Its value.
        fault_value: f64,
        /// The limit that the value broke.
        fault_limit: f64,
        /// What the controller was doing after the step.
        mode: String,
        /// What the cycle before saw of the inertial unit holds still, and the lists are empty.
        inertial_held: bool,
        /// Ages of the inertial unit's stamp and of its coming in, ns; none where there is no unit.
        inertial_age_ns: Vec<i64>,
        /// (x, y, z, w), or none.
        inertial_attitude: Vec<f64>,
        /// About the base's axes, rad/s, or none.
        inertial_angular_velocity: Vec<f64>,
        /// Along the base's axes, m/s², gravity included, or none.
        inertial_acceleration: Vec<f64>,
        /// The velocity command that the cycle before saw holds still, and the lists are empty.
        velocity_held: bool,
        /// Age of the velocity command's coming in, ns; none where nobody asked for a velocity.
        velocity_age_ns: Vec<i64>,
        /// Ahead, to the left, m/s, and turning, rad/s, or none.
        velocity: Vec<f64>,
        /// A pose of the body that was asked for since the cycle before: height, m, roll, pitch, yaw, rad, or none.
        body_pose: Vec<f64>,
    }
    /// How the optimisation of a gait ended.
    SolverReport {
        /// `converged`, `acceptable`, or why it is neither: the solver's own word.
        status: String,
        /// Iterations of the outer loop.
        iterations: u32,
        /// Wall time of the solve, s.
        solve_time_s: f64,
        /// Largest violation of any constraint at the end.
        max_violation: f64,
        /// The whole cost.
        objective: f64,
        /// The constraint that is violated most, or that binds, by name.
        worst_constraint: String,
    }
    /// What the controller does.
    ControllerState {
        /// When.
        header: Header,
        /// `disarmed`, `damping`, `standing_up`, `standing`, `starting`, `walking`, `stopping`, `sitting_down`,
        /// `fault`.
        mode: String,
        /// Names of the latched faults, comma between them; in damping without one `emergency_stop`,
        /// `stale_joint_state` or `armed`.
        fault: String,
        /// Name of the loaded gait; empty when there is none.
        gait: String,
        /// Steps taken since walking began.
        step_index: u64,
        /// Phase of the present step, 0 to 1.
        step_phase: f64,
        /// Control cycles since the start.
        cycles: u64,
        /// Control periods in which no cycle began because the one before took too long.
        missed_cycles: u64,
        /// Cycles that saw no joint state newer than the cycle before did.
        stale_inputs: u64,
        /// 12 entries, rad: reference minus measured.
        tracking_error_rad: Vec<f64>,
        /// 12 entries, Nm.
        commanded_torque_nm: Vec<f64>,
        /// One bit for each latched fault: `FAULT_BIT_*` of the definition file.
        fault_bits: u32,
        /// The mode: `MODE_ID_*`.
        mode_id: u8,
        /// Why it is damped without a fault: `DAMPED_ID_*`, 0: it is not, or by a fault.
        damped_id: u8,
    }
    /// Claims the robot for the program that calls.
    ClaimRequest {
        /// Who drives, for people.
        name: String,
        /// For how long, s; 0: until it is released.
        duration_s: f64,
        /// Take it from whoever holds it.
        take: bool,
    }
    /// Whether it was claimed.
    ClaimResponse {
        /// Claimed.
        success: bool,
        /// For people: what was claimed, or who holds it and for how long.
        message: String,
    }
    /// Which fault to clear.
    ClearFaultRequest {
        /// The fault's name, as in [`ControllerState::fault`].
        name: String,
    }
    /// Whether it was cleared.
    ClearFaultResponse {
        /// Cleared.
        success: bool,
        /// For people: what remains, or why it was refused.
        message: String,
    }
    /// What gait to plan. Empty: the behaviour's or the robot's own value; at most one of the three rates.
    GenerateGaitRequest {
        /// gait1, gait2, gait3, gait4 or amble.
        behaviour: String,
        /// Duration of one step (half a stride), s.
        step_duration_s: Optional<f64>,
        /// Steps per second.
        step_frequency_hz: Optional<f64>,
        /// Strides per second.
        stride_frequency_hz: Optional<f64>,
        /// Height of the swing toes at mid-step, m.
        clearance_m: Optional<f64>,
        /// Forward speed, m/s; negative is backward.
        speed_m_s: Optional<f64>,
        /// Height of the hip axes above the toe centres, m.
        height_m: Optional<f64>,
        /// Lateral distance of the toes from the centre line, m.
        half_width_m: Optional<f64>,
        /// Slope of the ground along the walk, rad; positive is uphill.
        slope_rad: Optional<f64>,
        /// Slope of the ground across the walk, rad; positive rises to the left.
        sideways_slope_rad: Optional<f64>,
        /// Pitch that the torso is held at, rad; positive lowers its nose.
        torso_pitch_rad: Optional<f64>,
        /// Roll that the torso is held at, rad; positive lowers its right side.
        torso_roll_rad: Optional<f64>,
        /// Friction coefficient that the plan may use.
        friction: Optional<f64>,
        /// Torque bounds of hip roll, hip pitch and knee on every leg, Nm; three entries or none.
        torque_limit_nm: Vec<f64>,
        /// What the tracking law follows: `compensated` (also when empty), `planned_joints` or `in_program`.
        reference: String,
        /// Points of the program, odd, 5 to 161; 0: 11.
        points: u32,
        /// Choose the step duration and the half-width, each where it is not given, for the smallest largest
        /// multiplier.
        stable: bool,
        /// Speed to the left, m/s; negative is to the right; 0: none.
        lateral_speed_m_s: f64,
        /// Yaw rate, rad/s; positive turns to the left; 0: none.
        yaw_rate_rad_s: f64,
        /// Contact schedule: `trot`, `crawl`, `pace` or `bound`; empty: the two steps of a trot.
        schedule: String,
        /// With the schedules `trot` and `crawl`: share of the step duration in which all four legs stand; 0: none.
        four_leg_share: f64,
        /// Plan the two steps from standing to the gait as well, as its lead.
        from_rest: bool,
    }
    /// The plan, or why there is none.
    GenerateGaitResponse {
        /// The gait is valid.
        success: bool,
        /// `converged`, `invalid_request`, `unreachable`, `unverified`, `unwalkable`, `time limit`, `cancelled`,
        /// `inactive`, `busy`, `internal_error`, or the solver's own word.
        status: String,
        /// For people: what was wrong, which constraint binds, the nearest value that would do.
        message: String,
        /// What stands in the way, by name; empty when `success`.
        binding_constraints: Vec<String>,
        /// The fields in which the nearest request that can be planned differs from this one; empty where none was
        /// found.
        nearest_fields: Vec<String>,
        /// Their values there, in the fields' own units.
        nearest_values: Vec<f64>,
        /// Name of the gait, which is published on the topic `gait` before the answer.
        gait: String,
        /// Its stamp there.
        gait_stamp: Time,
        /// Duration of its step, s.
        step_duration_s: f64,
        /// How far the base moves forward in a step, m.
        step_length_m: f64,
        /// What the solver reported, also of a gait that was not found.
        solver: SolverReport,
        /// Points of the program that the plan came from; 0: this and the three fields after it are not known.
        points: u32,
        /// Largest multiplier of the step's map.
        largest_multiplier: f64,
        /// How far from its place a swing toe would meet a slightly higher floor, m.
        landing_run_m: f64,
        /// Whether both say that the gait stands by itself.
        stable: bool,
    }
    /// One phase of a gait's lead or cycle, in which the same legs stand.
    GaitDomain {
        /// The legs that stand, by number, in ascending order.
        stance_legs: Vec<u8>,
        /// How long, s.
        duration_s: f64,
        /// Planned joint angles over the phase, not mirrored, rad: row-major 12 x (degree + 1).
        coefficients_rad: Vec<f64>,
        /// The reference that the tracking law follows, rad: row-major 12 x (degree + 1).
        reference_coefficients_rad: Vec<f64>,
    }
    /// A gait file.
    LoadGaitRequest {
        /// The file's text.
        json: String,
    }
    /// Whether it was loaded.
    LoadGaitResponse {
        /// Loaded.
        success: bool,
        /// For people: what was wrong.
        message: String,
    }
    /// Where to record.
    StartRecordingRequest {
        /// Name of the new bag's folder below the controller's `record_root`: 1 to 64 of ASCII's letters and digits,
        /// `_`, `-` and `.`, not with a dot first; must be empty or not there.
        folder: String,
    }
    /// Whether it records.
    StartRecordingResponse {
        /// It records.
        success: bool,
        /// For people: what was wrong.
        message: String,
    }
    /// Ends the recording.
    #[derive(Copy)]
    StopRecordingRequest {
        /// Never used: a structure on the wire has at least one byte.
        structure_needs_at_least_one_member: u8,
    }
    /// What was recorded.
    StopRecordingResponse {
        /// The bag is complete.
        success: bool,
        /// For people: what was wrong.
        message: String,
        /// The bag's folder.
        folder: String,
        /// Messages in the bag.
        messages: u64,
        /// Messages, and whole control cycles, that are not in it because the disk was too slow.
        dropped: u64,
        /// Size of the bag's files.
        bytes: u64,
    }
    /// The action's feedback: one iteration of the solver.
    GenerateGaitFeedback {
        /// Outer iterations done.
        iteration: u32,
        /// The whole cost.
        objective: f64,
        /// Largest violation of any constraint.
        max_violation: f64,
        /// Since the start of the solve, s.
        elapsed_s: f64,
    }
}

service! {
    /// Plans a gait.
    "tandem_msgs" GenerateGait: GenerateGaitRequest -> GenerateGaitResponse, refused by message
}
service! {
    /// Says who drives.
    "tandem_msgs" Claim: ClaimRequest -> ClaimResponse, refused by message
}
service! {
    /// Clears one latched fault by its name.
    "tandem_msgs" ClearFault: ClearFaultRequest -> ClearFaultResponse, refused by message
}
service! {
    /// Loads a gait file's text.
    "tandem_msgs" LoadGait: LoadGaitRequest -> LoadGaitResponse, refused by message
}

service! {
    /// Begins a recording of the run.
    "tandem_msgs" StartRecording: StartRecordingRequest -> StartRecordingResponse, refused by message
}
service! {
    /// Ends the recording of the run.
    "tandem_msgs" StopRecording: StopRecordingRequest -> StopRecordingResponse, refused by message
}

/// Plans a gait, with progress, cancellable. Goal and result have the fields of the service of the same name.
#[derive(Clone, Copy, Debug)]
pub enum GenerateGaitAction {}

impl Action for GenerateGaitAction {
    const PACKAGE: &'static str = "tandem_msgs";
    const NAME: &'static str = "GenerateGait";
    type Goal = GenerateGaitRequest;
    type Result = GenerateGaitResponse;
    type Feedback = GenerateGaitFeedback;
}
