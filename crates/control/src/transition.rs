//! The robot's day as one pure function: mode × event → mode, or a refusal that says why.

use crate::Tilted;
use joints::LEG_LABELS;

/// What the controller is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum Mode {
    /// Drives off.
    Disarmed,
    /// Drives on, every joint damped, nothing held: what arming leads to, and the safe answer to trouble.
    Damping,
    /// On the way to the standing posture.
    StandingUp,
    /// Holding a posture on four feet.
    Standing,
    /// Moving from the standing posture to the first posture of the gait, on four feet.
    Starting,
    /// Tracking the gait.
    Walking,
    /// Tracking the gait up to the next switch, then standing.
    Stopping,
    /// On the way to the sitting posture.
    SittingDown,
    /// Damping because of a latched fault.
    Fault,
}

impl Mode {
    /// The number that is published: its place in [`Mode::ALL`].
    pub fn number(self) -> u8 {
        self as u8
    }

    /// Every mode.
    pub const ALL: [Self; 9] = [
        Self::Disarmed,
        Self::Damping,
        Self::StandingUp,
        Self::Standing,
        Self::Starting,
        Self::Walking,
        Self::Stopping,
        Self::SittingDown,
        Self::Fault,
    ];

    /// The name that is published.
    pub fn name(self) -> &'static str {
        match self {
            Self::Disarmed => "disarmed",
            Self::Damping => "damping",
            Self::StandingUp => "standing_up",
            Self::Standing => "standing",
            Self::Starting => "starting",
            Self::Walking => "walking",
            Self::Stopping => "stopping",
            Self::SittingDown => "sitting_down",
            Self::Fault => "fault",
        }
    }

    /// Whether the drives are to be switched on.
    pub fn drives_on(self) -> bool {
        self != Self::Disarmed
    }

    /// Whether joints are held or moved: the modes in which trouble means damping.
    pub fn is_moving(self) -> bool {
        !matches!(self, Self::Disarmed | Self::Damping | Self::Fault)
    }
}

/// What happens to the controller: what an operator asks, and what the controller itself notices.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Event {
    /// Operator: switch the drives on.
    Arm,
    /// Operator: switch the drives off.
    Disarm,
    /// Operator: stand up.
    Stand,
    /// Operator: sit down and disarm.
    Sit,
    /// Operator: walk the loaded gait.
    Walk,
    /// Operator: stop walking at the next switch.
    Stop,
    /// On purpose only: start on the gait at its first instant, the robot being there already, as a simulator can put
    /// it.
    StartOnGait,
    /// The posture that was moved to is reached.
    PostureReached,
    /// A step has ended.
    SwitchReached,
    /// A velocity other than zero is asked for.
    VelocityAsked,
    /// None was asked for, for as long as the configuration waits for one.
    VelocityRests,
    /// The emergency stop is pressed.
    EmergencyStop,
    /// The joint states have stopped coming.
    Stale,
    /// A fault that means damping was latched.
    FaultLatched,
    /// The last fault that means damping was cleared.
    FaultsCleared,
}

impl Event {
    /// Every event.
    pub const ALL: [Self; 15] = [
        Self::Arm,
        Self::Disarm,
        Self::Stand,
        Self::Sit,
        Self::Walk,
        Self::Stop,
        Self::StartOnGait,
        Self::PostureReached,
        Self::SwitchReached,
        Self::VelocityAsked,
        Self::VelocityRests,
        Self::EmergencyStop,
        Self::Stale,
        Self::FaultLatched,
        Self::FaultsCleared,
    ];
}

/// What a transition may depend on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Guards {
    /// The joint states are fresh.
    pub fresh: bool,
    /// Every joint is within its limits and slow.
    pub posture_safe: bool,
    /// A gait is loaded.
    pub gait_loaded: bool,
    /// The base is tilted further than allowed.
    pub tilted: Option<Tilted>,
    /// Any fault is latched.
    pub any_fault: bool,
    /// The emergency stop is pressed.
    pub emergency_stop: bool,
    /// The configuration allows [`Event::StartOnGait`]: the robot is simulated.
    pub start_on_gait_allowed: bool,
    /// The base's estimate is not wanted, or it is good, or it waits for an inertial unit that never was there.
    pub estimate_usable: bool,
    /// A velocity may begin a walk: the configuration wants that, the base's estimate is good, and since the operator's
    /// last request no velocity was asked for, for as long as the configuration waits for one.
    pub velocity_heeded: bool,
}

