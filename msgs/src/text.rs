//! Text that came from elsewhere, made fit to be logged, answered or shown.

use std::borrow::Cow;
use std::fmt::Write as _;

/// Longest name that is repeated in a sentence, in characters. ROS 2's own names end at 255.
pub const NAME_CHARS: usize = 255;
/// Longest sentence that repeats somebody else's text, in characters.
pub const SENTENCE_CHARS: usize = 1000;

/// Whether a character moves the cursor, colours the terminal, begins a line, or changes or hides its neighbours.
fn is_treacherous(c: char) -> bool {
    c.is_control()
        || matches!(c,
            '\u{61c}' | '\u{200b}' | '\u{200e}' | '\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2060}'..='\u{206f}'
            | '\u{feff}' | '\u{fff9}'..='\u{fffb}' | '\u{e0000}'..='\u{e007f}')
}

/// A text in one line that says what it is: control characters, line ends, terminal sequences and signs that turn the
/// direction of writing come out escaped as in Rust (`\n`, `\u{1b}`), and what is longer than `most_chars` ends in an
/// ellipsis. Remote text goes through this before it enters a log line, an answer or a terminal: else a name could fake
/// a line of the log.
pub fn printable(text: &str, most_chars: usize) -> Cow<'_, str> {
    if !text.contains(is_treacherous) && (text.len() <= most_chars || text.chars().nth(most_chars).is_none()) {
        return Cow::Borrowed(text);
    }
    let mut shown = String::with_capacity(text.len().min(4 * most_chars));
    // What is escaped is longer than it was: the bound is on what comes out.
    let mut count = 0;
    for c in text.chars() {
        let before = shown.len();
        if is_treacherous(c) {
            // Writing to a String cannot fail.
            let _ = write!(shown, "{}", c.escape_default());
            count += shown.len() - before;
        } else {
            shown.push(c);
            count += 1;
        }
        if count > most_chars {
            shown.truncate(before);
            shown.push('…');
            break;
        }
    }
    Cow::Owned(shown)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_with_a_newline_fakes_no_line_and_no_terminal_obeys_it() {
        let shown = printable("trot\n[INFO] armed \u{1b}[2J\r\u{202e}x\u{2028}\u{9b}", 100);
        assert_eq!(shown, r"trot\n[INFO] armed \u{1b}[2J\r\u{202e}x\u{2028}\u{9b}");
        assert_eq!(printable(&shown, 100), shown, "twice is once");
        for treacherous in (0..=char::MAX as u32).filter_map(char::from_u32).filter(|c| c.is_control()) {
            assert!(!printable(&treacherous.to_string(), 100).contains(treacherous), "{treacherous:?}");
        }
    }

    #[test]
    fn a_text_stays_itself_up_to_its_bound_and_then_ends_in_an_ellipsis() {
        for (text, most, expected) in [
            ("Läufer 4", 8, "Läufer 4"),
            ("Läufer 4", 7, "Läufer …"),
            ("", 0, ""),
            ("a", 0, "…"),
            ("ab\n", 3, "ab…"),
            ("ab\n", 4, r"ab\n"),
        ] {
            assert_eq!(printable(text, most), expected, "{text:?} to {most}");
        }
        let long = "x".repeat(20 << 20);
        assert_eq!(printable(&long, SENTENCE_CHARS).chars().count(), SENTENCE_CHARS + 1);
    }
}
