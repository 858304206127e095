//! The left–right symmetry of a quadruped: the one place that says how coordinates are mirrored.

use crate::{JOINTS, JOINTS_PER_LEG, LEGS};

/// Coordinates of the base before those of the joints: x, y, z, roll, pitch, yaw.
const BASE: usize = 6;
/// Signs of the base's coordinates under the mirror.
const BASE_SIGN: [f64; BASE] = [1.0, -1.0, 1.0, -1.0, 1.0, -1.0];

/// The left–right mirror: joint k of leg i of the mirrored robot is `sign[k]` times joint k of leg `leg[i]`. Under it
/// y, roll and yaw of the base change sign, of its velocities too.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Mirror {
    /// For each leg, the leg it is mirrored from.
    pub leg: [usize; LEGS],
    /// Sign of hip roll, hip pitch, knee.
    pub sign: [f64; JOINTS_PER_LEG],
}

impl Mirror {
    /// For joint `row`: the joint it is mirrored from and the sign.
    pub fn source(&self, row: usize) -> (usize, f64) {
        let (leg, joint) = (row / JOINTS_PER_LEG, row % JOINTS_PER_LEG);
        (self.leg[leg] * JOINTS_PER_LEG + joint, self.sign[joint])
    }

    /// For coordinate `row` of 18, the base's six before the joints: the coordinate it is mirrored from and the sign.
    pub fn coordinate_source(&self, row: usize) -> (usize, f64) {
        if row < BASE {
            return (row, BASE_SIGN[row]);
        }
        let (from, sign) = self.source(row - BASE);
        (BASE + from, sign)
    }

    /// The same for a biped of one left and one right leg, the base's six coordinates before theirs: 12 in all.
    pub fn biped_coordinate_source(&self, row: usize) -> (usize, f64) {
        if row < BASE {
            return (row, BASE_SIGN[row]);
        }
        let (leg, joint) = ((row - BASE) / JOINTS_PER_LEG, (row - BASE) % JOINTS_PER_LEG);
        (BASE + (1 - leg) * JOINTS_PER_LEG + joint, self.sign[joint])
    }

    /// Joint positions, velocities or torques of the mirrored robot.
    pub fn apply(&self, joints: &[f64; JOINTS]) -> [f64; JOINTS] {
        std::array::from_fn(|row| {
            let (from, sign) = self.source(row);
            sign * joints[from]
        })
    }

    /// Coordinates or velocities, the base's six before the joints', of the mirrored robot.
    pub fn coordinates(&self, q: &[f64; BASE + JOINTS]) -> [f64; BASE + JOINTS] {
        std::array::from_fn(|row| {
            let (from, sign) = self.coordinate_source(row);
            sign * q[from]
        })
    }

    /// A leg's three joints as the leg across has them.
    pub fn leg_image(&self, joints: &[f64; JOINTS_PER_LEG]) -> [f64; JOINTS_PER_LEG] {
        std::array::from_fn(|joint| self.sign[joint] * joints[joint])
    }
}

/// A vector in the base's axes (x ahead, y left), mirrored.
pub const fn mirrored_vector([x, y, z]: [f64; 3]) -> [f64; 3] {
    [x, -y, z]
}

#[cfg(test)]
mod tests {
    use super::*;

    const MIRROR: Mirror = Mirror { leg: [2, 3, 0, 1], sign: [-1.0, 1.0, 1.0] };

    #[test]
    fn what_is_mirrored_twice_is_as_it_was() {
        let q: [f64; 18] = std::array::from_fn(|i| 1.0 + i as f64);
        assert_eq!(MIRROR.coordinates(&MIRROR.coordinates(&q)), q);
        for row in 0..12 {
            let (from, sign) = MIRROR.biped_coordinate_source(row);
            assert_eq!(MIRROR.biped_coordinate_source(from), (row, sign));
        }
    }

    #[test]
    fn base_joints_and_whole_robot_agree() {
        let q: [f64; 18] = std::array::from_fn(|i| 1.0 + i as f64);
        let mirrored = MIRROR.coordinates(&q);
        assert_eq!(mirrored[..6], [1.0, -2.0, 3.0, -4.0, 5.0, -6.0]);
        let joints: [f64; 12] = q[6..].try_into().unwrap();
        assert_eq!(mirrored[6..], MIRROR.apply(&joints));
        // Front left takes the place of front right.
        assert_eq!(mirrored[12..15], MIRROR.leg_image(&[7.0, 8.0, 9.0]));
    }
}
