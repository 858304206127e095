//! What the balanced law says of itself.

/// What the law did in its last cycle, for those who watch.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BalanceReport {
    /// How far the body is from where the plan has it, its velocity counted as 1/λ of it, ahead and to the left, m.
    pub error_m: [f64; 2],
    /// Where the swing toes are placed beyond the plan, ahead and to the left, m.
    pub placement_m: [f64; 2],
    /// Pace of the step against the gait's own.
    pub pace: f64,
    /// The placement is at its range's end, or a leg cannot reach.
    pub placement_limited: bool,
    /// The step cannot be hurried as it should be.
    pub hurry_limited: bool,
    /// The ground's rise over run, ahead and to the left.
    pub rise: [f64; 2],
}
