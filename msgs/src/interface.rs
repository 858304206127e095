//! What a message, a service and an action are.

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

/// A message: a structure with a name that ROS 2 knows.
pub trait Message: Serialize + DeserializeOwned + FieldType + Clone + Send + Sync + 'static {
    /// The package, such as `sensor_msgs`.
    const PACKAGE: &'static str;
    /// The name in the package, such as `JointState`.
    const NAME: &'static str;

    /// The fields in the order of the definition.
    fn fields() -> Vec<Field>;

    /// The full name, such as `sensor_msgs/msg/JointState`.
    fn full_name() -> String {
        format!("{}/msg/{}", Self::PACKAGE, Self::NAME)
    }
}

/// A service: a request and a response.
pub trait Service: 'static {
    /// The package, such as `std_srvs`.
    const PACKAGE: &'static str;
    /// The name in the package, such as `Trigger`.
    const NAME: &'static str;
    /// What the client sends.
    type Request: Message;
    /// What the server answers.
    type Response: Message;

    /// The answer that says no and why; none where the response has no field for it.
    #[must_use]
    fn refusal(_request: &Self::Request, _reason: &str) -> Option<Self::Response> {
        None
    }
}

/// An action: a goal, feedback while it runs, a result.
pub trait Action: 'static {
    /// The package.
    const PACKAGE: &'static str;
    /// The name in the package.
    const NAME: &'static str;
    /// What the client asks for.
    type Goal: Message;
    /// What the server answers at the end.
    type Result: Message;
    /// What the server reports on the way.
    type Feedback: Message;
}

/// One field of a definition.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Field {
    /// The field's name.
    pub name: &'static str,
    /// Its type as a definition file writes it, such as `float64[]` or `std_msgs/Header`.
    pub type_name: String,
}

/// Anything that can be a field: says how a definition file writes it.
pub trait FieldType {
    /// The type as a definition file writes it.
    fn type_name() -> String;
    /// Adds the definition of every message that this type contains: (full name without `msg/`, text), each once.
    fn add_definitions(_definitions: &mut Vec<(String, String)>) {}
}

macro_rules! primitive {
    ($($rust:ty => $ros:literal),* $(,)?) => {
        $(impl FieldType for $rust {
            fn type_name() -> String {
                $ros.to_string()
            }
        })*
    };
}
primitive! {
    bool => "bool", u8 => "uint8", i8 => "int8", u16 => "uint16", i16 => "int16", u32 => "uint32", i32 => "int32",
    u64 => "uint64", i64 => "int64", f32 => "float32", f64 => "float64", String => "string",
}

impl<T: FieldType> FieldType for Vec<T> {
    fn type_name() -> String {
        format!("{}[]", T::type_name())
    }
    fn add_definitions(definitions: &mut Vec<(String, String)>) {
        T::add_definitions(definitions);
    }
}

impl<T: FieldType, const N: usize> FieldType for [T; N] {
    fn type_name() -> String {
        format!("{}[{N}]", T::type_name())
    }
    fn add_definitions(definitions: &mut Vec<(String, String)>) {
        T::add_definitions(definitions);
    }
}

/// The text of a message's definition, followed by those of the messages in it, in the form that rosbag2 stores
/// (`ros2msg`: nested definitions after a line of 80 equals signs and `MSG: package/Name`).
#[must_use]
pub fn definition<M: Message>() -> String {
    let mut definitions = Vec::new();
    M::add_definitions(&mut definitions);
    let mut parts = definitions.into_iter();
    let mut text = parts.next().map(|(_, text)| text).unwrap_or_default();
    for (name, nested) in parts {
        text.push_str(&format!("{}\nMSG: {name}\n{nested}", "=".repeat(80)));
    }
    text
}

/// A value that may be absent: a sequence of at most one element (`float64[<=1]`), ROS 2's way to say so.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Optional<T>(pub Vec<T>);

/// More than one element arrived where at most one may stand.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TooMany(
    /// How many arrived.
    pub usize,
);

impl std::fmt::Display for TooMany {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(formatter, "at most one value expected, got {}", self.0)
    }
}

impl std::error::Error for TooMany {}

impl<T: Copy> Optional<T> {
    /// The value, if there is one.
    ///
    /// # Errors
    /// When the sequence holds more than one element, as only a sender that ignores the definition can arrange.
    pub fn value(&self) -> Result<Option<T>, TooMany> {
        match self.0.as_slice() {
            [] => Ok(None),
            [value] => Ok(Some(*value)),
            more => Err(TooMany(more.len())),
        }
    }
}

impl<T> From<Option<T>> for Optional<T> {
    fn from(value: Option<T>) -> Self {
        Optional(value.into_iter().collect())
    }
}

impl<T: FieldType> FieldType for Optional<T> {
    fn type_name() -> String {
        format!("{}[<=1]", T::type_name())
    }
    fn add_definitions(definitions: &mut Vec<(String, String)>) {
        T::add_definitions(definitions);
    }
}

/// A row-major 6 x 6 covariance (`float64[36]`).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Covariance(#[serde(with = "serde_big_array::BigArray")] pub [f64; 36]);

impl Default for Covariance {
    fn default() -> Self {
        Covariance([0.0; 36])
    }
}

impl FieldType for Covariance {
    fn type_name() -> String {
        "float64[36]".to_string()
    }
}