impl Guards {
    /// Everything as it should be.
    pub const READY: Self = Self {
        fresh: true,
        posture_safe: true,
        gait_loaded: true,
        tilted: None,
        any_fault: false,
        emergency_stop: false,
        start_on_gait_allowed: true,
        estimate_usable: true,
        velocity_heeded: true,
    };
}

/// What people call a joint.
fn label(joint: usize) -> String {
    let joints = ["hip roll", "hip pitch", "knee"];
    format!("the {} {}", LEG_LABELS[joint / 3 % 4], joints[joint % 3])
}

/// Why a request was refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Refusal {
    /// Not in this mode.
    #[error("{event:?} is refused while {}: {advice}", mode.name())]
    Mode {
        /// The mode.
        mode: Mode,
        /// What was asked.
        event: Event,
        /// What to do instead.
        advice: &'static str,
    },
    /// The joint states are missing or old.
    #[error("refused: no fresh joint states. Is the robot, or the simulator, running and connected?")]
    NotFresh,
    /// A joint is not as it must be; the controller says which and how.
    #[error("refused: a joint is outside its limits or moving, or its drive reports an error")]
    PostureUnsafe,
    /// A joint is out of its limits.
    #[error("refused: {} is outside its limits. Move it by hand, or check its zero point", label(*joint))]
    JointOutside {
        /// Which.
        joint: usize,
    },
    /// A joint moves.
    #[error("refused: {} is moving. Wait until the robot is at rest", label(*joint))]
    JointMoves {
        /// Which.
        joint: usize,
    },
    /// A drive reports an error.
    #[error("refused: the drive of {} reports an error. Look it up in the drive's manual", label(*joint))]
    JointDrive {
        /// Which.
        joint: usize,
    },
    /// No gait.
    #[error("refused: no gait is loaded. Ask the planner for one, or load one from a file")]
    NoGait,
    /// The base's estimate is not good.
    #[error("refused: the estimate of the base is not good. Is inertial data still received, and does it make sense?")]
    NoEstimate,
    /// A fault is latched.
    #[error("refused: a fault is latched. Read it in controller_state, cure it, and clear it by its name")]
    FaultLatched,
    /// The base lies on its side or its back.
    #[error("refused: the robot is {0}, and it does not right itself. Turn it onto its belly by hand, then ask again")]
    Tilted(Tilted),
    /// The emergency stop is pressed.
    #[error("refused: the emergency stop is pressed. Release it first")]
    EmergencyStop,
    /// The fault that was to be cleared is not latched.
    #[error("refused: that fault is not latched")]
    FaultNotLatched,
    /// Starting on the gait is for simulators.
    #[error(
        "refused: only a simulated robot can be put on a gait; the configuration does not say that this one is (simulation_start)"
    )]
    NotSimulated,
    /// More requests than one cycle takes.
    #[error("refused: too many requests in one control cycle. Ask again")]
    TooMany,
}

