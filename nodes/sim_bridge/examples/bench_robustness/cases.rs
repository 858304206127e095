//! Robot, gaits, and how many of a table's trials survived.

use control::Velocity;
use gait::Gait;
use gait_design::{GaitRequest, PlanError, PlanOptions, plan};
use robot::Robot;
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use tandem_sim_bridge::simulator::Push;
use tandem_sim_bridge::trial::{Outcome, Trial, run};

/// The behaviours of the paper's Table I.
pub const BEHAVIOURS: [&str; 5] = ["gait1", "gait2", "gait3", "gait4", "amble"];

/// The robot, the gaits planned so far, and how to walk.
pub struct Bench {
    pub robot: Robot,
    pub balanced: bool,
    pub quick: bool,
    pub watched: bool,
    /// Whether each case that did not survive is told of.
    pub tells_cases: bool,
    pub gaits: RefCell<BTreeMap<String, Gait>>,
}

impl Bench {
    /// The balanced law, every case, under the controller's watch, on the robot of this folder or the Vision 60.
    pub fn new(folder: Option<&str>) -> Self {
        let own = || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/robots/vision60");
        let folder = folder.map_or_else(own, PathBuf::from);
        let robot = Robot::load(&folder).unwrap_or_else(|error| fail(&error.to_string()));
        Self { robot, balanced: true, quick: false, watched: true, tells_cases: false, gaits: RefCell::default() }
    }

    /// A gait by name: a behaviour's own (`amble`), or its frequency counting steps at a half-width of 0.25 m
    /// (`amble/step`), or a slower amble at 0.28 m that is a good base for driving (`wide`).
    pub fn gait(&self, name: &str) -> Gait {
        if let Some(gait) = self.gaits.borrow().get(name) {
            return gait.clone();
        }
        let (behaviour, reading) = name.split_once('/').unwrap_or((name, "stride"));
        let behaviour = if behaviour == "wide" { "amble" } else { behaviour };
        let mut request = GaitRequest::named(behaviour, &self.robot).unwrap_or_else(|error| fail(&error.to_string()));
        if reading == "step" {
            request.step_duration_s *= 2.0;
            request.half_width_m = 0.25;
        }
        if name == "wide" {
            (request.step_duration_s, request.half_width_m, request.clearance_m) = (0.24, 0.28, 0.1);
        }
        let gait = self.plan(&request).unwrap_or_else(|error| fail(&format!("{name}: {error}")));
        self.gaits.borrow_mut().insert(name.to_owned(), gait.clone());
        gait
    }

    /// A gait for this request, or why there is none.
    pub fn plan(&self, request: &GaitRequest) -> Result<Gait, PlanError> {
        Ok(plan(&self.robot, request, &PlanOptions::default(), |_| ControlFlow::Continue(()))?.gait)
    }

    /// Stepping in place or `walking`, for a robot of any size: by its height, as `tests/robots/table` plans them.
    pub fn similar(&self, name: &str) -> Gait {
        let height_m = self.robot.nominal.height_m;
        let behaviour = if name == "walking" { "amble" } else { "gait1" };
        let request = GaitRequest::named(behaviour, &self.robot).unwrap_or_else(|error| fail(&error.to_string()));
        let request = GaitRequest {
            step_duration_s: height_m.sqrt() / 2.2,
            clearance_m: 0.14 * height_m,
            speed_m_s: if name == "walking" { 0.6 * height_m } else { 0.0 },
            ..request
        };
        self.plan(&request).unwrap_or_else(|error| fail(&format!("{name}: {error}")))
    }

    /// Whether case `n` is left out: with `--quick` seven of eight, but of each group of eight others, so that no side
    /// or phase is never run.
    pub fn skips(&self, n: usize) -> bool {
        self.quick && !(n + n / 8).is_multiple_of(8)
    }

    /// The five behaviours in both readings.
    pub fn all_gaits(&self) -> Vec<String> {
        ["/step", ""].iter().flat_map(|reading| BEHAVIOURS.map(|name| format!("{name}{reading}"))).collect()
    }

