//! Values of parameters: their types, on the wire and in files.

use std::fmt;

use serde_yaml_ng::Value as Yaml;
use tandem_msgs::rcl_interfaces as wire;

/// Most bytes of text in a value that is set from outside.
pub(super) const MAX_TEXT_BYTES: usize = 1 << 16;
/// Most items of the lists in a value that is set from outside.
pub(super) const MAX_ITEMS: usize = 4096;

/// A parameter's value.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum ParameterValue {
    /// No value.
    #[default]
    NotSet,
    /// A truth value.
    Bool(bool),
    /// A whole number.
    Integer(i64),
    /// A number.
    Double(f64),
    /// A text.
    String(String),
    /// Bytes.
    ByteArray(Vec<u8>),
    /// Truth values.
    BoolArray(Vec<bool>),
    /// Whole numbers.
    IntegerArray(Vec<i64>),
    /// Numbers.
    DoubleArray(Vec<f64>),
    /// Texts.
    StringArray(Vec<String>),
}

pub(super) const TYPE_NAMES: [&str; 10] = [
    "not set",
    "bool",
    "integer",
    "double",
    "string",
    "byte array",
    "bool array",
    "integer array",
    "double array",
    "string array",
];

impl fmt::Display for ParameterValue {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotSet => f.write_str("not set"),
            Self::Bool(value) => write!(f, "{value}"),
            Self::Integer(value) => write!(f, "{value}"),
            Self::Double(value) => write!(f, "{value:?}"),
            Self::String(value) => write!(f, "{value:?}"),
            Self::ByteArray(value) => write!(f, "{value:?}"),
            Self::BoolArray(value) => write!(f, "{value:?}"),
            Self::IntegerArray(value) => write!(f, "{value:?}"),
            Self::DoubleArray(value) => write!(f, "{value:?}"),
            Self::StringArray(value) => write!(f, "{value:?}"),
        }
    }
}

impl ParameterValue {
    /// The number that `rcl_interfaces/ParameterType` gives this type.
    pub(super) fn type_number(&self) -> u8 {
        match self {
            Self::NotSet => 0,
            Self::Bool(_) => 1,
            Self::Integer(_) => 2,
            Self::Double(_) => 3,
            Self::String(_) => 4,
            Self::ByteArray(_) => 5,
            Self::BoolArray(_) => 6,
            Self::IntegerArray(_) => 7,
            Self::DoubleArray(_) => 8,
            Self::StringArray(_) => 9,
        }
    }

    pub(super) fn type_name(&self) -> &'static str {
        TYPE_NAMES[usize::from(self.type_number())]
    }

    pub(super) fn to_wire(&self) -> wire::ParameterValue {
        let mut message = wire::ParameterValue { r#type: self.type_number(), ..Default::default() };
        match self.clone() {
            Self::NotSet => {}
            Self::Bool(value) => message.bool_value = value,
            Self::Integer(value) => message.integer_value = value,
            Self::Double(value) => message.double_value = value,
            Self::String(value) => message.string_value = value,
            Self::ByteArray(value) => message.byte_array_value = value,
            Self::BoolArray(value) => message.bool_array_value = value,
            Self::IntegerArray(value) => message.integer_array_value = value,
            Self::DoubleArray(value) => message.double_array_value = value,
            Self::StringArray(value) => message.string_array_value = value,
        }
        message
    }

    pub(super) fn from_wire(message: &wire::ParameterValue) -> Result<Self, String> {
        let texts = message.string_value.len() + message.string_array_value.iter().map(String::len).sum::<usize>();
        let items = message.byte_array_value.len()
            + message.bool_array_value.len()
            + message.integer_array_value.len()
            + message.double_array_value.len()
            + message.string_array_value.len();
        if texts > MAX_TEXT_BYTES || items > MAX_ITEMS {
            return Err(format!(
                "{texts} bytes of text and {items} items of lists, expected at most {MAX_TEXT_BYTES} and {MAX_ITEMS}"
            ));
        }
        Ok(match message.r#type {
            0 => Self::NotSet,
            1 => Self::Bool(message.bool_value),
            2 => Self::Integer(message.integer_value),
            3 => Self::Double(message.double_value),
            4 => Self::String(message.string_value.clone()),
            5 => Self::ByteArray(message.byte_array_value.clone()),
            6 => Self::BoolArray(message.bool_array_value.clone()),
            7 => Self::IntegerArray(message.integer_array_value.clone()),
            8 => Self::DoubleArray(message.double_array_value.clone()),
            9 => Self::StringArray(message.string_array_value.clone()),
            other => return Err(format!("type {other} is not known (0 to 9 are)")),
        })
    }

    /// From a YAML value, as parameter files and `-p` write it.
    pub(crate) fn from_yaml(yaml: &Yaml) -> Result<Self, String> {
        match yaml {
            Yaml::Bool(value) => Ok(Self::Bool(*value)),
            Yaml::Number(number) => match (number.as_i64(), number.as_f64()) {
                (Some(value), _) => Ok(Self::Integer(value)),
                (None, Some(value)) if number.is_f64() => Ok(Self::Double(value)),
                _ => Err(format!("{number} does not fit in 64 bits with a sign")),
            },
            // YAML 1.1, which ROS 2 reads, has more words for truth values than YAML 1.2.
            Yaml::String(text) => Ok(match text.as_str() {
                "y" | "Y" | "yes" | "Yes" | "YES" | "on" | "On" | "ON" => Self::Bool(true),
                "n" | "N" | "no" | "No" | "NO" | "off" | "Off" | "OFF" => Self::Bool(false),
                _ => Self::String(text.clone()),
            }),
            Yaml::Sequence(items) => {
                let items = items.iter().map(Self::from_yaml).collect::<Result<Vec<_>, _>>()?;
                array(&items).ok_or_else(|| {
                    "a list must be of one type: all bool, all integer, all double or all string".to_string()
                })
            }
            Yaml::Null => Err("a value is missing".to_string()),
            Yaml::Mapping(_) | Yaml::Tagged(_) => Err("expected a value or a list of values".to_string()),
        }
    }
}

