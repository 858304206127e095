//! The figures of a walk: speed, drift, torques, posture. The definitions are stated here once, because figures of two
//! programs can only be compared if they mean the same.

use crate::RobotState;
use serde::Serialize;

/// The first seconds of a walk are not counted in means: the robot settles into the gait.
pub const SETTLING_S: f64 = 2.0;

/// This share of a drive's limit counts as its limit: a frame resolves a two-thousandth of the torque.
const SATURATED: f64 = 0.999;

/// One number for each joint type.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct PerJointType {
    /// The four hip roll joints.
    pub hip_roll: f64,
    /// The four hip pitch joints.
    pub hip_pitch: f64,
    /// The four knees.
    pub knee: f64,
}

impl From<[f64; 3]> for PerJointType {
    fn from([hip_roll, hip_pitch, knee]: [f64; 3]) -> Self {
        Self { hip_roll, hip_pitch, knee }
    }
}

impl From<PerJointType> for [f64; 3] {
    fn from(p: PerJointType) -> Self {
        [p.hip_roll, p.hip_pitch, p.knee]
    }
}

/// The figures of a walk. Serialised, those that are not known yet are null.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(into = "Rounded")]
pub struct WalkFigures {
    /// Whether it went on after settling: means, deviations and the largest torque are 0 and unknown where it did not.
    pub settled: bool,
    /// Whether there were enough steps for a speed: it is 0 and unknown where there were not.
    pub speed_known: bool,
    /// Simulated time that was measured, s.
    pub time_s: f64,
    /// Mean |torque| over legs and time, after settling, Nm.
    pub mean_abs_torque_nm: PerJointType,
    /// Largest |torque| after settling, Nm.
    pub max_torque_nm: f64,
    /// Share of samples after settling at which a joint's torque is within a thousandth of the drive's limit.
    pub saturated_share: f64,
    /// Mean speed along the body's own heading over the second half of the steps, m/s.
    pub speed_m_s: f64,
    /// Mean speed to the body's left over the second half of the steps, m/s.
    pub lateral_speed_m_s: f64,
    /// Where the base ends: x and y, m.
    pub drift_m: [f64; 2],
    /// Turned from the start to the end, degrees.
    pub turned_deg: f64,
    /// Mean height of the base above the toe centres of a standing robot, after settling, m.
    pub height_m: f64,
    /// Standard deviation of roll after settling, degrees.
    pub roll_deviation_deg: f64,
    /// Mean pitch after settling, degrees.
    pub pitch_mean_deg: f64,
    /// Standard deviation of pitch after settling, degrees.
    pub pitch_deviation_deg: f64,
    /// Largest |roll| or |pitch| at any time, degrees.
    pub max_tilt_deg: f64,
}

/// [`WalkFigures`] as they are reported.
#[derive(Serialize)]
struct Rounded {
    time_s: f64,
    mean_abs_torque_nm: Option<PerJointType>,
    max_torque_nm: Option<f64>,
    saturated_share: Option<f64>,
    speed_m_s: Option<f64>,
    lateral_speed_m_s: Option<f64>,
    drift_m: [f64; 2],
    turned_deg: f64,
    height_m: Option<f64>,
    roll_deviation_deg: Option<f64>,
    pitch_mean_deg: Option<f64>,
    pitch_deviation_deg: Option<f64>,
    max_tilt_deg: f64,
}

impl From<WalkFigures> for Rounded {
    fn from(f: WalkFigures) -> Self {
        let settled = |value: f64| f.settled.then_some(value);
        let speed = |value: f64| f.speed_known.then_some(value);
        Rounded {
            time_s: f.time_s,
            mean_abs_torque_nm: f.settled.then_some(f.mean_abs_torque_nm),
            max_torque_nm: settled(f.max_torque_nm),
            saturated_share: settled(f.saturated_share),
            speed_m_s: speed(f.speed_m_s),
            lateral_speed_m_s: speed(f.lateral_speed_m_s),
            drift_m: f.drift_m,
            turned_deg: f.turned_deg,
            height_m: settled(f.height_m),
            roll_deviation_deg: settled(f.roll_deviation_deg),
            pitch_mean_deg: settled(f.pitch_mean_deg),
            pitch_deviation_deg: settled(f.pitch_deviation_deg),
            max_tilt_deg: f.max_tilt_deg,
        }
    }
}

#[derive(Clone, Copy, Debug, Default)]
struct Moments {
    n: f64,
    sum: f64,
    squares: f64,
}