    /// One trial.
    pub fn run(&self, gait: &Gait, trial: Trial) -> Outcome {
        self.run_with(gait, self.balanced, trial)
    }

    /// One trial of the balanced law or the paper's.
    pub fn run_with(&self, gait: &Gait, balanced: bool, trial: Trial) -> Outcome {
        let trial = Trial { balanced, watched: self.watched, ..trial };
        run(&self.robot, None, gait, &trial).unwrap_or_else(|error| fail(&error.to_string()))
    }

    /// Runs the trials, or with `--quick` one in eight, and prints how many survived.
    pub fn count(&self, name: &str, trials: impl IntoIterator<Item = (Gait, Trial)>) {
        let (mut survived, mut of) = (0, 0);
        let mut reasons: BTreeMap<String, u32> = BTreeMap::new();
        for (n, (gait, trial)) in trials.into_iter().enumerate() {
            if self.skips(n) {
                continue;
            }
            of += 1;
            match self.run(&gait, trial.clone()).ended {
                None => survived += 1,
                Some((at_s, why)) => {
                    if self.tells_cases {
                        println!("# {name} case {n}: {}: {why} after {at_s:.3} s", case(&gait, &trial));
                    }
                    *reasons.entry(why).or_default() += 1;
                }
            }
        }
        let reasons: Vec<String> = reasons.iter().map(|(why, n)| format!("{n} × {why}")).collect();
        let comment = if reasons.is_empty() { String::new() } else { format!(" # {}", reasons.join(", ")) };
        println!("{name} = {survived}/{of}{comment}");
    }
}

/// What happens in a trial, in words.
fn case(gait: &Gait, trial: &Trial) -> String {
    let asked = trial.asked.first().map_or(0.0, |(_, velocity)| velocity.forward_m_s);
    let push = |push: &Push| {
        let [x, y, _] = push.force_n.map(|newtons| newtons * push.duration_s);
        let steps = push.start_s / gait.step_duration_s;
        format!(", pushed by ({x:.0}, {y:.0}) N s at {:.3} s, in step {steps:.2}", push.start_s)
    };
    format!("at {asked:.2} m/s{}", trial.pushes.iter().map(push).collect::<String>())
}

/// A velocity.
pub fn velocity(forward_m_s: f64, left_m_s: f64, yaw_rad_s: f64) -> Velocity {
    Velocity { forward_m_s, left_m_s, yaw_rad_s }
}

/// Pushes of `impulse_n_s` within 0.1 s from four sides at eight phases of a step, both steps, at velocities
/// `asked`: trials that last three seconds more.
pub fn pushed(gait: &Gait, impulse_n_s: f64, asked: &[f64], base: &Trial) -> Vec<(Gait, Trial)> {
    const BEFORE_S: f64 = 2.0;
    const LASTS_S: f64 = 0.1;
    const PHASES: u32 = 8;
    let mut trials = Vec::new();
    for (n, &forward_m_s) in asked.iter().enumerate() {
        for (side, (x, y)) in [(0.0, 1.0), (0.0, -1.0), (1.0, 0.0), (-1.0, 0.0)].into_iter().enumerate() {
            for phase in 0..PHASES {
                let steps = f64::from(phase) / f64::from(PHASES) + f64::from(phase % 2);
                let start_s = BEFORE_S + steps * gait.step_duration_s;
                let force = impulse_n_s / LASTS_S;
                let mut trial = base.clone();
                trial.pushes.push(Push { start_s, duration_s: LASTS_S, force_n: [force * x, force * y, 0.0] });
                trial.seconds = start_s + 3.2;
                trial.asked = vec![(0.0, velocity(forward_m_s, 0.0, 0.0))];
                trial.simulator.seed = 1000 + u64::from(phase) + 10 * side as u64 + 100 * n as u64;
                trials.push((gait.clone(), trial));
            }
        }
    }
    trials
}

/// The speed that a gait was planned for, m/s.
pub fn own_speed(gait: &Gait) -> f64 {
    gait.step_length_m / gait.step_duration_s
}

pub fn fail(message: &str) -> ! {
    eprintln!("bench_robustness: {message}");
    std::process::exit(1);
}
