//! The topics of others that are recorded, and how often.

/// Takes one message in each period of its stamps: the same instants on every topic of one period.
pub struct Thinning {
    period_ns: i64,
    slot: Option<i64>,
}

impl Thinning {
    /// For one topic.
    pub fn new(period_ns: i64) -> Self {
        Self { period_ns, slot: None }
    }

    /// Whether a message with this stamp goes into the bag.
    pub fn takes(&mut self, stamp_ns: i64) -> bool {
        let slot = Some(stamp_ns.div_euclid(self.period_ns));
        std::mem::replace(&mut self.slot, slot) != slot
    }
}

/// Time from one message of a thinned topic to the next, ns.
pub const THINNED_NS: i64 = 10_000_000;
pub(super) const ODOM: &str = "odom";
pub(super) const GROUND_TRUTH: &str = "ground_truth/odom";
pub(super) const GROUND_FORCE: &str = "ground_force";
pub(super) const TF: &str = "tf";
/// The topic of the node's own diagnostics in the bag.
pub const DIAGNOSTICS: &str = "diagnostics";
/// The topic of the inertial unit in the bag.
pub const IMU: &str = "imu";
