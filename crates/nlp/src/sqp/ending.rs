//! When a solve ends, and how it ended.

use super::Violation;

/// When to stop and how.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// Converged: the objective that the last subproblem still promises to gain, relative to max(1, |f|), is at most
    /// this.
    pub objective_tolerance: f64,
    /// Converged: no constraint is broken by more than this, in its own unit.
    pub constraint_tolerance: f64,
    /// Acceptable: as `objective_tolerance`, at every one of the last `acceptable_iterations` points.
    pub acceptable_tolerance: f64,
    /// So many iterations in a row with `constraint_tolerance` and `acceptable_tolerance` end a solve whose tail
    /// stalls.
    pub acceptable_iterations: u32,
    /// Give up after so many iterations.
    pub max_iterations: u32,
    /// Multiplies the objective inside the subproblems, so that their absolute tolerance of 1e-8 fits it.
    pub objective_scale: f64,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            objective_tolerance: 1e-8,
            constraint_tolerance: 1e-6,
            acceptable_tolerance: 1e-6,
            acceptable_iterations: 20,
            max_iterations: 100,
            objective_scale: 1.0,
        }
    }
}

impl Settings {
    pub(super) fn check(&self) -> Result<(), SettingsError> {
        for (name, value) in [
            ("objective_tolerance", self.objective_tolerance),
            ("constraint_tolerance", self.constraint_tolerance),
            ("acceptable_tolerance", self.acceptable_tolerance),
            ("objective_scale", self.objective_scale),
        ] {
            if !(value > 0.0 && value.is_finite()) {
                return Err(SettingsError { name, value, expected: "a positive number" });
            }
        }
        for (name, value) in
            [("max_iterations", self.max_iterations), ("acceptable_iterations", self.acceptable_iterations)]
        {
            if value == 0 {
                return Err(SettingsError { name, value: 0.0, expected: "at least 1" });
            }
        }
        Ok(())
    }
}

/// A setting that no solve can run with.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("solver setting {name} is {value}, expected {expected}")]
pub struct SettingsError {
    name: &'static str,
    value: f64,
    expected: &'static str,
}

/// How a solve ended. Only [`Status::Converged`] and [`Status::Acceptable`] are solutions.
#[derive(Clone, Debug, PartialEq)]
pub enum Status {
    /// Both tolerances hold.
    Converged,
    /// The constraints hold as if converged; of the objective a little more could have been gained, by steps too
    /// short to go on with.
    Acceptable,
    /// No point near here satisfies the constraints, the worst first.
    Infeasible {
        /// Constraints that are broken where the violation is smallest.
        fighting: Vec<Violation>,
    },
    /// The iterations ran out.
    IterationLimit,
    /// No progress was possible.
    NumericalTrouble {
        /// What failed.
        reason: String,
    },
    /// The caller asked to stop.
    Cancelled,
}

impl Status {
    /// Whether the last point is a solution.
    pub fn is_solution(&self) -> bool {
        matches!(self, Self::Converged | Self::Acceptable)
    }
}

impl std::fmt::Display for Status {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Converged => f.write_str("converged"),
            Self::Acceptable => f.write_str("acceptable"),
            Self::Infeasible { .. } => f.write_str("infeasible"),
            Self::IterationLimit => f.write_str("iteration limit"),
            Self::NumericalTrouble { reason } => write!(f, "numerical trouble: {reason}"),
            Self::Cancelled => f.write_str("cancelled"),
        }
    }
}
