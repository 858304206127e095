//! `tandem plan --verify` and `--stability`: what is reported of a plan beyond the solver's word.

use anyhow::{Context, Result};
use gait_design::{BetweenPoints, Complex, GaitRequest, MOST_STEP_GROWTH, Plan, PlanPoint, StepComparison, StepLaw};
use serde_json::json;
use std::path::{Path, PathBuf};

/// A planned step beside its simulation, and between the program's points.
pub struct Verified {
    comparison: StepComparison,
    between: BetweenPoints,
    drawn: Option<PathBuf>,
}

impl Verified {
    /// Whether the model follows the plan.
    pub fn is_good(&self) -> bool {
        self.comparison.follows_plan() && self.between.is_kept()
    }

    /// Lines for a person.
    pub fn text(&self) -> String {
        let (c, b) = (&self.comparison, &self.between);
        let mut text = format!(
            "         full-order step {}: joints within {:.1e} rad, body {:.1e} m and {:.1e} rad, normal forces {:.3} %, toes land at {:+.1e} and {:+.1e} m\n",
            if c.follows_plan() { "follows the plan" } else { "DOES NOT FOLLOW the plan" },
            c.joint_error_rad,
            c.body_position_error_m,
            c.body_orientation_error_rad,
            100.0 * c.normal_force_error,
            c.landing_height_m[0],
            c.landing_height_m[1]
        );
        if let Some(file) = &self.drawn {
            text += &format!("         drawn: {}\n", file.display());
        }
        text += &format!(
            "         between the points {}: stance toes slip {:.1e} m, swing toes {:.1e} m below the floor, joints {:.1e} rad from their polynomials, base out of balance by {:.2} N or N m; beyond limits: joints {:.1e} rad, {:.1e} rad/s, torque {:.2} N m, ground forces {:.2} N\n",
            if b.is_kept() { "the plan is kept" } else { "the plan is NOT KEPT" },
            b.stance_slip_m,
            b.swing_below_floor_m,
            b.polynomial_rad,
            b.imbalance,
            b.joint_range_rad,
            largest(b.joint_velocity_rad_s),
            largest(b.torque_nm),
            b.ground_force_n
        );
        text
    }

    /// The same for a program.
    pub fn json(&self) -> serde_json::Value {
        let (c, b) = (&self.comparison, &self.between);
        json!({
            "follows_plan": c.follows_plan(), "joint_error_rad": c.joint_error_rad,
            "body_position_error_m": c.body_position_error_m, "body_orientation_error_rad": c.body_orientation_error_rad,
            "normal_force_error": c.normal_force_error, "landing_height_m": c.landing_height_m, "drawn": self.drawn,
            "between_points": {
                "kept": b.is_kept(), "stance_slip_m": b.stance_slip_m, "swing_below_floor_m": b.swing_below_floor_m,
                "polynomial_rad": b.polynomial_rad, "imbalance": b.imbalance, "joint_range_rad": b.joint_range_rad,
                "joint_velocity_rad_s": largest(b.joint_velocity_rad_s),
                "torque_nm": largest(b.torque_nm), "ground_force_n": b.ground_force_n,
            },
        })
    }
}

/// Simulates each planned step with the full-order model.
pub fn verify(
    robot: &robot::Robot,
    request: &GaitRequest,
    plan: &Plan,
    law: StepLaw,
    plot: Option<&Path>,
) -> Result<Vec<Verified>> {
    let robot = gait_design::on_slope(robot, request);
    let steps = [(&plan.points, ""), (&plan.second_points, "_second")];
    let planned = steps.into_iter().filter(|(points, _)| !points.is_empty());
    planned
        .map(|(points, which)| {
            let drawn = plot.map(|folder| folder.join(format!("{}{which}_step.png", plan.gait.name)));
            let comparison = gait_design::simulate_planned_step(&robot, &plan.gait, points, law)
                .with_context(|| format!("cannot simulate {}", plan.gait.name))?;
            if let Some(file) = &drawn {
                draw_step(&plan.gait, points, &comparison, file)?;
            }
            let between = gait_design::between_points(&robot, request, &plan.gait, points);
            Ok(Verified { comparison, between, drawn })
        })
        .collect()
}

