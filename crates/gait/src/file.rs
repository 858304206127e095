//! The gait file: JSON, format "tandem-gait". Version 1 is a gait whose second step mirrors the first; version 2 is
//! version 1 and a `second_step` of its own; version 3 has a `lead`, a `cycle` or both. A gait is written in the
//! lowest version that can carry it, so that a reader of version 1 reads every gait that it can walk, and refuses, by
//! its version, a gait that it would walk wrongly.

use crate::error::GaitError;
use crate::types::{Gait, GaitFile};
use crate::version::{
    FILE_FORMAT, FILE_VERSION, FILE_VERSION_DOMAINS, FILE_VERSION_TWO_STEPS, FILE_VERSIONS, MAX_FILE_BYTES,
};
use serde::Deserialize;

/// Read before everything else, so that a file of another version is named as such and not as a missing field.
#[derive(Deserialize)]
struct Header {
    format: String,
    version: u64,
}

impl Gait {
    /// The lowest version of the gait file that can carry the gait.
    pub fn file_version(&self) -> u64 {
        match &self.second_step {
            _ if !self.lead.is_empty() || !self.cycle.is_empty() => FILE_VERSION_DOMAINS,
            None => FILE_VERSION,
            Some(_) => FILE_VERSION_TWO_STEPS,
        }
    }

    /// Reads a gait file's text and checks every value.
    pub fn from_json(text: &str) -> Result<Self, GaitError> {
        if text.len() > MAX_FILE_BYTES {
            return Err(GaitError::Size { found: text.len() });
        }
        let header: Header = serde_json::from_str(text)?;
        if header.format != FILE_FORMAT {
            return Err(GaitError::Format { found: header.format });
        }
        if !FILE_VERSIONS.contains(&header.version) {
            return Err(GaitError::Version { found: header.version });
        }
        let file: GaitFile = serde_json::from_str(text)?;
        let gait = file.content();
        if gait.file_version() != header.version {
            let has = |is_there: bool| if is_there { "a" } else { "no" };
            let parts = [gait.second_step.is_some(), !gait.lead.is_empty(), !gait.cycle.is_empty()];
            let [second, lead, cycle] = parts.map(has);
            let problem = format!(
                "is {}, expected {}: the file has {second} second_step, {lead} lead and {cycle} cycle",
                header.version,
                gait.file_version()
            );
            return Err(gait.refuse("version", problem));
        }
        gait.validate()?;
        Ok(gait)
    }

    /// The gait file's text; the same gait gives the same bytes.
    pub fn to_json(&self) -> String {
        let file = GaitFile::new(FILE_FORMAT.into(), self.file_version(), self.clone());
        // A number that is not finite would become null; every gait is validated, so none is left.
        serde_json::to_string_pretty(&file).expect("a gait has only strings, numbers and arrays") + "\n"
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        Certificate, Coefficients, Domain, Gains, InitialState, JOINTS, MAX_NAME_CHARS, Mirror, SecondStep,
        SolverSummary, StepSide, bezier,
    };

    const CERTIFICATE: Certificate =
        Certificate { points: 21, largest_multiplier: 0.1 + 0.6, landing_run_m: 0.012, stable: true };

    /// A standing "gait": every joint stays where it is.
    fn standing() -> Gait {
        let joint: [f64; JOINTS] =
            std::array::from_fn(|j| [0.1, 0.94, 1.88][j % 3] * if j < 6 { 1.0 } else { [-1.0, 1.0, 1.0][j % 3] });
        let rows = joint.map(|v| [v; 6]);
        Gait {
            robot: "vision60".into(),
            name: "standing".into(),
            joint_names: std::array::from_fn(|j| format!("joint_{j}")),
            step_duration_s: 0.4,
            step_length_m: 0.0,
            bezier_degree: bezier::DEGREE,
            coefficients_rad: rows,
            mirror: Mirror { leg: [2, 3, 0, 1], sign: [-1.0, 1.0, 1.0] },
            second_step: None,
            lead: Vec::new(),
            cycle: Vec::new(),
            initial: InitialState {
                base_position_m: [0.0, 0.0, 0.5825],
                base_quaternion_xyzw: [0.0, 0.0, 0.0, 1.0],
                base_linear_velocity_world: [0.0; 3],
                base_angular_velocity_body: [0.0; 3],
                joint_position_rad: joint,
                joint_velocity_rad_s: [0.0; 12],
            },
            reference_coefficients_rad: rows,
            gains: Gains { kp: [230.0; 12], kd: [5.0; 12] },
            torque_limit_nm: [50.0; 12],
            request: serde_json::json!({"behaviour": "standing"}),
            solver: SolverSummary {
                status: "converged".into(),
                iterations: 3,
                solve_time_s: 0.1,
                max_violation: 1e-9,
                objective: 0.0,
            },
            certificate: None,
        }
    }

    #[test]
    fn a_file_read_back_is_the_same_gait_and_the_same_bytes() {
        let mut gait = standing();
        gait.step_duration_s = 0.1 + 0.2;
        assert!(!gait.to_json().contains("certificate"), "a gait without one is written as before");
        gait.certificate = Some(CERTIFICATE);
        let text = gait.to_json();
        let again = Gait::from_json(&text).unwrap();
        assert_eq!(again, gait);
        assert_eq!(again.to_json(), text);
    }

