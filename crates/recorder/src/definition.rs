//! Message definitions: the texts that a bag embeds so that any reader can decode its messages.
//!
//! The text of a type is its own `.msg` text followed, for every type it uses at any depth, by a line of 80 `=`, a line
//! `MSG: package/Type` and that type's text (MCAP's registry calls this encoding `ros2msg`).

use std::collections::BTreeMap;
use std::sync::OnceLock;

use crate::BagError;

/// Standard messages (field lists are those of ROS 2 Kilted), each after a `MSG:` line.
const STANDARD_MESSAGES: &str = include_str!("standard_messages.txt");

/// Tandem's own messages.
const OWN_MESSAGES: [(&str, &str); 6] = [
    ("tandem_msgs/ControlCycle", include_str!("../../../msgs/msg/ControlCycle.msg")),
    ("tandem_msgs/ControllerState", include_str!("../../../msgs/msg/ControllerState.msg")),
    ("tandem_msgs/Gait", include_str!("../../../msgs/msg/Gait.msg")),
    ("tandem_msgs/GaitDomain", include_str!("../../../msgs/msg/GaitDomain.msg")),
    ("tandem_msgs/JointCommand", include_str!("../../../msgs/msg/JointCommand.msg")),
    ("tandem_msgs/SolverReport", include_str!("../../../msgs/msg/SolverReport.msg")),
];

/// The line between the definitions of a type and of those it depends on.
const SEPARATOR: &str = "================================================================================";

/// The types whose text is known, by `package/Type`.
fn library() -> &'static BTreeMap<String, &'static str> {
    static LIBRARY: OnceLock<BTreeMap<String, &'static str>> = OnceLock::new();
    LIBRARY.get_or_init(|| {
        let mut library = split_texts(STANDARD_MESSAGES).expect("the standard messages begin with a separator");
        for (name, text) in OWN_MESSAGES {
            library.insert(name.to_owned(), text.trim_end());
        }
        library
    })
}

/// Splits `separator, MSG: name, text` blocks.
fn split_texts(text: &str) -> Option<BTreeMap<String, &str>> {
    let mut blocks = text.split(SEPARATOR);
    blocks.next()?.trim().is_empty().then_some(())?;
    blocks
        .map(|block| {
            let (name, body) = block.trim_start().strip_prefix("MSG: ")?.split_once('\n')?;
            Some((name.trim().to_owned(), body.trim()))
        })
        .collect()
}

/// Names of all types that [`full_definition`] knows, as `package/msg/Type`.
pub fn known_types() -> Vec<String> {
    library().keys().map(|name| name.replacen('/', "/msg/", 1)).collect()
}

/// The complete `ros2msg` text of a type, for example `"sensor_msgs/msg/JointState"`.
///
/// # Errors
/// [`BagError::UnknownType`] if the type, or one it uses, is none of ours or of the common standard messages.
pub fn full_definition(type_name: &str) -> Result<String, BagError> {
    let unknown = |name: &str| BagError::UnknownType { name: name.to_owned() };
    let short = short_name(type_name).ok_or_else(|| unknown(type_name))?;
    let mut text = library().get(&short).ok_or_else(|| unknown(type_name))?.trim_end().to_owned();
    text.push('\n');
    // Depth-first over the uses; a type is written once.
    let mut pending = vec![short.clone()];
    let mut written = vec![short];
    while let Some(name) = pending.pop() {
        let body = library().get(&name).ok_or_else(|| unknown(&name))?;
        for used in uses(&name, body)?.into_iter().rev() {
            if !written.contains(&used) {
                let body = library().get(&used).ok_or_else(|| unknown(&used))?;
                text.push_str(&format!("{SEPARATOR}\nMSG: {used}\n{}\n", body.trim_end()));
                written.push(used.clone());
                pending.push(used);
            }
        }
    }
    Ok(text)
}

/// `package/msg/Type` or `package/Type` to `package/Type`.
fn short_name(type_name: &str) -> Option<String> {
    let parts: Vec<&str> = type_name.split('/').collect();
    match parts.as_slice() {
        [package, "msg", name] | [package, name] if !package.is_empty() && !name.is_empty() => {
            Some(format!("{package}/{name}"))
        }
        _ => None,
    }
}

/// The message types that a definition uses, as `package/Type`.
fn uses(name: &str, body: &str) -> Result<Vec<String>, BagError> {
    let fields = parse_fields(name, body)?;
    Ok(fields
        .into_iter()
        .filter_map(|field| match field.element {
            Element::Message(used) => Some(used),
            _ => None,
        })
        .collect())
}

