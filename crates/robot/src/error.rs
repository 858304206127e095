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
        /// What the system said.
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
    #[error("the robot's URDF: {0}")]
    Model(#[from] ModelError),
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
    #[error("the URDF's joint '{joint}' belongs to no leg: make it fixed, or name it in robot.toml")]
    ExtraJoint {
        /// The joint.
        joint: String,
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
