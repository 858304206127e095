//! The robot's shape over time, from its recorded description.

use gait::{LEG_NAMES, LEGS};
use report::{Sample, Skeleton};
use rigid_body::{Data, FrameId, Model, forward_kinematics, frame_position};

use crate::BehaviourRun;

/// Frames a second: a film's.
const STEP_S: f64 = 0.02;

/// Places of the base and of every hip, knee and toe. `Err` says why there are none: no description in the bag, or one
/// of a robot without the links `LEG_hip`, `LEG_upper`, `LEG_lower`, `LEG_toe`.
///
/// # Errors
/// A sentence for people.
pub fn skeleton(run: &BehaviourRun) -> Result<Skeleton, String> {
    let urdf = run.robot_description.as_deref().ok_or("the bag holds no robot_description")?;
    let model = Model::floating_base_from_urdf(urdf).map_err(|error| error.to_string())?;
    let link = |name: String| model.frame_id(&name).ok_or_else(|| format!("the robot has no link '{name}'"));
    let mut links: Vec<FrameId> = Vec::new();
    for leg in LEG_NAMES {
        for part in ["hip", "upper", "lower", "toe"] {
            links.push(link(format!("{leg}_{part}"))?);
        }
    }
    if model.dof() != 18 {
        return Err(format!("the robot has {} degrees of freedom; expected 18", model.dof()));
    }
    let (Some(first), Some(last)) = (run.samples.first(), run.samples.last()) else {
        return Err("the run has no samples".into());
    };
    let mut data = Data::new(&model);
    let mut frames = Vec::new();
    let mut at = 0;
    for number in 0..=((last.time_s - first.time_s) / STEP_S) as usize {
        let time_s = first.time_s + number as f64 * STEP_S;
        while run.samples.get(at + 1).is_some_and(|next| next.time_s <= time_s) {
            at += 1;
        }
        frames.push(places(&model, &mut data, &links, &run.samples[at], run.has_body));
    }
    Ok(Skeleton { from_s: first.time_s, step_s: STEP_S, frames })
}

fn places(
    model: &Model,
    data: &mut Data,
    links: &[FrameId],
    sample: &Sample,
    has_body: bool,
) -> [[f64; 3]; 1 + 4 * LEGS] {
    let mut q = [0.0; 18];
    q[..3].copy_from_slice(&sample.base_position_m);
    q[3..6].copy_from_slice(&sample.base_roll_pitch_yaw_rad);
    q[6..].copy_from_slice(&sample.joint_position_rad);
    forward_kinematics(model, data, &q, &[0.0; 18], &[0.0; 18]);
    let mut places = [[0.0; 3]; 1 + 4 * LEGS];
    places[0] = sample.base_position_m;
    for (place, link) in places[1..].iter_mut().zip(links) {
        *place = frame_position(model, data, *link).into();
    }
    if !has_body {
        // Without a base the robot stands where its lowest foot touches the floor.
        let lowest = places.iter().fold(f64::INFINITY, |lowest, place| lowest.min(place[2]));
        for place in &mut places {
            place[2] -= lowest;
        }
    }
    places
}
