//! A node's table of parameters: one row each, with type, default, range, unit and text.
//!
//! [`parameters!`](crate::parameters!) makes a structure of the rows and declares them. The parameter services describe
//! what the rows say; a value that a row does not allow is refused, at the start as well as when it is set.

use std::ops::RangeInclusive;

use settings::Setting;

use crate::parameters::{Parameter, ParameterBuilder, ParameterType, Ranged};
use crate::{Node, PREFIX_RULE, RosError, check_prefix};

type Rule<T> = Box<dyn FnOnce(ParameterBuilder<T>) -> ParameterBuilder<T>>;

/// A row: all about a parameter but its name.
#[must_use = "a row belongs into a table of parameters"]
pub struct Row<T> {
    default: T,
    text: String,
    unit: &'static str,
    rule: Rule<T>,
}

impl<T: ParameterType> Row<T> {
    fn new(default: T, text: &str, rule: impl FnOnce(ParameterBuilder<T>) -> ParameterBuilder<T> + 'static) -> Self {
        Row { default, text: text.to_string(), unit: "", rule: Box::new(rule) }
    }

    /// With another default.
    pub fn default(mut self, default: T) -> Self {
        self.default = default;
        self
    }

    /// With a further sentence of text.
    pub fn note(mut self, sentence: &str) -> Self {
        self.text = format!("{} {sentence}", self.text);
        self
    }

    fn builder(self, node: &Node, name: &str) -> ParameterBuilder<T> {
        // Descriptors have no field for the unit.
        let unit = if self.unit.is_empty() { String::new() } else { format!(" Unit: {}.", self.unit) };
        (self.rule)(node.parameter(name, self.default).description(&(self.text + &unit)))
    }
}

fn ranged<T: Ranged>(default: T, range: RangeInclusive<T>, unit: &'static str, text: &str) -> Row<T> {
    let (from, to) = range.into_inner();
    Row { unit, ..Row::new(default, text, move |builder| builder.range_in(from, to, unit)) }
}

/// A number.
pub fn number(default: f64, range: RangeInclusive<f64>, unit: &'static str, text: &str) -> Row<f64> {
    ranged(default, range, unit, text)
}

/// A number that a library checks by the same setting.
pub fn setting(of: &Setting) -> Row<f64> {
    ranged(of.default, of.least..=of.greatest, of.unit, of.text)
}

/// A whole number.
pub fn integer(default: i64, range: RangeInclusive<i64>, text: &str) -> Row<i64> {
    ranged(default, range, "", text)
}

/// True or false.
pub fn flag(default: bool, text: &str) -> Row<bool> {
    Row::new(default, text, |builder| builder)
}

/// Any text.
pub fn string(default: &str, text: &str) -> Row<String> {
    Row::new(default.to_string(), text, |builder| builder)
}

/// One of a few words.
pub fn choice(default: &str, allowed: &'static [&'static str], text: &str) -> Row<String> {
    let words = match allowed {
        [others @ .., last] if !others.is_empty() => format!("{} or {last}", others.join(", ")),
        _ => allowed.concat(),
    };
    Row::new(default.to_string(), text, move |builder| {
        builder.validate(&words.clone(), move |value| {
            if allowed.contains(&value.as_str()) { Ok(()) } else { Err(format!("expected {words}, got {value:?}")) }
        })
    })
}

/// What stands before names of joints or frames; empty: nothing.
pub fn prefix(text: &str) -> Row<String> {
    Row::new(String::new(), text, |builder| builder.validate(PREFIX_RULE, check_prefix))
}

/// What a table's field can be: a plain value, which is set when the node is started, or a [`Parameter`], which can be
/// set at any time.
pub trait Field: Sized {
    /// The parameter's type.
    type Value;

    /// Declares the parameter.
    ///
    /// # Errors
    /// When a value given at the start is of another type or not allowed, or the name is taken.
    fn declare(node: &Node, name: &str, row: Row<Self::Value>) -> Result<Self, RosError>;
}

macro_rules! set_at_start {
    ($($rust:ty),*) => { $(
        impl Field for $rust {
            type Value = $rust;

            fn declare(node: &Node, name: &str, row: Row<$rust>) -> Result<Self, RosError> {
                Ok(row.builder(node, name).read_only().declare()?.get())
            }
        }
    )* };
}
set_at_start!(bool, i64, f64, String);

impl<T: ParameterType> Field for Parameter<T> {
    type Value = T;

    fn declare(node: &Node, name: &str, row: Row<T>) -> Result<Self, RosError> {
        row.builder(node, name).declare()
    }
}

/// A structure of parameters: each row is a name, a type and a [`Row`], which may use the values of the rows above it.
///
/// ```
/// use ros::table::{flag, number};
///
/// ros::parameters! {
///     /// The parameters of a lamp.
///     pub struct Table {
///         blink: bool = flag(false, "Goes on and off."),
///         period_s: f64 = number(if blink { 0.5 } else { 1.0 }, 0.1..=10.0, "s", "From on to on."),
///     }
/// }
/// ```
#[macro_export]
macro_rules! parameters {
    (
        $(#[$attribute:meta])*
        $visible:vis struct $table:ident {
            $($name:ident: $kind:ty = $row:expr),* $(,)?
        }
    ) => {
        $(#[$attribute])*
        #[derive(Clone)]
        $visible struct $table {
            $(
                #[doc = concat!("The parameter `", stringify!($name), "`.")]
                pub $name: $kind,
            )*
        }

        impl $table {
            /// Declares every parameter and reads its value.
            ///
            /// # Errors
            /// The first parameter whose value is of another type or not allowed.
            $visible fn declare(node: &$crate::Node) -> ::std::result::Result<Self, $crate::RosError> {
                $(
                    let $name = <$kind as $crate::table::Field>::declare(node, stringify!($name), $row)?;
                )*
                Ok(Self { $($name),* })
            }
        }
    };
}
