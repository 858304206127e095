//! The text of a line of the log, whatever it is written to.

use tandem_msgs::text::printable;
use tracing::field::{Field, Visit};

/// Longest line, in characters.
pub(crate) const LINE_CHARS: usize = 4000;

/// One event is one line, whatever texts of others are in it: a message with a newline would fake a second line, one
/// with a terminal sequence would rewrite the first.
pub(crate) fn write_field(
    writer: &mut impl std::fmt::Write,
    name: &str,
    value: &dyn std::fmt::Debug,
) -> std::fmt::Result {
    let text = format!("{value:?}");
    let text = printable(&text, LINE_CHARS);
    if name == "message" { write!(writer, "{text}") } else { write!(writer, " {name}={text}") }
}

/// A line's parts.
#[derive(Default)]
pub(crate) struct Text {
    pub(crate) message: String,
    pub(crate) fields: String,
}

impl Visit for Text {
    fn record_debug(&mut self, field: &Field, value: &dyn std::fmt::Debug) {
        // Writing to a String cannot fail.
        let _ = write_field(
            if field.name() == "message" { &mut self.message } else { &mut self.fields },
            field.name(),
            value,
        );
    }
}
