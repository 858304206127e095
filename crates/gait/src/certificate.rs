//! What is known of a gait's quality: how its solve ended, and how it stands by itself.

use crate::error::GaitError;
use crate::types::{Gait, SolverSummary};

impl SolverSummary {
    /// Whether the solver came to a gait that keeps its constraints. Interpolated ones are not solved.
    pub fn is_solution(&self) -> bool {
        matches!(self.status.as_str(), "converged" | "acceptable")
    }
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
        // Whoever reads the word alone must not read what the figure denies.
        if c.stable && c.largest_multiplier >= 1.0 {
            let problem = format!("is true, expected false with a largest multiplier of {}", c.largest_multiplier);
            return Err(self.refuse("certificate.stable", problem));
        }
        Ok(())
    }
}