/// The transition function: the next mode, or why not. Nothing else in this software changes the mode.
///
/// The controller's own events are never refused: where one means nothing, the mode stays. Operators' requests are
/// refused where they would surprise; asking for what is already so is granted.
pub fn transition(mode: Mode, event: Event, guards: &Guards) -> Result<Mode, Refusal> {
    use Event as E;
    use Mode as M;
    let refuse = |advice| Err(Refusal::Mode { mode, event, advice });
    match (mode, event) {
        (M::Disarmed, E::Arm) => ready(guards).map(|()| M::Damping),
        (M::Fault, E::Arm) => upright(guards).and_then(|()| refuse("it is armed; clear the fault by its name")),
        (_, E::Arm) => Ok(mode),

        (M::Disarmed | M::Damping | M::Fault, E::Disarm) => Ok(M::Disarmed),
        (M::SittingDown, E::Disarm) => refuse("it disarms by itself once it sits"),
        (_, E::Disarm) => refuse("the robot would drop. Stop, then sit; in an emergency use the emergency stop"),

        // What keeps it from standing up whatever is done before.
        (M::Disarmed, E::Stand) => upright(guards).and_then(|()| refuse("arm it first")),
        (M::Fault, E::Stand) => upright(guards).and_then(|()| refuse("clear the fault by its name first")),
        (M::Damping, E::Stand) => ready(guards).map(|()| M::StandingUp),
        (M::SittingDown, E::Stand) => Ok(M::StandingUp),
        (M::StandingUp | M::Standing | M::Stopping, E::Stand) => Ok(mode),
        (M::Starting, E::Stand) => Ok(M::Standing),
        (M::Walking, E::Stand) => Ok(M::Stopping),

        (M::Standing | M::StandingUp | M::SittingDown, E::Sit) => Ok(M::SittingDown),
        (M::Starting | M::Walking | M::Stopping, E::Sit) => refuse("stop first"),
        (M::Disarmed | M::Damping | M::Fault, E::Sit) => refuse("it does not stand"),

        (M::Standing, E::Walk) => ready_to_walk(guards).map(|()| M::Starting),
        (M::StandingUp, E::Walk) => ready_to_walk(guards).map(|()| M::StandingUp),
        (M::Stopping, E::Walk) => ready_to_walk(guards).map(|()| M::Walking),
        (M::Starting | M::Walking, E::Walk) => Ok(mode),
        (M::Disarmed, E::Walk) => refuse("arm it and let it stand up first"),
        (M::Damping | M::Fault | M::SittingDown, E::Walk) => refuse("let it stand up first"),

        (M::Walking, E::Stop) => Ok(M::Stopping),
        (M::Starting, E::Stop) => Ok(M::Standing),
        (_, E::Stop) => Ok(mode),

        (_, E::StartOnGait) if !guards.start_on_gait_allowed => Err(Refusal::NotSimulated),
        (M::Disarmed, E::StartOnGait) => ready_on_gait(guards).map(|()| M::Walking),
        (_, E::StartOnGait) => refuse("only a disarmed robot can be put on a gait"),

        (M::Standing, E::VelocityAsked) if may_begin(guards) => Ok(M::Starting),
        (M::Stopping, E::VelocityAsked) if may_begin(guards) => Ok(M::Walking),

        (
            _,
            E::PostureReached
            | E::SwitchReached
            | E::VelocityAsked
            | E::VelocityRests
            | E::EmergencyStop
            | E::Stale
            | E::FaultLatched
            | E::FaultsCleared,
        ) => Ok(noticed(mode, event)),
    }
}

/// What the controller itself notices.
fn noticed(mode: Mode, event: Event) -> Mode {
    use Event as E;
    use Mode as M;
    match (mode, event) {
        // Trouble: from every mode with the drives on to damping, from the others nowhere.
        (M::Disarmed, _) => mode,
        (_, E::FaultLatched) => M::Fault,
        (M::Fault, E::FaultsCleared) => M::Damping,
        (M::Fault, _) => mode,
        (_, E::EmergencyStop | E::Stale) => M::Damping,

        (M::StandingUp, E::PostureReached) => M::Standing,
        (M::Starting, E::PostureReached) => M::Walking,
        (M::SittingDown, E::PostureReached) => M::Disarmed,
        (M::Stopping, E::SwitchReached) => M::Standing,

        (M::Walking, E::VelocityRests) => M::Stopping,
        (M::Starting, E::VelocityRests) => M::Standing,
        _ => mode,
    }
}

/// No motion here rights a robot that lies on its side or its back.
fn upright(guards: &Guards) -> Result<(), Refusal> {
    guards.tilted.map_or(Ok(()), |tilted| Err(Refusal::Tilted(tilted)))
}

/// Before any torque, in this order: the button in the operator's hand, how the robot lies, what is known to be broken,
/// what is unknown.
fn ready(guards: &Guards) -> Result<(), Refusal> {
    if guards.emergency_stop {
        return Err(Refusal::EmergencyStop);
    }
    upright(guards)?;
    if guards.any_fault {
        Err(Refusal::FaultLatched)
    } else if !guards.fresh {
        Err(Refusal::NotFresh)
    } else if !guards.posture_safe {
        Err(Refusal::PostureUnsafe)
    } else {
        Ok(())
    }
}

fn ready_to_walk(guards: &Guards) -> Result<(), Refusal> {
    if guards.any_fault {
        Err(Refusal::FaultLatched)
    } else if !guards.gait_loaded {
        Err(Refusal::NoGait)
    } else if !guards.estimate_usable {
        Err(Refusal::NoEstimate)
    } else {
        Ok(())
    }
}

/// Whether a velocity begins a walk, or lets one that is about to end go on.
fn may_begin(guards: &Guards) -> bool {
    guards.velocity_heeded && guards.fresh && !guards.emergency_stop && ready_to_walk(guards).is_ok()
}

/// On a gait the joints move: what [`ready`] asks of their speed does not apply.
fn ready_on_gait(guards: &Guards) -> Result<(), Refusal> {
    if guards.emergency_stop {
        Err(Refusal::EmergencyStop)
    } else if !guards.fresh {
        Err(Refusal::NotFresh)
    } else {
        ready_to_walk(guards)
    }
}