/// One array out of values of one type.
fn array(items: &[ParameterValue]) -> Option<ParameterValue> {
    macro_rules! collect {
        ($variant:ident, $array:ident) => {
            items
                .iter()
                .map(|item| match item {
                    ParameterValue::$variant(value) => Some(value.clone()),
                    _ => None,
                })
                .collect::<Option<_>>()
                .map(ParameterValue::$array)
        };
    }
    match items.first() {
        // An empty list has no type; ROS 2 passes it on as not set.
        None => Some(ParameterValue::NotSet),
        Some(ParameterValue::Bool(_)) => collect!(Bool, BoolArray),
        Some(ParameterValue::Integer(_)) => collect!(Integer, IntegerArray),
        Some(ParameterValue::Double(_)) => collect!(Double, DoubleArray),
        Some(ParameterValue::String(_)) => collect!(String, StringArray),
        Some(_) => None,
    }
}

/// A Rust type that a parameter can have.
pub trait ParameterType: Clone + Send + Sync + 'static {
    /// To a parameter's value.
    fn into_value(self) -> ParameterValue;
    /// From a parameter's value of just this type.
    fn from_value(value: &ParameterValue) -> Option<Self>;
}

macro_rules! parameter_type {
    ($($rust:ty => $variant:ident),* $(,)?) => { $(
        impl ParameterType for $rust {
            fn into_value(self) -> ParameterValue {
                ParameterValue::$variant(self)
            }
            fn from_value(value: &ParameterValue) -> Option<Self> {
                match value {
                    ParameterValue::$variant(value) => Some(value.clone()),
                    _ => None,
                }
            }
        }
    )* };
}
parameter_type! {
    bool => Bool, i64 => Integer, f64 => Double, String => String,
    Vec<bool> => BoolArray, Vec<i64> => IntegerArray, Vec<f64> => DoubleArray, Vec<String> => StringArray,
}

/// A parameter type that can have a range.
pub trait Ranged: ParameterType + PartialOrd + fmt::Display {
    #[doc(hidden)]
    fn describe(from: &Self, to: &Self, descriptor: &mut wire::ParameterDescriptor);
}

impl Ranged for f64 {
    fn describe(from: &f64, to: &f64, descriptor: &mut wire::ParameterDescriptor) {
        descriptor.floating_point_range =
            Some(wire::FloatingPointRange { from_value: *from, to_value: *to, step: 0.0 }).into();
    }
}

impl Ranged for i64 {
    fn describe(from: &i64, to: &i64, descriptor: &mut wire::ParameterDescriptor) {
        descriptor.integer_range = Some(wire::IntegerRange { from_value: *from, to_value: *to, step: 0 }).into();
    }
}
