//! How a robot with given legs may stand and sit.

use nalgebra::Vector3;
use rigid_body::{Data, Description, FrameId, Model, forward_kinematics, frame_position};
use urdf_rs::Geometry;

use super::legs::{Found, LegFound};
use crate::RobotError;

/// Standing, the toe is this share of the stretched leg below the hip.
const STAND_SHARE: f64 = 0.76;
/// Sitting, the first of these shares that the leg can fold to.
const SIT_SHARES: [f64; 5] = [0.35, 0.42, 0.5, 0.58, 0.66];
/// Points of the grid on each joint that the search starts from.
const GRID: usize = 61;
/// A toe this close to its place is there, m.
const REACHED_M: f64 = 1e-7;

/// Postures and what follows from them.
#[derive(Debug, Clone)]
pub(super) struct Postures {
    pub stand_rad: [[f64; 3]; 4],
    pub sit_rad: [[f64; 3]; 4],
    pub height_m: f64,
    pub half_width_m: f64,
    pub toe_radius_m: f64,
    pub look_at: Vec<String>,
}

/// One leg's chain of frames.
struct LegChain<'a> {
    model: &'a Model,
    about: &'a LegFound,
    dof: [usize; 3],
    hip: FrameId,
    thigh: FrameId,
    shank: FrameId,
    toe: FrameId,
}

/// Where the leg's parts are, m, torso axes.
struct At {
    hip: Vector3<f64>,
    thigh: Vector3<f64>,
    shank: Vector3<f64>,
    toe: Vector3<f64>,
}

impl<'a> LegChain<'a> {
    fn new(model: &'a Model, about: &'a LegFound) -> Self {
        let dof = std::array::from_fn(|k| model.joint_index(&about.joints[k]).expect("a leg's joints move"));
        let frame = |name: &str| model.frame_id(name).expect("every link is a frame");
        let [hip, thigh, shank] = dof.map(|dof| frame(model.link_name(dof)));
        Self { model, about, dof, hip, thigh, shank, toe: frame(&about.toe) }
    }

    fn at(&self, data: &mut Data, joints: &[f64; 3]) -> At {
        let mut q = vec![0.0; self.model.dof()];
        let zero = vec![0.0; self.model.dof()];
        for k in 0..3 {
            q[self.dof[k]] = joints[k];
        }
        forward_kinematics(self.model, data, &q, &zero, &zero);
        let [hip, thigh, shank, toe] =
            [self.hip, self.thigh, self.shank, self.toe].map(|frame| frame_position(self.model, data, frame));
        At { hip, thigh, shank, toe }
    }

    fn length_m(&self, data: &mut Data) -> f64 {
        let at = self.at(data, &[0.0; 3]);
        (at.shank - at.thigh).norm() + (at.toe - at.shank).norm()
    }

    /// Joint angles with the toe straight below the hip pitch at height `z`, the knee behind the hip or before it.
    fn below(&self, data: &mut Data, z: f64, knee_behind: bool) -> Option<[f64; 3]> {
        let (low, high) = (self.about.min_rad, self.about.max_rad);
        let roll = 0.0_f64.clamp(low[0], high[0]);
        let point = |k: usize, i: usize| low[k] + (high[k] - low[k]) * i as f64 / (GRID - 1) as f64;
        let mut best: Option<(f64, [f64; 3])> = None;
        for i in 0..GRID * GRID {
            let joints = [roll, point(1, i / GRID), point(2, i % GRID)];
            let at = self.at(data, &joints);
            let miss = (at.toe.x - at.thigh.x).hypot(at.toe.z - z);
            let behind = at.shank.x < at.thigh.x;
            // The thigh hangs: a knee above the hip is another posture.
            let hangs = at.shank.z < at.thigh.z;
            if behind == knee_behind && hangs && best.is_none_or(|(least, _)| miss < least) {
                best = Some((miss, joints));
            }
        }
        self.refine(data, z, best?.1).filter(|joints| {
            let at = self.at(data, joints);
            (at.shank.x < at.thigh.x) == knee_behind
        })
    }