impl Moments {
    fn add(&mut self, value: f64) {
        self.n += 1.0;
        self.sum += value;
        self.squares += value * value;
    }

    fn mean(&self) -> f64 {
        if self.n > 0.0 { self.sum / self.n } else { 0.0 }
    }

    fn deviation(&self) -> f64 {
        let mean = self.mean();
        if self.n > 0.0 { (self.squares / self.n - mean * mean).max(0.0).sqrt() } else { 0.0 }
    }
}

/// Collects a walk's samples, one every control cycle, in memory that grows only with the number of steps taken.
#[derive(Clone, Debug)]
pub struct Measure {
    step_duration_s: f64,
    torque_limit_nm: [f64; 12],
    settling_s: f64,
    start_s: Option<f64>,
    last_s: f64,
    torque: [Moments; 3],
    max_torque_nm: f64,
    saturated: Moments,
    height: Moments,
    roll: Moments,
    pitch: Moments,
    max_tilt_rad: f64,
    /// Time, x, y and yaw at the beginning of every step.
    steps: Vec<[f64; 4]>,
    last: [f64; 2],
    yaw_rad: Option<f64>,
    turned_rad: f64,
}

impl Measure {
    /// Measures a walk whose steps take `step_duration_s`, with drives limited to `torque_limit_nm`. The first sample
    /// is the walk's beginning.
    pub fn new(step_duration_s: f64, torque_limit_nm: [f64; 12]) -> Self {
        Self {
            step_duration_s,
            torque_limit_nm,
            settling_s: SETTLING_S,
            start_s: None,
            last_s: 0.0,
            torque: Default::default(),
            max_torque_nm: 0.0,
            saturated: Moments::default(),
            height: Moments::default(),
            roll: Moments::default(),
            pitch: Moments::default(),
            max_tilt_rad: 0.0,
            steps: Vec::new(),
            last: [0.0; 2],
            yaw_rad: None,
            turned_rad: 0.0,
        }
    }

    /// Takes one sample; `height_m` is the base's height above the toe centres of a robot standing on the ground below
    /// it.
    pub fn sample(&mut self, state: &RobotState, height_m: f64) {
        let start = *self.start_s.get_or_insert(state.time_s);
        let since = state.time_s - start;
        self.last_s = since;
        let [roll, pitch, yaw] = state.roll_pitch_yaw();
        let turned = self.yaw_rad.map_or(0.0, |last| {
            // The shorter way round.
            (yaw - last + std::f64::consts::PI).rem_euclid(std::f64::consts::TAU) - std::f64::consts::PI
        });
        self.turned_rad += turned;
        self.yaw_rad = Some(yaw);
        let [x, y, _] = state.base_position_m;
        self.last = [x, y];
        if since + 1e-9 >= self.steps.len() as f64 * self.step_duration_s {
            self.steps.push([since, x, y, yaw]);
        }
        self.max_tilt_rad = self.max_tilt_rad.max(roll.abs()).max(pitch.abs());
        if since < self.settling_s {
            return;
        }
        for (j, torque) in state.joint_torque_nm.iter().enumerate() {
            self.torque[j % 3].add(torque.abs());
            self.max_torque_nm = self.max_torque_nm.max(torque.abs());
            self.saturated.add(f64::from(torque.abs() >= SATURATED * self.torque_limit_nm[j]));
        }
        self.height.add(height_m);
        self.roll.add(roll);
        self.pitch.add(pitch);
    }

