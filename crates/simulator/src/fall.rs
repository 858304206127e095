//! How a walk can end on the ground.

/// How the run has ended, if it has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fall {
    /// The base is lower than 0.6 of its height at the reset.
    Low,
    /// The base is rolled or pitched by more than 0.8 rad.
    Tilted,
    /// A position or velocity is not a finite number.
    NotFinite,
}

impl std::fmt::Display for Fall {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Low => "the body came down",
            Self::Tilted => "the body tilted over",
            Self::NotFinite => "the simulation diverged",
        })
    }
}
