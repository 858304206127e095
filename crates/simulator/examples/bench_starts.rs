//! What it costs the Vision 60 to begin a walk, to change it and to end it: standing, amble, gait3 and rest in the
//! simulator, with the gaits grown out of standing and with planned steps as leads out of standing and from the one to
//! the other, under both laws. One line a
//! phase: the largest torque, the largest roll or pitch, and how long it took to go as fast as the amble then goes,
//! over all seeds.
//!
//! bench_starts SEEDS; `launch-scripts/bench starts` runs it.

use control::balanced::BalanceConfig;
use control::{Config, Controller, Input, JointState, Mode, Output, PreparedGait, Request};
use gait::Gait;
use gait_design::{GaitRequest, PlanError, PlanOptions, TransitionOptions, TransitionRequest, plan, plan_transition};
use robot::Robot;
use simulator::{Posture, Simulator, SimulatorOptions};
use std::ops::ControlFlow;
use std::path::Path;
use std::time::Duration;

const PERIOD: Duration = Duration::from_millis(1);
/// How long each phase is looked at, s: longer than a gait grows.
const PHASE_S: f64 = 4.0;
/// As fast as it then goes is this share of the next phase's speed, over [`MEAN_S`] seconds.
const FAST_SHARE: f64 = 0.9;
const MEAN_S: f64 = 0.7;

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let seeds = match &arguments[..] {
        [seeds] => seeds.parse::<u64>().ok().filter(|seeds| *seeds > 0),
        _ => None,
    };
    let Some(seeds) = seeds else {
        eprintln!("usage: bench_starts SEEDS, a number of at least 1");
        std::process::exit(2);
    };
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/robots/vision60");
    let robot = Robot::load(&folder).expect("the robot's folder belongs to the project");
    for (name, leads) in [("grown", false), ("lead", true)] {
        let mut gaits = ["amble", "gait3"].map(|gait| planned(&robot, gait));
        if leads {
            let [amble, gait3] = &mut gaits;
            lead(&robot, gait3, TransitionRequest::between(&robot, amble, gait3));
            lead(&robot, amble, TransitionRequest::from_rest(&robot, amble));
        }
        for (law, balance) in [("bare", false), ("balanced", true)] {
            let mut figures = [Figures::default(); PHASES.len()];
            for seed in 1..=seeds {
                if let Err(fault) = day(&robot, &gaits, balance, seed, &mut figures) {
                    println!("{law}_{name}_seed_{seed}_fault = {fault}");
                }
            }
            for (phase, figures) in PHASES.iter().zip(&figures) {
                println!("{law}_{name}_{phase} = {figures}");
            }
        }
    }
}

/// A gait as the planner's defaults have it.
fn planned(robot: &Robot, name: &str) -> Gait {
    let request = GaitRequest::named(name, robot).expect("a behaviour's name");
    let go_on = |_: &_| ControlFlow::Continue(());
    plan(robot, &request, &PlanOptions::default(), go_on).expect("the defaults are planned").gait
}

/// Gives a gait the planned steps as its lead.
fn lead(robot: &Robot, gait: &mut Gait, steps: Result<TransitionRequest, PlanError>) {
    let steps = steps.expect("a planned gait holds its request");
    let go_on = |_: &_| ControlFlow::Continue(());
    match plan_transition(robot, &steps, &TransitionOptions::default(), go_on) {
        Ok(steps) => gait.lead = steps.steps.to_vec(),
        Err(error) => println!("{}_lead_refused = {error}", gait.name),
    }
}

/// Out of standing into the amble; the amble that is walked; from there to gait3; gait3; to rest.
const PHASES: [&str; 5] = ["start", "amble", "change", "gait3", "rest"];

/// The largest of a phase.
#[derive(Clone, Copy, Default)]
struct Figures {
    torque_nm: f64,
    tilt_rad: f64,
    fast_after_s: Option<f64>,
}

impl std::fmt::Display for Figures {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{:.1} N m, {:.2} deg", self.torque_nm, self.tilt_rad.to_degrees())?;
        self.fast_after_s.map_or(Ok(()), |after_s| write!(f, "; at its speed after {after_s:.1} s"))
    }
}

