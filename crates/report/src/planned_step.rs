//! A plan's step beside the same step simulated with the full-order model (the paper's Fig. "bi2quad").

use gait::{JOINTS, JOINTS_PER_LEG, LEG_LABELS, LEGS};
use plotters::prelude::*;

use crate::ReportError;
use crate::canvas::{BLUE, Image, ORANGE, draw, drawing, px};
use crate::figures::{JOINT_COLOURS, JOINT_TYPES, Labels, at_least, chart, heading, line, padded};

/// Joints and ground forces at one instant.
#[derive(Clone, Debug, PartialEq)]
pub struct StepPoint {
    /// Time since the step began, s.
    pub time_s: f64,
    /// Positions of the twelve joints, rad.
    pub joint_position_rad: [f64; JOINTS],
    /// Normal forces on the two stance legs' toes, N.
    pub normal_force_n: [f64; 2],
}

/// One step, planned and simulated.
#[derive(Clone, Debug, PartialEq)]
pub struct PlannedStep<'a> {
    /// Name of the gait.
    pub name: &'a str,
    /// The stance legs, in the order of the normal forces.
    pub stance_legs: [usize; 2],
    /// The plan's points.
    pub planned: &'a [StepPoint],
    /// The simulated step.
    pub simulated: &'a [StepPoint],
}

/// Five panels: the joints of each leg, and the normal forces; the plan's points as dots on the simulated lines.
///
/// # Errors
/// [`ReportError::TooLittle`] if either course has fewer than two points; [`ReportError::Drawing`].
pub fn planned_step(step: &PlannedStep) -> Result<Image, ReportError> {
    for (what, points) in [("planned", step.planned), ("simulated", step.simulated)] {
        if points.len() < 2 {
            return Err(ReportError::TooLittle {
                run: step.name.to_owned(),
                problem: format!("the {what} step has {} points, expected two or more", points.len()),
            });
        }
    }
    const FORCE_COLOURS: [RGBColor; 2] = [BLUE, ORANGE];
    draw(1800, 520, |area| {
        let legend: Vec<(&str, RGBColor)> = JOINT_TYPES.into_iter().zip(JOINT_COLOURS).collect();
        let title = format!("{}: the planned step and the full-order robot's", step.name);
        let note =
            "dots: the front biped's plan, recomposed; lines: all 18 coordinates, simulated from the plan's start";
        let plot = heading(area, &title, note, &legend)?;
        let panels = plot.split_evenly((1, LEGS + 1));
        let end = step.simulated.last().map_or(0.0, |p| p.time_s);
        for leg in 0..LEGS {
            let joints = leg * JOINTS_PER_LEG..(leg + 1) * JOINTS_PER_LEG;
            let all = step.planned.iter().chain(step.simulated);
            let values = all.flat_map(|p| p.joint_position_rad[joints.clone()].iter().copied());
            let stands = if step.stance_legs.contains(&leg) { "stands" } else { "swings" };
            let mut chart = chart(
                &panels[leg],
                0.0..end,
                at_least(padded(values), 0.1),
                Labels {
                    title: &format!("{} ({stands})", LEG_LABELS[leg]),
                    x: "time (s)",
                    y: "joint (rad)",
                    ..Labels::default()
                },
            )?;
            for (joint, colour) in joints.zip(JOINT_COLOURS) {
                let course = |points: &[StepPoint]| -> Vec<(f64, f64)> {
                    points.iter().map(|p| (p.time_s, p.joint_position_rad[joint])).collect()
                };
                line(&mut chart, &course(step.simulated), colour.to_rgba(), 2.0)?;
                dots(&mut chart, &course(step.planned), colour)?;
            }
        }
        let all = step.planned.iter().chain(step.simulated);
        let mut chart = chart(
            &panels[LEGS],
            0.0..end,
            at_least(padded(all.flat_map(|p| p.normal_force_n)), 10.0),
            Labels { x: "time (s)", y: "normal force (N)", ..Labels::default() },
        )?;
        for (place, colour) in FORCE_COLOURS.into_iter().enumerate() {
            let course = |points: &[StepPoint]| -> Vec<(f64, f64)> {
                points.iter().map(|p| (p.time_s, p.normal_force_n[place])).collect()
            };
            line(&mut chart, &course(step.simulated), colour.to_rgba(), 2.0)?;
            dots(&mut chart, &course(step.planned), colour)?;
        }
        let legs: Vec<(&str, RGBColor)> =
            step.stance_legs.into_iter().zip(FORCE_COLOURS).map(|(leg, colour)| (LEG_LABELS[leg], colour)).collect();
        crate::figures::panel_legend(&panels[LEGS], &legs)
    })
}

fn dots(chart: &mut crate::figures::Chart, points: &[(f64, f64)], colour: RGBColor) -> Result<(), ReportError> {
    let dot = |point: &(f64, f64)| Circle::new(*point, px(4), colour.filled());
    chart.draw_series(points.iter().map(dot)).map_err(drawing)?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn course(points: usize) -> Vec<StepPoint> {
        let at = |k: usize| k as f64 / (points - 1) as f64;
        (0..points)
            .map(|k| StepPoint {
                time_s: 0.35 * at(k),
                joint_position_rad: std::array::from_fn(|j| (at(k) * 3.0 + j as f64).sin()),
                normal_force_n: [180.0 + 40.0 * at(k), 190.0 - 40.0 * at(k)],
            })
            .collect()
    }

    #[test]
    fn the_picture_shows_the_plan_and_the_simulation() {
        let (planned, simulated) = (course(11), course(51));
        let step = PlannedStep { name: "amble", stance_legs: [1, 2], planned: &planned, simulated: &simulated };
        let both = planned_step(&step).unwrap();
        assert_eq!((both.width(), both.height()), (1800, 520));
        // Moved points move dots.
        let mut moved = planned.clone();
        moved[5].joint_position_rad[4] += 0.3;
        assert_ne!(planned_step(&PlannedStep { planned: &moved, ..step.clone() }).unwrap(), both);
        let error = planned_step(&PlannedStep { planned: &planned[..1], ..step }).unwrap_err().to_string();
        assert!(error.contains("planned step has 1 points"), "{error}");
    }
}
