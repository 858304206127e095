//! Where the robot is to go: the command, slewed, with the loops that hold speed, heading and place.

use super::BalanceConfig;
use estimator::Estimator;
use nalgebra::Vector2;
use std::time::Duration;

/// A velocity that is asked for, in the robot's heading frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Velocity {
    /// Ahead, m/s.
    pub forward_m_s: f64,
    /// To the left, m/s.
    pub left_m_s: f64,
    /// Turning to the left, rad/s.
    pub yaw_rad_s: f64,
}

impl Velocity {
    /// Whether nothing but standing still is asked for.
    pub fn is_rest(&self) -> bool {
        [self.forward_m_s, self.left_m_s, self.yaw_rad_s].iter().all(|v| v.abs() < REST_M_S)
    }

    /// Whether every number is finite.
    pub fn is_finite(&self) -> bool {
        self.forward_m_s.is_finite() && self.left_m_s.is_finite() && self.yaw_rad_s.is_finite()
    }
}

/// A velocity that somebody asked for, and when: it is obeyed until it is old.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VelocityCommand {
    /// What was asked.
    pub velocity: Velocity,
    /// When it came in, on the clock of `now`.
    pub arrived: Duration,
}

impl VelocityCommand {
    /// What is to be walked at `now`: nothing once it is older than `timeout_s`, from the future, or no number.
    pub fn at(&self, now: Duration, timeout_s: f64) -> Velocity {
        let fresh = now.checked_sub(self.arrived).is_some_and(|age| age.as_secs_f64() <= timeout_s);
        if fresh && self.velocity.is_finite() { self.velocity } else { Velocity::default() }
    }
}

/// The speed's error is filtered over this, s: the sway within a step is none.
const SPEED_FILTER_S: f64 = 0.35;
/// Largest share of the speed limits that the integral may add.
const INTEGRAL_M_S: [f64; 2] = [0.25, 0.15];
/// Largest turning that corrects the heading, rad/s, and largest heading error that is remembered, rad.
const HEADING_LIMIT: f64 = 0.5;
/// Largest velocities that hold a place, m/s, and the farthest place that is remembered, m.
const HOLD_M_S: [f64; 2] = [0.2, 0.15];
const HOLD_M: f64 = 0.5;
/// A place is held from where the robot has become slower than this, m/s: one that is taken while it still goes on is
/// gone back to.
const HOLD_BELOW_M_S: f64 = 0.05;
/// The farthest that a driven robot is taken to be behind or beside where its commands have led to, m: what a push or a
/// slope has carried it away by is not made up for.
const PATH_M: f64 = 0.2;
/// Slower than this is at rest, m/s; or turning, rad/s.
const REST_M_S: f64 = 1e-3;

/// The drive's memory.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Drive {
    /// The slewed velocity in the heading frame, m/s, and turning, rad/s.
    velocity: [f64; 2],
    yaw_rad_s: f64,
    /// The slewed command's own turning, and the heading that it has led to.
    asked_yaw_rad_s: f64,
    heading_rad: f64,
    filtered: [f64; 2],
    integral: [f64; 2],
    /// The place that is held while it is to rest, m, world.
    held_m: Option<[f64; 2]>,
    /// Where the command has led to; none at rest. Recordings that are older know of none.
    #[serde(default)]
    path: Option<Path>,
}

/// Where a robot would be that had gone as it was commanded.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct Path {
    /// The slewed command alone, in the heading frame, m/s.
    velocity: [f64; 2],
    /// m, world.
    place_m: [f64; 2],
}

/// What the legs are to do.
#[derive(Clone, Copy, Debug)]
pub(super) struct Driven {
    pub velocity: Vector2<f64>,
    pub yaw_rad_s: f64,
}

impl Drive {
    /// Begins at this velocity, in the heading that the robot has.
    pub fn new(velocity: &Velocity, estimate: &Estimator) -> Self {
        Self {
            velocity: [velocity.forward_m_s, velocity.left_m_s],
            yaw_rad_s: velocity.yaw_rad_s,
            asked_yaw_rad_s: velocity.yaw_rad_s,
            heading_rad: estimate.yaw_rad(),
            filtered: [0.0; 2],
            integral: [0.0; 2],
            held_m: None,
            path: None,
        }
    }

    /// The gait's own velocity becomes another by a plan: what is walked beyond it stays.
    pub fn go_over(&mut self, before: &Velocity, after: &Velocity) {
        let ahead = [after.forward_m_s - before.forward_m_s, after.left_m_s - before.left_m_s];
        for axis in 0..2 {
            self.velocity[axis] += ahead[axis];
        }
        self.yaw_rad_s += after.yaw_rad_s - before.yaw_rad_s;
        self.asked_yaw_rad_s += after.yaw_rad_s - before.yaw_rad_s;
        self.path = None;
    }

    /// The velocity that the legs are to walk now. An error of speed is answered in proportion as long as it is small:
    /// one that a push makes is the placement's to catch, and stance legs that run after it take away what the body
    /// stands on.
    pub fn driven(&self, config: &BalanceConfig) -> Driven {
        let error = Vector2::from(self.filtered);
        let small = config.speed_gain_range_m_s;
        let answered =
            if small > 0.0 { config.speed_gain / (1.0 + error.norm_squared() / (small * small)) } else { 0.0 };
        let velocity = Vector2::from(self.velocity) + Vector2::from(self.integral) - answered * error;
        Driven { velocity, yaw_rad_s: self.yaw_rad_s }
    }

