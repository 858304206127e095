//! Typed parameters: declared with description, range and validator; set from the command line, from files and at run time.

use std::collections::BTreeMap;
use std::fmt;
use std::marker::PhantomData;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use serde_yaml_ng::Value as Yaml;
use tandem_msgs::rcl_interfaces as wire;
use tandem_msgs::text::{NAME_CHARS, SENTENCE_CHARS, printable};

use settings::Quantity;

use crate::RosError;
use crate::arguments::Override;

mod file;

pub(crate) use file::overrides_from_yaml;

/// How long after its start a node's parameters are taken to be declared, if it does not say when.
const DECLARING: Duration = Duration::from_secs(1);

/// Most parameters that one request sets, reads or describes; what is beyond is refused, or left out where nothing can
/// be said.
const MAX_PARAMETERS: usize = 256;
/// Most bytes of text in a value that is set from outside.
const MAX_TEXT_BYTES: usize = 1 << 16;
/// Most items of the lists in a value that is set from outside.
const MAX_ITEMS: usize = 4096;

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

const TYPE_NAMES: [&str; 10] = [
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
    fn type_number(&self) -> u8 {
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

    fn type_name(&self) -> &'static str {
        TYPE_NAMES[usize::from(self.type_number())]
    }

    fn to_wire(&self) -> wire::ParameterValue {
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

    fn from_wire(message: &wire::ParameterValue) -> Result<Self, String> {
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

type Check = Box<dyn Fn(&ParameterValue) -> Result<(), String> + Send + Sync>;

struct Entry {
    value: ParameterValue,
    descriptor: wire::ParameterDescriptor,
    checks: Vec<Check>,
}

impl Entry {
    fn check(&self, value: &ParameterValue) -> Result<(), String> {
        if value.type_number() != self.descriptor.r#type {
            let expected = TYPE_NAMES[usize::from(self.descriptor.r#type)];
            let hint = match (value, expected) {
                (ParameterValue::Integer(number), "double") => format!("; write {number}.0"),
                _ => String::new(),
            };
            return Err(format!("expected {expected}, got {} {value}{hint}", value.type_name()));
        }
        self.checks.iter().try_for_each(|check| check(value))
    }
}

/// What happened to parameters, for `/parameter_events`.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Changes {
    pub(crate) new: Vec<(String, ParameterValue)>,
    pub(crate) changed: Vec<(String, ParameterValue)>,
}

impl Changes {
    pub(crate) fn into_event(self, node: String, stamp: tandem_msgs::builtin_interfaces::Time) -> wire::ParameterEvent {
        let list = |items: Vec<(String, ParameterValue)>| {
            items.into_iter().map(|(name, value)| wire::Parameter { name, value: value.to_wire() }).collect()
        };
        wire::ParameterEvent {
            stamp,
            node,
            new_parameters: list(self.new),
            changed_parameters: list(self.changed),
            deleted_parameters: Vec::new(),
        }
    }
}

/// A node's parameters.
pub(crate) struct Store {
    node: String,
    overrides: BTreeMap<String, ParameterValue>,
    declared: Mutex<BTreeMap<String, Entry>>,
    on_change: Box<dyn Fn(Changes) + Send + Sync>,
    started: Instant,
    complete: Mutex<bool>,
    completed: Condvar,
}

impl Store {
    /// `node` is the full name. Of the overrides that match it the later wins.
    pub(crate) fn new(
        node: String,
        overrides: &[Override],
        on_change: impl Fn(Changes) + Send + Sync + 'static,
    ) -> Self {
        let overrides = overrides
            .iter()
            .filter(|candidate| matches(&candidate.node, &node))
            .map(|candidate| (candidate.name.clone(), candidate.value.clone()))
            .collect();
        Store {
            node,
            overrides,
            declared: Mutex::default(),
            on_change: Box::new(on_change),
            started: Instant::now(),
            complete: Mutex::default(),
            completed: Condvar::new(),
        }
    }

    /// All parameters are declared.
    pub(crate) fn complete(&self) {
        *self.complete.lock().unwrap_or_else(PoisonError::into_inner) = true;
        self.completed.notify_all();
    }

    /// Waits until all are declared: a node that is starting shall not deny a parameter that it will have.
    pub(crate) fn wait_until_complete(&self) {
        let complete = self.complete.lock().unwrap_or_else(PoisonError::into_inner);
        let left = DECLARING.saturating_sub(self.started.elapsed());
        // Whoever says nothing in time has declared all.
        let _ = self.completed.wait_timeout_while(complete, left, |complete| !*complete);
    }

    fn declared(&self) -> MutexGuard<'_, BTreeMap<String, Entry>> {
        // Entries are replaced whole: a panic elsewhere leaves no half-written value.
        self.declared.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn declare(&self, name: &str, mut entry: Entry) -> Result<(), RosError> {
        let wrong = |reason: String| RosError::Parameter {
            name: name.to_string(),
            reason: format!("{reason} (node {})", self.node),
        };
        if let Some(value) = self.overrides.get(name) {
            entry.check(value).map_err(wrong)?;
            entry.value = value.clone();
        } else {
            entry.check(&entry.value).map_err(|reason| wrong(format!("its default: {reason}")))?;
        }
        let value = entry.value.clone();
        let mut declared = self.declared();
        if declared.contains_key(name) {
            return Err(wrong("declared twice".to_string()));
        }
        declared.insert(name.to_string(), entry);
        drop(declared);
        (self.on_change)(Changes { new: vec![(name.to_string(), value)], changed: Vec::new() });
        Ok(())
    }

    pub(crate) fn get(&self, name: &str) -> Option<ParameterValue> {
        self.declared().get(name).map(|entry| entry.value.clone())
    }

    /// Overrides for this node that no parameter took.
    pub(crate) fn unused_overrides(&self) -> Vec<String> {
        let declared = self.declared();
        self.overrides.keys().filter(|name| !declared.contains_key(*name)).cloned().collect()
    }

    /// All or nothing.
    pub(crate) fn set(&self, parameters: &[(String, ParameterValue)]) -> Result<(), String> {
        let mut declared = self.declared();
        for (name, value) in parameters {
            let entry = declared.get(name).ok_or_else(|| {
                let known: Vec<&str> = declared.keys().map(String::as_str).collect();
                format!("parameter {name:?} is not declared; this node has {}", known.join(", "))
            })?;
            if entry.descriptor.read_only {
                return Err(format!("parameter {name:?} is read-only: set it when the node is started"));
            }
            entry.check(value).map_err(|reason| format!("parameter {name:?}: {reason}"))?;
        }
        for (name, value) in parameters {
            if let Some(entry) = declared.get_mut(name) {
                entry.value = value.clone();
            }
        }
        drop(declared);
        (self.on_change)(Changes { new: Vec::new(), changed: parameters.to_vec() });
        Ok(())
    }

    fn set_from_wire(&self, parameters: &[wire::Parameter]) -> wire::SetParametersResult {
        let outcome = too_many(parameters.len())
            .and_then(|()| {
                parameters
                    .iter()
                    .map(|parameter| {
                        ParameterValue::from_wire(&parameter.value)
                            .map(|value| (parameter.name.clone(), value))
                            .map_err(|reason| {
                                format!("parameter {:?}: {reason}", printable(&parameter.name, NAME_CHARS))
                            })
                    })
                    .collect::<Result<Vec<_>, _>>()
            })
            .and_then(|parameters| self.set(&parameters));
        // The reason repeats names and values of the request.
        let reason = outcome.as_ref().err().map(|reason| printable(reason, SENTENCE_CHARS).into_owned());
        wire::SetParametersResult { successful: outcome.is_ok(), reason: reason.unwrap_or_default() }
    }

    // The six services. Of longer lists than they take they leave out the rest: no field of theirs says so.

    pub(crate) fn list_parameters(&self, request: &wire::ListParametersRequest) -> wire::ListParametersResponse {
        let declared = self.declared();
        let levels = |name: &str| name.matches('.').count() as u64;
        let wanted = |name: &&String| {
            if request.prefixes.is_empty() {
                return request.depth == 0 || levels(name) < request.depth;
            }
            request.prefixes.iter().take(MAX_PARAMETERS).any(|prefix| {
                name.as_str() == prefix
                    || name.strip_prefix(prefix.as_str()).is_some_and(|rest| {
                        rest.starts_with('.') && (request.depth == 0 || levels(&rest[1..]) < request.depth)
                    })
            })
        };
        let names: Vec<String> = declared.keys().filter(wanted).cloned().collect();
        let mut prefixes: Vec<String> =
            names.iter().filter_map(|name| name.rsplit_once('.').map(|(prefix, _)| prefix.to_string())).collect();
        prefixes.dedup();
        wire::ListParametersResponse { result: wire::ListParametersResult { names, prefixes } }
    }

    pub(crate) fn get_parameters(&self, request: &wire::GetParametersRequest) -> wire::GetParametersResponse {
        let declared = self.declared();
        wire::GetParametersResponse {
            values: request
                .names
                .iter()
                .take(MAX_PARAMETERS)
                .map(|name| declared.get(name).map(|entry| entry.value.to_wire()).unwrap_or_default())
                .collect(),
        }
    }

    pub(crate) fn get_parameter_types(
        &self,
        request: &wire::GetParameterTypesRequest,
    ) -> wire::GetParameterTypesResponse {
        let declared = self.declared();
        wire::GetParameterTypesResponse {
            types: request
                .names
                .iter()
                .take(MAX_PARAMETERS)
                .map(|name| declared.get(name).map_or(0, |entry| entry.value.type_number()))
                .collect(),
        }
    }

    pub(crate) fn describe_parameters(
        &self,
        request: &wire::DescribeParametersRequest,
    ) -> wire::DescribeParametersResponse {
        let declared = self.declared();
        wire::DescribeParametersResponse {
            descriptors: request
                .names
                .iter()
                .take(MAX_PARAMETERS)
                .map(|name| match declared.get(name) {
                    Some(entry) => entry.descriptor.clone(),
                    None => wire::ParameterDescriptor {
                        name: printable(name, NAME_CHARS).into_owned(),
                        ..Default::default()
                    },
                })
                .collect(),
        }
    }

    pub(crate) fn set_parameters(&self, request: &wire::SetParametersRequest) -> wire::SetParametersResponse {
        if let Err(reason) = too_many(request.parameters.len()) {
            // None is set; of the refusals there are no more than of parameters that would have been.
            let refused = wire::SetParametersResult { successful: false, reason };
            return wire::SetParametersResponse { results: vec![refused; MAX_PARAMETERS] };
        }
        wire::SetParametersResponse {
            results: request
                .parameters
                .iter()
                .map(|parameter| self.set_from_wire(std::slice::from_ref(parameter)))
                .collect(),
        }
    }

    pub(crate) fn set_parameters_atomically(
        &self,
        request: &wire::SetParametersAtomicallyRequest,
    ) -> wire::SetParametersAtomicallyResponse {
        wire::SetParametersAtomicallyResponse { result: self.set_from_wire(&request.parameters) }
    }
}

fn too_many(parameters: usize) -> Result<(), String> {
    if parameters > MAX_PARAMETERS {
        return Err(format!("{parameters} parameters in one request, expected at most {MAX_PARAMETERS}"));
    }
    Ok(())
}

/// A declared parameter. Reading it takes a lock: not for a control thread. Clones are the same parameter.
#[derive(Clone)]
pub struct Parameter<T> {
    store: Arc<Store>,
    name: String,
    default: T,
}

impl<T: ParameterType> Parameter<T> {
    /// The present value.
    #[must_use]
    pub fn get(&self) -> T {
        // Declared with this type and never undeclared, so the default is never used.
        self.store.get(&self.name).and_then(|value| T::from_value(&value)).unwrap_or_else(|| self.default.clone())
    }

    /// Sets it from inside the program, through the same checks as from outside.
    ///
    /// # Errors
    /// The check that refused the value.
    pub fn set(&self, value: T) -> Result<(), String> {
        self.store.set(&[(self.name.clone(), value.into_value())])
    }
}

/// A parameter that is about to be declared: see [`Node::parameter`](crate::Node::parameter).
#[must_use = "call declare()"]
pub struct ParameterBuilder<T> {
    store: Arc<Store>,
    default: T,
    entry: Entry,
    kind: PhantomData<T>,
}

impl<T: ParameterType> ParameterBuilder<T> {
    pub(crate) fn new(store: Arc<Store>, name: &str, default: T) -> Self {
        let value = default.clone().into_value();
        ParameterBuilder {
            store,
            default,
            entry: Entry {
                descriptor: wire::ParameterDescriptor {
                    name: name.to_string(),
                    r#type: value.type_number(),
                    ..Default::default()
                },
                value,
                checks: Vec::new(),
            },
            kind: PhantomData,
        }
    }

    /// What it is, with its unit.
    pub fn description(mut self, text: &str) -> Self {
        self.entry.descriptor.description = text.to_string();
        self
    }

    /// Can be set only when the node is started.
    pub fn read_only(mut self) -> Self {
        self.entry.descriptor.read_only = true;
        self
    }

    /// A check beyond the range; its error reaches whoever sets the parameter. `rule` says it for people.
    pub fn validate(mut self, rule: &str, check: impl Fn(&T) -> Result<(), String> + Send + Sync + 'static) -> Self {
        self.entry.descriptor.additional_constraints = rule.to_string();
        self.entry.checks.push(Box::new(move |value| match T::from_value(value) {
            Some(value) => check(&value),
            None => Ok(()), // the type is checked before
        }));
        self
    }

    /// Declares it. Its value is the default, or what the command line or a file says.
    ///
    /// # Errors
    /// When a value given at the start is of another type or out of range, or the name is taken.
    pub fn declare(self) -> Result<Parameter<T>, RosError> {
        let name = self.entry.descriptor.name.clone();
        self.store.declare(&name, self.entry)?;
        Ok(Parameter { store: self.store, name, default: self.default })
    }
}

impl<T: Ranged> ParameterBuilder<T> {
    /// Least and greatest value of a plain number. NaN is in no range.
    pub fn range(self, from: T, to: T) -> Self {
        self.range_in(from, to, "")
    }

    /// Least and greatest value, and their unit. NaN is in no range.
    pub fn range_in(mut self, from: T, to: T, unit: &'static str) -> Self {
        T::describe(&from, &to, &mut self.entry.descriptor);
        self.entry.checks.push(Box::new(move |value| match T::from_value(value) {
            Some(value) if value >= from && value <= to => Ok(()),
            Some(value) => {
                let (to, value) = (Quantity(&to, unit), Quantity(value, unit));
                Err(format!("expected a value from {from} to {to}, got {value}"))
            }
            None => Ok(()), // the type is checked before
        }));
        self
    }
}

/// Whether a node pattern of a parameter file (`/a/*/b`, `/**`) matches a full node name.
fn matches(pattern: &str, node: &str) -> bool {
    fn parts(pattern: &[&str], node: &[&str]) -> bool {
        match (pattern.split_first(), node.split_first()) {
            (None, None) => true,
            (Some((&"**", rest)), _) => (0..=node.len()).any(|skip| parts(rest, &node[skip..])),
            (Some((&"*", rest)), Some((_, others))) => parts(rest, others),
            (Some((name, rest)), Some((other, others))) => name == other && parts(rest, others),
            _ => false,
        }
    }
    let split = |name: &'_ str| name.split('/').filter(|part| !part.is_empty()).map(str::to_string).collect::<Vec<_>>();
    let (pattern, node) = (split(pattern), split(node));
    parts(&pattern.iter().map(String::as_str).collect::<Vec<_>>(), &node.iter().map(String::as_str).collect::<Vec<_>>())
}

#[cfg(test)]
mod tests;
