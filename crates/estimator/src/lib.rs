//! Where the base is, how it is turned and how fast it moves, from an inertial unit and the legs. Pure: what
//! comes out depends on the configuration, the memory and the input; nothing allocates.
//!
//! > q̂ ← gyro + (â/|â| × up)/τ_a,  v̂ ← v̂ + h (R a − g) + (h/τ_v) (v_leg − v̂),  p̂ ← p̂ + h v̂,
//!
//! with v_leg the mean over the standing toes of −R (J θ̇ + ω × p + ω_shank × (−r up)): a standing toe is at
//! rest, and its sphere of radius r rolls. The accelerometer is taken for the vertical less where |a| differs
//! from g; a standing leg less where it contradicts the estimate (it slips, or one of its joints is wrong) and
//! around a switch.
//!
//! Roll and pitch are against gravity. Yaw and position are integrated from where the estimator began: they drift.

mod config;

pub use config::Config;

use joints::{InertialState, LEGS};
use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};
use std::time::Duration;

/// What the inertial unit measured, in the base's axes at its origin.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Inertial {
    /// Angular velocity, rad/s.
    pub angular_velocity_rad_s: [f64; 3],
    /// Acceleration less that of free fall, m/s²: upwards g at rest.
    pub specific_force_m_s2: [f64; 3],
    /// How long ago it was measured, s.
    pub age_s: f64,
    /// The unit's own attitude (x, y, z, w), if it has one: where the estimate begins.
    pub attitude_xyzw: Option<[f64; 4]>,
}

impl Inertial {
    /// What a unit's newest message is worth at `now`; none where it does not measure both turning and acceleration.
    pub fn of(unit: &InertialState, now: Duration) -> Option<Self> {
        Some(Self {
            angular_velocity_rad_s: unit.angular_velocity_rad_s?,
            specific_force_m_s2: unit.acceleration_m_s2?,
            age_s: now.saturating_sub(unit.arrived).as_secs_f64(),
            attitude_xyzw: unit.attitude_xyzw,
        })
    }
}

/// A toe from its leg's joints, in the base's axes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Toe {
    /// The toe's centre from the base's origin, m.
    pub position_m: [f64; 3],
    /// Its velocity against the base, J θ̇, m/s.
    pub velocity_m_s: [f64; 3],
    /// Angular velocity of the shank against the base, rad/s.
    pub shank_rad_s: [f64; 3],
    /// Whether it is planned to stand.
    pub stands: bool,
}

/// All that one step sees.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Input {
    /// Since the last step, s.
    pub dt_s: f64,
    /// The newest inertial data, if there ever were.
    pub inertial: Option<Inertial>,
    /// The four toes.
    pub toes: [Toe; LEGS],
    /// Phase of the step that is walked, from 0 to 1; none where the robot stands on all that stand.
    pub phase: Option<f64>,
}

/// What the estimate is worth.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum Health {
    /// No inertial data have come yet.
    #[default]
    Waiting,
    /// It follows its sensors.
    Good,
    /// The inertial data are too old.
    Stale,
    /// The inertial data are no numbers, or none that a robot can have.
    Invalid,
    /// The estimate has left what is possible.
    OutOfBounds,
}

impl Health {
    /// The name that is published.
    pub fn name(self) -> &'static str {
        match self {
            Self::Waiting => "waiting",
            Self::Good => "good",
            Self::Stale => "stale",
            Self::Invalid => "invalid",
            Self::OutOfBounds => "out_of_bounds",
        }
    }
}

/// The estimate, and all that the next step needs of this one.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Estimator {
    health: Health,
    /// World from base, (x, y, z, w).
    attitude_xyzw: [f64; 4],
    velocity_m_s: [f64; 3],
    position_m: [f64; 3],
    gyro_offset_rad_s: [f64; 3],
    angular_velocity_rad_s: [f64; 3],
    /// Since it began, s.
    time_s: f64,
    /// Over which the attitude has been corrected, s.
    settled_s: f64,
    /// Since inertial data were usable, s.
    missing_s: f64,
    /// Walked, m.
    distance_m: f64,
    /// Mean square of what the standing legs differ from the estimate by, m²/s².
    contradiction: f64,
}

impl Default for Estimator {
    fn default() -> Self {
        Self::WAITING
    }
}

/// Variances for whoever fuses the odometry with more.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Variances {
    /// Of x and y, m².
    pub position_m2: f64,
    /// Of roll and pitch, rad².
    pub tilt_rad2: f64,
    /// Of yaw, rad².
    pub yaw_rad2: f64,
    /// Of the velocity's components, m²/s².
    pub velocity_m2_s2: f64,
}

/// The attitude's corrections settle the start within this time, s.
const SETTLING_S: f64 = 0.05;
/// After this long without inertial data the attitude is begun anew, s.
const LOST_S: f64 = 0.2;