/// A field's element that has no parts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[expect(missing_docs, reason = "each is what it is called")]
pub enum Primitive {
    Bool,
    U8,
    I8,
    U16,
    I16,
    U32,
    I32,
    U64,
    I64,
    F32,
    F64,
    Text,
    WideText,
}

impl Primitive {
    fn parse(word: &str) -> Option<Primitive> {
        // A bound, as in string<=32, does not change how it is written.
        let word = word.split_once("<=").map_or(word, |(name, _)| name);
        Some(match word {
            "bool" => Primitive::Bool,
            "byte" | "uint8" | "char" => Primitive::U8,
            "int8" => Primitive::I8,
            "uint16" => Primitive::U16,
            "int16" => Primitive::I16,
            "uint32" => Primitive::U32,
            "int32" => Primitive::I32,
            "uint64" => Primitive::U64,
            "int64" => Primitive::I64,
            "float32" => Primitive::F32,
            "float64" => Primitive::F64,
            "string" => Primitive::Text,
            "wstring" => Primitive::WideText,
            _ => return None,
        })
    }

    /// Size and alignment in bytes of the fixed-size ones.
    pub fn size(self) -> usize {
        match self {
            Primitive::Bool | Primitive::U8 | Primitive::I8 => 1,
            Primitive::U16 | Primitive::I16 => 2,
            Primitive::U32 | Primitive::I32 | Primitive::F32 => 4,
            Primitive::U64 | Primitive::I64 | Primitive::F64 => 8,
            Primitive::Text | Primitive::WideText => 4,
        }
    }
}

/// What a field holds one or several of.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Element {
    /// A number, a truth value or a text.
    Primitive(Primitive),
    /// `package/Type`.
    Message(String),
}

/// How many elements a field holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Count {
    /// One.
    One,
    /// An array of this length.
    Fixed(usize),
    /// A sequence, bounded or not: its length is in the data.
    Sequence,
}

/// A field of a message.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Field {
    /// Its name.
    pub name: String,
    /// What it holds.
    pub element: Element,
    /// How many of it.
    pub count: Count,
}

/// The fields of one `.msg` text, in order; constants and comments are left out.
fn parse_fields(type_name: &str, body: &str) -> Result<Vec<Field>, BagError> {
    let package = type_name.split('/').next().unwrap_or_default();
    let mut fields = Vec::new();
    for (index, line) in body.lines().enumerate() {
        // '#' inside a string default would be cut too, but then only the default is lost, which is not needed here.
        let line = line.split('#').next().unwrap_or_default().trim();
        if line.is_empty() {
            continue;
        }
        let bad = |reason: &str| BagError::BadDefinition {
            name: type_name.to_owned(),
            reason: format!("line {} ('{line}'): {reason}", index + 1),
        };
        let mut words = line.split_whitespace();
        let kind = words.next().ok_or_else(|| bad("expected 'type name'"))?;
        let rest = line[kind.len()..].trim_start();
        let name_end = rest.find(|c: char| !(c.is_ascii_alphanumeric() || c == '_')).unwrap_or(rest.len());
        let name = &rest[..name_end];
        if name.is_empty() {
            return Err(bad("expected 'type name'"));
        }
        if rest[name_end..].trim_start().starts_with('=') {
            continue; // a constant
        }
        let (element, count) = match kind.find('[') {
            None => (kind, Count::One),
            Some(at) => {
                let inside = kind[at + 1..].strip_suffix(']').ok_or_else(|| bad("'[' without ']'"))?;
                let count = if inside.is_empty() || inside.starts_with("<=") {
                    Count::Sequence
                } else {
                    Count::Fixed(inside.parse().map_err(|_| bad("the array's length is not a number"))?)
                };
                (&kind[..at], count)
            }
        };
        let element = match Primitive::parse(element) {
            Some(primitive) => Element::Primitive(primitive),
            None if element == "Header" => Element::Message("std_msgs/Header".to_owned()),
            None if element.contains('/') => {
                Element::Message(short_name(element).ok_or_else(|| bad("expected package/Type"))?)
            }
            None => Element::Message(format!("{package}/{element}")),
        };
        fields.push(Field { name: name.to_owned(), element, count });
    }
    Ok(fields)
}

/// A parsed message definition: what is needed to decode messages of a type met for the first time in a bag.
#[derive(Clone, Debug)]
pub struct Definition {
    root: String,
    types: BTreeMap<String, Vec<Field>>,
}

