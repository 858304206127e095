use thiserror::Error;

/// Why a robot's description was refused. Every message names the thing at fault, what was expected,
/// and what to do.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum ModelError {
    /// The text is longer than the limit.
    #[error("URDF is {found_bytes} bytes long, expected at most {limit_bytes}: keep meshes in files of their own")]
    TooLarge {
        /// Length of the text given.
        found_bytes: usize,
        /// The limit.
        limit_bytes: usize,
    },
    /// The text carries a document type declaration, the door to entity expansion.
    #[error(
        "URDF has a document type declaration (<!DOCTYPE …>), which is not accepted: remove it and write its entities out"
    )]
    DocumentType,
    /// Elements are nested deeper than any URDF needs.
    #[error(
        "URDF nests elements deeper than {limit} levels at byte {at_byte}: expected robot/link/visual/geometry/shape"
    )]
    TooDeep {
        /// The limit.
        limit: usize,
        /// Where the limit was passed.
        at_byte: usize,
    },
    /// More elements than the limit.
    #[error("URDF has more than {limit} elements: remove what is not part of the robot")]
    TooManyElements {
        /// The limit.
        limit: usize,
    },
    /// The text is not XML, or not a URDF.
    #[error("URDF cannot be read: {0}: expected an XML document whose root element is <robot>")]
    NotUrdf(String),
    /// A text where numbers are expected.
    #[error(
        "{owner}: {field} is \"{text}\" (line {line}): expected {count} number(s), such as 0.5, separated by spaces"
    )]
    NotANumber {
        /// "link 'x'" or "joint 'x'".
        owner: String,
        /// Element and attribute.
        field: String,
        /// Line of the text, from 1.
        line: usize,
        /// What stands there.
        text: String,
        /// How many numbers are expected.
        count: usize,
    },
    /// An expression of xacro that was not expanded.
    #[error(
        "{owner}: {field} is \"{text}\" (line {line}), an expression of xacro: expand the file first, `ros2 run xacro xacro ROBOT.urdf.xacro > ROBOT.urdf` or `python3 -m xacro …`"
    )]
    Xacro {
        /// "link 'x'" or "joint 'x'".
        owner: String,
        /// Element and attribute.
        field: String,
        /// Line of the text, from 1.
        line: usize,
        /// What stands there.
        text: String,
    },
    /// An element of xacro that was not expanded.
    #[error(
        "line {line} has an element <{element}>: expand the file with xacro first, `ros2 run xacro xacro ROBOT.urdf.xacro > ROBOT.urdf` or `python3 -m xacro …`"
    )]
    XacroElement {
        /// Line of the text, from 1.
        line: usize,
        /// The element's name.
        element: String,
    },
    /// No link is free of a parent, or there are no links.
    #[error("URDF has no root link: expected one link that is no joint's child (links found: {links})")]
    NoRoot {
        /// How many links there are.
        links: usize,
    },
    /// More than one link has no parent.
    #[error(
        "URDF has two roots, links '{first}' and '{second}': expected one tree; join them by a joint or remove one"
    )]
    TwoRoots {
        /// One link without a parent.
        first: String,
        /// Another one.
        second: String,
    },
    /// A link is reached by two joints, or joints form a ring.
    #[error(
        "joint '{joint}' closes a loop at link '{link}': expected a tree, each link the child of at most one joint"
    )]
    Loop {
        /// The joint that closes it.
        joint: String,
        /// The link reached twice.
        link: String,
    },
    /// Two things of one name.
    #[error("URDF has two {kind}s named '{name}': names must be unique")]
    Duplicate {
        /// "link" or "joint".
        kind: &'static str,
        /// The name.
        name: String,
    },
    /// A joint names a link that does not exist.
    #[error("joint '{joint}' names link '{link}', which does not exist: add the link or correct the name")]
    UnknownLink {
        /// The joint.
        joint: String,
        /// The missing link.
        link: String,
    },
    /// A joint type outside revolute, continuous, prismatic and fixed.
    #[error(
        "joint '{joint}' is of type '{found}', which is not supported: expected revolute, continuous, prismatic or fixed; a floating joint may hang from a root link without mass, and is then left out"
    )]
    UnsupportedJoint {
        /// The joint.
        joint: String,
        /// Its type.
        found: String,
    },
    /// A movable body without mass.
    #[error("link '{link}' (with the links fixed to it) has no mass: add an <inertial> with a positive mass")]
    MissingInertial {
        /// The link.
        link: String,
    },
    /// A mass that is zero or negative.
    #[error("link '{link}' has mass {mass_kg} kg: expected a positive mass")]
    BadMass {
        /// The link.
        link: String,
        /// The mass given.
        mass_kg: f64,
    },
    /// A rotational inertia that no body can have.
    #[error(
        "link '{link}' (with the links fixed to it) has principal moments of inertia {moments:?} kg m²: expected positive ones, each at most the sum of the other two"
    )]
    BadInertia {
        /// The link.
        link: String,
        /// Its principal moments, ascending.
        moments: [f64; 3],
    },
    /// NaN or infinity.
    #[error("{owner}: {field} is {value}: expected a finite number")]
    NotFinite {
        /// "link 'x'" or "joint 'x'".
        owner: String,
        /// Which number.
        field: &'static str,
        /// The value.
        value: f64,
    },
    /// A joint axis of no length.
    #[error("joint '{joint}' has an axis of length {length}: expected a direction such as 0 0 1")]
    BadAxis {
        /// The joint.
        joint: String,
        /// Its length.
        length: f64,
    },
    /// A joint asked for by name is not there.
    #[error("the model has no joint '{joint}': it has {known}")]
    UnknownJoint {
        /// The name asked for.
        joint: String,
        /// The names there are.
        known: String,
    },
    /// A kept joint hangs from a joint that is not kept.
    #[error("joint '{joint}' cannot be kept without its parent joint '{parent}'")]
    MissingParent {
        /// The kept joint.
        joint: String,
        /// The joint it hangs from.
        parent: String,
    },
    /// The share of the torso is not a fraction.
    #[error("torso share is {0}: expected a number from 0 to 1")]
    BadTorsoShare(f64),
}
