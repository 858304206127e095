//! One walk, as samples over time.

use gait::{Gait, JOINTS, JOINTS_PER_LEG, LEGS};
use serde::{Deserialize, Serialize};

use crate::{ReportError, Tile};

/// The robot at one time.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Sample {
    /// Time, s, on the run's own clock.
    pub time_s: f64,
    /// Base origin, m, in the world.
    pub base_position_m: [f64; 3],
    /// Base orientation, rad: R = Rz(yaw) Ry(pitch) Rx(roll).
    pub base_roll_pitch_yaw_rad: [f64; 3],
    /// Velocity of the base origin, m/s, in the world.
    pub base_linear_velocity_m_s: [f64; 3],
    /// Joint positions, rad.
    pub joint_position_rad: [f64; JOINTS],
    /// Joint velocities, rad/s.
    pub joint_velocity_rad_s: [f64; JOINTS],
    /// Torques that the drives applied, N m.
    pub joint_torque_nm: [f64; JOINTS],
    /// Normal ground force at each foot, N; zero in the air.
    pub ground_force_n: [f64; LEGS],
}

/// Where samples come from, which decides their name and colour in a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Origin {
    /// MuJoCo: green.
    Simulated,
    /// A robot or a bag: blue.
    Recorded,
}

/// A run to be drawn.
#[derive(Clone, Copy, Debug)]
pub struct Run<'a> {
    /// The gait that was walked.
    pub gait: &'a Gait,
    /// Where the samples come from.
    pub origin: Origin,
    /// Samples in the order of time, 100 Hz or more; 1 kHz is usual.
    pub samples: &'a [Sample],
    /// When the first step began, s, on the samples' clock.
    pub walking_from_s: f64,
    /// Pictures of the robot; may be empty.
    pub tiles: &'a [Tile],
}

/// What a foot carries before it counts as standing, N: above the simulator's contact chatter, far below a stance
/// foot's load.
pub(crate) const STANDING_N: f64 = 10.0;

impl<'a> Run<'a> {
    /// What the run's pictures show, for the head of their strip.
    pub(crate) fn tiles_caption(&self) -> String {
        let shown_s = match self.tiles {
            [first, .., last] => last.time_s - first.time_s,
            _ => 0.0,
        };
        let stride_s = self.gait.stride_duration_s();
        let (what, time_s) =
            if shown_s > 0.75 * stride_s { ("one stride", stride_s) } else { ("one step", self.gait.step_duration_s) };
        format!("{}: {what} of {time_s:.3} s, {}", self.gait.name, self.origin.word())
    }

    pub(crate) fn check(&self) -> Result<(), ReportError> {
        let name = || self.gait.name.clone();
        let mut last = f64::NEG_INFINITY;
        for sample in self.samples {
            let time_s = sample.time_s;
            let bad = |problem: &str| Err(ReportError::BadSample { run: name(), time_s, problem: problem.into() });
            let numbers = sample
                .base_position_m
                .iter()
                .chain(&sample.base_roll_pitch_yaw_rad)
                .chain(&sample.base_linear_velocity_m_s)
                .chain(&sample.joint_position_rad)
                .chain(&sample.joint_velocity_rad_s)
                .chain(&sample.joint_torque_nm)
                .chain(&sample.ground_force_n);
            if !time_s.is_finite() || numbers.into_iter().any(|value| !value.is_finite()) {
                return bad("a value is not a finite number");
            }
            if time_s <= last {
                return bad(&format!("time does not rise (the sample before is at {last} s)"));
            }
            last = time_s;
        }
        let walked_s = self.walking().last().map_or(0.0, |sample| sample.time_s - self.walking_from_s);
        let needed_s = 2.0 * self.gait.stride_duration_s();
        if walked_s < needed_s {
            let problem = format!(
                "{walked_s:.2} s of walking in {} samples; expected at least two strides, {needed_s:.2} s",
                self.samples.len()
            );
            return Err(ReportError::TooLittle { run: name(), problem });
        }
        let fewest = (100.0 * walked_s * 0.9) as usize;
        if self.walking().len() < fewest {
            let problem = format!(
                "{} samples over {walked_s:.2} s of walking; expected at least {fewest} (100 a second)",
                self.walking().len()
            );
            return Err(ReportError::TooLittle { run: name(), problem });
        }
        Ok(())
    }

    /// Samples from the first step on.
    pub(crate) fn walking(&self) -> &'a [Sample] {
        from(self.samples, self.walking_from_s)
    }

    /// Samples of settled walking: two seconds in, as the referee counts; all of a shorter walk but its first stride.
    pub(crate) fn settled(&self) -> &'a [Sample] {
        let stride_s = self.gait.stride_duration_s();
        let end_s = self.samples.last().map_or(0.0, |sample| sample.time_s);
        let wanted_s = self.walking_from_s + 2.0;
        let start_s = if wanted_s + 2.0 * stride_s <= end_s { wanted_s } else { self.walking_from_s + stride_s };
        from(self.samples, start_s)
    }
}

pub(crate) fn from(samples: &[Sample], start_s: f64) -> &[Sample] {
    &samples[samples.partition_point(|sample| sample.time_s < start_s)..]
}

/// Mean absolute torque of hip roll, hip pitch and knee over all legs and samples, N m: the paper's Table II. Zeros for
/// no samples.
pub fn mean_absolute_torque_nm(samples: &[Sample]) -> [f64; JOINTS_PER_LEG] {
    let count = (samples.len() * LEGS).max(1) as f64;
    std::array::from_fn(|joint| {
        let torque = |sample: &Sample| -> f64 {
            (0..LEGS).map(|leg| sample.joint_torque_nm[leg * JOINTS_PER_LEG + joint].abs()).sum()
        };
        samples.iter().map(torque).sum::<f64>() / count
    })
}

/// Mean speed along the heading of the first sample, m/s. Zero for less than two samples.
pub fn mean_forward_speed_m_s(samples: &[Sample]) -> f64 {
    let [first, .., last] = samples else { return 0.0 };
    let (sin, cos) = first.base_roll_pitch_yaw_rad[2].sin_cos();
    let moved = |axis: usize| last.base_position_m[axis] - first.base_position_m[axis];
    (cos * moved(0) + sin * moved(1)) / (last.time_s - first.time_s)
}
