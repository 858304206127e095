//! Whether a gait's values are any that can be walked.

use joints::{JOINTS, LEGS};

use crate::bezier;
use crate::error::GaitError;
use crate::schedule::StepSide;
use crate::types::Gait;
use std::ops::RangeInclusive;

/// Longest name of a gait or its robot, in characters.
pub const MAX_NAME_CHARS: usize = 128;
/// How short a step or another domain may be, s.
pub const SHORTEST_DOMAIN_S: f64 = 0.02;
/// How long a step or another domain may take, s.
const DURATION_S: RangeInclusive<f64> = SHORTEST_DOMAIN_S..=10.0;
/// A jump of the planned joints where one domain follows another would be a blow to the drives.
pub(crate) const JUMP_RAD: f64 = 0.02;

impl Gait {
    pub(crate) fn refuse(&self, field: impl Into<String>, problem: impl Into<String>) -> GaitError {
        GaitError::Value { gait: self.name.clone(), field: field.into(), problem: problem.into() }
    }

    /// Checks every value: finite, in range, and each step's end meeting the next one's start.
    pub fn validate(&self) -> Result<(), GaitError> {
        self.check_header()?;
        self.check_polynomials()?;
        self.check_initial()?;
        self.check_ranges()?;
        self.check_mirror()?;
        self.check_joint_names()?;
        self.check_certificate()?;
        self.check_continuity()?;
        self.check_lead()?;
        self.check_cycle()
    }

    pub(crate) fn check_finite(&self, field: &str, values: &[f64]) -> Result<(), GaitError> {
        match values.iter().position(|v| !v.is_finite()) {
            Some(i) => Err(self.refuse(format!("{field}[{i}]"), format!("is {}, expected a finite number", values[i]))),
            None => Ok(()),
        }
    }

    fn check_header(&self) -> Result<(), GaitError> {
        if self.bezier_degree != bezier::DEGREE {
            let problem = format!("is {}, expected {}", self.bezier_degree, bezier::DEGREE);
            return Err(self.refuse("bezier_degree", problem));
        }
        for (field, text) in [("name", &self.name), ("robot", &self.robot)] {
            if text.chars().count() > MAX_NAME_CHARS || text.contains(char::is_control) {
                return Err(self.refuse(field, format!("is {} bytes long, expected at most {MAX_NAME_CHARS} characters, none of them a control character", text.len())));
            }
        }
        self.check_duration("step_duration_s", self.step_duration_s)?;
        self.check_finite("step_length_m", &[self.step_length_m])
    }

    pub(crate) fn check_duration(&self, field: &str, duration_s: f64) -> Result<(), GaitError> {
        let (least, most) = (DURATION_S.start(), DURATION_S.end());
        match DURATION_S.contains(&duration_s) {
            true => Ok(()),
            false => Err(self.refuse(field, format!("is {duration_s}, expected {least} to {most} s"))),
        }
    }

    fn check_polynomials(&self) -> Result<(), GaitError> {
        self.check_finite("coefficients_rad", self.coefficients_rad.as_flattened())?;
        self.check_finite("reference_coefficients_rad", self.reference_coefficients_rad.as_flattened())?;
        let Some(second) = &self.second_step else { return Ok(()) };
        let reference = second.reference_coefficients_rad.as_flattened();
        self.check_finite("second_step.coefficients_rad", second.coefficients_rad.as_flattened())?;
        self.check_finite("second_step.reference_coefficients_rad", reference)
    }

    fn check_initial(&self) -> Result<(), GaitError> {
        let i = &self.initial;
        self.check_finite("initial.base_position_m", &i.base_position_m)?;
        self.check_finite("initial.base_quaternion_xyzw", &i.base_quaternion_xyzw)?;
        self.check_finite("initial.base_linear_velocity_world", &i.base_linear_velocity_world)?;
        self.check_finite("initial.base_angular_velocity_body", &i.base_angular_velocity_body)?;
        self.check_finite("initial.joint_position_rad", &i.joint_position_rad)?;
        self.check_finite("initial.joint_velocity_rad_s", &i.joint_velocity_rad_s)?;
        let norm = i.base_quaternion_xyzw.iter().map(|v| v * v).sum::<f64>().sqrt();
        if (norm - 1.0).abs() > 1e-6 {
            return Err(self.refuse("initial.base_quaternion_xyzw", format!("has norm {norm}, expected 1")));
        }
        Ok(())
    }

    fn check_ranges(&self) -> Result<(), GaitError> {
        for (field, values) in [("gains.kp", &self.gains.kp), ("gains.kd", &self.gains.kd)] {
            if let Some(j) = values.iter().position(|v| !(0.0..=1e5).contains(v)) {
                return Err(self.refuse(format!("{field}[{j}]"), format!("is {}, expected 0 to 1e5", values[j])));
            }
        }
        if let Some(j) = self.torque_limit_nm.iter().position(|v| !(*v > 0.0 && v.is_finite())) {
            return Err(self.refuse(
                format!("torque_limit_nm[{j}]"),
                format!("is {}, expected a positive number", self.torque_limit_nm[j]),
            ));
        }
        Ok(())
    }

    fn check_mirror(&self) -> Result<(), GaitError> {
        let mut seen = [false; LEGS];
        for (leg, &from) in self.mirror.leg.iter().enumerate() {
            if from >= LEGS || std::mem::replace(&mut seen[from], true) {
                return Err(self.refuse(
                    "mirror.leg",
                    format!("{:?} at leg {leg}: expected a permutation of 0 to 3", self.mirror.leg),
                ));
            }
            if self.mirror.leg[from] != leg {
                return Err(self.refuse(
                    "mirror.leg",
                    format!("{:?}: mirroring twice must give the same leg again", self.mirror.leg),
                ));
            }
        }
        if self.mirror.sign.iter().any(|s| s.abs() != 1.0) {
            return Err(self.refuse("mirror.sign", format!("{:?}: expected 1 or -1", self.mirror.sign)));
        }
        Ok(())
    }

    fn check_joint_names(&self) -> Result<(), GaitError> {
        for (a, name) in self.joint_names.iter().enumerate() {
            if name.is_empty() || self.joint_names[..a].contains(name) {
                return Err(
                    self.refuse(format!("joint_names[{a}]"), format!("is \"{name}\": expected twelve different names"))
                );
            }
        }
        Ok(())
    }

    fn check_continuity(&self) -> Result<(), GaitError> {
        let (start, _) = self.planned(StepSide::First, 0.0);
        for j in 0..JOINTS {
            let initial = self.initial.joint_position_rad[j];
            if (start[j] - initial).abs() > JUMP_RAD {
                return Err(self.refuse(
                    format!("initial.joint_position_rad[{j}]"),
                    format!("is {initial}, the planned step starts at {}", start[j]),
                ));
            }
        }
        // What is walked then are no two steps.
        if !self.cycle.is_empty() {
            return Ok(());
        }
        for (side, field) in
            [(StepSide::First, "coefficients_rad"), (StepSide::Mirrored, "second_step.coefficients_rad")]
        {
            let (end, _) = self.planned(side, 1.0);
            let (next, _) = self.planned(side.other(), 0.0);
            for j in 0..JOINTS {
                if (end[j] - next[j]).abs() > JUMP_RAD {
                    return Err(self.refuse(
                        field,
                        format!(
                            "let {} jump by {:.3} rad at the switch of steps, expected at most {JUMP_RAD}",
                            self.joint_names[j],
                            end[j] - next[j]
                        ),
                    ));
                }
            }
        }
        Ok(())
    }
}
