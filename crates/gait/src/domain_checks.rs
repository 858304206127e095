//! Whether a gait's domains are any that can be walked: those of its lead and of its cycle.

use joints::{JOINTS, LEG_NAMES, LEGS};

use crate::domain::Domain;
use crate::error::GaitError;
use crate::schedule::StepSide;
use crate::types::Gait;
use crate::validate::JUMP_RAD;

/// Most domains of a lead.
pub const MAX_LEAD_DOMAINS: usize = 8;
/// Most domains of a cycle.
pub const MAX_CYCLE_DOMAINS: usize = 8;
/// Fewest legs that stand in a domain of a cycle.
const FEWEST_STANCE_LEGS: usize = 2;
/// A jump of the planned joints' velocities from one domain of a cycle to the next, rad/s. Polynomials that are fitted
/// to a plan leave 0.2 (a slow crawl) to 1.9 (a pace of 0.15 s).
const JUMP_RAD_S: f64 = 2.5;
/// A cycle takes a whole number of T to within this share of T.
const WHOLE_STEPS: f64 = 1e-6;

impl Gait {
    /// Every domain by itself, and each one's end meeting the next one's start, the last one's the first step's.
    pub(crate) fn check_lead(&self) -> Result<(), GaitError> {
        self.check_domains("lead", &self.lead, MAX_LEAD_DOMAINS)?;
        for (n, domain) in self.lead.iter().enumerate() {
            if domain.stands == [false; LEGS] {
                let problem = "names none, expected at least one leg that stands";
                return Err(self.refuse(format!("lead[{n}].stance_legs"), problem));
            }
            let (end, _) = domain.planned(1.0);
            let (next, _) =
                self.lead.get(n + 1).map_or_else(|| self.planned(StepSide::First, 0.0), |next| next.planned(0.0));
            self.check_join(&format!("lead[{n}]"), "rad", &end, &next, JUMP_RAD)?;
        }
        Ok(())
    }

    /// The same of the cycle, which joins its own beginning, and whose first domain the gait's step fields describe.
    pub(crate) fn check_cycle(&self) -> Result<(), GaitError> {
        let Some(first) = self.cycle.first() else { return Ok(()) };
        self.check_domains("cycle", &self.cycle, MAX_CYCLE_DOMAINS)?;
        self.check_stance_legs()?;
        if self.second_step.is_some() {
            return Err(self.refuse("second_step", "is given beside a cycle, expected one of them"));
        }
        for (field, step, domain) in [
            ("coefficients_rad", &self.coefficients_rad, &first.planned_rad),
            ("reference_coefficients_rad", &self.reference_coefficients_rad, &first.reference_rad),
        ] {
            if step != domain {
                return Err(self.refuse(field, format!("differ from cycle[0].{field}, expected the same")));
            }
        }
        let steps = self.stride_duration_s() / self.step_duration_s;
        if steps < 0.5 || (steps - steps.round()).abs() > WHOLE_STEPS {
            let problem = format!("takes {steps} times step_duration_s, expected a whole number");
            return Err(self.refuse("cycle", problem));
        }
        for (n, domain) in self.cycle.iter().enumerate() {
            let next = &self.cycle[(n + 1) % self.cycle.len()];
            let ((end, end_velocity), (start, start_velocity)) = (domain.planned(1.0), next.planned(0.0));
            self.check_join(&format!("cycle[{n}]"), "rad", &end, &start, JUMP_RAD)?;
            self.check_join(&format!("cycle[{n}]"), "rad/s", &end_velocity, &start_velocity, JUMP_RAD_S)?;
        }
        Ok(())
    }

    fn check_domains(&self, list: &str, domains: &[Domain], most: usize) -> Result<(), GaitError> {
        if domains.len() > most {
            return Err(self.refuse(list, format!("has {} domains, expected at most {most}", domains.len())));
        }
        for (n, domain) in domains.iter().enumerate() {
            let field = |name: &str| format!("{list}[{n}].{name}");
            self.check_duration(&field("duration_s"), domain.duration_s)?;
            self.check_finite(&field("coefficients_rad"), domain.planned_rad.as_flattened())?;
            self.check_finite(&field("reference_coefficients_rad"), domain.reference_rad.as_flattened())?;
        }
        Ok(())
    }

    /// A leg that never swings would have to slide, and one that never stands is no leg of the gait.
    fn check_stance_legs(&self) -> Result<(), GaitError> {
        for (n, domain) in self.cycle.iter().enumerate() {
            let count = domain.stands.iter().filter(|stands| **stands).count();
            if count < FEWEST_STANCE_LEGS {
                let problem = format!("names {count}, expected at least {FEWEST_STANCE_LEGS} legs that stand");
                return Err(self.refuse(format!("cycle[{n}].stance_legs"), problem));
            }
        }
        for (does, stands) in [("stand", true), ("swing", false)] {
            if let Some(leg) = (0..LEGS).find(|leg| self.cycle.iter().all(|domain| domain.stands[*leg] == stands)) {
                let problem = "in every domain, expected each leg to stand in one and to swing in one";
                return Err(self.refuse("cycle", format!("has {} {does} {problem}", LEG_NAMES[leg])));
            }
        }
        Ok(())
    }

    /// The planned joints where a domain ends and the next one begins: positions or velocities, by their unit.
    fn check_join(
        &self,
        domain: &str,
        unit: &str,
        end: &[f64; JOINTS],
        next: &[f64; JOINTS],
        most: f64,
    ) -> Result<(), GaitError> {
        let Some(j) = (0..JOINTS).find(|&j| (end[j] - next[j]).abs() > most) else { return Ok(()) };
        let (joint, jump) = (&self.joint_names[j], end[j] - next[j]);
        let problem = format!("let {joint} jump by {jump:.3} {unit} at the domain's end, expected at most {most}");
        Err(self.refuse(format!("{domain}.coefficients_rad"), problem))
    }
}
