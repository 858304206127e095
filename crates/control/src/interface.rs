//! What one step is given and what it returns.

use crate::balanced::{BalanceReport, VelocityCommand};
use crate::body_pose::{BodyPose, BodyPoseAnswer};
use crate::{
    Fault, FaultReport, FaultSet, InertialState, JOINTS, JointCommand, JointState, Mode, PreparedGait, Refusal,
};
use estimator::Estimator;
use std::time::Duration;

/// Requests that one step takes; more are refused.
pub const MAX_REQUESTS: usize = 8;

/// What an operator may ask.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Request {
    /// Switch the drives on.
    Arm,
    /// Switch the drives off.
    Disarm,
    /// Stand up.
    Stand,
    /// Sit down and disarm.
    Sit,
    /// Walk: at once when standing, else as soon as it stands.
    Walk,
    /// Stop walking at the next switch.
    Stop,
    /// Clear a fault by its name.
    ClearFault(Fault),
    /// Start on the gait at its first instant. Only for simulators, which can put the robot there
    /// ([`crate::Config::simulation_start`]).
    StartOnGait,
}

impl Request {
    /// The requests that need nothing but their name, which names their service and stands in recordings.
    pub const NAMED: [(&'static str, Self); 7] = [
        ("arm", Self::Arm),
        ("disarm", Self::Disarm),
        ("stand", Self::Stand),
        ("sit", Self::Sit),
        ("walk", Self::Walk),
        ("stop", Self::Stop),
        ("start_on_gait", Self::StartOnGait),
    ];
}

/// All that one step gets to see.
#[derive(Clone, Copy, Debug, Default)]
pub struct Input<'a> {
    /// The newest joint state; the same again is fine.
    pub joints: Option<&'a JointState>,
    /// The inertial unit's newest measurement, where there is one and its data is received.
    pub inertial: Option<InertialState>,
    /// The newest velocity that was asked for, if one ever was: only the balanced law can go other than the gait.
    pub velocity: Option<VelocityCommand>,
    /// A pose of the body that was asked for since the last step: one that stands goes there, and stays.
    pub body_pose: Option<BodyPose>,
    /// What operators asked since the last step, in order.
    pub requests: &'a [Request],
    /// A gait that arrived since the last step.
    pub gait: Option<&'a PreparedGait>,
    /// The emergency stop is pressed.
    pub emergency_stop: bool,
    /// A fault that the layer below noticed: a bus or a drive.
    pub fault: Option<FaultReport>,
}

/// Why the robot is damped.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum DampingReason {
    /// It was just armed, or its faults were cleared.
    Armed,
    /// The emergency stop.
    EmergencyStop,
    /// The joint states stopped coming.
    StaleJointState,
    /// A latched fault.
    Fault,
}

impl DampingReason {
    /// The name that is published.
    pub fn name(self) -> &'static str {
        match self {
            Self::Armed => "armed",
            Self::EmergencyStop => "emergency_stop",
            Self::StaleJointState => "stale_joint_state",
            Self::Fault => "fault",
        }
    }

    /// The number that is published, from 1; 0 for a fault, which has its own.
    pub fn number(self) -> u8 {
        match self {
            Self::Armed => 1,
            Self::EmergencyStop => 2,
            Self::StaleJointState => 3,
            Self::Fault => 0,
        }
    }
}

/// All that one step returns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Output {
    /// What to send.
    pub command: JointCommand,
    /// Whether the drives are to be on.
    pub drives_on: bool,
    /// What the controller is doing.
    pub mode: Mode,
    /// Why it is damped, where it is.
    pub damping_reason: Option<DampingReason>,
    /// The latched faults.
    pub faults: FaultSet,
    /// The newest fault.
    pub report: Option<FaultReport>,
    /// The stamp of the joint state that this answers.
    pub answered: Option<Duration>,
    /// For each of the input's first [`MAX_REQUESTS`] requests, in order: the mode it led to, or why it was refused.
    pub replies: [Option<Result<Mode, Refusal>>; MAX_REQUESTS],
    /// Requests beyond those: refused unseen, [`Refusal::TooMany`].
    pub requests_refused_unseen: usize,
    /// Whether it holds a posture that it has reached: standing, the motion out of a walk has run out.
    pub holds_posture: bool,
    /// Steps since walking began, counted from 0.
    pub step_index: u64,
    /// t / T, 0 where it does not walk.
    pub step_phase: f64,
    /// Commanded minus measured positions, rad; 0 where none is commanded.
    pub tracking_error_rad: [f64; JOINTS],
    /// Torques that the command gives at the measured state, N m.
    pub torque_nm: [f64; JOINTS],
    /// The estimate of the base, where the configuration asks for balance.
    pub estimate: Option<Estimator>,
    /// What the balanced law did, where it is walked.
    pub balance: Option<BalanceReport>,
    /// Where the body is against the posture that is held.
    pub body_pose: BodyPose,
    /// What became of the input's pose.
    pub body_pose_answer: Option<BodyPoseAnswer>,
    /// Steps of the controller.
    pub cycles: u64,
    /// Steps that found no new joint state.
    pub stale_inputs: u64,
}

impl Output {
    /// The number of what damps the robot although no fault is latched; 0: nothing does.
    pub fn damped_number(&self) -> u8 {
        self.damping_reason.filter(|_| self.faults.is_empty()).map_or(0, DampingReason::number)
    }
}

impl Output {
    /// The reply to the input's request of this number, from 0.
    pub fn reply(&self, number: usize) -> Option<Result<Mode, Refusal>> {
        match number.checked_sub(MAX_REQUESTS) {
            None => self.replies[number],
            Some(beyond) => (beyond < self.requests_refused_unseen).then_some(Err(Refusal::TooMany)),
        }
    }
}
