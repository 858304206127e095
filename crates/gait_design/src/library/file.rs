//! The library's file.

use super::contents::{Entry, Header, Library};
use super::error::LibraryError;
use crate::full_order::stride_unknowns;
use crate::program::layout;
use robot::Robot;
use serde::{Deserialize, Serialize};

pub use super::contents::{FORMAT, VERSION, VERSION_STRIDES};

/// Read before everything else, so that a file of another version is named as such.
#[derive(Deserialize)]
struct Beginning {
    format: String,
    version: u64,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Line {
    index: usize,
    entry: Entry,
}

impl Library {
    /// First line of the file.
    pub fn header_line(&self) -> String {
        checked_line(&self.header)
    }

    /// The line of one point.
    pub fn entry_line(index: usize, entry: &Entry) -> String {
        checked_line(&Line { index, entry: entry.clone() })
    }

    /// The whole file, in the grid's order: the same library gives the same bytes however it was solved.
    pub fn to_text(&self) -> String {
        let mut text = self.header_line();
        for (index, entry) in self.entries.iter().enumerate() {
            if let Some(entry) = entry {
                text += &Self::entry_line(index, entry);
            }
        }
        text
    }

    /// Reads a complete library, checked against the robot.
    pub fn from_text(text: &str, robot: &Robot) -> Result<Self, LibraryError> {
        let (library, used) = Self::resume(text, robot)?;
        if used < text.len() {
            let line = text[..used].lines().count() + 1;
            return Err(LibraryError::File { line, problem: "it is cut short".into() });
        }
        match library.missing() {
            0 => Ok(library),
            missing => Err(LibraryError::Incomplete { missing, all: library.entries.len() }),
        }
    }

    /// Reads a library that may be incomplete: whatever follows the last line's end, left by an interruption, is not
    /// used. Gives the number of bytes that are good; writing goes on there.
    pub fn resume(text: &str, robot: &Robot) -> Result<(Self, usize), LibraryError> {
        let used = text.rfind('\n').map_or(0, |end| end + 1);
        let mut lines = text[..used].lines();
        let at = |line: usize| move |problem: String| LibraryError::File { line, problem };
        let first = lines.next().ok_or_else(|| at(1)("it is missing or cut short: this is no library".into()))?;
        let json = checked(first).map_err(at(1))?;
        let beginning: Beginning =
            serde_json::from_str(json).map_err(|e| at(1)(format!("it is not a library's header: {e}")))?;
        if beginning.format != FORMAT || ![VERSION, VERSION_STRIDES].contains(&beginning.version) {
            return Err(at(1)(format!(
                "the file is \"{}\" version {}, expected \"{FORMAT}\" version {VERSION} or {VERSION_STRIDES}",
                beginning.format, beginning.version
            )));
        }
        let header: Header = serde_json::from_str(json).map_err(|e| at(1)(e.to_string()))?;
        header.grid.check()?;
        let strides = header.grid.is_of_strides();
        if strides != (header.version == VERSION_STRIDES) {
            return Err(at(1)(format!(
                "version {} does not fit its grid: {VERSION_STRIDES} is of strides, {VERSION} of a step and its mirror image",
                header.version
            )));
        }
        if header.points < 5 || header.points.is_multiple_of(2) {
            return Err(at(1)(format!("points is {}, expected an odd number from 5", header.points)));
        }
        let entries = vec![None; header.grid.points()];
        let unknowns = if strides { stride_unknowns(robot, header.points) } else { layout::point(header.points) };
        let mut library = Self { header, entries };
        library.check_robot(robot)?;
        for (number, line) in (2..).zip(lines) {
            let json = checked(line).map_err(at(number))?;
            let Line { index, entry } = serde_json::from_str(json).map_err(|e| at(number)(e.to_string()))?;
            let all = library.entries.len();
            let place = library
                .entries
                .get_mut(index)
                .ok_or_else(|| at(number)(format!("gait number {index}, the grid has {all}")))?;
            if place.is_some() {
                return Err(at(number)(format!("gait number {index} comes a second time")));
            }
            if let Entry::Gait { unknowns: x, .. } = &entry
                && (x.len() != unknowns || x.iter().any(|v| !v.is_finite()))
            {
                return Err(at(number)(format!("{} unknowns, expected {unknowns} finite ones", x.len())));
            }
            if let Entry::Mirror { of } = entry
                && library.header.grid.mirror_of(index) != Some(of)
            {
                return Err(at(number)(format!("gait number {index} is no mirror image of number {of}")));
            }
            *place = Some(entry);
        }
        Ok((library, used))
    }
}

fn checked_line(value: &impl Serialize) -> String {
    let json = serde_json::to_string(value).expect("a library has only strings, numbers and arrays");
    format!("{:08x} {json}\n", crc32fast::hash(json.as_bytes()))
}

fn checked(line: &str) -> Result<&str, String> {
    let (crc, json) =
        line.split_once(' ').ok_or("it does not begin with a checksum and a space: this is no library's line")?;
    let found = crc32fast::hash(json.as_bytes());
    if crc.len() != 8 || u32::from_str_radix(crc, 16) != Ok(found) {
        return Err(format!("its checksum is {found:08x}, the line says {crc:?}: the file is damaged"));
    }
    Ok(json)
}
