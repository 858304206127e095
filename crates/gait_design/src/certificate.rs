//! What is known of how a gait stands by itself, cheap enough to go with every plan: the largest multiplier of its
//! step's map, and whether touchdown by the clock, which that map takes for granted, can be had.
//!
//! The map's swing toes land at T wherever the floor is. A robot that is off its plan by a few millimetres meets the
//! floor earlier, and what happens then depends on the way down: a toe that comes from above stands where it would
//! have stood; one that skims the last centimetres is held back by them. Backward gaits skim (the optimum of a
//! forward gait draws its toes back before they land; walked backward the same arc is a glide), and so they leave
//! their plan, or fall, where the map contracts. docs/planning.md has the measurement.

use crate::Reference;
use crate::recompose::PlanPoint;
use crate::refine::integral;
use crate::stability::stability;
use crate::verification::step_of;
use decomposition::DynamicsError;
use gait::{Certificate, Gait};
use nalgebra::Vector3;
use rigid_body::Data;
use robot::Robot;

/// How much higher than planned the floor is where the landing run is measured, as a share of the nominal height: 5.5
/// mm on the Vision 60, as far as a toe's place is off after a push.
const RAISED_SHARE: f64 = 0.01;
/// Longest landing run of a gait that is called stable, as a share of the nominal height: 2 cm on the Vision 60.
const RUN_SHARE: f64 = 0.036;
/// Largest growth of a disturbance within a step of a gait that is called stable.
pub const MOST_STEP_GROWTH: f64 = 11.0;

/// The certificate of a plan, whose points and second points are [`crate::Plan`]'s. For a plan on a slope, `robot` is
/// [`crate::on_slope`]'s. There is none where the law follows the planned joints themselves: it gives other torques,
/// and the map would be linearised about a motion that the robot does not make.
///
/// # Errors
///
/// If the dynamics are singular at a point of the plan.
pub fn certificate(
    robot: &Robot,
    gait: &Gait,
    reference: Reference,
    [points, second_points]: [&[PlanPoint]; 2],
) -> Result<Option<Certificate>, DynamicsError> {
    if reference == Reference::PlannedJoints {
        return Ok(None);
    }
    let stability = stability(robot, gait, points, second_points)?;
    let largest_multiplier = stability.spectral_radius();
    let steps = [points, second_points].into_iter().filter(|points| !points.is_empty());
    let landing_run_m = steps.map(|points| landing_run_m(robot, gait, points)).fold(0.0, f64::max);
    let lands_by_the_clock = landing_run_m <= RUN_SHARE * robot.nominal.height_m;
    let stable = largest_multiplier < 1.0 && stability.step_growth <= MOST_STEP_GROWTH && lands_by_the_clock;
    Ok(Some(Certificate { points: points.len() as u32, largest_multiplier, landing_run_m, stable }))
}

/// How far from its place a swing toe would meet a floor that is a little higher, m: the farther one's.
fn landing_run_m(robot: &Robot, gait: &Gait, points: &[PlanPoint]) -> f64 {
    const PARTS: usize = 10;
    let (_, _, swing) = step_of(points);
    let mut data = Data::new(&robot.model);
    let mut toes = |q: &[f64; 18]| -> [Vector3<f64>; 2] {
        rigid_body::forward_kinematics(&robot.model, &mut data, q, &[0.0; 18], &[0.0; 18]);
        swing.map(|leg| rigid_body::frame_position(&robot.model, &data, robot.legs[leg].toe))
    };
    let h = 2.0 * gait.step_duration_s / (points.len() - 1) as f64;
    let raised = RAISED_SHARE * robot.nominal.height_m;
    let landed = toes(&points[points.len() - 1].q);
    let mut below = landed;
    let mut runs = [None; 2];
    // Back in time from the landing to where both toes are above the raised floor.
    for three in points.windows(3).step_by(2).rev() {
        for part in (0..PARTS).rev() {
            let weights = integral(part as f64 / PARTS as f64);
            let moved = |i: usize| -> f64 { (0..3).map(|k| weights[k] * three[k].v[i]).sum() };
            let now = toes(&std::array::from_fn(|i| three[0].q[i] + h * moved(i)));
            for k in 0..2 {
                let (low, high) = (below[k].z - landed[k].z, now[k].z - landed[k].z);
                if runs[k].is_none() && high >= raised {
                    let meets = below[k].lerp(&now[k], ((raised - low) / (high - low)).clamp(0.0, 1.0));
                    runs[k] = Some((meets - landed[k]).xy().norm());
                }
            }
            if let [Some(a), Some(b)] = runs {
                return a.max(b);
            }
            below = now;
        }
    }
    // A toe that is never so high scrapes all the way.
    let start = toes(&points[0].q);
    (0..2).map(|k| runs[k].unwrap_or((start[k] - landed[k]).xy().norm())).fold(0.0, f64::max)
}
