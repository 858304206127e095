//! Other robots (`--robot FOLDER`): the balanced law beside the bare one, by dynamic similarity.

use super::cases::{Bench, own_speed, pushed, velocity};
use super::driving::{FROM, errors};
use gait::Gait;
use robot::LegKinematics;
use tandem_sim_bridge::simulator::{SimulatorOptions, Terrain};
use tandem_sim_bridge::trial::Trial;

/// The push: a velocity of this for the whole robot, m/s, at the Vision 60's leg length, m, and height, m.
const PUSH_M_S: f64 = 0.8;
const LEG_M: f64 = 0.68;
const HEIGHT_M: f64 = 0.55;

pub fn robot(bench: &Bench) {
    let robot = &bench.robot;
    let leg_m = LegKinematics::all(robot).map_or(f64::NAN, |legs| legs[0].length_m());
    let mass_kg = robot.model.total_mass();
    let impulse_n_s = PUSH_M_S * mass_kg * (leg_m / LEG_M).sqrt();
    println!(
        "robot_{} = {mass_kg:.1} kg, legs of {leg_m:.3} m, hips at {:.3} m, pushes of {impulse_n_s:.1} N s",
        robot.name, robot.nominal.height_m
    );
    let gaits = ["stepping", "walking"].map(|name| bench.similar(name));
    let own = |gait: &Gait| vec![(0.0, velocity(own_speed(gait), 0.0, 0.0))];
    for share in [0.5, 1.0] {
        let pushes =
            gaits.iter().flat_map(|gait| pushed(gait, share * impulse_n_s, &[own_speed(gait)], &Trial::default()));
        compare(bench, &format!("{}_pushes_times_{share}", robot.name), pushes.collect());
    }
    for degrees in [5.0_f64, 10.0] {
        let mut trials = Vec::new();
        for direction in 0..8 {
            let (sine, cosine) = (f64::from(direction) * std::f64::consts::FRAC_PI_4).sin_cos();
            let rise = degrees.to_radians().tan();
            let terrain = Terrain::Slope { uphill_rad: (rise * cosine).atan(), sideways_rad: (rise * sine).atan() };
            for gait in &gaits {
                let simulator = SimulatorOptions { terrain, seed: 17, ..Trial::default().simulator };
                trials.push((gait.clone(), Trial { seconds: 12.0, asked: own(gait), simulator, ..Trial::default() }));
            }
        }
        compare(bench, &format!("{}_slope_{degrees}deg", robot.name), trials);
    }
    drive(bench, &gaits);
}

/// How often each law survived, and how often the bare one where the balanced one did not: that must be never.
fn compare(bench: &Bench, name: &str, trials: Vec<(Gait, Trial)>) {
    let (mut balanced, mut bare, mut worse, mut of) = (0, 0, 0, 0);
    for (n, (gait, trial)) in trials.into_iter().enumerate() {
        if bench.skips(n) {
            continue;
        }
        of += 1;
        let outcomes = [true, false].map(|law| bench.run_with(&gait, law, trial.clone()));
        let [with, without] = outcomes.each_ref().map(|outcome| outcome.survived());
        (balanced, bare) = (balanced + i32::from(with), bare + i32::from(without));
        if let Some((at_s, why)) = &outcomes[0].ended
            && (bench.tells_cases || without)
        {
            let beside = if without { ", where the bare law survives" } else { "" };
            println!("# {name} case {n}: {}: {why} after {at_s:.2} s{beside}", gait.name);
        }
        worse += i32::from(without && !with);
    }
    println!("{name} = balanced {balanced}/{of}, bare {bare}/{of}, only bare {worse}");
}

/// The commands of the table `driving`, by dynamic similarity.
fn drive(bench: &Bench, gaits: &[Gait; 2]) {
    let scale = (bench.robot.nominal.height_m / HEIGHT_M).sqrt();
    let from = FROM.map(|(at_s, [x, y, yaw])| (at_s, [scale * x, scale * y, yaw]));
    for gait in gaits {
        let (errors, ended) = errors(bench, gait, &from, 1);
        let ended = ended.map_or("up".to_owned(), |(at_s, why)| format!("{why} after {at_s:.1} s"));
        let mean = |axis: usize| errors.iter().map(|e| e[axis]).sum::<f64>() / errors.len().max(1) as f64;
        println!(
            "{}_driving_{} = {ended}, mean error {:.3} {:.3} m/s {:.3} rad/s of up to {:.2} {:.2} m/s 0.40 rad/s",
            bench.robot.name,
            gait.name,
            mean(0),
            mean(1),
            mean(2),
            0.3 * scale,
            0.15 * scale
        );
    }
}