impl Estimator {
    /// Before any data.
    pub const WAITING: Self = Self {
        health: Health::Waiting,
        attitude_xyzw: [0.0, 0.0, 0.0, 1.0],
        velocity_m_s: [0.0; 3],
        position_m: [0.0; 3],
        gyro_offset_rad_s: [0.0; 3],
        angular_velocity_rad_s: [0.0; 3],
        time_s: 0.0,
        settled_s: 0.0,
        missing_s: 0.0,
        distance_m: 0.0,
        contradiction: 0.0,
    };

    /// What the estimate is worth.
    pub fn health(&self) -> Health {
        self.health
    }

    /// Rotation from the base's axes to the world's.
    pub fn rotation(&self) -> Matrix3<f64> {
        self.attitude().to_rotation_matrix().into_inner()
    }

    /// World from base, (x, y, z, w).
    pub fn attitude_xyzw(&self) -> [f64; 4] {
        self.attitude_xyzw
    }

    /// Velocity of the base's origin in the world's axes, m/s.
    pub fn velocity_m_s(&self) -> [f64; 3] {
        self.velocity_m_s
    }

    /// The same in the base's axes, m/s.
    pub fn velocity_in_base_m_s(&self) -> [f64; 3] {
        (self.rotation().transpose() * Vector3::from(self.velocity_m_s)).into()
    }

    /// The base's origin from where it began, m.
    pub fn position_m(&self) -> [f64; 3] {
        self.position_m
    }

    /// Angular velocity in the base's axes, less the gyroscope's offset, rad/s.
    pub fn angular_velocity_rad_s(&self) -> [f64; 3] {
        self.angular_velocity_rad_s
    }

    /// Yaw, from −π to π, rad.
    pub fn yaw_rad(&self) -> f64 {
        let r = self.rotation();
        r.m21.atan2(r.m11)
    }

    /// Roll and pitch, rad: R = Rz(yaw) Ry(pitch) Rx(roll).
    pub fn roll_pitch_rad(&self) -> [f64; 2] {
        let r = self.rotation();
        [r.m32.atan2(r.m33), (-r.m31).clamp(-1.0, 1.0).asin()]
    }

    /// How far the estimate can be off.
    pub fn variances(&self, config: &Config) -> Variances {
        let walked = config.odometry_share * self.distance_m;
        Variances {
            position_m2: walked * walked + 1e-6,
            tilt_rad2: config.tilt_deviation_rad * config.tilt_deviation_rad,
            yaw_rad2: config.yaw_variance_rate * self.time_s + 1e-6,
            velocity_m2_s2: config.velocity_deviation_m_s * config.velocity_deviation_m_s + 0.25 * self.contradiction,
        }
    }

    /// One step.
    pub fn step(&mut self, config: &Config, input: &Input) {
        let dt_s = input.dt_s.clamp(0.0, config.timeout_s);
        let usable = match &input.inertial {
            None => None,
            Some(data) => match problem(config, data) {
                Some(health) => {
                    if self.health != Health::Waiting {
                        self.health = health;
                    }
                    None
                }
                None => Some(data),
            },
        };
        match usable {
            Some(data) if self.health == Health::Waiting || self.missing_s > LOST_S => {
                self.begin(data);
                self.predict(config, data, 0.0);
            }
            Some(data) => {
                self.health = Health::Good;
                self.missing_s = 0.0;
                self.predict(config, data, dt_s);
            }
            // Without inertial data the legs alone carry the velocity on; whoever uses it sees the health.
            None if self.health == Health::Waiting => return,
            None => {
                self.missing_s += dt_s;
                if input.inertial.is_none() {
                    self.health = Health::Stale;
                }
            }
        }
        self.correct(config, input, dt_s);
        let velocity = Vector3::from(self.velocity_m_s);
        self.position_m = (Vector3::from(self.position_m) + velocity * dt_s).into();
        self.distance_m += velocity.xy().norm() * dt_s;
        self.time_s += dt_s;
        self.keep_bounds(config);
    }

    fn attitude(&self) -> UnitQuaternion<f64> {
        let [x, y, z, w] = self.attitude_xyzw;
        UnitQuaternion::new_normalize(Quaternion::new(w, x, y, z))
    }

    fn set_attitude(&mut self, attitude: &UnitQuaternion<f64>) {
        self.attitude_xyzw = [attitude.i, attitude.j, attitude.k, attitude.w];
    }

    /// Level with the unit's own attitude, else with the vertical that it measures; yaw and position go on.
    fn begin(&mut self, data: &Inertial) {
        let (yaw_rad, position_m, distance_m, time_s) = (self.yaw_rad(), self.position_m, self.distance_m, self.time_s);
        *self = Self { health: Health::Good, position_m, distance_m, time_s, ..Self::default() };
        let up_in_base = match data.attitude_xyzw {
            Some([x, y, z, w]) => UnitQuaternion::new_normalize(Quaternion::new(w, x, y, z)).inverse() * Vector3::z(),
            None => Vector3::from(data.specific_force_m_s2),
        };
        let level = UnitQuaternion::rotation_between(&up_in_base, &Vector3::z()).unwrap_or_default();
        let (_, _, yaw) = level.euler_angles();
        self.set_attitude(&(UnitQuaternion::from_euler_angles(0.0, 0.0, yaw_rad - yaw) * level));
        // An attitude that is known has nothing to settle.
        self.settled_s = if data.attitude_xyzw.is_some() { f64::MAX } else { 0.0 };
    }

