//! The gait's message. One list gives its fields, their order on the wire, and which field of a gait each of them
//! carries; planner, controller and recorder convert by it. A field of a gait that is not in the list does not build.

use gait::bezier::DEGREE;

use crate::carried::{Carried, Place};
use crate::gait_error::{GAIT_VERSIONS, GaitMessageError};
use crate::geometry_msgs::{Pose, Twist};
use crate::std_msgs::Header;
use crate::{GaitDomain, SolverReport};

/// Defines the message and its mapping. `own` fields are the message's. Then come the gait's fields, each with the
/// fields of the message that carry it:
///
/// - `field { wire: Type }`: one field carries it.
/// - `field: Part { wire: Type = part, … }`: a structure, whose own fields are carried; `a & b` are carried by one.
/// - `field: Part [present] { … }`: a structure that may be absent; `present` says of a message whether it is there.
macro_rules! gait_message {
    (
        $(#[$meta:meta])*
        own { $( $(#[$own_meta:meta])* $own:ident: $own_type:ty, )+ }
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
    lead {
        /// What is walked once before the first step; empty: nothing.
        lead: Vec<GaitDomain>,
    }
    cycle {
        /// What is walked over and over in place of the two steps; empty: the two steps are.
        cycle: Vec<GaitDomain>,
    }
}

impl Gait {
    /// The message of a gait. The header's stamp is the sender's to set.
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
        if !GAIT_VERSIONS.contains(&self.version) {
            return Err(GaitMessageError::Version { found: self.version });
        }
        if usize::from(self.bezier_degree) != DEGREE {
            return Err(GaitMessageError::Degree { gait: self.name.clone(), found: self.bezier_degree });
        }
        let gait = self.carried()?;
        let expected = gait.file_version() as u32;
        if self.version != expected {
            return Err(GaitMessageError::Parts { gait: gait.name, version: self.version, expected });
        }
        gait.validate()?;
        Ok(gait)
    }

    fn has_second_step(&self) -> bool {
        !(self.second_coefficients_rad.is_empty() && self.second_reference_coefficients_rad.is_empty())
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
    fn a_lead_and_a_cycle_come_back_as_they_went() {
        let mut steps = standing().schedule();
        steps[0].duration_s = 0.3;
        steps[1].duration_s = 0.1;
        let with_lead = gait::Gait { lead: steps.clone(), ..standing() };
        let with_cycle = gait::Gait { cycle: steps.clone(), ..standing() };
        for gait in [gait::Gait { cycle: steps, ..with_lead.clone() }, with_lead, with_cycle] {
            let message = Gait::from_gait(&gait);
            assert_eq!(message.version, 3);
            assert_eq!(message.to_gait().unwrap(), gait);
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
        fn domain(m: &Gait) -> GaitDomain {
            GaitDomain {
                stance_legs: vec![1, 2],
                duration_s: 0.4,
                coefficients_rad: m.coefficients_rad.clone(),
                reference_coefficients_rad: m.reference_coefficients_rad.clone(),
            }
        }
        let cases: [(&str, Break); 16] = [
            ("version is 4, expected 1, 2 or 3", |m| m.version = 4),
            ("version is 2, expected 1", |m| m.version = 2),
            ("version is 1, expected 2", |m| {
                m.second_coefficients_rad = m.coefficients_rad.clone();
                m.second_reference_coefficients_rad = m.coefficients_rad.clone();
            }),
            ("version is 1, expected 3", |m| m.lead = vec![domain(m)]),
            ("lead[1].coefficients_rad has 71 entries, expected 72", |m| {
                m.lead = vec![domain(m); 2];
                m.lead[1].coefficients_rad.pop();
            }),
            ("cycle[0].stance_legs names leg 4, expected some of 0 to 3, each once", |m| {
                m.cycle = vec![domain(m)];
                m.cycle[0].stance_legs[1] = 4;
            }),
            ("cycle[0].stance_legs names leg 1, expected some of 0 to 3, each once", |m| {
                m.cycle = vec![domain(m)];
                m.cycle[0].stance_legs[1] = 1;
            }),
            ("duration_s", |m| {
                m.version = 3;
                m.lead = vec![domain(m)];
                m.lead[0].duration_s = f64::NAN;
            }),
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
