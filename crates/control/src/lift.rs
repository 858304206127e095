//! Raising and lowering the body over feet that stay where they are: feet that carry the robot do not slide, and legs
//! that go from posture to posture joint by joint would have to drag them there.

use crate::ramp::{Ramp, smoothstep};
use crate::{Config, JOINTS, JointCommand, of_leg};
use gait::{JOINTS_PER_LEG, LEGS};
use nalgebra::Vector3;
use robot::LegKinematics;

/// What the first instant lacks of continuity runs out over this share of the time.
const FADE_SHARE: f64 = 0.5;
/// Velocities are differences over so many seconds: the joints' limits have no derivative.
const DIFFERENCE_S: f64 = 1e-4;
/// Halvings of the way that a toe has to move aside: to a thousandth of it.
const BISECTIONS: usize = 10;

/// A move along the torso's vertical. `ramp` says how gains and torques go over; of its positions only the end holds.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Lift {
    pub ramp: Ramp,
    /// The toes' centres at the start and at the end, from the torso's origin, m, torso axes.
    start_m: [[f64; 3]; LEGS],
    end_m: [[f64; 3]; LEGS],
}

impl Lift {
    /// From a command to the depth of a posture `to`, with its gains and torques. `duration_s` gives the time from the
    /// positions at the end.
    pub fn new(
        legs: &[LegKinematics; LEGS],
        from: JointCommand,
        to: JointCommand,
        duration_s: impl Fn(&[f64; JOINTS]) -> f64,
        gain_s: Option<f64>,
    ) -> Self {
        let toes = |positions_rad: &[f64; JOINTS]| -> [Vector3<f64>; LEGS] {
            std::array::from_fn(|leg| legs[leg].toe_m(&of_leg(positions_rad, leg)))
        };
        let (start, posture) = (toes(&from.position_rad), toes(&to.position_rad));
        let end_m = std::array::from_fn(|leg| lowered(&legs[leg], &start[leg], &posture[leg]).into());
        let ramp = Ramp { from, to, duration_s: 1.0, gain_s: 1.0 };
        let mut lift = Self { ramp, start_m: start.map(Into::into), end_m };
        lift.ramp.to.position_rad = lift.posture(legs, 1.0);
        lift.ramp.duration_s = duration_s(&lift.ramp.to.position_rad);
        lift.ramp.gain_s = gain_s.unwrap_or(f64::MAX).min(lift.ramp.duration_s);
        lift
    }

    /// Joint positions with this share of the way gone, rad. What has to move aside does so in the second half: feet
    /// that are dragged turn a short leg with less.
    fn posture(&self, legs: &[LegKinematics; LEGS], share: f64) -> [f64; JOINTS] {
        let aside = smoothstep((2.0 * share - 1.0).max(0.0));
        let mut position_rad = [0.0; JOINTS];
        for (leg, kinematics) in legs.iter().enumerate() {
            let (start, end) = (Vector3::from(self.start_m[leg]), Vector3::from(self.end_m[leg]));
            let toe = start + Vector3::new(aside, aside, share).component_mul(&(end - start));
            let joints_rad = kinematics.joints(&toe).joints_rad;
            position_rad[leg * JOINTS_PER_LEG..][..JOINTS_PER_LEG].copy_from_slice(&joints_rad);
        }
        position_rad
    }

    fn position_rad(&self, legs: &[LegKinematics; LEGS], elapsed_s: f64) -> [f64; JOINTS] {
        let mut position_rad = self.posture(legs, smoothstep((elapsed_s / self.ramp.duration_s).clamp(0.0, 1.0)));
        let fade_s = FADE_SHARE * self.ramp.duration_s;
        let x = (elapsed_s / fade_s).clamp(0.0, 1.0);
        let from = &self.ramp.from;
        let first = self.posture(legs, 0.0);
        for j in 0..JOINTS {
            let jump_rad = from.position_rad[j] - first[j];
            position_rad[j] +=
                (1.0 - smoothstep(x)) * jump_rad + x * (1.0 - x) * (1.0 - x) * fade_s * from.velocity_rad_s[j];
        }
        position_rad
    }

    pub fn at(&self, config: &Config, elapsed_s: f64) -> JointCommand {
        let duration_s = self.ramp.duration_s;
        let (Some(legs), true) = (&config.legs, elapsed_s < duration_s) else { return self.ramp.at(elapsed_s) };
        let (before_s, after_s) = ((elapsed_s - DIFFERENCE_S).max(0.0), (elapsed_s + DIFFERENCE_S).min(duration_s));
        let (before, after) = (self.position_rad(legs, before_s), self.position_rad(legs, after_s));
        JointCommand {
            position_rad: self.position_rad(legs, elapsed_s),
            velocity_rad_s: std::array::from_fn(|j| (after[j] - before[j]) / (after_s - before_s)),
            ..self.ramp.at(elapsed_s)
        }
    }
}

/// Where a toe ends: at a posture's depth and as near to below its start as the leg can put it there, so that all legs
/// end equally deep and the body does not tilt.
fn lowered(leg: &LegKinematics, start: &Vector3<f64>, posture: &Vector3<f64>) -> Vector3<f64> {
    let at = |share: f64| Vector3::new(start.x, start.y, posture.z).lerp(posture, share);
    if !leg.joints(&at(0.0)).limited {
        return at(0.0);
    }
    let (mut outside, mut within) = (0.0, 1.0);
    for _ in 0..BISECTIONS {
        let middle = 0.5 * (outside + within);
        *(if leg.joints(&at(middle)).limited { &mut outside } else { &mut within }) = middle;
    }
    at(within)
}
