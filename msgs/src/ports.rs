//! The gait message and the gait: planner, controller and recorder convert here, in one place.

use gait::bezier::DEGREE;
use gait::{Certificate, Coefficients, InitialState, JOINTS, Mirror, SecondStep, SolverSummary};

use crate::geometry_msgs::{Point, Pose, Quaternion, Twist, Vector3};
use crate::std_msgs::Header;
use crate::{Gait, SolverReport};

/// Version of the gait message's schema, that of the gait file: 1, or 2 with a second step of its own.
pub const GAIT_VERSION: u32 = gait::FILE_VERSION as u32;
const GAIT_VERSION_TWO_STEPS: u32 = gait::FILE_VERSION_TWO_STEPS as u32;

/// Why a gait message was refused.
#[derive(Debug, thiserror::Error)]
pub enum GaitMessageError {
    /// Another version.
    #[error(
        "gait message: version is {found}, expected {GAIT_VERSION} or {GAIT_VERSION_TWO_STEPS}: run planner and controller of one release"
    )]
    Version {
        /// What the message says.
        found: u32,
    },
    /// Another polynomial degree.
    #[error("gait message \"{gait}\": bezier_degree is {found}, expected {DEGREE}")]
    Degree {
        /// The gait's name.
        gait: String,
        /// What the message says.
        found: u8,
    },
    /// A second step in a version that has none, or none in one that has.
    #[error(
        "gait message \"{gait}\": version {version} with {found} second coefficients: version {GAIT_VERSION} has none, version {GAIT_VERSION_TWO_STEPS} a second step"
    )]
    SecondStep {
        /// The gait's name.
        gait: String,
        /// What the message says.
        version: u32,
        /// How many coefficients there are.
        found: usize,
    },
    /// An array of another length.
    #[error("gait message \"{gait}\": {field} has {found} entries, expected {expected}")]
    Length {
        /// The gait's name.
        gait: String,
        /// Which field.
        field: &'static str,
        /// How many there are.
        found: usize,
        /// How many there must be.
        expected: usize,
    },
    /// The request is not JSON.
    #[error("gait message \"{gait}\": request_json is not JSON: {reason}")]
    Request {
        /// The gait's name.
        gait: String,
        /// The parser's reason.
        reason: String,
    },
    /// The values are none of a gait that can be walked.
    #[error(transparent)]
    Gait(#[from] gait::GaitError),
}

fn vector3([x, y, z]: [f64; 3]) -> Vector3 {
    Vector3 { x, y, z }
}

impl Gait {
    /// The message of a gait. The header's stamp is the sender's to set.
    #[must_use]
    pub fn from_gait(gait: &gait::Gait) -> Self {
        let [x, y, z] = gait.initial.base_position_m;
        let [qx, qy, qz, qw] = gait.initial.base_quaternion_xyzw;
        let flat = |rows: Option<&[Coefficients; JOINTS]>| rows.map_or(Vec::new(), |rows| rows.as_flattened().to_vec());
        let second = gait.second_step.as_ref();
        Gait {
            header: Header { frame_id: "odom".to_string(), ..Header::default() },
            version: if second.is_some() { GAIT_VERSION_TWO_STEPS } else { GAIT_VERSION },
            robot: gait.robot.clone(),
            name: gait.name.clone(),
            joint_names: gait.joint_names.to_vec(),
            step_duration_s: gait.step_duration_s,
            step_length_m: gait.step_length_m,
            bezier_degree: DEGREE as u8,
            coefficients_rad: gait.coefficients_rad.as_flattened().to_vec(),
            reference_coefficients_rad: gait.reference_coefficients_rad.as_flattened().to_vec(),
            second_coefficients_rad: flat(second.map(|s| &s.coefficients_rad)),
            second_reference_coefficients_rad: flat(second.map(|s| &s.reference_coefficients_rad)),
            // Below four: a mirror is a permutation of the legs.
            mirror_leg: gait.mirror.leg.iter().map(|leg| *leg as u8).collect(),
            mirror_sign: gait.mirror.sign.to_vec(),
            initial_base_pose: Pose {
                position: Point { x, y, z },
                orientation: Quaternion { x: qx, y: qy, z: qz, w: qw },
            },
            initial_base_twist: Twist {
                linear: vector3(gait.initial.base_linear_velocity_world),
                angular: vector3(gait.initial.base_angular_velocity_body),
            },
            initial_joint_position_rad: gait.initial.joint_position_rad.to_vec(),
            initial_joint_velocity_rad_s: gait.initial.joint_velocity_rad_s.to_vec(),
            kp: gait.kp.to_vec(),
            kd: gait.kd.to_vec(),
            torque_limit_nm: gait.torque_limit_nm.to_vec(),
            request_json: gait.request.to_string(),
            solver: SolverReport {
                status: gait.solver.status.clone(),
                iterations: gait.solver.iterations,
                solve_time_s: gait.solver.solve_time_s,
                max_violation: gait.solver.max_violation,
                objective: gait.solver.objective,
                worst_constraint: String::new(),
            },
            points: gait.certificate.map_or(0, |c| c.points),
            largest_multiplier: gait.certificate.map_or(0.0, |c| c.largest_multiplier),
            landing_run_m: gait.certificate.map_or(0.0, |c| c.landing_run_m),
            stable: gait.certificate.is_some_and(|c| c.stable),
        }
    }

