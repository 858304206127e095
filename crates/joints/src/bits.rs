//! Writing numbers down so that every one of them, also one that is none, comes back to the bit:
//! `#[serde(with = "joints::bits")]`.

use serde::{Deserialize, Deserializer, Serializer};

/// Writes a number as its bits.
///
/// # Errors
/// As the serializer.
pub fn serialize<S: Serializer>(value: &f64, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_u64(value.to_bits())
}

/// Reads a number that was written as its bits.
///
/// # Errors
/// As the deserializer.
pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    u64::deserialize(deserializer).map(f64::from_bits)
}