    fn predict(&mut self, config: &Config, data: &Inertial, dt_s: f64) {
        let attitude = self.attitude();
        let force = Vector3::from(data.specific_force_m_s2);
        let up_in_base = attitude.inverse() * Vector3::z();
        let size = force.norm();
        let away = (size - config.gravity_m_s2) / config.gravity_tolerance_m_s2;
        let trust = (1.0 - away * away).max(0.0);
        let tilt = if size > 0.0 { (force / size).cross(&up_in_base) } else { Vector3::zeros() };
        // The longer it runs the slower it follows: at first it is a mean over the time since the beginning.
        let rate = (1.0 / (self.settled_s + SETTLING_S)).max(1.0 / config.attitude_s);
        self.settled_s += dt_s;
        let correction = tilt * trust;
        let limit = config.gyro_offset_limit_rad_s;
        let offset = Vector3::from(self.gyro_offset_rad_s) - correction * (config.gyro_offset_rate_s * dt_s);
        self.gyro_offset_rad_s = offset.map(|value| value.clamp(-limit, limit)).into();
        let turning = Vector3::from(data.angular_velocity_rad_s) - Vector3::from(self.gyro_offset_rad_s);
        self.angular_velocity_rad_s = turning.into();
        let mut next = attitude * UnitQuaternion::from_scaled_axis((turning + correction * rate) * dt_s);
        next.renormalize();
        self.set_attitude(&next);
        let acceleration = next * force - Vector3::new(0.0, 0.0, config.gravity_m_s2);
        self.velocity_m_s = (Vector3::from(self.velocity_m_s) + acceleration * dt_s).into();
    }

    /// The standing toes are at rest.
    fn correct(&mut self, config: &Config, input: &Input, dt_s: f64) {
        let rotation = self.rotation();
        let turning = Vector3::from(self.angular_velocity_rad_s);
        let down_in_base = -rotation.row(2).transpose() * config.toe_radius_m;
        let velocity = Vector3::from(self.velocity_m_s);
        let (mut sum, mut square, mut standing) = (Vector3::zeros(), 0.0, 0.0);
        for toe in input.toes.iter().filter(|toe| toe.stands) {
            let shank = turning + Vector3::from(toe.shank_rad_s);
            let of_toe = Vector3::from(toe.velocity_m_s)
                + turning.cross(&Vector3::from(toe.position_m))
                + shank.cross(&down_in_base);
            let difference = -(rotation * of_toe) - velocity;
            let squared = difference.norm_squared();
            if !squared.is_finite() {
                continue;
            }
            let weight = 1.0 / (1.0 + squared / (config.slip_m_s * config.slip_m_s));
            sum += difference * weight;
            square += squared;
            standing += 1.0;
        }
        if standing == 0.0 {
            return;
        }
        let at_switch = input.phase.is_some_and(|s| s < config.switch_end || s > config.switch_begin);
        let share = if at_switch { config.switch_share } else { 1.0 };
        // Each leg's weight counts against all that stand: legs that contradict pull less, not only relative to
        // each other.
        let gain = (dt_s / config.velocity_s * share).min(1.0);
        self.velocity_m_s = (velocity + sum * (gain / standing)).into();
        self.contradiction += gain * (square / standing - self.contradiction);
    }

    fn keep_bounds(&mut self, config: &Config) {
        let state =
            [&self.velocity_m_s[..], &self.position_m[..], &self.attitude_xyzw[..], &self.gyro_offset_rad_s[..]];
        if !state.into_iter().flatten().all(|value| value.is_finite()) {
            // The next data begin anew: what is left here is level by default, not by measurement.
            *self = Self { health: Health::OutOfBounds, missing_s: 2.0 * LOST_S, ..Self::default() };
        } else if Vector3::from(self.velocity_m_s).norm() > config.speed_limit_m_s {
            self.health = Health::OutOfBounds;
        }
    }
}

/// What is wrong with the inertial data.
fn problem(config: &Config, data: &Inertial) -> Option<Health> {
    let within = |values: &[f64; 3], limit: f64| values.iter().all(|value| value.abs() <= limit);
    let attitude = data.attitude_xyzw.is_none_or(|q| {
        let square: f64 = q.iter().map(|value| value * value).sum();
        (0.5..2.0).contains(&square)
    });
    // Written so that NaN is a problem too.
    if !(within(&data.angular_velocity_rad_s, config.angular_velocity_limit_rad_s)
        && within(&data.specific_force_m_s2, config.specific_force_limit_m_s2)
        && attitude)
    {
        return Some(Health::Invalid);
    }
    if !(0.0..=config.timeout_s).contains(&data.age_s) { Some(Health::Stale) } else { None }
}