    /// The gait of a message, every length and value checked.
    ///
    /// # Errors
    /// Names the field, what it holds and what was expected.
    pub fn to_gait(&self) -> Result<gait::Gait, GaitMessageError> {
        if ![GAIT_VERSION, GAIT_VERSION_TWO_STEPS].contains(&self.version) {
            return Err(GaitMessageError::Version { found: self.version });
        }
        let second_entries = self.second_coefficients_rad.len() + self.second_reference_coefficients_rad.len();
        if (self.version == GAIT_VERSION_TWO_STEPS) != (second_entries > 0) {
            return Err(GaitMessageError::SecondStep {
                gait: self.name.clone(),
                version: self.version,
                found: second_entries,
            });
        }
        if usize::from(self.bezier_degree) != DEGREE {
            return Err(GaitMessageError::Degree { gait: self.name.clone(), found: self.bezier_degree });
        }
        let (pose, twist) = (&self.initial_base_pose, &self.initial_base_twist);
        let mirror_leg: [u8; gait::LEGS] = self.array("mirror_leg", &self.mirror_leg)?;
        let gait = gait::Gait {
            robot: self.robot.clone(),
            name: self.name.clone(),
            joint_names: self.array("joint_names", &self.joint_names)?,
            step_duration_s: self.step_duration_s,
            step_length_m: self.step_length_m,
            coefficients_rad: self.rows("coefficients_rad", &self.coefficients_rad)?,
            mirror: Mirror { leg: mirror_leg.map(usize::from), sign: self.array("mirror_sign", &self.mirror_sign)? },
            second_step: if second_entries > 0 {
                Some(SecondStep {
                    coefficients_rad: self.rows("second_coefficients_rad", &self.second_coefficients_rad)?,
                    reference_coefficients_rad: self
                        .rows("second_reference_coefficients_rad", &self.second_reference_coefficients_rad)?,
                })
            } else {
                None
            },
            initial: InitialState {
                base_position_m: [pose.position.x, pose.position.y, pose.position.z],
                base_quaternion_xyzw: [pose.orientation.x, pose.orientation.y, pose.orientation.z, pose.orientation.w],
                base_linear_velocity_world: [twist.linear.x, twist.linear.y, twist.linear.z],
                base_angular_velocity_body: [twist.angular.x, twist.angular.y, twist.angular.z],
                joint_position_rad: self.array("initial_joint_position_rad", &self.initial_joint_position_rad)?,
                joint_velocity_rad_s: self.array("initial_joint_velocity_rad_s", &self.initial_joint_velocity_rad_s)?,
            },
            reference_coefficients_rad: self.rows("reference_coefficients_rad", &self.reference_coefficients_rad)?,
            kp: self.array("kp", &self.kp)?,
            kd: self.array("kd", &self.kd)?,
            torque_limit_nm: self.array("torque_limit_nm", &self.torque_limit_nm)?,
            request: serde_json::from_str(&self.request_json)
                .map_err(|error| GaitMessageError::Request { gait: self.name.clone(), reason: error.to_string() })?,
            solver: SolverSummary {
                status: self.solver.status.clone(),
                iterations: self.solver.iterations,
                solve_time_s: self.solver.solve_time_s,
                max_violation: self.solver.max_violation,
                objective: self.solver.objective,
            },
            certificate: (self.points > 0).then_some(Certificate {
                points: self.points,
                largest_multiplier: self.largest_multiplier,
                landing_run_m: self.landing_run_m,
                stable: self.stable,
            }),
        };
        gait.validate()?;
        Ok(gait)
    }

    fn array<T: Clone, const N: usize>(&self, field: &'static str, values: &[T]) -> Result<[T; N], GaitMessageError> {
        <[T; N]>::try_from(values.to_vec()).map_err(|values| GaitMessageError::Length {
            gait: self.name.clone(),
            field,
            found: values.len(),
            expected: N,
        })
    }