/// Draws a planned step beside its simulation.
fn draw_step(
    gait: &gait::Gait,
    points: &[PlanPoint],
    comparison: &gait_design::StepComparison,
    file: &Path,
) -> Result<()> {
    let legs = comparison.stance_legs;
    let planned: Vec<report::StepPoint> = points
        .iter()
        .map(|p| report::StepPoint {
            time_s: p.phase * gait.step_duration_s,
            joint_position_rad: std::array::from_fn(|j| p.q[6 + j]),
            normal_force_n: legs.map(|leg| p.ground_force_n[leg][2]),
        })
        .collect();
    let simulated: Vec<report::StepPoint> = comparison
        .simulated
        .iter()
        .map(|p| report::StepPoint {
            time_s: p.time_s,
            joint_position_rad: p.joint_position_rad,
            normal_force_n: p.normal_force_n,
        })
        .collect();
    let step = report::PlannedStep { name: &gait.name, stance_legs: legs, planned: &planned, simulated: &simulated };
    let png = report::planned_step(&step)?.to_png()?;
    if let Some(folder) = file.parent() {
        std::fs::create_dir_all(folder).with_context(|| format!("cannot make the folder {}", folder.display()))?;
    }
    crate::output::write_file(file, &png)
}

/// The step's map around the gait, with a line for a person.
pub struct Stable {
    map: &'static str,
    stability: gait_design::Stability,
    certificate: Option<gait::Certificate>,
}

impl Stable {
    /// Linearises the plan.
    pub fn of(robot: &robot::Robot, request: &GaitRequest, plan: &Plan) -> Result<Stable> {
        let on_slope = gait_design::on_slope(robot, request);
        let stability = gait_design::stability(&on_slope, &plan.gait, &plan.points, &plan.second_points)
            .with_context(|| format!("cannot linearise {}", request.behaviour))?;
        let map = if plan.second_points.is_empty() { "step-to-step" } else { "stride-to-stride" };
        Ok(Stable { map, stability, certificate: plan.gait.certificate })
    }

    /// What the certificate reports.
    fn word(&self) -> String {
        match &self.certificate {
            None => "no certificate: the law does not give the planned torques".into(),
            Some(c) if c.stable => "stable".into(),
            Some(c) if c.largest_multiplier < 1.0 && self.stability.step_growth > MOST_STEP_GROWTH => format!(
                "not called stable: within a step a disturbance grows {:.0} times before it shrinks; try a shorter step",
                self.stability.step_growth
            ),
            Some(c) if c.largest_multiplier < 1.0 => format!(
                "not called stable: a swing toe skims the floor for {:.3} m before it lands, and touchdown by the clock cannot be had",
                c.landing_run_m
            ),
            Some(_) => "not stable by itself: early touchdown has to catch it".into(),
        }
    }

    /// A line for a person.
    pub fn text(&self) -> String {
        let s = &self.stability;
        let show =
            |m: &[Complex]| m.iter().map(|m| format!("{:+.3}{:+.3}i", m.re, m.im)).collect::<Vec<_>>().join(", ");
        format!(
            "         {} map, rigid touchdown by the clock: largest multiplier {:.3} ({}): {}; x, y{} {}\n",
            self.map,
            s.spectral_radius(),
            self.word(),
            show(&s.multipliers[..6]),
            if s.neutral.len() == 3 { ", yaw" } else { "" },
            show(&s.neutral)
        )
    }

    /// The same for a program; complex numbers as their two parts.
    pub fn json(&self) -> serde_json::Value {
        let s = &self.stability;
        let parts = |m: &[Complex]| m.iter().map(|m| [m.re, m.im]).collect::<Vec<_>>();
        json!({
            "map": self.map, "spectral_radius": s.spectral_radius(), "stable": self.certificate.is_some_and(|c| c.stable),
            "landing_run_m": self.certificate.map(|c| c.landing_run_m), "step_growth": s.step_growth,
            "multipliers": parts(&s.multipliers), "neutral": parts(&s.neutral),
        })
    }
}

/// The largest of three excesses; one that is no number is reported, and not passed over.
fn largest(excesses: [f64; 3]) -> f64 {
    excesses.into_iter().fold(0.0, |most, one| if one.is_nan() || one > most { one } else { most })
}

#[cfg(test)]
mod tests {
    #[test]
    fn an_excess_that_is_no_number_is_not_passed_over() {
        assert_eq!(super::largest([0.0, 2.0, 1.0]), 2.0);
        assert!(super::largest([f64::NAN, 2.0, 1.0]).is_nan() && super::largest([1.0, 2.0, f64::NAN]).is_nan());
    }
}
