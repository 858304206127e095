use thiserror::Error;

/// Why a motion could not be computed.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum DynamicsError {
    /// The mass matrix is not positive definite.
    #[error(
        "the mass matrix is singular at coordinate {coordinate}: the torso's pitch is {pitch_rad} rad, and ±π/2 is where roll and yaw turn about the same axis"
    )]
    SingularMassMatrix {
        /// Where the factorisation stopped.
        coordinate: usize,
        /// The torso's pitch.
        pitch_rad: f64,
    },
    /// The contacts do not determine their forces.
    #[error(
        "contacts at {toes} are singular: their {rows} rows have rank {rank}; expected legs that are bent and toes that are apart"
    )]
    SingularContacts {
        /// The toes in contact.
        toes: String,
        /// Three rows a toe.
        rows: usize,
        /// How many are independent.
        rank: usize,
    },
    /// Prescribed joints tear stance toes apart.
    #[error(
        "the prescribed joint accelerations contradict the contacts at legs {legs:?} by {residual:.1e} m/s²: with joints prescribed the distance between stance toes is too, and its acceleration must be zero"
    )]
    Inconsistent {
        /// The legs in stance.
        legs: Vec<usize>,
        /// By how much, in equations scaled to entries of order one.
        residual: f64,
    },
    /// A set of equations that ought to be regular is not.
    #[error("the equations of {what} have rank {rank} of {size}: the posture is singular")]
    Singular {
        /// Which equations.
        what: &'static str,
        /// Their rank.
        rank: usize,
        /// Their number.
        size: usize,
    },
    /// What follows from the dynamics is no number.
    #[error("{what} is not finite: a gain, a velocity or the step's duration is far out of range")]
    NotFinite {
        /// What it is.
        what: &'static str,
    },
    /// A pairing that is not a signed permutation.
    #[error("pairing: {0}: expected each of the six joints once, signs ±1 and finite offsets")]
    BadPairing(String),
    /// The simulation's step size fell below what a number can resolve.
    #[error(
        "simulation stopped at t = {time_s} s: the step size fell to {step_s:.1e} s; the motion is singular there or the controller jumps"
    )]
    StepTooSmall {
        /// When.
        time_s: f64,
        /// The last step tried.
        step_s: f64,
    },
    /// The simulation needed more steps than allowed.
    #[error("simulation stopped at t = {time_s} s after {steps} steps, the limit given")]
    TooManySteps {
        /// When.
        time_s: f64,
        /// How many.
        steps: usize,
    },
    /// The controller returned NaN or infinity.
    #[error("the controller's torque {joint} is {value} at t = {time_s} s: expected a finite number")]
    BadTorque {
        /// Which joint.
        joint: usize,
        /// Its value.
        value: f64,
        /// When.
        time_s: f64,
    },
    /// An option out of range.
    #[error("simulation option {name} is {value}: expected {expected}")]
    BadOption {
        /// Which option.
        name: &'static str,
        /// Its value.
        value: f64,
        /// What it should be.
        expected: &'static str,
    },
}
