//! Numbers as a page holds them.

use serde_json::{Value, json};

/// Enough digits for a screen.
pub(crate) fn rounded(value: f64, step: f64) -> f64 {
    let rounded = (value / step).round() * step;
    // The multiplication leaves digits behind the last one that is meant.
    format!("{rounded:.6}").parse().unwrap_or(rounded)
}

/// As many of them.
pub(crate) fn list(values: impl Iterator<Item = f64>, step: f64) -> Vec<Value> {
    values.map(|value| json!(rounded(value, step))).collect()
}