    /// Newton's method in pitch and knee, within the limits.
    fn refine(&self, data: &mut Data, z: f64, mut joints: [f64; 3]) -> Option<[f64; 3]> {
        const STEP: f64 = 1e-6;
        for _ in 0..40 {
            let miss = |at: &At| [at.toe.x - at.thigh.x, at.toe.z - z];
            let here = miss(&self.at(data, &joints));
            if here[0].hypot(here[1]) < REACHED_M {
                return Some(joints);
            }
            let column = |data: &mut Data, k: usize| {
                let mut moved = joints;
                moved[k] += STEP;
                let there = miss(&self.at(data, &moved));
                [(there[0] - here[0]) / STEP, (there[1] - here[1]) / STEP]
            };
            let (a, b) = (column(data, 1), column(data, 2));
            let determinant = a[0] * b[1] - b[0] * a[1];
            if determinant.abs() < 1e-9 {
                return None;
            }
            let step =
                [(here[0] * b[1] - b[0] * here[1]) / determinant, (a[0] * here[1] - here[0] * a[1]) / determinant];
            for (k, step) in [(1, step[0]), (2, step[1])] {
                let to = joints[k] - step.clamp(-0.2, 0.2);
                joints[k] = to.clamp(self.about.min_rad[k], self.about.max_rad[k]);
            }
        }
        None
    }
}

/// Postures for the legs found.
pub(super) fn find(model: &Model, description: &Description, found: &Found) -> Result<Postures, RobotError> {
    let mut data = Data::new(model);
    let mut look_at = Vec::new();
    let legs: Vec<LegChain> = found.legs.iter().map(|about| LegChain::new(model, about)).collect();
    let length_m = legs[0].length_m(&mut data);
    let hip_z = legs[0].at(&mut data, &[0.0; 3]).thigh.z;
    let front = |data: &mut Data, share: f64| all_legs(&legs, data, hip_z - share * length_m);
    let Some((stand_rad, knees)) = front(&mut data, STAND_SHARE) else {
        return Err(RobotError::NotFourLegs {
            problem: format!(
                "a leg cannot stand with its toe {:.3} m straight below the hip within the URDF's limits",
                STAND_SHARE * length_m
            ),
        });
    };
    if let Some(line) = knees {
        look_at.push(line);
    }
    let sit_rad =
        SIT_SHARES.iter().find_map(|&share| front(&mut data, share).map(|(sit, _)| sit)).unwrap_or_else(|| {
            look_at.push("sit_rad: no folded posture was found within the limits, standing is taken".to_owned());
            stand_rad
        });
    let at: Vec<At> = (0..4).map(|leg| legs[leg].at(&mut data, &stand_rad[leg])).collect();
    let height_m = at.iter().map(|at| at.hip.z - at.toe.z).sum::<f64>() / 4.0;
    let half_width_m = at.iter().map(|at| at.toe.y.abs()).sum::<f64>() / 4.0;
    look_at.push(format!(
        "standing: toes {height_m:.3} m below the hips, {half_width_m:.3} m from the middle, {:.0} % of the stretched leg; the picture shows it",
        100.0 * STAND_SHARE
    ));
    let toe_radius_m = toe_radius(description, &found.legs[0].toe).unwrap_or_else(|| {
        let assumed = (0.05 * length_m * 1e3).round() / 1e3;
        look_at.push(format!(
            "toe_radius_m: toe link '{}' is neither ball nor cylinder, {assumed} m assumed",
            found.legs[0].toe
        ));
        assumed
    });
    Ok(Postures { stand_rad, sit_rad, height_m, half_width_m, toe_radius_m, look_at })
}

type Angles = [[f64; 3]; 4];

/// All legs with their toes at height `z`: all knees behind, else all before, else as each can, with a line that says
/// so.
fn all_legs(legs: &[LegChain], data: &mut Data, z: f64) -> Option<(Angles, Option<String>)> {
    let tries = [true, false].map(|behind| legs.iter().map(|leg| leg.below(data, z, behind)).collect::<Vec<_>>());
    for side in &tries {
        if let [Some(a), Some(b), Some(c), Some(d)] = side[..] {
            return Some(([a, b, c, d], None));
        }
    }
    let each: Vec<[f64; 3]> = (0..4).filter_map(|leg| tries[0][leg].or(tries[1][leg])).collect();
    let angles = <Angles>::try_from(each).ok()?;
    let line = "front and rear knees point apart or together, as the URDF's limits ask: such plans take tenths of a second, and no library of gaits can hold them";
    Some((angles, Some(line.to_owned())))
}

/// Radius of the toe's ball or cylinder.
fn toe_radius(description: &Description, toe: &str) -> Option<f64> {
    let link = description.robot().links.iter().find(|link| link.name == toe)?;
    if let Some((_, radius)) = crate::toe::ball(link) {
        return Some(radius);
    }
    let shapes = link.collision.iter().map(|c| &c.geometry).chain(link.visual.iter().map(|v| &v.geometry));
    shapes.into_iter().find_map(|shape| match shape {
        Geometry::Sphere { radius } | Geometry::Cylinder { radius, .. } | Geometry::Capsule { radius, .. } => {
            Some(*radius)
        }
        _ => None,
    })
}
