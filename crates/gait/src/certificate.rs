//! What is known of a gait's quality: how its solve ended, and how it stands by itself.

use crate::{Gait, GaitError, SolverSummary};

impl SolverSummary {
    /// Whether the solver came to a gait that keeps its constraints. Interpolated ones are not solved.
    pub fn is_solution(&self) -> bool {
        matches!(self.status.as_str(), "converged" | "acceptable")
    }
}

/// The certificate of a gait: what its step's linearised map says of small disturbances, and whether the touchdown by
/// the clock that the map takes for granted can be had.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Certificate {
    /// Hermite–Simpson points of the program that the plan came from: more than were asked for where it was solved
    /// again.
    pub points: u32,
    /// Largest modulus of the step-to-step map's multipliers under the tracking law, or of the stride's where the
    /// second step is no mirror image: below 1 a small disturbance shrinks while toes land by the clock.
    pub largest_multiplier: f64,
    /// How far from its place a swing toe would meet a floor that is 1 % of the nominal height higher, m. A toe that
    /// skims the floor before it lands is held back by it, and touchdown is not by the clock.
    pub landing_run_m: f64,
    /// Whether both say that the gait stands by itself.
    pub stable: bool,
}

impl Gait {
    pub(crate) fn check_certificate(&self) -> Result<(), GaitError> {
        let Some(c) = &self.certificate else { return Ok(()) };
        for (field, value) in
            [("certificate.largest_multiplier", c.largest_multiplier), ("certificate.landing_run_m", c.landing_run_m)]
        {
            if !(value.is_finite() && value >= 0.0) {
                return Err(self.refuse(field, format!("is {value}, expected a number of at least 0")));
            }
        }
        // Whoever reads the word alone must not be told what the figure denies.
        if c.stable && c.largest_multiplier >= 1.0 {
            let problem = format!("is true, expected false with a largest multiplier of {}", c.largest_multiplier);
            return Err(self.refuse("certificate.stable", problem));
        }
        Ok(())
    }
}
