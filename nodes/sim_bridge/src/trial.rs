//! A walk under stress: noisy sensors, commands that are late, pushes, ground that nobody announced, a robot that
//! is not as its description says. One thread, one seed, one outcome.

mod control_loop;
mod sensors;

pub use control_loop::{ControlLoop, ControlLoopError};
pub use sensors::Noise;

use crate::measure::{Measure, WalkFigures};
use crate::simulator::{Fall, Push, RobotState, Simulator, SimulatorOptions, Terrain};
use control::Velocity;
use gait::Gait;
use nalgebra::Vector3;
use robot::{LegKinematics, Robot};
use sensors::Sensors;
use std::collections::VecDeque;
use std::time::Duration;

/// Control period, s.
const PERIOD_S: f64 = 1e-3;
/// One sample is kept in this many control cycles.
const SAMPLED: u64 = 10;

/// What is tried.
#[derive(Clone, Debug)]
pub struct Trial {
    /// How long, s.
    pub seconds: f64,
    /// Velocities asked for, each from its time on, s; none before the first: the gait's own.
    pub asked: Vec<(f64, Velocity)>,
    /// Pushes.
    pub pushes: Vec<Push>,
    /// The sensors' noise.
    pub noise: Noise,
    /// How long a command is on its way, in control cycles.
    pub delay_cycles: usize,
    /// Whether the balanced law walks, or the paper's.
    pub balanced: bool,
    /// Whether the controller's watch over joints and tilt may end the walk, as on the robot; else the law walks alone
    /// until it falls.
    pub watched: bool,
    /// The simulated world and robot.
    pub simulator: SimulatorOptions,
}

impl Default for Trial {
    fn default() -> Self {
        Self {
            seconds: 20.0,
            asked: Vec::new(),
            pushes: Vec::new(),
            noise: Noise::default(),
            delay_cycles: 2,
            balanced: true,
            watched: true,
            simulator: SimulatorOptions { joint_noise_rad: 0.01, ..SimulatorOptions::default() },
        }
    }
}

/// The robot at one time of a trial, and what was estimated and asked of it.
#[derive(Clone, Copy, Debug)]
pub struct Sample {
    /// Since the beginning, s.
    pub time_s: f64,
    /// Base in the world, m.
    pub position_m: [f64; 3],
    /// Roll, pitch and yaw against the ground, rad; yaw goes on past half a turn.
    pub turned_rad: [f64; 3],
    /// Velocity ahead and to the left in the heading frame, m/s, and turning, rad/s.
    pub velocity: [f64; 3],
    /// The same as estimated.
    pub estimated: [f64; 3],
    /// The place as estimated, m.
    pub odometry_m: [f64; 3],
    /// Pace of the step against the gait's own, 1 without the balanced law.
    pub pace: f64,
    /// The step could not be placed or hurried as it should have been.
    pub limited: bool,
}

/// How a trial ended.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// When and how it fell or stopped walking.
    pub ended: Option<(f64, String)>,
    /// The walk's figures.
    pub figures: WalkFigures,
    /// Samples, 100 a second.
    pub samples: Vec<Sample>,
    /// Mean |τ q̇| over time, all joints, W.
    pub power_w: f64,
    /// Root mean square of roll and pitch after two seconds, degrees.
    pub sway_deg: [f64; 2],
}

impl Outcome {
    /// Whether it was still walking at the end.
    pub fn survived(&self) -> bool {
        self.ended.is_none()
    }
}

/// The gait with a beginning that stands on the slope as the balanced law does: the body over its toes along
/// gravity.
fn begun_on_slope(robot: &Robot, gait: &Gait, terrain: &Terrain) -> Result<Gait, ControlLoopError> {
    let Terrain::Slope { uphill_rad, sideways_rad } = *terrain else { return Ok(gait.clone()) };
    let legs = LegKinematics::all(robot)?;
    let mut begun = gait.clone();
    let joints = &gait.initial.joint_position_rad;
    let of_leg = |leg: usize| [joints[3 * leg], joints[3 * leg + 1], joints[3 * leg + 2]];
    let height_m = (0..4).map(|leg| legs[leg].hip_m().z - legs[leg].toe_m(&of_leg(leg)).z).sum::<f64>() / 4.0;
    let shift = Vector3::new(uphill_rad.tan(), sideways_rad.tan(), 0.0) * height_m;
    for axis in 0..2 {
        begun.initial.base_position_m[axis] += shift[axis];
    }
    for leg in 0..4 {
        let solution = legs[leg].joints(&(legs[leg].toe_m(&of_leg(leg)) - shift));
        begun.initial.joint_position_rad[3 * leg..3 * leg + 3].copy_from_slice(&solution.joints_rad);
    }
    Ok(begun)
}

