//! Type hashes as ROS 2 announces them (REP 2016, `RIHS01`): SHA-256 of the type's description and of those of all
//! types in it, written as JSON.

use crate::action_msgs::{CancelGoal, GoalStatusArray};
use crate::builtin_interfaces::Time;
use crate::sha256::sha256;
use crate::unique_identifier_msgs::UUID;
use crate::{Action, FieldType, Message, Service};

/// The line between the definitions of a type and of those in it.
const SEPARATOR: &str = "================================================================================";

/// A structure's fields: names and types as a definition file writes them.
type Fields = Vec<(String, String)>;

/// A type's full name, such as `std_msgs/msg/Header` or `std_srvs/srv/Trigger_Request`, and its hash: `RIHS01_` and 64
/// hexadecimal digits.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TypeHash {
    /// The full name.
    pub name: String,
    /// The hash.
    pub hash: String,
}

impl TypeHash {
    /// A message's.
    #[must_use]
    pub fn of_message<M: Message>() -> Self {
        Description::of::<M>(M::full_name()).hash()
    }

    /// Those of a service's request and response.
    #[must_use]
    pub fn of_service<S: Service>() -> [Self; 2] {
        let name = |part| format!("{}/srv/{}_{part}", S::PACKAGE, S::NAME);
        [Description::of::<S::Request>(name("Request")), Description::of::<S::Response>(name("Response"))]
            .map(Description::hash)
    }

    /// Those of all that an action sends.
    #[must_use]
    pub fn of_action<A: Action>() -> Vec<Self> {
        let name = |part| format!("{}/action/{}_{part}", A::PACKAGE, A::NAME);
        let goal = Description::of::<A::Goal>(name("Goal"));
        let result = Description::of::<A::Result>(name("Result"));
        let feedback = Description::of::<A::Feedback>(name("Feedback"));
        let id = || Description::of::<UUID>(UUID::full_name());
        let none = |type_name: &str| Description { name: type_name.into(), ..Description::default() };
        let stamp = Description::of::<Time>(Time::full_name());
        let send_goal = Description::with(name("SendGoal_Request"), [("goal_id", id()), ("goal", goal)]);
        let accepted = Description::with(name("SendGoal_Response"), [("accepted", none("bool")), ("stamp", stamp)]);
        let get_result = Description::with(name("GetResult_Request"), [("goal_id", id())]);
        let ended = Description::with(name("GetResult_Response"), [("status", none("int8")), ("result", result)]);
        let progress = Description::with(name("FeedbackMessage"), [("goal_id", id()), ("feedback", feedback)]);
        let mut all: Vec<_> = [send_goal, accepted, get_result, ended, progress].map(Description::hash).into();
        all.extend(Self::of_service::<CancelGoal>());
        all.push(Self::of_message::<GoalStatusArray>());
        all
    }

    /// That of a definition's text, in the form that rosbag2 stores ([`crate::definition`]); comments, constants and
    /// default values are no part of a type.
    #[must_use]
    pub fn of_definition(name: &str, text: &str) -> Self {
        let mut parts = text.split(SEPARATOR);
        let fields = fields_of(name, parts.next().unwrap_or_default());
        let nested = parts.filter_map(|part| {
            let (name, text) = part.trim_start().strip_prefix("MSG:")?.split_once('\n')?;
            let name = full_name(name.trim());
            let fields = fields_of(&name, text);
            Some((name, fields))
        });
        Description { name: name.to_owned(), fields, nested: nested.collect() }.hash()
    }

    /// What DDS calls the type: `std_msgs::msg::dds_::Header_`.
    #[must_use]
    pub fn dds_name(&self) -> String {
        let (folder, name) = self.name.rsplit_once('/').unwrap_or(("", &self.name));
        format!("{}::dds_::{name}_", folder.replace('/', "::"))
    }
}

/// A type, and all types in it, each once.
#[derive(Clone, Debug, Default)]
struct Description {
    name: String,
    fields: Fields,
    nested: Vec<(String, Fields)>,
}

impl Description {
    /// A message's, under a name of its own.
    fn of<M: FieldType>(name: String) -> Self {
        let mut definitions = Vec::new();
        M::add_definitions(&mut definitions);
        let mut types = definitions.iter().map(|(name, text)| (full_name(name), fields(text)));
        let fields = types.next().map(|(_, fields)| fields).unwrap_or_default();
        Self { name, fields, nested: types.collect() }
    }

    /// A structure of such parts; those without fields are no structures themselves.
    fn with<const N: usize>(name: String, parts: [(&str, Self); N]) -> Self {
        let mut whole = Self { name, ..Self::default() };
        for (field, part) in parts {
            whole.fields.push((field.into(), part.name.clone()));
            whole.nested.extend(part.nested);
            if !part.fields.is_empty() {
                whole.nested.push((part.name, part.fields));
            }
        }
        whole
    }

