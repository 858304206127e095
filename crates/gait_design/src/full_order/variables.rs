//! Bounds and names of the program's unknowns.

use super::costs::{SWAY_RAD, leaning};
use super::goal;
use super::schedule::{COEFFICIENTS, Closure, Place, Schedule, at};
use crate::limits::Limits;
use crate::planar::PlanarMotion;
use crate::request::GaitRequest;
use crate::terms::Names;
use gait::JOINTS;
use robot::Robot;

/// How far a reference may be outside a joint's range, rad: torque over stiffness, and half as much again.
const REFERENCE_SPARE_RAD: f64 = 0.4;
/// How far a coefficient may be outside its joint's range, rad: a polynomial between its bounds may have coefficients a
/// little outside.
const COEFFICIENT_SPARE_RAD: f64 = 0.3;

/// By how much a number of the state that is to be reached may be missed, either way: far more than is ever used.
const MISSED: f64 = 10.0;

/// Lower and upper bounds of all unknowns.
pub(super) fn bounds(
    robot: &Robot,
    request: &GaitRequest,
    schedule: &Schedule,
    limits: &Limits,
    joints_prescribed: bool,
) -> [Vec<f64>; 2] {
    [0, 1].map(|side| {
        let mut bounds = Vec::with_capacity(schedule.unknowns);
        let range: [f64; JOINTS] = std::array::from_fn(|j| {
            let leg = &robot.legs[j / 3];
            [leg.position_min_rad, leg.position_max_rad][side][j % 3]
        });
        let outward = [-1.0, 1.0][side];
        let bends = bends(request, schedule);
        let spare = coefficient_spare_rad(bends, joints_prescribed);
        for _ in 0..schedule.domains.len() * COEFFICIENTS {
            bounds.extend((0..JOINTS).map(|j| range[j] + spare[j % 3] * outward));
        }
        bounds.push(limits.step_duration_s[side]);
        for place in schedule.places() {
            bounds.extend(base(request, schedule, limits, place, side));
            bounds.extend(range.map(|end| end - limits.joint_inward_rad * outward));
            bounds.extend(limits.base_rate.map(|rate| rate * outward));
            bounds.extend((0..JOINTS).map(|j| limits.joint_rate_rad_s[j % 3] * outward));
            bounds.extend(limits.base_acceleration.map(|acceleration| acceleration * outward));
            bounds.extend([limits.joint_acceleration_rad_s2 * outward; JOINTS]);
            bounds.extend((0..JOINTS).map(|j| limits.torque_nm[j % 3] * outward));
            for _ in &schedule.domains[place.domain].stance {
                bounds.extend(limits.force_n[side]);
            }
        }
        if let Closure::Between(states) = &schedule.closure {
            let first = schedule.places()[0].column;
            bounds[first + at::Q..first + at::V].copy_from_slice(&states[0].q);
            bounds[first + at::V..first + at::A].copy_from_slice(&states[0].v);
            bounds.extend(schedule.missed().map(|_| MISSED * outward));
        }
        bounds
    })
}

/// Whether hip rolls' coefficients may be outside the joint's range. Straight on they need not; in place, sideways and
/// from state to state, gaits whose coefficients may not are bent by it until they fall.
fn bends(request: &GaitRequest, schedule: &Schedule) -> bool {
    schedule.is_between() || !PlanarMotion::of(request).is_straight()
}

/// Of hip roll, hip pitch and knee.
fn coefficient_spare_rad(bends: bool, joints_prescribed: bool) -> [f64; 3] {
    let roll = if bends { COEFFICIENT_SPARE_RAD } else { 0.0 };
    let reference = if joints_prescribed { 0.0 } else { REFERENCE_SPARE_RAD };
    [roll, COEFFICIENT_SPARE_RAD, COEFFICIENT_SPARE_RAD].map(|spare| spare + reference)
}

/// Bounds of the base's coordinates on one side. y and yaw are about where the motion leads.
fn base(request: &GaitRequest, schedule: &Schedule, limits: &Limits, place: &Place, side: usize) -> [f64; 6] {
    let (motion, t) = (PlanarMotion::of(request), place.time * request.step_duration_s);
    let outward = [-1.0, 1.0][side];
    let [y, z, roll, pitch, yaw] = limits.base[side];
    // x of a step that is mirrored is 0 at its first point: where it begins is free. Each step has the reach of the
    // first.
    let begins = place.index == 0 && schedule.closure == Closure::Mirrored;
    let x = if begins { 0.0 } else { limits.reach_m * (place.domain + 1) as f64 };
    let mut bounds = [x * outward, y + motion.displacement_m(t).y, z, roll, pitch, yaw + motion.yaw_rad(t)];
    for (coordinate, angle) in leaning(request) {
        bounds[coordinate] = angle + SWAY_RAD * outward;
    }
    bounds
}

/// What an unknown is, for people.
pub(super) fn name(schedule: &Schedule, names: &Names, column: usize) -> String {
    if column < schedule.t() {
        let (domain, k) = (column / JOINTS / COEFFICIENTS, column / JOINTS % COEFFICIENTS);
        return format!(
            "Bézier coefficient {k} of {}{}",
            names.joint(column % JOINTS),
            schedule.places_of(domain)[0].step
        );
    }
    if column == schedule.t() {
        return "step duration".into();
    }
    if let Some(row) = column.checked_sub(schedule.missed().start) {
        let last = schedule.domains.last().expect("a schedule has domains");
        return format!("what is missed of {}", goal::what([&last.stance, &last.swing], row, names));
    }
    let after = schedule.places().partition_point(|place| place.column <= column);
    let place = &schedule.places()[after - 1];
    let what = match column - place.column {
        i if i < at::V => format!("position of {}", names.coordinate(i)),
        i if i < at::A => format!("velocity of {}", names.coordinate(i - at::V)),
        i if i < at::U => format!("acceleration of {}", names.coordinate(i - at::A)),
        i if i < at::LAMBDA => format!("torque of {}", names.joint(i - at::U)),
        i => format!("force on {}", names.toe(schedule.domains[place.domain].stance[(i - at::LAMBDA) / 3])),
    };
    format!("{what}, {place}")
}