    #[test]
    fn a_text_of_20_mb_is_refused_by_its_size_and_not_read() {
        // What is not JSON at all shows that nobody looked.
        let e = Gait::from_json(&"{".repeat(20 << 20)).unwrap_err();
        assert!(matches!(e, GaitError::Size { found } if found == 20 << 20), "{e}");
        let padded = standing().to_json();
        let padded = padded.clone() + &" ".repeat(MAX_FILE_BYTES - padded.len());
        assert_eq!(Gait::from_json(&padded).unwrap(), standing());
    }

    #[test]
    fn a_name_of_control_characters_or_without_end_is_refused() {
        for name in ["trot\n[INFO] armed", "\u{1b}[2J", &"x".repeat(MAX_NAME_CHARS + 1)] {
            let mut gait = standing();
            gait.name = name.to_owned();
            let e = gait.validate().unwrap_err().to_string();
            assert!(e.contains("control character"), "{e}");
        }
    }

    #[test]
    fn a_file_cut_in_half_is_one_clear_error() {
        let text = standing().to_json();
        let e = Gait::from_json(&text[..text.len() / 2]).unwrap_err().to_string();
        assert!(e.contains("Is it whole?"), "{e}");
    }

    #[test]
    fn another_version_is_named_before_any_missing_field() {
        let e = Gait::from_json(r#"{"format": "tandem-gait", "version": 7}"#).unwrap_err().to_string();
        assert!(e.contains("version is 7, expected 1, 2 or 3"), "{e}");
        let e = Gait::from_json(r#"{"format": "urdf", "version": 1}"#).unwrap_err().to_string();
        assert!(e.contains("format is \"urdf\""), "{e}");
    }

    #[test]
    fn a_second_step_makes_version_2_and_is_walked_as_it_stands() {
        let mirrored = standing();
        assert!(mirrored.to_json().contains("\"version\": 1,") && !mirrored.to_json().contains("second_step"));
        let mut gait = mirrored.clone();
        // A lean that no mirror gives: the second step differs from the first one's mirror image.
        let lean = |rows: [Coefficients; JOINTS], by: f64| rows.map(|row| row.map(|c| c + by));
        let rows = lean(gait.coefficients_rad, 0.01);
        gait.second_step =
            Some(SecondStep { coefficients_rad: rows, reference_coefficients_rad: lean(gait.coefficients_rad, 0.2) });
        let text = gait.to_json();
        assert!(text.contains("\"version\": 2,"), "{text}");
        let again = Gait::from_json(&text).unwrap();
        assert_eq!(again, gait);
        assert_eq!(again.planned(StepSide::Mirrored, 0.5).0[0], rows[0][0]);
        assert!((again.reference(StepSide::Mirrored, 0.5).0[0] - rows[0][0] - 0.19).abs() < 1e-12);
        assert_eq!(again.planned(StepSide::First, 0.5), mirrored.planned(StepSide::First, 0.5));
        // A file that says one thing and holds the other is refused.
        for (from, to, text) in [("2", "1", &text), ("1", "2", &mirrored.to_json())] {
            let text = text.replace(&format!("\"version\": {from},"), &format!("\"version\": {to},"));
            let e = Gait::from_json(&text).unwrap_err().to_string();
            assert!(e.contains("version is ") && e.contains(" second_step, no lead and no cycle"), "{e}");
        }
    }

    /// Two steps of other durations than the gait's own.
    fn with_lead() -> Gait {
        let mut gait = standing();
        gait.lead = gait.schedule().into_iter().map(|step| Domain { duration_s: 0.3, ..step }).collect();
        gait
    }

    #[test]
    fn a_lead_makes_version_3_and_comes_back() {
        let mut gait = with_lead();
        for second_step in [false, true] {
            let rows = gait.coefficients_rad.map(|row| row.map(|c| c + 0.005));
            gait.second_step =
                second_step.then_some(SecondStep { coefficients_rad: rows, reference_coefficients_rad: rows });
            let text = gait.to_json();
            assert!(text.contains("\"version\": 3,"), "{text}");
            let again = Gait::from_json(&text).unwrap();
            assert_eq!(again, gait);
            assert_eq!(again.to_json(), text);
            assert!(text.contains("\"rear_left\",\n        \"front_right\""), "legs are named: {text}");
        }
        let text = standing().to_json().replace("\"version\": 1,", "\"version\": 3,");
        let e = Gait::from_json(&text).unwrap_err().to_string();
        assert!(e.contains("version is 3, expected 1: the file has no second_step, no lead and no cycle"), "{e}");
        let text = with_lead().to_json().replace("\"version\": 3,", "\"version\": 2,");
        let e = Gait::from_json(&text).unwrap_err().to_string();
        assert!(e.contains("version is 2, expected 3: the file has no second_step, a lead and no cycle"), "{e}");
    }

    #[test]
    fn stance_legs_that_are_unknown_or_named_twice_are_refused() {
        let text = with_lead().to_json();
        for (from, to, expected) in [
            ("\"rear_left\"", "\"tail\"", "stance_legs names \"tail\", expected some of [\"front_left\""),
            ("\"rear_left\"", "\"front_right\"", "stance_legs names front_right twice"),
        ] {
            let e = Gait::from_json(&text.replace(from, to)).unwrap_err().to_string();
            assert!(e.contains(expected), "{e}");
        }
    }

    #[test]
    fn bad_values_are_named() {
        type Case = (&'static str, fn(&mut Gait));
        let cases: [Case; 20] = [
            ("lead has 9 domains, expected at most 8", |g| g.lead = vec![with_lead().lead[0].clone(); 9]),
            ("lead[1].duration_s is 0.001, expected 0.02 to 10 s", |g| {
                g.lead = with_lead().lead;
                g.lead[1].duration_s = 0.001;
            }),
            ("lead[0].stance_legs names none", |g| {
                g.lead = with_lead().lead;
                g.lead[0].stands = [false; 4];
            }),
            ("lead[1].reference_coefficients_rad[6] is NaN", |g| {
                g.lead = with_lead().lead;
                g.lead[1].reference_rad[1][0] = f64::NAN;
            }),
            ("lead[0].coefficients_rad let joint_4 jump by 0.100 rad", |g| {
                g.lead = with_lead().lead;
                g.lead[0].planned_rad[4][5] += 0.1;
            }),
            ("lead[1].coefficients_rad let joint_4 jump by 0.100 rad", |g| {
                g.lead = with_lead().lead;
                g.lead[1].planned_rad[4][5] += 0.1;
            }),
            ("certificate.landing_run_m is NaN", |g| {
                g.certificate = Some(Certificate { landing_run_m: f64::NAN, ..CERTIFICATE });
            }),
            ("certificate.stable is true, expected false with a largest multiplier of 1.2", |g| {
                g.certificate = Some(Certificate { largest_multiplier: 1.2, ..CERTIFICATE });
            }),
            ("second_step.coefficients_rad let joint_0 jump", |g| {
                let mut rows = g.coefficients_rad;
                rows[0][5] += 0.1;
                g.second_step = Some(SecondStep { coefficients_rad: rows, reference_coefficients_rad: rows });
            }),
            ("second_step.reference_coefficients_rad[6] is NaN", |g| {
                let mut rows = g.coefficients_rad;
                rows[1][0] = f64::NAN;
                g.second_step =
                    Some(SecondStep { coefficients_rad: g.coefficients_rad, reference_coefficients_rad: rows });
            }),
            ("bezier_degree is 4, expected 5", |g| g.bezier_degree = 4),
            ("step_duration_s is NaN", |g| g.step_duration_s = f64::NAN),
            ("coefficients_rad[13] is NaN", |g| g.coefficients_rad[2][1] = f64::NAN),
            ("gains.kp[3] is -1", |g| g.gains.kp[3] = -1.0),
            ("torque_limit_nm[0] is inf", |g| g.torque_limit_nm[0] = f64::INFINITY),
            ("mirror.leg", |g| g.mirror.leg = [2, 2, 0, 1]),
            ("mirror.sign", |g| g.mirror.sign[0] = 0.5),
            ("norm", |g| g.initial.base_quaternion_xyzw[3] = 2.0),
            ("jump by", |g| g.coefficients_rad[4][5] += 0.1),
            ("joint_names[5]", |g| g.joint_names[5] = "joint_0".into()),
        ];
        for (expected, spoil) in cases {
            let mut gait = standing();
            spoil(&mut gait);
            let e = gait.validate().unwrap_err().to_string();
            assert!(e.contains(expected), "expected {expected:?} in {e:?}");
        }
        standing().validate().unwrap();
    }

    #[test]
    fn a_gait_of_another_robot_is_refused() {
        let gait = standing();
        let mut names = gait.joint_names.clone();
        assert!(gait.check_robot("vision60", &names).is_ok());
        assert!(gait.check_robot("solo12", &names).unwrap_err().to_string().contains("solo12"));
        names[7] = "knee".into();
        assert!(gait.check_robot("vision60", &names).unwrap_err().to_string().contains("joint_names[7]"));
    }

    #[test]
    fn the_mirrored_step_moves_the_other_legs_with_roll_reversed() {
        let mut gait = standing();
        gait.coefficients_rad[0] = [0.0, 0.1, 0.2, 0.3, 0.4, 0.5];
        gait.coefficients_rad[1] = [1.0, 1.1, 1.2, 1.3, 1.4, 1.5];
        let (first, first_velocity) = gait.planned(StepSide::First, 0.3);
        let (mirrored, mirrored_velocity) = gait.planned(StepSide::Mirrored, 0.3);
        assert_eq!(mirrored[6], -first[0]);
        assert_eq!(mirrored[7], first[1]);
        assert_eq!(mirrored_velocity[6], -first_velocity[0]);
        assert_eq!(mirrored_velocity[7], first_velocity[1]);
        assert!((first_velocity[0] - 0.5 / 0.4).abs() < 1e-12);
    }
}
