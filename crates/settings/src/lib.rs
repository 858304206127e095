//! Numbers that a user may set: name, default, range, unit and text, each declared once.
//!
//! Libraries check their configuration by them, nodes declare parameters by them, and the command line takes its
//! defaults from them.

use std::fmt;

/// A number that a user may set.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Setting {
    /// Its name, with the unit: `start_blend_s`.
    pub name: &'static str,
    /// Its value where nobody sets it.
    pub default: f64,
    /// Least value.
    pub least: f64,
    /// Greatest value.
    pub greatest: f64,
    /// Its unit; empty for a plain number.
    pub unit: &'static str,
    /// What it is, in a sentence.
    pub text: &'static str,
}

/// A value outside of its range. NaN is in no range.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error(
    "is {}, expected {} to {}",
    Quantity(*value, setting.unit),
    setting.least,
    Quantity(setting.greatest, setting.unit)
)]
pub struct OutOfRange {
    /// The setting.
    pub setting: Setting,
    /// The value that was given.
    pub value: f64,
}

impl Setting {
    /// Checks a value.
    ///
    /// # Errors
    /// If it is out of range or NaN.
    pub fn check(&self, value: f64) -> Result<(), OutOfRange> {
        if (self.least..=self.greatest).contains(&value) { Ok(()) } else { Err(OutOfRange { setting: *self, value }) }
    }
}

/// A number with its unit, for people.
#[derive(Clone, Copy, Debug)]
pub struct Quantity<T>(pub T, pub &'static str);

impl<T: fmt::Display> fmt::Display for Quantity<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.0)?;
        if self.1.is_empty() { Ok(()) } else { write!(f, " {}", self.1) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PATIENCE_S: Setting =
        Setting { name: "patience_s", default: 1.0, least: 0.5, greatest: 2.0, unit: "s", text: "How long it waits." };

    #[test]
    fn both_ends_are_in_the_range_and_nan_is_not() {
        assert_eq!(PATIENCE_S.check(0.5), Ok(()));
        assert_eq!(PATIENCE_S.check(2.0), Ok(()));
        assert_eq!(PATIENCE_S.check(2.1).unwrap_err().to_string(), "is 2.1 s, expected 0.5 to 2 s");
        assert_eq!(PATIENCE_S.check(f64::NAN).unwrap_err().to_string(), "is NaN s, expected 0.5 to 2 s");
        let plain = Setting { unit: "", ..PATIENCE_S };
        assert_eq!(plain.check(0.0).unwrap_err().to_string(), "is 0, expected 0.5 to 2");
    }
}
