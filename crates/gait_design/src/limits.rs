//! Bounds that the decomposed and the full-order program share: what a robot, a request and the settings allow at a
//! point.

use crate::Tolerances;
use crate::request::GaitRequest;
use robot::Robot;

/// Settings of the program that are no part of a request.
#[derive(Clone, Debug, PartialEq)]
pub struct ProgramSettings {
    /// Hermite–Simpson points, 2N + 1: odd, 5 to 161; more where the plan breaks something between them.
    pub points: usize,
    /// Weight of ‖u‖² over all twelve torques, 1/(N m)². It settles the internal force along the stance diagonal; left
    /// out on any leg, that force builds up and the gait falls.
    pub torque_weight: f64,
    /// Weight of ‖q̈_f‖².
    pub acceleration_weight: f64,
    /// How far the body may leave the height asked for, m.
    pub height_tolerance_m: f64,
    /// How far the distance between the two stance toes may differ from the one asked for, m.
    pub toe_distance_tolerance_m: f64,
    /// Smallest normal force of a stance toe, as a share of the robot's weight.
    pub normal_force_min_share: f64,
    /// Bound of roll, pitch and yaw, rad.
    pub orientation_limit_rad: f64,
    /// How far the swing toes may miss the clearance in the middle of the step, m.
    pub clearance_tolerance_m: f64,
    /// How far above the clearance a swing toe may ever be, m.
    pub clearance_margin_m: f64,
}

impl Default for ProgramSettings {
    fn default() -> Self {
        Self {
            points: 11,
            torque_weight: 1e-6,
            acceleration_weight: 1e-7,
            height_tolerance_m: 0.01,
            toe_distance_tolerance_m: 0.005,
            // 30 N on the Vision 60.
            normal_force_min_share: 30.0 / (38.0 * 9.81),
            orientation_limit_rad: 0.3,
            clearance_tolerance_m: 0.005,
            clearance_margin_m: 0.01,
        }
    }
}

/// Bounds of one request on one robot; pairs are (lower, upper).
#[derive(Clone, Debug, Default)]
pub(crate) struct Limits {
    settings: ProgramSettings,
    clearance_m: f64,
    /// T, s.
    pub step_duration_s: [f64; 2],
    /// How far the base may be from where it starts along x, in one step, m.
    pub reach_m: f64,
    /// Of the base's y, z, roll, pitch, yaw, m and rad.
    pub base: [[f64; 5]; 2],
    /// Of the base's velocity, m/s and rad/s, either way.
    pub base_rate: [f64; 6],
    /// Of the base's acceleration, m/s² and rad/s², either way.
    pub base_acceleration: [f64; 6],
    /// Of hip roll's, hip pitch's and knee's velocity, rad/s, either way: within the robot's limit by what may be
    /// beyond it between the points, for the controller walks no gait that is.
    pub joint_rate_rad_s: [f64; 3],
    /// By how much joints are inside their range at the points, rad: what their polynomials may depart from them in
    /// between.
    pub joint_inward_rad: f64,
    /// Of a joint's acceleration, rad/s², either way.
    pub joint_acceleration_rad_s2: f64,
    /// Of hip roll's, hip pitch's and knee's torque, N m, either way.
    pub torque_nm: [f64; 3],
    /// Of the force on a stance toe, N.
    pub force_n: [[f64; 3]; 2],
    /// How far a toe may land from its foothold along x and along y, m.
    pub foothold_tolerance_m: f64,
    /// Of the squared distance between the stance toes, m².
    pub toe_distance_squared_m2: [f64; 2],
}

impl Limits {
    /// `toe_distance_m` is the distance between the stance toes that the request asks for.
    pub fn of(robot: &Robot, request: &GaitRequest, settings: &ProgramSettings, toe_distance_m: f64) -> Self {
        let t = request.step_duration_s;
        let relative = GaitRequest::STEP_DURATION_TOLERANCE;
        let (height, height_spare) = (request.height_m, settings.height_tolerance_m);
        let angle = settings.orientation_limit_rad;
        let toe_spare = settings.toe_distance_tolerance_m;
        let tolerances = Tolerances::of(robot, request.torque_limit_nm);
        Self {
            clearance_m: request.clearance_m,
            step_duration_s: [t * (1.0 - relative), t * (1.0 + relative)],
            reach_m: 0.5 + (request.speed_m_s * t).abs(),
            base: [
                [-0.3, height - height_spare, -angle, -angle, -angle],
                [0.3, height + height_spare, angle, angle, angle],
            ],
            // Far outside what a gait needs; they only keep the first subproblems from running away.
            base_rate: [4.0, 4.0, 4.0, 6.0, 6.0, 6.0],
            base_acceleration: [100.0, 100.0, 100.0, 300.0, 300.0, 300.0],
            joint_rate_rad_s: std::array::from_fn(|k| robot.limits.velocity_rad_s[k] - tolerances.velocity_rad_s[k]),
            joint_inward_rad: tolerances.angle_rad,
            joint_acceleration_rad_s2: 3000.0,
            torque_nm: request.torque_limit_nm,
            force_n: [[-1e3, -1e3, settings.normal_force_min_share * robot.model.total_mass() * 9.81], [1e3, 1e3, 3e3]],
            foothold_tolerance_m: toe_spare,
            toe_distance_squared_m2: [(toe_distance_m - toe_spare).powi(2), (toe_distance_m + toe_spare).powi(2)],
            settings: settings.clone(),
        }
    }

    /// Of a swing toe's height at a point of a step, m.
    pub fn swing_height_m(&self, point: usize, points: usize) -> [f64; 2] {
        let last = points - 1;
        let (clearance, s) = (self.clearance_m, &self.settings);
        let phase = point as f64 / last as f64;
        if point == 0 || point == last {
            // Implied by how the step ends; stated loosely only to keep the first subproblems sensible.
            [-0.05, 0.05]
        } else if 2 * point == last {
            [clearance - s.clearance_tolerance_m, clearance + s.clearance_tolerance_m]
        } else if (0.2..=0.8).contains(&phase) {
            [1.2 * clearance * phase * (1.0 - phase), clearance + s.clearance_margin_m]
        } else {
            [0.0, clearance + s.clearance_margin_m]
        }
    }
}

/// Points that keep the ÿ row of the stance hip roll: with y = ẏ = 0 at the first point four determine its six
/// coefficients, and every further one repeats the fixed distance of the stance toes.
pub(crate) fn keeps_stance_roll(point: usize, points: usize) -> bool {
    (1..=4).any(|k| (k * (points - 1)) / 5 == point)
}
