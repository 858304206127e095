//! Where toes are under a body that glides along its motion, for any contact schedule: a toe stands where it is at its
//! place under the body in the middle of its stance, and swings from one such place to the next.

use super::schedule::{Closure, Foothold, Place, Schedule};
use crate::guess::swing_arc;
use crate::planar::PlanarMotion;
use crate::request::GaitRequest;
use nalgebra::{Vector2, Vector3};
use robot::Mirror;

/// Cycles before and after the one that is planned: enough for every stance that it meets to be whole.
const CYCLES: i32 = 2;

/// The stances of all legs over some cycles.
pub(super) struct Footfalls {
    motion: PlanarMotion,
    clearance_m: f64,
    /// T, s.
    t: f64,
    /// Of each leg's toe in the body's axes, m.
    under_body: [Vector2<f64>; 4],
    /// Beginning and end of each leg's stances, over T.
    stances: [Vec<[f64; 2]>; 4],
}

impl Footfalls {
    /// Of a schedule that closes on itself; `hip_x_m` is where the hips are.
    pub fn new(schedule: &Schedule, mirror: &Mirror, request: &GaitRequest, hip_x_m: [f64; 4]) -> Self {
        let under_body = std::array::from_fn(|leg| {
            let side = if leg < 2 { 1.0 } else { -1.0 };
            Vector2::new(hip_x_m[leg], side * request.half_width_m)
        });
        Self {
            motion: PlanarMotion::of(request),
            clearance_m: request.clearance_m,
            t: request.step_duration_s,
            under_body,
            stances: std::array::from_fn(|leg| stances(schedule, mirror, leg)),
        }
    }

    /// Places of the legs that newly stand in a domain.
    pub fn footholds(&self, schedule: &Schedule, mirror: &Mirror, domain: usize) -> Vec<Foothold> {
        let first = &schedule.places_of(domain)[0];
        let middle = first.time + 0.5 * first.share;
        let foothold = |leg| Foothold { leg, place_m: self.standing(leg, self.around(leg, middle)).into() };
        schedule.newly_standing(mirror, domain).into_iter().map(foothold).collect()
    }

    /// A toe at a point whose time is `t_s`, m.
    pub fn toe(&self, leg: usize, place: &Place, t_s: f64) -> Vector3<f64> {
        let middle = place.time + (0.5 - place.phase) * place.share;
        let around = self.around(leg, middle);
        if around[0] <= middle && middle <= around[1] {
            return self.standing(leg, around).push(0.0);
        }
        let before = self.stances[leg].iter().rfind(|stance| stance[1] <= middle).expect("earlier cycles");
        let phase = (t_s / self.t - before[1]) / (around[0] - before[1]);
        let (along, lift) = swing_arc(phase.clamp(0.0, 1.0));
        self.standing(leg, *before).lerp(&self.standing(leg, around), along).push(self.clearance_m * lift)
    }

    /// The stance around a time, or the next one where the leg swings.
    fn around(&self, leg: usize, time: f64) -> [f64; 2] {
        *self.stances[leg].iter().find(|stance| time <= stance[1]).expect("later cycles")
    }

    fn standing(&self, leg: usize, [from, to]: [f64; 2]) -> Vector2<f64> {
        let middle_s = 0.5 * (from + to) * self.t;
        self.motion.displacement_m(middle_s) + self.motion.rotation(middle_s) * self.under_body[leg]
    }
}

/// Beginnings and ends of a leg's stances, over T.
fn stances(schedule: &Schedule, mirror: &Mirror, leg: usize) -> Vec<[f64; 2]> {
    let half = schedule.duration();
    let mut stances: Vec<[f64; 2]> = Vec::new();
    let is_mirrored = schedule.closure == Closure::Mirrored;
    let (passes, duration) = if is_mirrored { (2, 2.0 * half) } else { (1, half) };
    for cycle in -CYCLES..=CYCLES {
        for pass in 0..passes {
            let leg = if pass == 1 { mirror.leg[leg] } else { leg };
            let begins = f64::from(cycle) * duration + f64::from(pass) * half;
            for (domain, d) in schedule.domains.iter().enumerate() {
                let from = begins + schedule.places_of(domain)[0].time;
                let after_stance = stances.last().is_some_and(|last| (last[1] - from).abs() < 1e-9);
                match (d.stance.contains(&leg), stances.last_mut()) {
                    (true, Some(last)) if after_stance => last[1] = from + d.share,
                    (true, _) => stances.push([from, from + d.share]),
                    (false, _) => {}
                }
            }
        }
    }
    stances
}
