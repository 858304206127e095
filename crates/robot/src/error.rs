use rigid_body::ModelError;
use thiserror::Error;

/// Why a robot was refused. Every message names the thing at fault, what was expected and what to do.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum RobotError {
    /// A file that cannot be read.
    #[error("cannot read {path}: {reason}")]
    File {
        /// The file.
        path: String,
        /// What the system reported.
        reason: String,
    },
    /// The robot file is not TOML, or a field is missing, unknown or of the wrong type.
    #[error("robot.toml: {0}")]
    Toml(String),
    /// Another format or version.
    #[error("robot.toml has format '{format}' version {version}: expected format 'tandem-robot' version 1")]
    Version {
        /// The format found.
        format: String,
        /// The version found.
        version: u32,
    },
    /// A number or list out of its range.
    #[error("robot.toml: {field} is {found}: expected {expected}")]
    Field {
        /// Which field.
        field: String,
        /// Its value.
        found: String,
        /// What it should be.
        expected: String,
    },
    /// The URDF was refused.
    // No `source`: whoever prints the chain of causes would print the same twice.
    #[error("the robot's URDF: {0}")]
    Model(ModelError),
    /// A toe's link that the URDF does not have.
    #[error("leg '{leg}': the URDF has no link '{link}' to be its toe: correct toe_link in robot.toml")]
    UnknownToe {
        /// The leg.
        leg: String,
        /// The link named.
        link: String,
    },
    /// A joint that the URDF does not have.
    #[error("leg '{leg}': the URDF has no movable joint '{joint}': correct joints in robot.toml; it has {known}")]
    UnknownJoint {
        /// The leg.
        leg: String,
        /// The joint named.
        joint: String,
        /// What there is.
        known: String,
    },
    /// Joints and toe that are no chain from the torso to the toe.
    #[error("leg '{leg}': {problem}: expected three revolute joints in a chain, torso, hip roll, hip pitch, knee, toe")]
    NotALeg {
        /// The leg.
        leg: String,
        /// What is wrong.
        problem: String,
    },
    /// A movable joint of the URDF that belongs to no leg.
    #[error(
        "the URDF's joint '{joint}' belongs to no leg: lock it in robot.toml, in a table [locked] with the line \"{joint}\" = 0.0 (its position in rad or m), or make it fixed in the URDF"
    )]
    ExtraJoint {
        /// The joint.
        joint: String,
    },
    /// A rear leg that cannot do what the front leg across from it does.
    #[error("leg '{rear}' cannot do as leg '{front}' across does: {what}")]
    RearDiffers {
        /// The rear leg.
        rear: String,
        /// The front leg on the other side.
        front: String,
        /// What differs.
        what: String,
    },
    /// A URDF that no robot.toml can be proposed for.
    #[error("the URDF is of no robot with four legs of three turning joints each: {problem}")]
    NotFourLegs {
        /// What is not as it should be.
        problem: String,
    },
    /// A locked joint that the URDF does not have, or that is a leg's.
    #[error("robot.toml: locked.\"{joint}\": {problem}")]
    Locked {
        /// The joint.
        joint: String,
        /// What is wrong.
        problem: String,
    },
    /// An angle that can only be degrees.
    #[error(
        "robot.toml: {field} is {degrees}, which looks like degrees: expected radians ({degrees} degrees are {radians:.5} rad)"
    )]
    Degrees {
        /// Which field.
        field: String,
        /// Its value.
        degrees: f64,
        /// The same, were it degrees.
        radians: f64,
    },
    /// A leg that stands where another leg should.
    #[error(
        "{place} stands {found}: legs[{number}] of robot.toml ('{leg}', toe link '{toe}') must be the {place} leg, but its toe is at x = {x_m:.3} m, y = {y_m:.3} m of the torso (x ahead, y left): list the legs as front-left, rear-left, front-right, rear-right"
    )]
    WrongPlace {
        /// What the leg should be, such as front_left.
        place: &'static str,
        /// Where it stands, such as "on the right".
        found: &'static str,
        /// Its number, from 0.
        number: usize,
        /// Its name.
        leg: String,
        /// Its toe.
        toe: String,
        /// Where the toe stands ahead, m.
        x_m: f64,
        /// Where the toe stands to the left, m.
        y_m: f64,
    },
    /// A standing posture that does not fit the nominal one.
    #[error(
        "leg '{leg}': stand_rad puts the toe {found_m:.4} m {what}, but nominal.{field} is {nominal_m}: correct stand_rad or nominal.{field} in robot.toml (they may differ by {tolerance_m:.3} m)"
    )]
    Posture {
        /// The leg.
        leg: String,
        /// What is measured.
        what: &'static str,
        /// Which field says otherwise.
        field: &'static str,
        /// What the posture gives.
        found_m: f64,
        /// What the field reports.
        nominal_m: f64,
        /// Allowed difference.
        tolerance_m: f64,
    },
    /// A limit of robot.toml that the URDF's does not allow.
    #[error("robot.toml: {field} is {found} for the joint '{joint}', whose {what} in the URDF is {allowed}: {cure}")]
    AgainstUrdf {
        /// Which field.
        field: String,
        /// Its value.
        found: f64,
        /// The joint.
        joint: String,
        /// What of the URDF.
        what: &'static str,
        /// Its value.
        allowed: String,
        /// What to do.
        cure: &'static str,
    },
    /// Lower and upper limits of a joint of the URDF that are swapped.
    #[error("the robot's URDF: joint '{joint}' has the limits lower {lower} and upper {upper}: they are swapped")]
    SwappedLimits {
        /// The joint.
        joint: String,
        /// Its lower limit.
        lower: f64,
        /// Its upper limit.
        upper: f64,
    },
    /// The two sides differ.
    #[error(
        "the mirror does not fit the model: {what} of link '{link}' is {found}, its mirror image, link '{image}', has {expected} (allowed difference {tolerance}): correct the URDF, or mirror.joint_sign, mirror.leg or mirror.tolerance in robot.toml"
    )]
    Mirror {
        /// Which property differs.
        what: &'static str,
        /// The link.
        link: String,
        /// The link that should be its image.
        image: String,
        /// The link's value.
        found: String,
        /// The value that symmetry asks for.
        expected: String,
        /// Allowed relative difference.
        tolerance: f64,
    },
    /// A leg that the control cycle's kinematics do not know.
    #[error("leg '{leg}' {problem}: the balanced law needs a hip roll that carries parallel hip pitch and knee")]
    LegShape {
        /// The leg.
        leg: String,
        /// What is otherwise.
        problem: String,
    },
    /// A toe position that the leg cannot reach.
    #[error("leg '{leg}' cannot put its toe at {target:?} m from its hip: the nearest it comes is {miss_m:.4} m away")]
    OutOfReach {
        /// The leg.
        leg: String,
        /// The position asked for, torso axes, from the hip-roll joint.
        target: [f64; 3],
        /// Distance that remains.
        miss_m: f64,
    },
}

impl From<ModelError> for RobotError {
    fn from(error: ModelError) -> Self {
        Self::Model(error)
    }
}
