//! The body's posture while the robot stands: height, roll, pitch and yaw against the posture that it holds, over feet
//! that stay where they are.

use crate::contact::toe_force_n;
use crate::{Config, JOINTS, JointCommand, of_leg};
use gait::{JOINTS_PER_LEG, LEGS};
use nalgebra::{Rotation3, Vector3};
use robot::LegKinematics;

/// The body crosses its whole range in this time, s, and reaches that speed in a quarter of it.
const RANGE_S: f64 = 1.2;
/// Velocities are differences over so many seconds: the joints' limits have no derivative.
const DIFFERENCE_S: f64 = 1e-4;
/// After a late cycle the body is late too: no step of it is longer, s.
const LONGEST_STEP_S: f64 = 0.02;
/// Halvings of the way to a pose that the joints do not reach: to a thousandth of it.
const BISECTIONS: usize = 10;

/// A pose of the body against the one that it has in the held posture, in that one's axes.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BodyPose {
    /// Higher, m.
    pub height_m: f64,
    /// The left side up, rad.
    pub roll_rad: f64,
    /// The nose down, rad.
    pub pitch_rad: f64,
    /// To the left, rad.
    pub yaw_rad: f64,
}

impl BodyPose {
    /// Height, roll, pitch, yaw.
    pub fn numbers(&self) -> [f64; 4] {
        [self.height_m, self.roll_rad, self.pitch_rad, self.yaw_rad]
    }

    /// The pose of such numbers.
    pub fn of([height_m, roll_rad, pitch_rad, yaw_rad]: [f64; 4]) -> Self {
        Self { height_m, roll_rad, pitch_rad, yaw_rad }
    }
}

/// What became of a pose that was asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BodyPoseAnswer {
    /// The body goes there.
    Taken,
    /// It goes as far as the range and the joints allow.
    Limited,
    /// Refused: the robot does not stand.
    NotStanding,
    /// Refused: not all of it are numbers.
    NotFinite,
    /// Refused: the legs' kinematics cannot be inverted.
    NoKinematics,
}

impl BodyPoseAnswer {
    /// The sentence for people.
    pub fn text(self) -> &'static str {
        match self {
            Self::Taken => "taken",
            Self::Limited => "limited: beyond what the joints or the range allow; the body goes as far as they do",
            Self::NotStanding => "refused: only a robot that stands moves its body. Let it stand up, or stop, first",
            Self::NotFinite => "refused: expected finite numbers",
            Self::NoKinematics => "refused: this robot's legs are of a shape that cannot be inverted",
        }
    }
}

/// Where the body is, how it moves and where it goes: height, roll, pitch, yaw.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Body {
    pose: [f64; 4],
    velocity: [f64; 4],
    target: [f64; 4],
}

impl Body {
    /// As the held posture has it.
    pub const NEUTRAL: Self = Self { pose: [0.0; 4], velocity: [0.0; 4], target: [0.0; 4] };

    pub fn is_neutral(&self) -> bool {
        *self == Self::NEUTRAL
    }

    pub fn pose(&self) -> BodyPose {
        BodyPose::of(self.pose)
    }

    /// Goes to a pose, over feet that carry the robot in the posture `held_rad`.
    pub fn ask(&mut self, config: &Config, held_rad: &[f64; JOINTS], asked: &BodyPose) -> BodyPoseAnswer {
        let Some(legs) = &config.legs else { return BodyPoseAnswer::NoKinematics };
        let asked = asked.numbers();
        if !asked.iter().all(|value| value.is_finite()) {
            return BodyPoseAnswer::NotFinite;
        }
        let target = config.body_range.clamped(&asked);
        let share_of = |share: f64| target.map(|value| share * value);
        let (mut within, mut outside) = (0.0, 1.0);
        if is_reached(config, legs, held_rad, &target) {
            within = 1.0;
        } else {
            for _ in 0..BISECTIONS {
                let middle = 0.5 * (within + outside);
                *(if is_reached(config, legs, held_rad, &share_of(middle)) { &mut within } else { &mut outside }) =
                    middle;
            }
        }
        self.target = share_of(within);
        if self.target == asked { BodyPoseAnswer::Taken } else { BodyPoseAnswer::Limited }
    }

    /// Goes back to the held posture.
    pub fn go_back(&mut self) {
        self.target = [0.0; 4];
    }

