//! What a gait plans over a stride, for the figures.

use gait::{Gait, LEGS};

/// One joint's planned stride: positions rad and velocities rad/s at `points` phases of each of its steps and the last.
pub(crate) fn planned_orbit(gait: &Gait, joint: usize, points: u32) -> Vec<(f64, f64)> {
    let stride = gait.schedule();
    stride
        .iter()
        .flat_map(|domain| (0..=points).map(move |point| domain.planned(f64::from(point) / f64::from(points))))
        .map(|(position, velocity)| (position[joint], velocity[joint]))
        .collect()
}

/// A step of a walk: from when to when, s, and which legs stand.
pub(crate) struct PlannedStep {
    pub from_s: f64,
    pub to_s: f64,
    pub stands: [bool; LEGS],
}

/// The steps that a walk of so many seconds has ended, as they are planned; it began with the stride's first.
pub(crate) fn planned_steps(gait: &Gait, walked_s: f64) -> Vec<PlannedStep> {
    let (stride, stride_s) = (gait.schedule(), gait.stride_duration_s());
    let mut steps = Vec::new();
    for number in 0.. {
        let mut from_s = f64::from(number) * stride_s;
        for domain in &stride {
            let to_s = from_s + domain.duration_s;
            if to_s > walked_s + 1e-9 {
                return steps;
            }
            steps.push(PlannedStep { from_s, to_s, stands: domain.stands });
            from_s = to_s;
        }
    }
    steps
}
