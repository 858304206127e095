//! The gait's message. One list gives its fields, their order on the wire, and which field of a gait each of them
//! carries; planner, controller and recorder convert by it. A field of a gait that is not in the list does not build.

use gait::bezier::DEGREE;

use crate::SolverReport;
use crate::carried::{Carried, Place};
use crate::gait_error::{GAIT_VERSION_DOMAINS, GAIT_VERSION_TWO_STEPS, GAIT_VERSIONS, GaitMessageError};
use crate::geometry_msgs::{Pose, Twist};
use crate::std_msgs::Header;

/// Defines the message and its mapping. `own` fields are the message's; `not_carried` are fields of a gait that its
/// file has and the message has not, and a gait that has them is refused by its version. Then come the gait's fields,
/// each with the fields of the message that carry it:
///
/// - `field { wire: Type }`: one field carries it.
/// - `field: Part { wire: Type = part, … }`: a structure, whose own fields are carried; `a & b` are carried by one.
/// - `field: Part [present] { … }`: a structure that may be absent; `present` says of a message whether it is there.
macro_rules! gait_message {
    (
        $(#[$meta:meta])*
        own { $( $(#[$own_meta:meta])* $own:ident: $own_type:ty, )+ }
        not_carried { $( $left_out:ident ),+ }
        $( $field:ident $(: $part:ident $([$present:expr])?)? {
            $( $(#[$wire_meta:meta])* $wire:ident: $type:ty $(= $($sub:ident)&+)?, )+
        } )+
    ) => {
        messages! { "tandem_msgs";
            $(#[$meta])*
            Gait {
                $( $(#[$own_meta])* $own: $own_type, )+
                $($( $(#[$wire_meta])* $wire: $type, )+)+
            }
        }

        impl Gait {
            /// Writes every field that carries one of the gait's.
            fn carry(&mut self, gait: &gait::Gait) {
                $( gait_message!(@write self, &gait.$field, [$($part $($present)?)?], $($wire: $type $(= $($sub)&+)?),+); )+
            }

            /// The gait that is carried, its lengths checked.
            fn carried(&self) -> Result<gait::Gait, GaitMessageError> {
                Ok(gait::Gait {
                    $( $left_out: Default::default(), )+
                    $( $field: gait_message!(@read self, [$($part $($present)?)?], $($wire: $type $(= $($sub)&+)?),+), )+
                })
            }
        }
    };

    (@write $message:ident, $value:expr, [], $wire:ident: $type:ty) => {
        $message.$wire = Carried::<$type>::to_wire($value);
    };
    (@write $message:ident, $value:expr, [$part:ident], $($wire:ident: $type:ty = $($sub:ident)&+),+) => {
        let part: &gait::$part = $value;
        $( $message.$wire = Carried::<$type>::to_wire(&($(part.$sub.clone(),)+)); )+
    };
    (@write $message:ident, $value:expr, [$part:ident $present:expr], $($rows:tt)+) => {
        if let Some(part) = $value {
            gait_message!(@write $message, part, [$part], $($rows)+);
        }
    };

    (@read $message:ident, [], $wire:ident: $type:ty) => {
        Carried::<$type>::from_wire(&$message.$wire, Place { gait: &$message.name, field: stringify!($wire) })?
    };
    (@read $message:ident, [$part:ident], $($wire:ident: $type:ty = $($sub:ident)&+),+) => {{
        $( let ($($sub,)+) = gait_message!(@read $message, [], $wire: $type); )+
        gait::$part { $($($sub,)+)+ }
    }};
    (@read $message:ident, [$part:ident $present:expr], $($rows:tt)+) => {
        if $present($message) { Some(gait_message!(@read $message, [$part], $($rows)+)) } else { None }
    };
}

gait_message! {
    /// A planned gait. Arrays over joints have 12 entries: leg * 3 + joint.
    own {
        /// stamp: when the plan was made; frame_id: the frame of `initial_base_pose`.
        header: Header,
        /// Version of the gait's schema.
        version: u32,
    }
    // A field more would be another type to every program that is built with this one.
    not_carried { lead, cycle }
    robot {
        /// The robot that the gait is for.
        robot: String,
    }
    name {
        /// The gait's name.
        name: String,
    }
    joint_names {
        /// 12 joint names.
        joint_names: Vec<String>,
    }
    step_duration_s {
        /// Duration of one step (half a stride), s.
        step_duration_s: f64,
    }
    step_length_m {
        /// Forward motion of the base in one step, m.
        step_length_m: f64,
    }
    bezier_degree {
        /// Degree of the Bézier polynomials.
        bezier_degree: u8,
    }
    coefficients_rad {
        /// Planned joint angles over the first step, rad: row-major 12 x (degree + 1).
        coefficients_rad: Vec<f64>,
    }
    reference_coefficients_rad {
        /// The compensated reference that the tracking law follows, rad: row-major 12 x (degree + 1).
        reference_coefficients_rad: Vec<f64>,
    }
    second_step: SecondStep [Gait::has_second_step] {
        /// The second step's own planned joints (legs 0 and 3 stand), not mirrored, rad: row-major 12 x (degree + 1);
        /// empty where the mirror gives them.
        second_coefficients_rad: Vec<f64> = coefficients_rad,
        /// The second step's own reference, rad: as `second_coefficients_rad`.
        second_reference_coefficients_rad: Vec<f64> = reference_coefficients_rad,
    }
    mirror: Mirror {
        /// The next step: row of leg i, joint k = `mirror_sign[k]` * row of leg `mirror_leg[i]`.
        mirror_leg: Vec<u8> = leg,
        /// 3 entries, each 1 or -1.
        mirror_sign: Vec<f64> = sign,
    }
    initial: InitialState {
        /// Base at the start of the first step, m.
        initial_base_pose: Pose = base_position_m & base_quaternion_xyzw,
        /// linear: world axes, m/s; angular: body axes, rad/s.
        initial_base_twist: Twist = base_linear_velocity_world & base_angular_velocity_body,
        /// rad.
        initial_joint_position_rad: Vec<f64> = joint_position_rad,
        /// rad/s.
        initial_joint_velocity_rad_s: Vec<f64> = joint_velocity_rad_s,
    }
    gains: Gains {
        /// Nm/rad.
        kp: Vec<f64> = kp,
        /// Nm s/rad.
        kd: Vec<f64> = kd,
    }
    torque_limit_nm {
        /// Nm.
        torque_limit_nm: Vec<f64>,
    }
    request {
        /// The request that the gait answers, as JSON.
        request_json: String,
    }
    solver {
        /// How the optimisation ended.
        solver: SolverReport,
    }
    certificate: Certificate [Gait::has_certificate] {
        /// Points of the program that the plan came from; 0: this and the three fields after it are not known.
        points: u32 = points,
        /// Largest multiplier of the step's map.
        largest_multiplier: f64 = largest_multiplier,
        /// How far from its place a swing toe would meet a slightly higher floor, m.
        landing_run_m: f64 = landing_run_m,
        /// Whether both say that the gait stands by itself.
        stable: bool = stable,
    }
}

impl Gait {
    /// The message of a gait. The header's stamp is the sender's to set. Of a gait with a lead or a cycle its version
    /// says what is missing, and [`Self::to_gait`] refuses it: such a gait goes by its file.
    #[must_use]
    pub fn from_gait(gait: &gait::Gait) -> Self {
        let mut message = Gait {
            header: Header { frame_id: "odom".to_string(), ..Header::default() },
            version: gait.file_version() as u32,
            ..Gait::default()
        };
        message.carry(gait);
        message
    }

    /// The gait of a message, every length and value checked.
    ///
    /// # Errors
    /// Names the field, what it holds and what was expected.
    pub fn to_gait(&self) -> Result<gait::Gait, GaitMessageError> {
        if self.version == GAIT_VERSION_DOMAINS {
            return Err(GaitMessageError::Domains { gait: self.name.clone() });
        }
        if !GAIT_VERSIONS.contains(&self.version) {
            return Err(GaitMessageError::Version { found: self.version });
        }
        if (self.version == GAIT_VERSION_TWO_STEPS) != self.has_second_step() {
            return Err(GaitMessageError::SecondStep {
                gait: self.name.clone(),
                version: self.version,
                found: self.second_entries(),
            });
        }
        if usize::from(self.bezier_degree) != DEGREE {
            return Err(GaitMessageError::Degree { gait: self.name.clone(), found: self.bezier_degree });
        }
        let gait = self.carried()?;
        gait.validate()?;
        Ok(gait)
    }

    fn second_entries(&self) -> usize {
        self.second_coefficients_rad.len() + self.second_reference_coefficients_rad.len()
    }

    fn has_second_step(&self) -> bool {
        self.second_entries() > 0
    }

    fn has_certificate(&self) -> bool {
        self.points > 0
    }
}

#[cfg(test)]
mod tests {
    use gait::{Certificate, Gains, InitialState, JOINTS, Mirror, SecondStep, SolverSummary};

    use super::*;

    /// Stands on the spot; every array holds different numbers where a gait allows it, so that no two can be swapped
    /// unseen.
    fn standing() -> gait::Gait {
        let joint: [f64; JOINTS] =
            std::array::from_fn(|j| [0.1, 0.94, 1.88][j % 3] * if j < 6 { 1.0 } else { [-1.0, 1.0, 1.0][j % 3] });
        gait::Gait {
            robot: "vision60".into(),
            name: "standing".into(),
            joint_names: std::array::from_fn(|j| format!("joint_{j}")),
            step_duration_s: 0.4,
            step_length_m: 0.0,
            bezier_degree: DEGREE,
            coefficients_rad: joint.map(|v| [v; 6]),
            mirror: Mirror { leg: [2, 3, 0, 1], sign: [-1.0, 1.0, 1.0] },
            second_step: None,
            lead: Vec::new(),
            cycle: Vec::new(),
            initial: InitialState {
                base_position_m: [0.01, 0.02, 0.58],
                base_quaternion_xyzw: [0.0, 0.0, 0.6, 0.8],
                base_linear_velocity_world: [0.1, 0.2, 0.3],
                base_angular_velocity_body: [0.4, 0.5, 0.6],
                joint_position_rad: joint,
                joint_velocity_rad_s: std::array::from_fn(|j| 0.01 * j as f64),
            },
            reference_coefficients_rad: joint.map(|v| [v, v, v, v, v, v].map(|v| v * 1.01)),
            gains: Gains { kp: std::array::from_fn(|j| 200.0 + j as f64), kd: std::array::from_fn(|j| 5.0 + j as f64) },
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
    fn a_gait_with_a_lead_or_a_cycle_is_refused_and_never_walked_without_it() {
        let steps = standing().schedule();
        let with_lead = gait::Gait { lead: steps.clone(), ..standing() };
        let with_cycle = gait::Gait { cycle: steps, ..standing() };
        for gait in [with_lead, with_cycle] {
            let error = Gait::from_gait(&gait).to_gait().unwrap_err().to_string();
            assert!(error.contains("\"standing\" has a lead or a cycle"), "{error}");
            assert!(error.contains("load the gait's file"), "{error}");
        }
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
            ("version is 4, expected 1 or 2", |m| m.version = 4),
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