    fn rows(&self, field: &'static str, values: &[f64]) -> Result<[Coefficients; JOINTS], GaitMessageError> {
        let flat: [f64; JOINTS * (DEGREE + 1)] = self.array(field, values)?;
        Ok(std::array::from_fn(|joint| std::array::from_fn(|power| flat[joint * (DEGREE + 1) + power])))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Stands on the spot; every array holds different numbers where a gait allows it, so that no two can be swapped unseen.
    fn standing() -> gait::Gait {
        let joint: [f64; JOINTS] =
            std::array::from_fn(|j| [0.1, 0.94, 1.88][j % 3] * if j < 6 { 1.0 } else { [-1.0, 1.0, 1.0][j % 3] });
        gait::Gait {
            robot: "vision60".into(),
            name: "standing".into(),
            joint_names: std::array::from_fn(|j| format!("joint_{j}")),
            step_duration_s: 0.4,
            step_length_m: 0.0,
            coefficients_rad: joint.map(|v| [v; 6]),
            mirror: Mirror { leg: [2, 3, 0, 1], sign: [-1.0, 1.0, 1.0] },
            second_step: None,
            initial: InitialState {
                base_position_m: [0.01, 0.02, 0.58],
                base_quaternion_xyzw: [0.0, 0.0, 0.6, 0.8],
                base_linear_velocity_world: [0.1, 0.2, 0.3],
                base_angular_velocity_body: [0.4, 0.5, 0.6],
                joint_position_rad: joint,
                joint_velocity_rad_s: std::array::from_fn(|j| 0.01 * j as f64),
            },
            reference_coefficients_rad: joint.map(|v| [v, v, v, v, v, v].map(|v| v * 1.01)),
            kp: std::array::from_fn(|j| 200.0 + j as f64),
            kd: std::array::from_fn(|j| 5.0 + j as f64),
            torque_limit_nm: std::array::from_fn(|j| 50.0 + j as f64),
            request: serde_json::json!({"behaviour": "standing", "speed_m_s": 0.0}),
            solver: SolverSummary {
                status: "converged".into(),
                iterations: 7,
                solve_time_s: 0.1,
                max_violation: 1e-9,
                objective: 0.04,
            },
            certificate: Some(Certificate { points: 21, largest_multiplier: 0.7, landing_run_m: 0.01, stable: true }),
        }
    }

    #[test]
    fn a_gait_comes_back_as_it_went() {
        let mut gait = standing();
        gait.validate().expect("the fixture is a gait");
        assert_eq!(Gait::from_gait(&gait).version, 1);
        assert_eq!(Gait::from_gait(&gait).to_gait().unwrap(), gait);
        gait.second_step = Some(SecondStep {
            coefficients_rad: gait.coefficients_rad.map(|row| row.map(|c| c + 0.01)),
            reference_coefficients_rad: gait.coefficients_rad.map(|row| row.map(|c| c + 0.2)),
        });
        assert_eq!(Gait::from_gait(&gait).version, 2);
        assert_eq!(Gait::from_gait(&gait).to_gait().unwrap(), gait);
        gait.certificate = None;
        assert_eq!(Gait::from_gait(&gait).to_gait().unwrap(), gait);
    }

    #[test]
    fn a_row_holds_one_joints_coefficients() {
        let mut gait = standing();
        gait.coefficients_rad[3][2] = 9.0;
        assert_eq!(Gait::from_gait(&gait).coefficients_rad[3 * 6 + 2], 9.0);
    }

    #[test]
    fn wrong_messages_are_refused_with_the_field_named() {
        type Break = fn(&mut Gait);
        let cases: [(&str, Break); 11] = [
            ("version is 3, expected 1 or 2", |m| m.version = 3),
            ("version 2 with 0 second coefficients", |m| m.version = 2),
            ("version 1 with 72 second coefficients", |m| m.second_coefficients_rad = m.coefficients_rad.clone()),
            ("second_reference_coefficients_rad has 0 entries, expected 72", |m| {
                m.version = 2;
                m.second_coefficients_rad = m.coefficients_rad.clone();
            }),
            ("bezier_degree is 4, expected 5", |m| m.bezier_degree = 4),
            ("coefficients_rad has 71 entries, expected 72", |m| {
                m.coefficients_rad.pop();
            }),
            ("kp has 13 entries, expected 12", |m| m.kp.push(1.0)),
            ("joint_names has 0 entries, expected 12", |m| m.joint_names.clear()),
            ("mirror_leg has 3 entries, expected 4", |m| {
                m.mirror_leg.pop();
            }),
            ("request_json is not JSON", |m| m.request_json = "{".into()),
            ("reference_coefficients_rad[", |m| {
                m.reference_coefficients_rad[5] = f64::NAN;
            }),
        ];
        for (expected, break_it) in cases {
            let mut message = Gait::from_gait(&standing());
            break_it(&mut message);
            let error = message.to_gait().expect_err(expected).to_string();
            assert!(error.contains(expected), "{error:?} must say {expected:?}");
        }
    }
}
