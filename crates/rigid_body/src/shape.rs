//! The text of a URDF before it is read: what could exhaust memory or stack, and what the reader proper would report
//! without saying where.

use quick_xml::Reader;
use quick_xml::events::{BytesStart, Event};

use crate::error::ModelError;

/// Longest URDF accepted. The largest robots' files are below 1 MB; meshes are files of their own.
const LIMIT_BYTES: usize = 4 << 20;
/// Deepest nesting accepted: a parser that recurses must not run out of stack.
const LIMIT_DEPTH: usize = 32;
/// Most elements accepted.
const LIMIT_ELEMENTS: usize = 50_000;

/// Attributes that hold numbers: element, attribute, how many.
const NUMBERS: [(&str, &str, usize); 31] = [
    ("origin", "xyz", 3),
    ("origin", "rpy", 3),
    ("axis", "xyz", 3),
    ("mass", "value", 1),
    ("inertia", "ixx", 1),
    ("inertia", "ixy", 1),
    ("inertia", "ixz", 1),
    ("inertia", "iyy", 1),
    ("inertia", "iyz", 1),
    ("inertia", "izz", 1),
    ("box", "size", 3),
    ("cylinder", "radius", 1),
    ("cylinder", "length", 1),
    ("capsule", "radius", 1),
    ("capsule", "length", 1),
    ("sphere", "radius", 1),
    ("mesh", "scale", 3),
    ("color", "rgba", 4),
    ("limit", "lower", 1),
    ("limit", "upper", 1),
    ("limit", "effort", 1),
    ("limit", "velocity", 1),
    ("dynamics", "damping", 1),
    ("dynamics", "friction", 1),
    ("mimic", "multiplier", 1),
    ("mimic", "offset", 1),
    ("safety_controller", "soft_lower_limit", 1),
    ("safety_controller", "soft_upper_limit", 1),
    ("safety_controller", "k_position", 1),
    ("safety_controller", "k_velocity", 1),
    ("calibration", "rising", 1),
];

/// What the walk over the text has met.
struct Walk<'a> {
    text: &'a str,
    depth: usize,
    elements: usize,
    root_seen: bool,
    /// The link, joint or other element of the second level that the walk is in, such as "link 'torso'".
    owner: String,
    /// Whether the owner is one whose numbers are read.
    is_read: bool,
    /// The first element of xacro: its line and name.
    xacro: Option<(usize, String)>,
    /// Elements of the second level.
    parts: Vec<Part>,
}

/// An element of the second level: a link or a joint, mostly.
pub(crate) struct Part {
    /// Such as "link 'torso'".
    pub owner: String,
    /// Its bytes in the text.
    pub bytes: std::ops::Range<usize>,
}

/// Walks over the text once, without building anything.
pub(crate) fn check(text: &str) -> Result<Vec<Part>, ModelError> {
    if text.len() > LIMIT_BYTES {
        return Err(ModelError::TooLarge { found_bytes: text.len(), limit_bytes: LIMIT_BYTES });
    }
    let not_urdf = |problem: String| Err(ModelError::NotUrdf(problem));
    let mut reader = Reader::from_str(text);
    let mut walk = Walk {
        text,
        depth: 0,
        elements: 0,
        root_seen: false,
        owner: String::new(),
        is_read: false,
        xacro: None,
        parts: Vec::new(),
    };
    loop {
        let at_byte = reader.buffer_position() as usize;
        match reader.read_event() {
            Err(error) => return not_urdf(format!("{error} (at byte {at_byte}, line {})", line_of(text, at_byte))),
            Ok(Event::Eof) if walk.depth > 0 => return not_urdf("the text ends inside an element".to_owned()),
            Ok(Event::Eof) if !walk.root_seen => return not_urdf("there is no element".to_owned()),
            Ok(Event::Eof) => return walk.end(),
            Ok(Event::DocType(_)) => return Err(ModelError::DocumentType),
            Ok(Event::Start(element)) => walk.element(&element, true, at_byte)?,
            Ok(Event::Empty(element)) => {
                walk.element(&element, false, at_byte)?;
                if walk.depth == 1
                    && let Some(part) = walk.parts.last_mut()
                {
                    part.bytes.end = reader.buffer_position() as usize;
                }
            }
            Ok(Event::End(_)) => match walk.depth.checked_sub(1) {
                Some(above) => {
                    walk.depth = above;
                    if above == 1
                        && let Some(part) = walk.parts.last_mut()
                    {
                        part.bytes.end = reader.buffer_position() as usize;
                    }
                }
                None => return not_urdf(format!("an element is closed at byte {at_byte} that was not opened")),
            },
            Ok(_) => {}
        }
    }
}

