//! How far the body may be moved while the robot stands.

/// How far the body may be asked to move; nothing where the legs' kinematics are not known.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BodyRange {
    /// Lowest and highest, m.
    pub height_m: [f64; 2],
    /// Largest roll, pitch and yaw to either side, rad.
    pub angle_rad: [f64; 3],
}

impl BodyRange {
    /// For a robot whose hips are so high above its toes: what leaves room for the joints and keeps the weight far
    /// inside the feet.
    pub fn for_height(height_m: f64) -> Self {
        Self { height_m: [-0.25 * height_m, 0.1 * height_m], angle_rad: [0.25, 0.25, 0.3] }
    }

    /// What is wrong with it: a range without the pose that is held, or one of more than half a turn's third.
    pub(crate) fn problem(&self) -> Option<String> {
        let [low, high] = self.height_m;
        let angles = self.angle_rad.iter().all(|angle| (0.0..=1.0).contains(angle));
        let fine = angles && low <= 0.0 && high >= 0.0 && high - low <= 2.0;
        (!fine).then(|| format!("is {self:?}, expected heights around 0 and angles from 0 to 1 rad"))
    }

    /// Of height, roll, pitch or yaw, by their number.
    pub(crate) fn least_and_most(&self, k: usize) -> [f64; 2] {
        if k == 0 { self.height_m } else { [-self.angle_rad[k - 1], self.angle_rad[k - 1]] }
    }

    /// The nearest pose within it.
    pub(crate) fn clamped(&self, pose: &[f64; 4]) -> [f64; 4] {
        std::array::from_fn(|k| {
            let [least, most] = self.least_and_most(k);
            pose[k].clamp(least, most)
        })
    }
}
