//! Decoding a message by the definition embedded in the bag, for types met for the first time.

use recorder::{Count, Element, Primitive};

use crate::{BagError, Definition};

/// A decoded value.
#[derive(Clone, Debug, PartialEq)]
pub enum Value {
    /// `bool`
    Bool(bool),
    /// Any signed integer.
    Integer(i64),
    /// Any unsigned integer.
    Unsigned(u64),
    /// `float32` or `float64`
    Number(f64),
    /// `string`
    Text(String),
    /// An array or a sequence.
    List(Vec<Value>),
    /// A message: fields in the order of its definition.
    Fields(Vec<(String, Value)>),
}

impl Value {
    /// The field of a message, if this is one and has it.
    pub fn field(&self, name: &str) -> Option<&Value> {
        match self {
            Value::Fields(fields) => fields.iter().find(|(field, _)| field == name).map(|(_, value)| value),
            _ => None,
        }
    }

    /// The value as a number, if it is one or a truth value.
    pub fn number(&self) -> Option<f64> {
        match self {
            Value::Bool(value) => Some(f64::from(u8::from(*value))),
            Value::Integer(value) => Some(*value as f64),
            Value::Unsigned(value) => Some(*value as f64),
            Value::Number(value) => Some(*value),
            _ => None,
        }
    }

    /// Calls `take` with the path and the value of everything inside that has no parts: `position[3]`,
    /// `header.stamp.sec`.
    pub fn for_each_leaf(&self, take: &mut impl FnMut(&str, &Value)) {
        self.walk(&mut String::new(), take);
    }

    fn walk(&self, path: &mut String, take: &mut impl FnMut(&str, &Value)) {
        let length = path.len();
        match self {
            Value::Fields(fields) => {
                for (name, value) in fields {
                    if length > 0 {
                        path.push('.');
                    }
                    path.push_str(name);
                    value.walk(path, take);
                    path.truncate(length);
                }
            }
            Value::List(values) => {
                for (index, value) in values.iter().enumerate() {
                    path.push_str(&format!("[{index}]"));
                    value.walk(path, take);
                    path.truncate(length);
                }
            }
            leaf => take(path, leaf),
        }
    }
}

/// Decodes one message, `cdr` with its four-byte encapsulation header.
///
/// # Errors
/// [`BagError::Cdr`] if the bytes do not fit the definition.
pub fn decode(definition: &Definition, cdr: &[u8]) -> Result<Value, BagError> {
    let bad = |reason: String| BagError::Cdr { name: definition.root().to_owned(), action: "read from", reason };
    let (header, body) =
        cdr.split_at_checked(4).ok_or_else(|| bad(format!("{} bytes; expected at least 4", cdr.len())))?;
    let little_endian = match header[..2] {
        [0, 0] => false,
        [0, 1] => true,
        _ => {
            return Err(bad(format!(
                "encapsulation {:02x}{:02x}; expected plain CDR, 0000 or 0001",
                header[0], header[1]
            )));
        }
    };
    let mut reader = Reader { body, at: 0, little_endian, left: MOST_VALUES };
    reader.message(definition, definition.root()).map_err(|reason| bad(format!("at byte {}: {reason}", reader.at + 4)))
}

/// A message with more values than this is damage: memory for it is not spent.
const MOST_VALUES: usize = 1 << 24;

struct Reader<'a> {
    body: &'a [u8],
    at: usize,
    little_endian: bool,
    left: usize,
}

impl Reader<'_> {
    fn bytes(&mut self, length: usize) -> Result<&[u8], String> {
        let found = self.at.checked_add(length).and_then(|end| self.body.get(self.at..end));
        let bytes = found.ok_or("the message ends too early for its definition")?;
        self.at += length;
        Ok(bytes)
    }

    /// A plain value of `N` bytes, aligned to its own size, in the order of this machine's bytes.
    fn plain<const N: usize>(&mut self) -> Result<[u8; N], String> {
        self.at = self.at.next_multiple_of(N);
        let little_endian = self.little_endian;
        let mut value: [u8; N] = self.bytes(N)?.try_into().map_err(|_| "the message ends too early")?;
        if little_endian != cfg!(target_endian = "little") {
            value.reverse();
        }
        Ok(value)
    }

    fn message(&mut self, definition: &Definition, name: &str) -> Result<Value, String> {
        let fields = definition.fields(name);
        if fields.is_empty() {
            self.bytes(1)?; // the byte that ROS 2 puts in place of nothing
        }
        let mut values = Vec::with_capacity(fields.len());
        for field in fields {
            let value = match field.count {
                Count::One => self.element(definition, &field.element),
                Count::Fixed(count) => self.list(definition, &field.element, count),
                Count::Sequence => {
                    let count = u32::from_ne_bytes(self.plain()?) as usize;
                    self.list(definition, &field.element, count)
                }
            };
            values.push((field.name.clone(), value.map_err(|reason| format!("{}: {reason}", field.name))?));
        }
        Ok(Value::Fields(values))
    }

    fn list(&mut self, definition: &Definition, element: &Element, count: usize) -> Result<Value, String> {
        let smallest = match element {
            Element::Primitive(primitive) => primitive.size(),
            Element::Message(_) => 1,
        };
        // A damaged length must not allocate more than the message can hold.
        if count.saturating_mul(smallest) > self.body.len().saturating_sub(self.at) {
            return Err(format!("a sequence of {count} elements does not fit the message"));
        }
        let mut values = Vec::with_capacity(count);
        for _ in 0..count {
            values.push(self.element(definition, element)?);
        }
        Ok(Value::List(values))
    }

    fn element(&mut self, definition: &Definition, element: &Element) -> Result<Value, String> {
        self.left = self.left.checked_sub(1).ok_or_else(|| format!("more than {MOST_VALUES} values in one message"))?;
        let primitive = match element {
            Element::Message(name) => return self.message(definition, name),
            Element::Primitive(primitive) => primitive,
        };
        Ok(match primitive {
            Primitive::Bool => Value::Bool(self.bytes(1)?[0] != 0),
            Primitive::U8 => Value::Unsigned(self.bytes(1)?[0].into()),
            Primitive::I8 => Value::Integer((self.bytes(1)?[0] as i8).into()),
            Primitive::U16 => Value::Unsigned(u16::from_ne_bytes(self.plain()?).into()),
            Primitive::I16 => Value::Integer(i16::from_ne_bytes(self.plain()?).into()),
            Primitive::U32 => Value::Unsigned(u32::from_ne_bytes(self.plain()?).into()),
            Primitive::I32 => Value::Integer(i32::from_ne_bytes(self.plain()?).into()),
            Primitive::U64 => Value::Unsigned(u64::from_ne_bytes(self.plain()?)),
            Primitive::I64 => Value::Integer(i64::from_ne_bytes(self.plain()?)),
            Primitive::F32 => Value::Number(f32::from_ne_bytes(self.plain()?).into()),
            Primitive::F64 => Value::Number(f64::from_ne_bytes(self.plain()?)),
            Primitive::Text => {
                let length = u32::from_ne_bytes(self.plain()?) as usize;
                let bytes = self.bytes(length)?;
                let bytes = bytes.strip_suffix(&[0]).unwrap_or(bytes);
                Value::Text(String::from_utf8_lossy(bytes).into_owned())
            }
            Primitive::WideText => return Err("wstring is not supported".into()),
        })
    }
}