    /// Moves for `dt_s` more: at a bounded speed that grows and falls at a bounded rate.
    pub fn follow(&mut self, config: &Config, dt_s: f64) {
        let dt_s = dt_s.min(LONGEST_STEP_S);
        for k in 0..4 {
            let [least, most] = config.body_range.least_and_most(k);
            let speed = (most - least) / RANGE_S;
            let rate = 4.0 * speed / RANGE_S;
            let left = self.target[k] - self.pose[k];
            // Half the rate is left for what the discrete steps are late by: no overshoot.
            let wanted = (rate * left.abs()).sqrt().min(speed).copysign(left);
            let velocity = wanted.clamp(self.velocity[k] - rate * dt_s, self.velocity[k] + rate * dt_s);
            self.velocity[k] = velocity;
            self.pose[k] += velocity * dt_s;
            if left.abs() <= rate * dt_s * dt_s && velocity.abs() <= 2.0 * rate * dt_s {
                (self.pose[k], self.velocity[k]) = (self.target[k], 0.0);
            }
        }
    }

    /// What is asked for in a held posture, with the body where it is: to the bit the posture's own where that is
    /// neutral.
    pub fn over(&self, config: &Config, held: JointCommand) -> JointCommand {
        let (Some(legs), false) = (&config.legs, self.is_neutral()) else { return held };
        let at = |time_s: f64| {
            let pose = std::array::from_fn(|k| self.pose[k] + time_s * self.velocity[k]);
            moved(legs, &held.position_rad, &pose).0
        };
        let (before, after) = (at(-DIFFERENCE_S), at(DIFFERENCE_S));
        let position_rad = at(0.0);
        JointCommand {
            position_rad,
            velocity_rad_s: std::array::from_fn(|j| (after[j] - before[j]) / (2.0 * DIFFERENCE_S)),
            torque_nm: carried(legs, &held, &position_rad, &world_from_body(&self.pose)),
            ..held
        }
    }
}

/// Whether the joints reach a pose with their soft stops' room.
fn is_reached(config: &Config, legs: &[LegKinematics; LEGS], held_rad: &[f64; JOINTS], pose: &[f64; 4]) -> bool {
    let (joints_rad, limited) = moved(legs, held_rad, pose);
    let margin = config.soft_stop_rad;
    let inside = |j: usize| {
        let (low, high) = (config.position_min_rad[j] + margin, config.position_max_rad[j] - margin);
        (low..=high).contains(&joints_rad[j])
    };
    !limited && (0..JOINTS).all(inside)
}

/// The moved body's axes in the held posture's.
fn world_from_body(pose: &[f64; 4]) -> Rotation3<f64> {
    Rotation3::from_euler_angles(pose[1], pose[2], pose[3])
}

/// Torques that press each toe on the ground as the held posture's do, N m: these and what J(q)ᵀ Rᵀ f has more than
/// J(q₀)ᵀ f, where f is the toe's force in the held posture.
fn carried(
    legs: &[LegKinematics; LEGS],
    held: &JointCommand,
    position_rad: &[f64; JOINTS],
    world_from_body: &Rotation3<f64>,
) -> [f64; JOINTS] {
    let mut torque_nm = held.torque_nm;
    for (leg, kinematics) in legs.iter().enumerate() {
        let jacobian = |positions_rad: &[f64; JOINTS]| kinematics.toe(&of_leg(positions_rad, leg)).jacobian;
        let (here, there) = (jacobian(&held.position_rad), jacobian(position_rad));
        let force_n = toe_force_n(&here, &of_leg(&held.torque_nm, leg).into());
        let more_nm = there.tr_mul(&(world_from_body.inverse() * force_n)) - here.tr_mul(&force_n);
        for k in 0..JOINTS_PER_LEG {
            torque_nm[leg * JOINTS_PER_LEG + k] += more_nm[k];
        }
    }
    torque_nm
}

/// Joint positions that put the body there over the toes of the held posture, rad; and whether a leg does not reach.
fn moved(legs: &[LegKinematics; LEGS], held_rad: &[f64; JOINTS], pose: &[f64; 4]) -> ([f64; JOINTS], bool) {
    let (height_m, world_from_body) = (pose[0], world_from_body(pose));
    let (mut joints_rad, mut limited) = (*held_rad, false);
    for (leg, kinematics) in legs.iter().enumerate() {
        let toe_m = kinematics.toe_m(&of_leg(held_rad, leg));
        let there = kinematics.joints(&(world_from_body.inverse() * (toe_m - Vector3::new(0.0, 0.0, height_m))));
        // Against what the inverse makes of the posture itself, so that nothing jumps at its edge.
        let here = kinematics.joints(&toe_m);
        for k in 0..JOINTS_PER_LEG {
            joints_rad[leg * JOINTS_PER_LEG + k] += there.joints_rad[k] - here.joints_rad[k];
        }
        limited |= there.limited;
    }
    (joints_rad, limited)
}
