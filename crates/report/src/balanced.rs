//! What the balanced law saw and did, for the page.

use crate::Sample;
use crate::numbers::{list, rounded};
use gait::Gait;
use serde_json::{Value, json};

/// A step that ran faster than this, of its own pace, was hurried.
const HURRIED: f64 = 1.05;

/// The balanced walk at one time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Balanced {
    /// Time, s, on the run's own clock.
    pub time_s: f64,
    /// Number of the step that is walked.
    pub step: u64,
    /// Where the base is by the estimate, m, from where that began.
    pub position_m: [f64; 2],
    /// Its heading, rad.
    pub yaw_rad: f64,
    /// Velocity ahead and to the left, m/s, and turning, rad/s, by the estimate.
    pub velocity: [f64; 3],
    /// The same as asked for; none where nobody asked, and the gait's own velocity is walked.
    pub asked: Option<[f64; 3]>,
    /// Where the swing feet are placed beyond the plan, ahead and to the left, m.
    pub placement_m: [f64; 2],
    /// The step's pace against the gait's own.
    pub pace: f64,
}

/// A place and a heading.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Pose {
    x: f64,
    y: f64,
    yaw: f64,
}

impl Pose {
    /// A place, seen from this pose.
    fn seen(self, [x, y]: [f64; 2]) -> [f64; 2] {
        let (sine, cosine) = self.yaw.sin_cos();
        let (x, y) = (x - self.x, y - self.y);
        [cosine * x + sine * y, cosine * y - sine * x]
    }
}

/// A balanced walk and what is known beside it.
pub(crate) struct Way<'a> {
    pub gait: Option<&'a Gait>,
    pub samples: &'a [Sample],
    pub balanced: &'a [Balanced],
    /// Whether the samples' base is the truth.
    pub has_truth: bool,
}

impl<'a> Way<'a> {
    /// A run's part of the page: nothing where the paper's law walked. Paths are seen from where the walk began.
    pub fn data(&self) -> Option<Value> {
        let [first, .., last] = self.balanced else { return None };
        let begun = Pose { x: first.position_m[0], y: first.position_m[1], yaw: first.yaw_rad };
        let estimated: Vec<[f64; 2]> = self.balanced.iter().map(|at| begun.seen(at.position_m)).collect();
        let truth = self.has_truth.then(|| self.true_samples());
        let true_path = truth.as_ref().map(|samples| seen_first(samples));
        let drift_m = true_path.as_ref().and_then(|path| {
            let (a, b) = (path.last()?, estimated.last()?);
            Some((a[0] - b[0]).hypot(a[1] - b[1]))
        });
        let of = |value: &dyn Fn(&Balanced) -> f64| json!(list(self.balanced.iter().map(value), 0.001));
        let own = [self.gait.map_or(0.0, Gait::speed_m_s), 0.0, 0.0];
        let speeds = |axis: usize| {
            let mut lines = vec![of(&|at| at.velocity[axis]), of(&|at| at.asked.unwrap_or(own)[axis])];
            if let Some(samples) = &truth {
                lines.push(json!(list(true_velocities(samples, axis).into_iter(), 0.001)));
            }
            lines
        };
        let hurried = hurried(self.balanced);
        Some(json!({
            "t": list(self.balanced.iter().map(|at| at.time_s), 0.001),
            "estimated": path(&estimated), "true": true_path.as_deref().map(path), "asked": path(&asked_path(self.balanced)),
            "ahead": speeds(0), "turning": speeds(2),
            "placement": [of(&|at| at.placement_m[0]), of(&|at| at.placement_m[1])],
            "pace": [of(&|at| at.pace)],
            "steps": last.step - first.step + 1, "hurried": hurried.len(),
            "fastest": hurried.iter().copied().fold(1.0, f64::max),
            "farthest_m": self.balanced.iter().map(|at| at.placement_m[0].hypot(at.placement_m[1])).fold(0.0, f64::max),
            "way_m": way_m(true_path.as_ref().unwrap_or(&estimated)), "drift_m": drift_m,
        }))
    }

    /// The true sample at each time of the law's.
    fn true_samples(&self) -> Vec<&'a Sample> {
        let at = |time_s: f64| self.samples.partition_point(|sample| sample.time_s <= time_s).saturating_sub(1);
        self.balanced.iter().map(|balanced| &self.samples[at(balanced.time_s)]).collect()
    }
}

fn path(points: &[[f64; 2]]) -> Value {
    json!([list(points.iter().map(|p| p[0]), 0.001), list(points.iter().map(|p| p[1]), 0.001)])
}

fn seen_first(samples: &[&Sample]) -> Vec<[f64; 2]> {
    let [x, y, _] = samples[0].base_position_m;
    let begun = Pose { x, y, yaw: samples[0].base_roll_pitch_yaw_rad[2] };
    samples.iter().map(|sample| begun.seen([sample.base_position_m[0], sample.base_position_m[1]])).collect()
}

/// Ahead (0), to the left (1), m/s, or turning (2), rad/s.
fn true_velocities(samples: &[&Sample], axis: usize) -> Vec<f64> {
    if axis == 2 {
        let rate = |pair: &[&Sample]| {
            let turned = pair[1].base_roll_pitch_yaw_rad[2] - pair[0].base_roll_pitch_yaw_rad[2];
            let whole = (turned / std::f64::consts::TAU).round() * std::f64::consts::TAU;
            (turned - whole) / (pair[1].time_s - pair[0].time_s).max(1e-3)
        };
        return samples.windows(2).map(rate).chain([0.0]).collect();
    }
    let velocity = |sample: &&Sample| {
        let (sine, cosine) = sample.base_roll_pitch_yaw_rad[2].sin_cos();
        let [vx, vy, _] = sample.base_linear_velocity_m_s;
        [cosine * vx + sine * vy, cosine * vy - sine * vx][axis]
    };
    samples.iter().map(velocity).collect()
}

/// The way that was asked for, walked exactly from where the robot was, by the estimate, when somebody first asked.
fn asked_path(balanced: &[Balanced]) -> Vec<[f64; 2]> {
    let Some(begin) = balanced.iter().position(|at| at.asked.is_some()) else { return Vec::new() };
    let from = balanced[0];
    let origin = Pose { x: from.position_m[0], y: from.position_m[1], yaw: from.yaw_rad };
    let first = balanced[begin];
    let mut at = Pose { x: first.position_m[0], y: first.position_m[1], yaw: first.yaw_rad };
    let mut path = vec![origin.seen([at.x, at.y])];
    for pair in balanced[begin..].windows(2) {
        let dt_s = pair[1].time_s - pair[0].time_s;
        let [ahead, left, turning] = pair[0].asked.unwrap_or_default();
        let (sine, cosine) = (at.yaw + 0.5 * turning * dt_s).sin_cos();
        at.x += (cosine * ahead - sine * left) * dt_s;
        at.y += (sine * ahead + cosine * left) * dt_s;
        at.yaw += turning * dt_s;
        path.push(origin.seen([at.x, at.y]));
    }
    path
}

/// The greatest pace of each step that was hurried.
fn hurried(balanced: &[Balanced]) -> Vec<f64> {
    let steps = balanced.chunk_by(|a, b| a.step == b.step);
    steps.map(|step| step.iter().fold(1.0, |most: f64, at| most.max(at.pace))).filter(|pace| *pace > HURRIED).collect()
}

fn way_m(path: &[[f64; 2]]) -> f64 {
    rounded(path.windows(2).map(|p| (p[1][0] - p[0][0]).hypot(p[1][1] - p[0][1])).sum(), 0.001)
}
