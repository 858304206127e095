//! A phase of a walk in which the same legs stand, with its own duration and polynomials.

use joints::{JOINTS, LEG_NAMES, LEGS};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use crate::bezier::{self, Coefficients};

/// A phase of the stride in which the same legs stand.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Domain {
    /// Which legs stand; in the file their names, in ascending order.
    #[serde(rename = "stance_legs", with = "stance_legs")]
    pub stands: [bool; LEGS],
    /// How long, s.
    pub duration_s: f64,
    /// The planned joints' polynomials over the domain, rad.
    #[serde(rename = "coefficients_rad")]
    pub planned_rad: [Coefficients; JOINTS],
    /// The polynomials that the tracking law follows, rad.
    #[serde(rename = "reference_coefficients_rad")]
    pub reference_rad: [Coefficients; JOINTS],
}

impl Domain {
    /// The planned joints at phase `s` ∈ [0, 1] of the domain: positions rad, velocities rad/s. Does not allocate.
    pub fn planned(&self, s: f64) -> ([f64; JOINTS], [f64; JOINTS]) {
        evaluate(&self.planned_rad, self.duration_s, s)
    }

    /// What the tracking law follows at phase `s` ∈ [0, 1] of the domain: positions rad, velocities rad/s. Does not
    /// allocate.
    pub fn reference(&self, s: f64) -> ([f64; JOINTS], [f64; JOINTS]) {
        evaluate(&self.reference_rad, self.duration_s, s)
    }
}

/// Positions, rad, and velocities, rad/s, of polynomials that take `duration_s`. Does not allocate.
pub(crate) fn evaluate(rows: &[Coefficients; JOINTS], duration_s: f64, s: f64) -> ([f64; JOINTS], [f64; JOINTS]) {
    let (value, slope) = (bezier::basis(s), bezier::basis_first_derivative(s));
    let position = std::array::from_fn(|j| bezier::combine(&rows[j], &value));
    let velocity = std::array::from_fn(|j| bezier::combine(&rows[j], &slope) / duration_s);
    (position, velocity)
}

/// The legs that stand, by name.
mod stance_legs {
    use super::*;

    pub fn serialize<S: Serializer>(stands: &[bool; LEGS], serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_seq((0..LEGS).filter(|leg| stands[*leg]).map(|leg| LEG_NAMES[leg]))
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<[bool; LEGS], D::Error> {
        let mut stands = [false; LEGS];
        for name in Vec::<String>::deserialize(deserializer)? {
            let leg = LEG_NAMES.iter().position(|leg| *leg == name);
            match leg.map(|leg| std::mem::replace(&mut stands[leg], true)) {
                Some(false) => {}
                Some(true) => return Err(serde::de::Error::custom(format!("stance_legs names {name} twice"))),
                None => {
                    let problem = format!("stance_legs names \"{name}\", expected some of {LEG_NAMES:?}");
                    return Err(serde::de::Error::custom(problem));
                }
            }
        }
        Ok(stands)
    }
}