impl Definition {
    /// Parses a complete `ros2msg` text, as embedded in a bag.
    ///
    /// # Errors
    /// [`BagError::BadDefinition`] if a line cannot be read, a used type is missing, or a type contains itself.
    pub fn parse(type_name: &str, text: &str) -> Result<Definition, BagError> {
        let bad = |reason: String| BagError::BadDefinition { name: type_name.to_owned(), reason };
        let root = short_name(type_name).ok_or_else(|| bad("expected a name package/msg/Type".into()))?;
        let mut types = BTreeMap::new();
        for (index, block) in text.split(SEPARATOR).enumerate() {
            let (name, body) = if index == 0 {
                (root.clone(), block)
            } else {
                let (name, body) = block
                    .trim_start()
                    .strip_prefix("MSG: ")
                    .map(|rest| rest.split_once('\n').unwrap_or((rest, "")))
                    .ok_or_else(|| bad("a line of '=' is not followed by 'MSG: package/Type'".into()))?;
                let name = short_name(name.trim()).ok_or_else(|| bad(format!("'{name}' is not package/Type")))?;
                (name, body)
            };
            let fields = parse_fields(&name, body)?;
            types.insert(name, fields);
        }
        let definition = Definition { root, types };
        definition.check(&definition.root, &mut Vec::new()).map_err(bad)?;
        Ok(definition)
    }

    /// Every used type is there, and none contains itself (which would have no end).
    fn check(&self, name: &str, path: &mut Vec<String>) -> Result<(), String> {
        if path.iter().any(|above| above == name) {
            return Err(format!("{name} contains itself"));
        }
        let fields = self.types.get(name).ok_or_else(|| format!("the text of {name} is missing"))?;
        path.push(name.to_owned());
        // Depth is bounded by the number of types, because no type repeats on a path.
        for field in fields {
            if let Element::Message(used) = &field.element {
                self.check(used, path)?;
            }
        }
        path.pop();
        Ok(())
    }

    /// `package/Type` of the message itself.
    pub fn root(&self) -> &str {
        &self.root
    }

    /// The fields of the message itself or of one that it uses, by `package/Type`.
    pub fn fields(&self, name: &str) -> &[Field] {
        &self.types[name]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_known_type_is_complete() {
        let types = known_types();
        assert!(types.len() > 35, "{types:?}");
        for name in types {
            let text = full_definition(&name).unwrap();
            Definition::parse(&name, &text).unwrap();
        }
    }

    #[test]
    fn joint_state_embeds_header_and_time_once() {
        let text = full_definition("sensor_msgs/msg/JointState").unwrap();
        assert_eq!(text.matches("MSG: std_msgs/Header").count(), 1);
        assert_eq!(text.matches("MSG: builtin_interfaces/Time").count(), 1);
        assert_eq!(text.matches(SEPARATOR).count(), 2);
    }

    #[test]
    fn unknown_and_malformed_names_are_errors() {
        for name in ["JointState", "a/b/c", "sensor_msgs/msg/Nothing", "", "/", "sensor_msgs/"] {
            assert!(matches!(full_definition(name), Err(BagError::UnknownType { .. })), "{name}");
        }
    }

    #[test]
    fn fields_constants_bounds_and_arrays() {
        let text = "uint8 OK=0\nstring<=8 a # comment\nfloat64[3] b 1.0\nint32[<=4] c\nOther[] d\n\
                    ================================================================================\nMSG: p/Other\nbool x\n";
        let definition = Definition::parse("p/msg/T", text).unwrap();
        let fields = definition.fields("p/T");
        assert_eq!(fields.iter().map(|f| f.name.as_str()).collect::<Vec<_>>(), ["a", "b", "c", "d"]);
        assert_eq!(fields[1].count, Count::Fixed(3));
        assert_eq!(fields[2].count, Count::Sequence);
        assert_eq!(fields[3].element, Element::Message("p/Other".into()));
    }

    #[test]
    fn a_definition_that_contains_itself_or_misses_a_part_is_an_error() {
        assert!(Definition::parse("p/msg/T", "T t\n").unwrap_err().to_string().contains("contains itself"));
        assert!(Definition::parse("p/msg/T", "Q t\n").unwrap_err().to_string().contains("missing"));
        assert!(Definition::parse("p/msg/T", "int32[ x\n").is_err());
        assert!(Definition::parse("p/msg/T", "int32\n").is_err());
    }
}
