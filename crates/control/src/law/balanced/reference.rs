//! From the plan to joints: where the toes are to be at a phase of the step, and the joints that put them there.

use super::BalanceConfig;
use super::drive::Driven;
use super::ground::{Frames, Ground, up_on};
use super::stance::{Stance, Turns};
use crate::step::Step;
use crate::{JOINTS, PreparedGait, of_leg};
use nalgebra::{Vector2, Vector3};

/// The swing's placement is reached at this phase, and an offset of the landing before is left by then.
const PLACED: f64 = 0.75;
/// Levelling is whole from this phase on.
const LEVELLED: f64 = 0.6;

/// 10 x³ − 15 x⁴ + 6 x⁵ between 0 and 1: from rest to rest, with no acceleration at the ends.
pub(super) fn smooth(x: f64) -> f64 {
    let x = x.clamp(0.0, 1.0);
    x * x * x * (10.0 + x * (6.0 * x - 15.0))
}

/// The plan at one phase, driven: joints B, toes p̄ from the body, and the compensating torque.
#[derive(Clone, Copy, Debug)]
pub(super) struct Planned {
    pub joints_rad: [f64; JOINTS],
    pub toes_m: [Vector3<f64>; 4],
    pub torque_nm: [f64; JOINTS],
}

/// Joints θ′ at one phase.
#[derive(Clone, Copy, Debug)]
pub(super) struct Placed {
    pub joints_rad: [f64; JOINTS],
    /// Whether a leg cannot reach where it is to be.
    pub limited: bool,
}

/// All that shapes one cycle's reference, at any phase.
pub(super) struct Shape<'a> {
    pub config: &'a BalanceConfig,
    pub gait: &'a PreparedGait,
    pub step: Step,
    pub stance: Stance,
    pub turns: Turns,
    pub driven: Driven,
    /// The gait's own velocity, m/s.
    pub own_velocity: Vector2<f64>,
    /// Its own turning, rad/s.
    pub own_yaw_rad_s: f64,
    /// Middle of the gait's postures, rad, and the share of the motion about it that is walked.
    pub middle_rad: [f64; JOINTS],
    pub share: f64,
    pub ground: Ground,
    pub frames: Frames,
    pub offsets_m: [[f64; 2]; 4],
}

impl Shape<'_> {
    /// Stance toes move as one rigid body, so that none slips; swing toes go between where that begins and ends.
    pub fn planned(&self, s: f64) -> Planned {
        let at = self.gait.at_step(self.step, s);
        let joints_rad = if self.share >= 1.0 {
            at.position_rad
        } else {
            std::array::from_fn(|j| self.middle_rad[j] + self.share * (at.position_rad[j] - self.middle_rad[j]))
        };
        let period_s = self.gait.duration_s(self.step);
        let beyond = self.driven.velocity - self.own_velocity;
        let turning_beyond = self.driven.yaw_rad_s - self.own_yaw_rad_s;
        let toes_m = std::array::from_fn(|leg| {
            let toe = self.config.legs[leg].toe_m(&of_leg(&joints_rad, leg));
            let t = period_s * self.turns.progress(leg, s);
            let (sine, cosine) = (turning_beyond * t).sin_cos();
            let (x, y) = (toe.x - beyond.x * t, toe.y - beyond.y * t);
            Vector3::new(cosine * x + sine * y, cosine * y - sine * x, toe.z)
        });
        Planned { joints_rad, toes_m, torque_nm: at.torque_nm }
    }

    /// Joints for the toes, offset, placed by `placement` where they swing, shifted on a slope, and levelled.
    pub fn placed(&self, s: f64, planned: &Planned, placement: Vector2<f64>) -> Placed {
        let swings = self.stance.swings();
        let (reached, level) = (smooth(s / PLACED), smooth(s / LEVELLED));
        let shifts = self.shifts(swings);
        let mut placed = Placed { joints_rad: [0.0; JOINTS], limited: false };
        for leg in 0..4 {
            let mut toe = planned.toes_m[leg];
            let offset = Vector2::from(self.offsets_m[leg]);
            let by = if swings[leg] { offset * (1.0 - reached) + placement * reached } else { offset } + shifts[leg];
            toe.x += by.x;
            toe.y += by.y;
            toe.z += self.ground.lowered_m;
            if swings[leg] {
                // Where the toe would be from a body that is parallel to the ground.
                let away = self.frames.ground.tr_mul(&toe) - toe;
                let [across, up] = self.config.level_gain.map(|gain| gain * level);
                toe += Vector3::new(across * away.x, across * away.y, up * away.z);
            }
            let solution = self.config.legs[leg].joints(&toe);
            placed.limited |= solution.limited;
            placed.joints_rad[3 * leg..3 * leg + 3].copy_from_slice(&solution.joints_rad);
        }
        placed
    }

    /// The shift of each toe on a slope. What a leg has no room for to its side, the other leg of its pair takes: the
    /// body needs the middle of the two.
    fn shifts(&self, swings: [bool; 4]) -> [Vector2<f64>; 4] {
        let shift = Vector2::from(self.ground.shift_m);
        let Some(room_m) = self.gait.lateral_room_m() else { return [shift; 4] };
        // A damaged recording may have the bounds the wrong way round, at which `clamp` panics.
        let within = |leg: usize, y: f64| y.max(room_m[leg][0]).min(room_m[leg][1]);
        std::array::from_fn(|leg| {
            let missing: f64 = (0..4)
                .filter(|&other| other != leg && swings[other] == swings[leg])
                .map(|other| shift.y - within(other, shift.y))
                .sum();
            Vector2::new(shift.x, within(leg, shift.y + missing))
        })
    }

    /// What the stance legs must carry otherwise than planned: the same weight in another posture, and along real
    /// gravity in place of that of the ground that the gait is planned for.
    pub fn carried_nm(&self, planned: &Planned, placed: &Placed) -> [f64; JOINTS] {
        let each_n = self.config.mass_kg * self.config.estimator.gravity_m_s2 / self.stance.count() as f64;
        let (up, planned_up) = (self.frames.up * each_n, up_on(self.gait.rise()) * each_n);
        let mut torque = [0.0; JOINTS];
        for leg in self.stance.legs() {
            let now = self.config.legs[leg].toe(&of_leg(&placed.joints_rad, leg)).jacobian;
            let plan = self.config.legs[leg].toe(&of_leg(&planned.joints_rad, leg)).jacobian;
            let difference = plan.tr_mul(&planned_up) - now.tr_mul(&up);
            torque[3 * leg..3 * leg + 3].copy_from_slice(difference.as_slice());
        }
        torque
    }
}
