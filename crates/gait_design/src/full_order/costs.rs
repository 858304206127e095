//! The program's cost: a sum of weighted squares of single unknowns, each kind from one function here.

use super::schedule::{Place, Schedule, at};
use crate::limits::ProgramSettings;
use crate::planar::PlanarMotion;
use crate::request::GaitRequest;
use gait::JOINTS;

/// weight · (x[column] − centre)².
#[derive(Clone, Copy, Debug)]
pub(super) struct Square {
    pub column: usize,
    pub weight: f64,
    pub centre: f64,
}

/// ‖q̇_b − what the motion asks for‖² at a point, at the pace of the T asked for.
pub(super) fn base_velocity(place: &Place, motion: PlanarMotion, nominal_t_s: f64) -> impl Iterator<Item = Square> {
    let velocity_m_s = motion.velocity_m_s(place.time * nominal_t_s);
    let centres = [velocity_m_s.x, velocity_m_s.y, 0.0, 0.0, 0.0, motion.yaw_rate_rad_s];
    let first = place.column + at::V;
    centres.into_iter().enumerate().map(move |(i, centre)| Square { column: first + i, weight: 1.0, centre })
}

/// ‖q̈_f‖² and ‖u‖² at a point. The decomposed program weighs the front biped's accelerations only; the same here.
pub(super) fn effort(place: &Place, settings: &ProgramSettings) -> impl Iterator<Item = Square> {
    let (p, acceleration, torque) = (place.column, settings.acceleration_weight, settings.torque_weight);
    let front = (0..9).chain(12..15).map(move |i| Square { column: p + at::A + i, weight: acceleration, centre: 0.0 });
    front.chain((0..JOINTS).map(move |j| Square { column: p + at::U + j, weight: torque, centre: 0.0 }))
}

/// How far from its angle a leaning torso may sway, rad.
pub(super) const SWAY_RAD: f64 = 0.05;
/// Of roll and pitch about where they are to be, 1/rad².
const TILT_WEIGHT: f64 = 1.0;

/// The coordinates in which the torso leans, and the angles that it is to be held at, rad.
pub(super) fn leaning(request: &GaitRequest) -> impl Iterator<Item = (usize, f64)> {
    [(3, request.torso_roll_rad), (4, request.torso_pitch_rad)].into_iter().filter(|(_, angle)| *angle != 0.0)
}

/// (roll, pitch − what was asked for)²: of a torso that is to lean, and of one that turns, steps aside or goes from
/// state to state, which is to stay level.
pub(super) fn tilt(schedule: &Schedule, request: &GaitRequest) -> Vec<Square> {
    let asked = [(3, request.torso_roll_rad), (4, request.torso_pitch_rad)];
    let levelled = schedule.is_between() || schedule.has_footholds() || !PlanarMotion::of(request).is_straight();
    asked
        .into_iter()
        .filter(|(_, angle)| levelled || *angle != 0.0)
        .flat_map(|(coordinate, centre)| {
            let column = move |place: &Place| place.column + at::Q + coordinate;
            schedule.places().iter().map(move |place| Square { column: column(place), weight: TILT_WEIGHT, centre })
        })
        .collect()
}

/// Moving the joints otherwise than in `x` (rate), and holding them elsewhere (position).
///
/// Without the pairing the cheapest gait is one that lets its nose down as far as it may and falls when it is walked.
/// So the program asks for the motion of the gait in `x` about a posture of its own, which is what a slope changes.
pub(super) fn near(schedule: &Schedule, x: &[f64]) -> Vec<Square> {
    /// 1/rad² and 1/(rad/s)², chosen by walking the plans in MuJoCo (docs/planning.md).
    const WEIGHTS: [(usize, f64); 2] = [(at::Q, 1e-3), (at::V, 0.1)];
    let of = |place: &Place| {
        let p = place.column;
        WEIGHTS.into_iter().flat_map(move |(block, weight)| {
            (p + block + 6..p + block + 6 + JOINTS).map(move |column| (column, weight))
        })
    };
    let columns = schedule.places().iter().flat_map(of);
    columns.map(|(column, weight)| Square { column, weight, centre: x[column] }).collect()
}

/// What is missed of the state that is to be reached.
pub(super) fn missed(schedule: &Schedule) -> impl Iterator<Item = Square> {
    /// So dear that what can be reached is; 1/m², 1/rad², 1/(m/s)², 1/(rad/s)².
    const WEIGHT: f64 = 1e5;
    schedule.missed().map(|column| Square { column, weight: WEIGHT, centre: 0.0 })
}
