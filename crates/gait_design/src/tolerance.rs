//! How far a plan may be off: one tolerance for each kind of quantity, in the robot's own measure, wherever the
//! quantity is looked at. What is refused between the points and what `--verify` asks of the simulated step are the
//! same figures.

use gait::Gait;
use robot::Robot;

/// Shares: of the nominal height (0.99 mm on the Vision 60), of a joint's velocity limit, of the torque bound asked
/// for (1 N m of 50), of the weight (1.9 N of 373).
const LENGTH_SHARE: f64 = 1.8e-3;
const VELOCITY_SHARE: f64 = 5e-3;
const TORQUE_SHARE: f64 = 0.02;
const FORCE_SHARE: f64 = 5e-3;
/// An angle's, of what the tracking law answers with its torque's tolerance.
const ANGLE_SHARE: f64 = 0.3;

/// What counts as kept.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Tolerances {
    /// Of a joint's angle, rad: what the tracking law answers with 0.3 of its torque's tolerance (1.0e-3 rad on the
    /// Vision 60 at 50 N m).
    pub angle_rad: f64,
    /// Of a toe's place, m.
    pub length_m: f64,
    /// Of each joint type's velocity, rad/s.
    pub velocity_rad_s: [f64; 3],
    /// Of each joint type's torque, N m.
    pub torque_nm: [f64; 3],
    /// Of a ground force, N.
    pub force_n: f64,
}

impl Tolerances {
    /// Those of a gait.
    #[must_use]
    pub fn of_gait(robot: &Robot, gait: &Gait) -> Self {
        Self::of(robot, std::array::from_fn(|k| gait.torque_limit_nm[k]))
    }

    /// Those of a robot whose plan has this torque bound of each joint type.
    #[must_use]
    pub fn of(robot: &Robot, torque_limit_nm: [f64; 3]) -> Self {
        let weight_n = robot.model.total_mass() * robot.model.gravity.norm();
        let torque_nm = torque_limit_nm.map(|limit| TORQUE_SHARE * limit);
        let angles_rad = torque_nm.iter().zip(robot.gains.kp_nm_per_rad).map(|(torque, kp)| ANGLE_SHARE * torque / kp);
        Self {
            angle_rad: angles_rad.fold(f64::INFINITY, f64::min),
            length_m: LENGTH_SHARE * robot.nominal.height_m,
            velocity_rad_s: robot.limits.velocity_rad_s.map(|limit| VELOCITY_SHARE * limit),
            torque_nm,
            force_n: FORCE_SHARE * weight_n,
        }
    }
}
