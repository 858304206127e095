//! Figures of the paper that a run is compared with.

use gait::JOINTS_PER_LEG;

/// One behaviour's column of Table II (Ma & Ames 2020): mean absolute torque of hip roll, hip pitch, knee, N m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TableTwo {
    /// The behaviour.
    pub gait: &'static str,
    /// On the robot.
    pub experiment_nm: [f64; JOINTS_PER_LEG],
    /// In the authors' MuJoCo simulation.
    pub mujoco_nm: [f64; JOINTS_PER_LEG],
}

#[expect(clippy::approx_constant, reason = "6.28 is a torque here")]
const TABLE_TWO: [TableTwo; 5] = [
    TableTwo { gait: "gait1", experiment_nm: [5.04, 3.65, 16.45], mujoco_nm: [7.80, 6.78, 18.49] },
    TableTwo { gait: "gait2", experiment_nm: [4.83, 5.24, 16.50], mujoco_nm: [9.23, 9.14, 18.38] },
    TableTwo { gait: "gait3", experiment_nm: [4.16, 5.26, 16.86], mujoco_nm: [10.27, 10.71, 18.45] },
    TableTwo { gait: "gait4", experiment_nm: [5.14, 3.77, 16.95], mujoco_nm: [8.68, 6.64, 18.61] },
    TableTwo { gait: "amble", experiment_nm: [7.11, 6.28, 18.36], mujoco_nm: [8.06, 7.27, 19.03] },
];

/// The robot of the paper: its torques are of no use beside another's.
const ROBOT: &str = "vision60";

/// The column of a behaviour, if the paper has one of that name and the robot is the paper's.
pub fn table_two(robot: &str, gait: &str) -> Option<TableTwo> {
    TABLE_TWO.into_iter().find(|column| robot == ROBOT && column.gait == gait)
}

#[cfg(test)]
mod tests {
    use super::table_two;

    #[test]
    fn table_two_is_the_vision60s_alone() {
        assert_eq!(table_two("vision60", "gait1").map(|column| column.mujoco_nm), Some([7.80, 6.78, 18.49]));
        assert_eq!(table_two("go2", "gait1"), None);
        assert_eq!(table_two("vision60", "trot"), None);
    }
}
