//! Ground that was not planned for.

use super::cases::{Bench, velocity};
use gait::Gait;
use tandem_sim_bridge::simulator::{Push, Random, SimulatorOptions, Terrain};
use tandem_sim_bridge::trial::Trial;

const GAITS: [&str; 3] = ["amble/step", "amble", "wide"];

/// Trials on `terrain` of all gaits at `asked` speeds ahead, with `seeds` each.
fn on(bench: &Bench, terrain: Terrain, asked: &[f64], seeds: u64, seconds: f64) -> Vec<(Gait, Trial)> {
    let mut trials = Vec::new();
    for name in GAITS {
        let gait = bench.gait(name);
        for &forward_m_s in asked {
            for seed in 0..seeds {
                let simulator = SimulatorOptions { terrain, seed: 17 + seed, ..Trial::default().simulator };
                let asked = vec![(0.0, velocity(forward_m_s, 0.0, 0.0))];
                trials.push((gait.clone(), Trial { seconds, asked, simulator, ..Trial::default() }));
            }
        }
    }
    trials
}

pub fn slopes(bench: &Bench) {
    for degrees in [5.0_f64, 10.0, 15.0] {
        let mut trials = Vec::new();
        for direction in 0..8 {
            let (sine, cosine) = (f64::from(direction) * std::f64::consts::FRAC_PI_4).sin_cos();
            let rise = degrees.to_radians().tan();
            let terrain = Terrain::Slope { uphill_rad: (rise * cosine).atan(), sideways_rad: (rise * sine).atan() };
            trials.extend(on(bench, terrain, &[0.0, 0.3], 1, 12.0));
        }
        bench.count(&format!("slope_{degrees}deg"), trials);
    }
}

pub fn ramps(bench: &Bench) {
    for degrees in [5.0_f64, 10.0, 15.0, -5.0, -10.0, -15.0] {
        let terrain = Terrain::Ramp { incline_rad: degrees.to_radians() };
        bench.count(&format!("ramp_{degrees}deg"), on(bench, terrain, &[0.3], 4, 14.0));
    }
}

pub fn kerbs(bench: &Bench) {
    for height_m in [0.05, 0.08] {
        let kerb = Terrain::Kerb { height_m };
        bench.count(&format!("kerb_{height_m}m_up_and_down"), on(bench, kerb, &[0.2, 0.35], 4, 24.0));
    }
}

pub fn bumps(bench: &Bench) {
    for height_m in [0.03, 0.05, 0.08] {
        let terrain = Terrain::Rough { height_m, cell_m: 0.2 };
        bench.count(&format!("bumps_{height_m}m"), on(bench, terrain, &[0.0, 0.3], 5, 14.0));
    }
}

pub fn stairs(bench: &Bench) {
    let terrain = Terrain::Steps { rise_m: 0.05, run_m: 0.4 };
    bench.count("stairs_0.05m", on(bench, terrain, &[0.3], 4, 20.0));
}

/// 40 s: a new random command every 2 s, a push of 10 to 25 N s every 4 s, ground that rolls to 10° with 3 cm bumps.
pub fn torture(bench: &Bench) {
    for (name, noise, bump_m, most_n_s) in
        [("torture", 1.0, 0.03, 25.0), ("torture_noise_times_3", 3.0, 0.03, 25.0), ("torture_harsh", 1.0, 0.05, 40.0)]
    {
        let mut trials = Vec::new();
        for gait in GAITS {
            let gait = bench.gait(gait);
            for seed in 0..10 {
                trials.push((gait.clone(), tortured(seed, noise, bump_m, most_n_s)));
            }
        }
        bench.count(name, trials);
    }
}

pub fn tortured(seed: u64, noise: f64, bump_m: f64, most_n_s: f64) -> Trial {
    let mut random = Random::new(7000 + seed);
    let mut between = |low: f64, high: f64| low + (high - low) * random.uniform();
    let asked = (0..20)
        .map(|n| (2.0 * f64::from(n), velocity(between(-0.3, 0.5), between(-0.15, 0.15), between(-0.4, 0.4))))
        .collect();
    let pushes = (0..9)
        .map(|n| {
            let (impulse_n_s, direction) = (between(10.0, most_n_s), between(0.0, std::f64::consts::TAU));
            let (sine, cosine) = direction.sin_cos();
            let force = impulse_n_s / 0.1;
            let start_s = 4.0 * f64::from(n + 1) + between(0.0, 0.5);
            Push { start_s, duration_s: 0.1, force_n: [force * cosine, force * sine, 0.0] }
        })
        .collect();
    let terrain = Terrain::Hills { incline_rad: 10_f64.to_radians(), bump_m };
    let simulator = SimulatorOptions { terrain, seed, ..Trial::default().simulator };
    let noise = Trial::default().noise.times(noise);
    Trial { seconds: 40.0, asked, pushes, noise, simulator, ..Trial::default() }
}