    /// The figures so far. Means of a walk shorter than the settling time are 0.
    pub fn figures(&self) -> WalkFigures {
        let half = self.steps.len() / 2;
        let (mut ahead, mut left, mut duration) = (0.0, 0.0, 0.0);
        if self.steps.len() > 8 {
            for pair in self.steps[half..].windows(2) {
                let [t0, x0, y0, yaw] = pair[0];
                let [t1, x1, y1, _] = pair[1];
                let (dx, dy) = (x1 - x0, y1 - y0);
                ahead += dx * yaw.cos() + dy * yaw.sin();
                left += -dx * yaw.sin() + dy * yaw.cos();
                duration += t1 - t0;
            }
        }
        let speed = |distance: f64| if duration > 0.0 { distance / duration } else { 0.0 };
        WalkFigures {
            settled: self.height.n > 0.0,
            speed_known: duration > 0.0,
            time_s: self.last_s,
            mean_abs_torque_nm: self.torque.map(|m| m.mean()).into(),
            max_torque_nm: self.max_torque_nm,
            saturated_share: self.saturated.mean(),
            speed_m_s: speed(ahead),
            lateral_speed_m_s: speed(left),
            drift_m: self.last,
            turned_deg: self.turned_rad.to_degrees(),
            height_m: self.height.mean(),
            roll_deviation_deg: self.roll.deviation().to_degrees(),
            pitch_mean_deg: self.pitch.mean().to_degrees(),
            pitch_deviation_deg: self.pitch.deviation().to_degrees(),
            max_tilt_deg: self.max_tilt_rad.to_degrees(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn state(time_s: f64, x: f64, y: f64, yaw: f64, torque: f64) -> RobotState {
        RobotState {
            step: 0,
            time_s,
            base_position_m: [x, y, 0.58],
            base_quaternion_xyzw: [0.0, 0.0, (0.5 * yaw).sin(), (0.5 * yaw).cos()],
            base_linear_velocity_world: [0.0; 3],
            base_angular_velocity_body: [0.0; 3],
            base_specific_force_body: [0.0; 3],
            joint_position_rad: [0.0; 12],
            joint_velocity_rad_s: [0.0; 12],
            joint_torque_nm: std::array::from_fn(|j| if j % 3 == 2 { torque } else { -1.0 }),
            toe_force_n: [[0.0; 3]; 4],
        }
    }

    #[test]
    fn a_torque_that_a_frame_rounded_below_the_limit_is_at_the_limit() {
        for (torque_nm, share) in [(50.0, 1.0 / 3.0), (-49.96, 1.0 / 3.0), (49.9, 0.0)] {
            let mut measure = Measure::new(0.4, [50.0; 12]);
            for i in 0..10_000 {
                measure.sample(&state(1e-3 * f64::from(i), 0.0, 0.0, 0.0, torque_nm), 0.55);
            }
            let figures = measure.figures().saturated_share;
            assert!((figures - share).abs() < 1e-12, "{torque_nm} N m: {figures}");
        }
    }

    #[test]
    fn a_straight_walk_in_any_direction_has_its_speed_ahead() {
        for heading in [0.0f64, 1.2, -3.0] {
            let mut measure = Measure::new(0.4, [50.0; 12]);
            for i in 0..10_000 {
                let t = 1e-3 * i as f64;
                let (forward, sideways) = (0.35 * t, 0.02 * t);
                let x = forward * heading.cos() - sideways * heading.sin();
                let y = forward * heading.sin() + sideways * heading.cos();
                measure.sample(&state(t, x, y, heading, 50.0), 0.55);
            }
            let f = measure.figures();
            assert!((f.speed_m_s - 0.35).abs() < 1e-9 && (f.lateral_speed_m_s - 0.02).abs() < 1e-9, "{f:?}");
            assert_eq!((f.mean_abs_torque_nm.knee, f.mean_abs_torque_nm.hip_roll), (50.0, 1.0));
            assert!((f.saturated_share - 1.0 / 3.0).abs() < 1e-12);
            assert!((f.height_m - 0.55).abs() < 1e-12 && f.turned_deg.abs() < 1e-9);
        }
    }

    #[test]
    fn what_a_short_walk_does_not_tell_is_null_and_not_0() {
        let mut measure = Measure::new(0.4, [50.0; 12]);
        for i in 0..1000 {
            measure.sample(&state(1e-3 * f64::from(i), 0.0, 0.0, 0.0, 10.0), 0.55);
        }
        let figures = serde_json::to_value(measure.figures()).unwrap();
        for unknown in ["speed_m_s", "mean_abs_torque_nm", "max_torque_nm", "saturated_share", "height_m"] {
            assert!(figures[unknown].is_null(), "{unknown}: {figures}");
        }
        assert_eq!((&figures["turned_deg"], &figures["time_s"]), (&0.0.into(), &0.999.into()));
    }

    #[test]
    fn turning_past_half_a_turn_is_counted_on() {
        let mut measure = Measure::new(0.4, [50.0; 12]);
        for i in 0..=1000 {
            let yaw = 7.0 * i as f64 / 1000.0;
            measure.sample(&state(1e-3 * i as f64, 0.0, 0.0, yaw, 0.0), 0.55);
        }
        assert!((measure.figures().turned_deg - 7f64.to_degrees()).abs() < 1e-6);
    }
}