    fn hash(mut self) -> TypeHash {
        self.nested.sort();
        self.nested.dedup();
        let nested: Vec<String> = self.nested.iter().map(|(name, fields)| described(name, fields)).collect();
        let json = format!(
            r#"{{"type_description": {}, "referenced_type_descriptions": [{}]}}"#,
            described(&self.name, &self.fields),
            nested.join(", ")
        );
        let digits: String = sha256(json.as_bytes()).iter().map(|byte| format!("{byte:02x}")).collect();
        TypeHash { name: self.name, hash: format!("RIHS01_{digits}") }
    }
}

/// `std_msgs/Header` in full; a full name stays as it is.
fn full_name(name: &str) -> String {
    match name.split_once('/') {
        Some((package, name)) if !name.contains('/') => format!("{package}/msg/{name}"),
        _ => name.to_owned(),
    }
}

/// The fields of a definition's text.
fn fields(text: &str) -> Fields {
    let lines = text.lines().filter_map(|line| line.split_once(' '));
    or_a_byte(lines.map(|(type_name, name)| (name.to_owned(), type_name.to_owned())).collect())
}

/// The fields of a structure; where it has none, the byte that ROS 2 puts there.
fn or_a_byte(fields: Fields) -> Fields {
    match fields.is_empty() {
        true => vec![("structure_needs_at_least_one_member".into(), "uint8".into())],
        false => fields,
    }
}

/// The fields of a definition's text as people write it; a type without a package is of its owner's.
fn fields_of(owner: &str, text: &str) -> Fields {
    let package = owner.split('/').next().unwrap_or_default();
    let field = |line: &str| {
        let (type_name, rest) = line.trim_start().split_once(char::is_whitespace)?;
        let rest = rest.trim_start();
        let name = &rest[..rest.find(|c: char| !c.is_ascii_alphanumeric() && c != '_').unwrap_or(rest.len())];
        let is_constant = rest[name.len()..].trim_start().starts_with('=');
        let element = type_name.split('[').next().unwrap_or_default();
        let own = primitive(element).is_none() && !element.contains('/');
        let type_name = if own { format!("{package}/{type_name}") } else { type_name.to_owned() };
        (!element.starts_with('#') && !name.is_empty() && !is_constant).then(|| (name.to_owned(), type_name))
    };
    or_a_byte(text.lines().filter_map(field).collect())
}

fn described(name: &str, fields: &Fields) -> String {
    let fields: Vec<String> = fields
        .iter()
        .map(|(name, type_name)| format!(r#"{{"name": "{name}", "type": {}}}"#, described_type(type_name)))
        .collect();
    format!(r#"{{"type_name": "{name}", "fields": [{}]}}"#, fields.join(", "))
}

/// A field's type by the numbers of `type_description_interfaces/msg/FieldType`.
fn described_type(type_name: &str) -> String {
    /// Added to an element's number: an array, a bounded and an unbounded sequence of it.
    const ARRAY: u8 = 48;
    const BOUNDED: u8 = 96;
    const UNBOUNDED: u8 = 144;
    let (element, size) = type_name.strip_suffix(']').and_then(|whole| whole.split_once('[')).unzip();
    let (container, capacity) = match size {
        None => (0, "0"),
        Some("") => (UNBOUNDED, "0"),
        Some(size) => size.strip_prefix("<=").map_or((ARRAY, size), |bound| (BOUNDED, bound)),
    };
    let element = element.unwrap_or(type_name);
    let (number, string_capacity) = primitive(element).unwrap_or((1, "0"));
    let nested = if number == 1 { full_name(element) } else { String::new() };
    let number = number + container;
    format!(
        r#"{{"type_id": {number}, "capacity": {capacity}, "string_capacity": {string_capacity}, "nested_type_name": "{nested}"}}"#
    )
}

/// The number of a type that is no structure, and the bound of a string; 0: none.
fn primitive(element: &str) -> Option<(u8, &str)> {
    /// Added to a string's number: a bounded one.
    const BOUNDED_STRING: u8 = 4;
    let (name, bound) = element.split_once("<=").map_or((element, None), |(name, bound)| (name, Some(bound)));
    let number = match name {
        "int8" => 2,
        "uint8" | "char" => 3,
        "int16" => 4,
        "uint16" => 5,
        "int32" => 6,
        "uint32" => 7,
        "int64" => 8,
        "uint64" => 9,
        "float32" => 10,
        "float64" => 11,
        "bool" => 15,
        "byte" => 16,
        "string" => 17,
        "wstring" => 18,
        _ => return None,
    };
    Some(bound.map_or((number, "0"), |bound| (number + BOUNDED_STRING, bound)))
}
