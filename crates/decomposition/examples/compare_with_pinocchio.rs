//! Compares a robot's dynamics with numbers that Pinocchio computed: `compare_with_pinocchio FOLDER GOLDEN.json`.
//!
//! FOLDER is a robot's folder as `config/robots/NAME` is one; `tests/pinocchio/run` makes both. Exits with an error
//! above a relative difference of 1e-9. Also checks Proposition 1 on the robot at a posture of its own.

use std::path::Path;
use std::process::ExitCode;

use decomposition::{Bipeds, ContactDynamics};
use robot::Robot;

#[path = "../tests/common/golden.rs"]
mod golden;

const TOLERANCE: f64 = 1e-9;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [folder, numbers] = &arguments[..] else {
        eprintln!("usage: compare_with_pinocchio FOLDER GOLDEN.json");
        return ExitCode::from(2);
    };
    match run(folder, numbers) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(problem) => {
            eprintln!("{problem}");
            ExitCode::FAILURE
        }
    }
}

fn run(folder: &str, numbers: &str) -> Result<bool, String> {
    let robot = Robot::load(Path::new(folder)).map_err(|error| format!("{folder}: {error}"))?;
    let text = std::fs::read_to_string(numbers).map_err(|error| format!("{numbers}: {error}"))?;
    let golden: golden::Golden = serde_json::from_str(&text).map_err(|error| format!("{numbers}: {error}"))?;
    let mut worst = golden::compare(&robot, &golden);
    worst.push(("Proposition 1", proposition_1(&robot)?));
    let mut good = true;
    for (what, error) in worst {
        good &= error < TOLERANCE;
        println!("{} {what} {error:.1e}{}", golden.robot, if error < TOLERANCE { "" } else { " TOO FAR" });
    }
    Ok(good)
}

/// Largest relative difference in accelerations between the whole robot and its bipeds, toes 1 and 2 standing.
fn proposition_1(robot: &Robot) -> Result<f64, String> {
    let show = |error: decomposition::DynamicsError| error.to_string();
    let mut q = [0.0; 18];
    q[6..].copy_from_slice(&robot.stand_rad());
    let v: [f64; 18] = std::array::from_fn(|i| (i as f64).sin());
    let u: [f64; 12] = std::array::from_fn(|i| (3.0 * i as f64).cos());
    let mut tau = [0.0; 18];
    tau[6..].copy_from_slice(&u);
    let toes = [1, 2].map(|leg: usize| robot.legs[leg].toe);
    let mut whole = ContactDynamics::new(&robot.model, 2);
    let expected = &whole.motion(&robot.model, &q, &v, &tau, &toes).map_err(show)?.acceleration;
    let mut worst = 0.0_f64;
    for share in [0.0, 0.3, 0.5, 1.0] {
        let mut bipeds = Bipeds::new(robot, share).map_err(|error| error.to_string())?;
        let pair = bipeds.motion(&q, &v, &u, &[1, 2]).map_err(show)?;
        let found = Bipeds::join(&pair.front, &pair.rear);
        for i in 0..18 {
            worst = worst.max((found[i] - expected[i]).abs() / expected.amax());
        }
    }
    Ok(worst)
}