/// Runs a trial of `gait`. The controller knows `robot`; `simulated` is walked, if it is another.
///
/// # Errors
/// Options that cannot be, or a gait for another robot.
pub fn run(robot: &Robot, simulated: Option<&Robot>, gait: &Gait, trial: &Trial) -> Result<Outcome, ControlLoopError> {
    let mut simulator = Simulator::new(simulated.unwrap_or(robot), trial.simulator.clone())?;
    let begun = if trial.balanced { begun_on_slope(robot, gait, &trial.simulator.terrain)? } else { gait.clone() };
    simulator.reset_to_gait(&begun)?;
    simulator.expect_height(robot.nominal.height_m);
    for push in &trial.pushes {
        simulator.push(*push)?;
    }
    let steps_per_cycle = (PERIOD_S / trial.simulator.timestep_s).round().max(1.0) as u32;
    let mut control_loop = ControlLoop::new(robot, gait, trial.balanced, trial.watched)?;
    let mut sensors = Sensors::new(trial.simulator.seed, trial.noise, &simulator);
    let torque_limit_nm = std::array::from_fn(|j| robot.limits.drive_torque_nm[j % 3]);
    let mut recorder = Recorder::new(Measure::new(gait.step_duration_s, torque_limit_nm));
    let mut on_the_way = VecDeque::with_capacity(trial.delay_cycles + 1);
    let cycles = (trial.seconds / PERIOD_S).round() as u64;
    for cycle in 0..cycles {
        let now = Duration::from_micros(1000 * cycle);
        let time_s = now.as_secs_f64();
        let (joints, inertial) = sensors.read(&simulator, now);
        let asked = trial.asked.iter().take_while(|(from_s, _)| *from_s <= time_s).last().map(|(_, v)| *v);
        let command = match control_loop.cycle(&joints, &inertial, asked, now) {
            Ok(command) => command,
            Err(why) => return Ok(recorder.outcome(Some((time_s, why)))),
        };
        on_the_way.push_back(command);
        if on_the_way.len() > trial.delay_cycles
            && let Some(command) = on_the_way.pop_front()
        {
            simulator.command(&command);
        }
        for _ in 0..steps_per_cycle {
            simulator.step();
            sensors.accumulate(&simulator);
        }
        if let Some(fall) = simulator.fallen() {
            let why = recorder.record(&simulator, &control_loop, cycle, Some(fall));
            return Ok(recorder.outcome(Some((time_s, why))));
        }
        recorder.record(&simulator, &control_loop, cycle, None);
    }
    Ok(recorder.outcome(None))
}

struct Recorder {
    measure: Measure,
    samples: Vec<Sample>,
    yaw_rad: f64,
    energy_j: f64,
    sway: [f64; 2],
    settled: f64,
    cycles: f64,
}

impl Recorder {
    fn new(measure: Measure) -> Self {
        Self { measure, samples: Vec::new(), yaw_rad: 0.0, energy_j: 0.0, sway: [0.0; 2], settled: 0.0, cycles: 0.0 }
    }

    fn record(&mut self, simulator: &Simulator, control_loop: &ControlLoop, cycle: u64, fall: Option<Fall>) -> String {
        if let Some(fall) = fall {
            return fall.to_string();
        }
        let state = simulator.state();
        self.measure.sample(&state, simulator.height_m());
        let [roll, pitch, yaw] = state.roll_pitch_yaw();
        self.yaw_rad +=
            (yaw - self.yaw_rad + std::f64::consts::PI).rem_euclid(std::f64::consts::TAU) - std::f64::consts::PI;
        self.cycles += 1.0;
        self.energy_j +=
            PERIOD_S * (0..12).map(|j| (state.joint_torque_nm[j] * state.joint_velocity_rad_s[j]).abs()).sum::<f64>();
        if state.time_s > crate::measure::SETTLING_S {
            self.settled += 1.0;
            self.sway[0] += roll * roll;
            self.sway[1] += pitch * pitch;
        }
        if cycle.is_multiple_of(SAMPLED) {
            self.samples.push(sample(&state, [roll, pitch, self.yaw_rad], control_loop));
        }
        String::new()
    }

    fn outcome(&self, ended: Option<(f64, String)>) -> Outcome {
        Outcome {
            ended,
            figures: self.measure.figures(),
            samples: self.samples.clone(),
            power_w: self.energy_j / (self.cycles * PERIOD_S).max(PERIOD_S),
            sway_deg: self.sway.map(|sum| (sum / self.settled.max(1.0)).sqrt().to_degrees()),
        }
    }
}

fn sample(state: &RobotState, turned_rad: [f64; 3], control_loop: &ControlLoop) -> Sample {
    let heading = |velocity: [f64; 3], yaw: f64| {
        let (sine, cosine) = yaw.sin_cos();
        [cosine * velocity[0] + sine * velocity[1], cosine * velocity[1] - sine * velocity[0]]
    };
    let [vx, vy] = heading(state.base_linear_velocity_world, turned_rad[2]);
    let (estimate, report) = control_loop.watched();
    let [ex, ey] = heading(estimate.velocity_m_s(), estimate.yaw_rad());
    Sample {
        time_s: state.time_s,
        position_m: state.base_position_m,
        turned_rad,
        velocity: [vx, vy, state.base_angular_velocity_body[2]],
        estimated: [ex, ey, estimate.angular_velocity_rad_s()[2]],
        odometry_m: estimate.position_m(),
        pace: report.pace,
        limited: report.placement_limited || report.hurry_limited,
    }
}
