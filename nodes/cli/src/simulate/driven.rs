//! The picture of a robot that was driven, out of a simulated walk.

use anyhow::Result;
use nalgebra::{Rotation3, Vector3};
use report::{Driven, Run, Sample};
use robot::{LegKinematics, Robot};
use simulator::walk::WalkOptions;

/// A foot that carries more than this has come down, N.
const DOWN_N: f64 = 10.0;
/// A foot that was in the air for less has not been lifted, s: contact chatters.
const AIR_S: f64 = 0.05;

/// As PNG.
pub(super) fn picture(run: &Run, robot: &Robot, options: &WalkOptions) -> Result<Vec<u8>> {
    let begin_s = run.walking_from_s;
    let asked: Vec<_> = (options.velocities.iter())
        .map(|(from_s, asked)| (begin_s + from_s, [asked.forward_m_s, asked.left_m_s, asked.yaw_rad_s]))
        .collect();
    // A push that was to come after the end of the run has not come.
    let end_s = run.samples.last().map_or(begin_s, |last| last.time_s);
    let pushes: Vec<_> = (options.pushes.iter())
        .map(|push| (begin_s + push.start_s, [push.force_n[0], push.force_n[1]]))
        .filter(|(at_s, _)| *at_s < end_s)
        .collect();
    let footholds_m = footholds_m(robot, run.samples)?;
    let driven = Driven { asked: &asked, pushes: &pushes, footholds_m: &footholds_m };
    Ok(report::driven(run, &driven)?.to_png()?)
}

/// Where feet came down, in the world, m.
fn footholds_m(robot: &Robot, samples: &[Sample]) -> Result<Vec<[f64; 2]>> {
    let legs = LegKinematics::all(robot)?;
    let mut found = Vec::new();
    for (leg, kinematics) in legs.iter().enumerate() {
        let mut last_down_s = f64::NEG_INFINITY;
        for sample in samples.iter().filter(|sample| sample.ground_force_n[leg] > DOWN_N) {
            if sample.time_s - last_down_s > AIR_S {
                let joints_rad = std::array::from_fn(|k| sample.joint_position_rad[3 * leg + k]);
                let [roll, pitch, yaw] = sample.base_roll_pitch_yaw_rad;
                let turned = Rotation3::from_euler_angles(roll, pitch, yaw) * kinematics.toe_m(&joints_rad);
                let toe = Vector3::from(sample.base_position_m) + turned;
                found.push([toe.x, toe.y]);
            }
            last_down_s = sample.time_s;
        }
    }
    Ok(found)
}