/// The line, from 1, of a byte of the text.
fn line_of(text: &str, at_byte: usize) -> usize {
    1 + text.as_bytes()[..at_byte.min(text.len())].iter().filter(|&&byte| byte == b'\n').count()
}

impl Walk<'_> {
    fn element(&mut self, element: &BytesStart, opens: bool, at_byte: usize) -> Result<(), ModelError> {
        let name = String::from_utf8_lossy(element.name().as_ref()).into_owned();
        if self.depth == 0 {
            if self.root_seen || name != "robot" {
                return Err(ModelError::NotUrdf(format!("there is an element <{name}> at the top")));
            }
            self.root_seen = true;
        }
        // Properties and arguments make no part of a robot by themselves.
        if name.starts_with("xacro:")
            && !["xacro:property", "xacro:arg"].contains(&name.as_str())
            && self.xacro.is_none()
        {
            self.xacro = Some((line_of(self.text, at_byte), name.clone()));
        }
        if self.depth == 1 {
            self.owner = match attribute(element, "name")? {
                Some(given) => format!("{name} '{given}'"),
                None => format!("<{name}>"),
            };
            self.parts.push(Part { owner: self.owner.clone(), bytes: at_byte..at_byte });
            self.is_read = ["link", "joint", "material"].contains(&name.as_str());
            if name == "joint" {
                check_joint_type(element)?;
            }
        }
        self.check_attributes(element, &name, at_byte)?;
        self.elements += 1;
        if self.elements > LIMIT_ELEMENTS {
            return Err(ModelError::TooManyElements { limit: LIMIT_ELEMENTS });
        }
        if opens {
            self.depth += 1;
        }
        if self.depth > LIMIT_DEPTH {
            return Err(ModelError::TooDeep { limit: LIMIT_DEPTH, at_byte });
        }
        Ok(())
    }

    fn check_attributes(&self, element: &BytesStart, name: &str, at_byte: usize) -> Result<(), ModelError> {
        if !self.is_read {
            return Ok(());
        }
        for found in element.attributes() {
            let Ok(found) = found else { continue };
            let key = String::from_utf8_lossy(found.key.as_ref()).into_owned();
            let value = String::from_utf8_lossy(&found.value).into_owned();
            let place = || (self.owner.clone(), format!("{name} {key}"), line_of(self.text, at_byte), value.clone());
            if value.contains("${") || value.contains("$(") {
                let (owner, field, line, text) = place();
                return Err(ModelError::Xacro { owner, field, line, text });
            }
            let Some(&(.., count)) = NUMBERS.iter().find(|(e, a, _)| *e == name && *a == key) else { continue };
            let mut numbers = 0;
            let all_read = value.split_whitespace().all(|word| {
                numbers += 1;
                word.parse::<f64>().is_ok()
            });
            if !all_read || numbers != count {
                let (owner, field, line, text) = place();
                return Err(ModelError::NotANumber { owner, field, line, text, count });
            }
        }
        Ok(())
    }

    fn end(self) -> Result<Vec<Part>, ModelError> {
        match self.xacro {
            Some((line, element)) => Err(ModelError::XacroElement { line, element }),
            None => Ok(self.parts),
        }
    }
}

/// What the reader proper has to say of the text, with the link or joint that it cannot read: it says none itself.
pub(crate) fn with_place(text: &str, parts: &[Part], whole: String) -> ModelError {
    for part in parts {
        let Some(alone) = text.get(part.bytes.clone()) else { continue };
        if let Err(error) = urdf_rs::read_from_string(&format!("<robot name=\"part\">{alone}</robot>")) {
            let line = line_of(text, part.bytes.start);
            return ModelError::NotUrdf(format!("{}, line {line}: {error}", part.owner));
        }
    }
    ModelError::NotUrdf(whole)
}

fn attribute(element: &BytesStart, name: &str) -> Result<Option<String>, ModelError> {
    match element.try_get_attribute(name) {
        Ok(found) => Ok(found.map(|attribute| String::from_utf8_lossy(&attribute.value).into_owned())),
        Err(error) => Err(ModelError::NotUrdf(error.to_string())),
    }
}

/// The reader proper knows URDF's joint types only, and does not say which joint has another.
fn check_joint_type(element: &BytesStart) -> Result<(), ModelError> {
    const KNOWN: [&str; 7] = ["revolute", "continuous", "prismatic", "fixed", "floating", "planar", "spherical"];
    let joint = attribute(element, "name")?.unwrap_or_default();
    match attribute(element, "type")? {
        Some(found) if !KNOWN.contains(&found.as_str()) => Err(ModelError::UnsupportedJoint { joint, found }),
        _ => Ok(()),
    }
}