/// One robot's day; a fault ends it.
fn day(robot: &Robot, gaits: &[Gait; 2], balance: bool, seed: u64, figures: &mut [Figures]) -> Result<(), String> {
    let config = Config {
        balance: balance.then(|| BalanceConfig::for_robot(robot).expect("legs that it knows")),
        ..Config::for_robot(robot)
    };
    let prepared = gaits.each_ref().map(|gait| PreparedGait::new(gait, &config).expect("a gait for this robot"));
    let options = SimulatorOptions { joint_noise_rad: 0.01, seed, ..SimulatorOptions::default() };
    let mut simulator = Simulator::new(robot, options).expect("the robot's description is simulated");
    simulator.reset_to_posture(Posture::Sit);
    let controller = Controller::new(config).expect("the robot's own configuration");
    let mut day = Day { controller, simulator, now: Duration::ZERO, x_m: Vec::new() };
    day.cycle(&[Request::Arm, Request::Stand], Some(&prepared[0]), &mut Figures::default())?;
    while day.controller.mode() != Mode::Standing {
        day.cycle(&[], None, &mut Figures::default())?;
    }
    day.run(1.0, &mut Figures::default())?;
    day.cycle(&[Request::Walk], None, &mut figures[0])?;
    day.run(PHASE_S, &mut figures[0])?;
    day.run(PHASE_S, &mut figures[1])?;
    day.cycle(&[], Some(&prepared[1]), &mut figures[2])?;
    day.run(PHASE_S, &mut figures[2])?;
    day.run(PHASE_S, &mut figures[3])?;
    day.cycle(&[Request::Stop], None, &mut figures[4])?;
    day.run(PHASE_S, &mut figures[4])?;
    // Each phase was one cycle in which it was asked for and PHASE_S, or PHASE_S alone.
    let phase = cycles(PHASE_S);
    let start = fast_after_s(&day.x_m[day.x_m.len() - 5 * phase - 3..]);
    figures[0].fast_after_s = Some(figures[0].fast_after_s.map_or(start, |most| most.max(start)));
    Ok(())
}

fn cycles(seconds: f64) -> usize {
    (seconds / PERIOD.as_secs_f64()).round() as usize
}

/// From the beginning of `x_m` to the last time within a phase that it went slower than the phase after it goes, s.
fn fast_after_s(x_m: &[f64]) -> f64 {
    let (phase, mean) = (cycles(PHASE_S), cycles(MEAN_S));
    let least_m = FAST_SHARE * (x_m[2 * phase] - x_m[phase]) * MEAN_S / PHASE_S;
    let slow = (0..=phase).rev().find(|&begin| x_m[begin + mean] - x_m[begin] < least_m);
    slow.map_or(0.0, |begin| (begin + mean) as f64 * PERIOD.as_secs_f64())
}

struct Day {
    controller: Controller,
    simulator: Simulator,
    now: Duration,
    /// The base's place ahead in every cycle, m.
    x_m: Vec<f64>,
}

impl Day {
    fn run(&mut self, seconds: f64, figures: &mut Figures) -> Result<(), String> {
        (0..cycles(seconds)).try_for_each(|_| self.cycle(&[], None, figures))
    }

    fn cycle(&mut self, requests: &[Request], gait: Option<&PreparedGait>, most: &mut Figures) -> Result<(), String> {
        let (position_rad, velocity_rad_s) = self.simulator.joints();
        let joints = JointState {
            stamp: self.now,
            arrived: [self.now; 12],
            position_rad,
            velocity_rad_s,
            temperature_c: None,
            drive_error: [0; 12],
        }
        .to_resolution();
        let inertial = Some(self.simulator.inertial_state(self.now).to_resolution());
        let input = Input { joints: Some(&joints), inertial, requests, gait, ..Input::default() };
        let output = self.controller.step(&input, self.now);
        self.refused(&output)?;
        self.simulator.command(&output.command);
        for _ in 0..2 {
            self.simulator.step();
        }
        self.now += PERIOD;
        let state = self.simulator.state();
        let [roll_rad, pitch_rad, _] = state.roll_pitch_yaw();
        most.tilt_rad = most.tilt_rad.max(roll_rad.abs()).max(pitch_rad.abs());
        most.torque_nm = state.joint_torque_nm.iter().fold(most.torque_nm, |most, torque| most.max(torque.abs()));
        self.x_m.push(state.base_position_m[0]);
        Ok(())
    }

    /// What ended the day, if anything did.
    fn refused(&self, output: &Output) -> Result<(), String> {
        let at = || format!("{:.2} s, {}", self.now.as_secs_f64(), output.mode.name());
        if let Some(report) = output.report.filter(|_| !output.faults.is_empty()) {
            return Err(format!("{} at {}", report.fault.name(), at()));
        }
        match output.replies.iter().flatten().find_map(|reply| reply.err()) {
            Some(refusal) => Err(format!("{refusal} at {}", at())),
            None => Ok(()),
        }
    }
}