    /// One cycle towards `asked`.
    pub fn step(&mut self, config: &BalanceConfig, asked: &Velocity, estimate: &Estimator, dt_s: f64) {
        let limit = &config.velocity_limit;
        let asked_velocity = [
            asked.forward_m_s.clamp(-limit.backward_m_s, limit.forward_m_s),
            asked.left_m_s.clamp(-limit.lateral_m_s, limit.lateral_m_s),
        ];
        let asked_yaw = asked.yaw_rad_s.clamp(-limit.yaw_rad_s, limit.yaw_rad_s);
        let (sine, cosine) = estimate.yaw_rad().sin_cos();
        let to_heading = |v: [f64; 2]| [cosine * v[0] + sine * v[1], cosine * v[1] - sine * v[0]];
        // Heading.
        let most = config.angular_acceleration_rad_s2 * dt_s;
        self.asked_yaw_rad_s += (asked_yaw - self.asked_yaw_rad_s).clamp(-most, most);
        self.heading_rad = wrapped(self.heading_rad + self.asked_yaw_rad_s * dt_s);
        let error = wrapped(self.heading_rad - estimate.yaw_rad()).clamp(-HEADING_LIMIT, HEADING_LIMIT);
        self.heading_rad = wrapped(estimate.yaw_rad() + error);
        let turning = self.asked_yaw_rad_s + (config.heading_gain_s * error).clamp(-HEADING_LIMIT, HEADING_LIMIT);
        self.yaw_rad_s += (turning - self.yaw_rad_s).clamp(-most, most);
        // Place.
        let mut wanted = asked_velocity;
        let most = config.acceleration_m_s2 * dt_s;
        if asked_velocity.iter().any(|v| v.abs() >= REST_M_S) {
            self.held_m = None;
            if config.path_gain_s > 0.0 {
                let correction = to_heading(self.away_from_path(asked_velocity, estimate, most, dt_s));
                for axis in 0..2 {
                    wanted[axis] += config.path_gain_s * correction[axis];
                }
            }
        } else {
            self.path = None;
            if self.held_m.is_some() || self.is_slow() {
                let correction = to_heading(self.away_from_held_place(estimate)).map(|d| config.position_gain_s * d);
                for axis in 0..2 {
                    wanted[axis] += correction[axis].clamp(-HOLD_M_S[axis], HOLD_M_S[axis]);
                }
            }
        }
        // Speed.
        let [vx, vy, _] = estimate.velocity_m_s();
        let measured = to_heading([vx, vy]);
        for axis in 0..2 {
            let error = measured[axis] - self.velocity[axis];
            self.filtered[axis] += dt_s / SPEED_FILTER_S * (error - self.filtered[axis]);
            let integral = self.integral[axis] - dt_s * config.speed_integral_rate_s * self.filtered[axis];
            self.integral[axis] = integral.clamp(-INTEGRAL_M_S[axis], INTEGRAL_M_S[axis]);
            self.velocity[axis] += (wanted[axis] - self.velocity[axis]).clamp(-most, most);
        }
    }

    /// Whether the robot hardly moves, its sway within a step left out.
    fn is_slow(&self) -> bool {
        (0..2).all(|axis| (self.velocity[axis] + self.filtered[axis]).abs() < HOLD_BELOW_M_S)
    }

    /// From the robot to the place that the command has led to, m, world. The command is slewed by `most` at once.
    fn away_from_path(&mut self, asked: [f64; 2], estimate: &Estimator, most: f64, dt_s: f64) -> [f64; 2] {
        let [x, y, _] = estimate.position_m();
        let mut path = self.path.unwrap_or(Path { velocity: self.velocity, place_m: [x, y] });
        for axis in 0..2 {
            path.velocity[axis] += (asked[axis] - path.velocity[axis]).clamp(-most, most);
        }
        let ([ahead, left], (sine, cosine)) = (path.velocity, self.heading_rad.sin_cos());
        let walked = dt_s * Vector2::new(cosine * ahead - sine * left, sine * ahead + cosine * left);
        let away = (Vector2::from(path.place_m) + walked - Vector2::new(x, y)).cap_magnitude(PATH_M);
        path.place_m = [x + away.x, y + away.y];
        self.path = Some(path);
        away.into()
    }

    /// From the robot to the place that is held, m, world; the place follows a robot that was carried away.
    fn away_from_held_place(&mut self, estimate: &Estimator) -> [f64; 2] {
        let [x, y, _] = estimate.position_m();
        let held = Vector2::from(*self.held_m.get_or_insert([x, y]));
        let here = Vector2::new(x, y);
        let mut away = held - here;
        let distance = away.norm();
        if distance > HOLD_M {
            away *= HOLD_M / distance;
            self.held_m = Some((here + away).into());
        }
        away.into()
    }
}

/// The same angle from −π to π.
pub(super) fn wrapped(angle: f64) -> f64 {
    angle - std::f64::consts::TAU * (angle / std::f64::consts::TAU).round()
}

#[cfg(test)]
mod tests;
