//! Whether a gait that was planned for the command or the slope walks it better than the law drives another gait there.

use super::cases::{Bench, pushed, velocity};
use gait::Gait;
use gait_design::GaitRequest;
use tandem_sim_bridge::simulator::{SimulatorOptions, Terrain};
use tandem_sim_bridge::trial::{Sample, Trial};

/// A gait, and a speed ahead in m/s and a slope ahead in degrees that are not its own.
const CASES: [(&str, f64, f64); 11] = [
    ("gait1", 0.2, 0.0),
    ("gait1", 0.35, 0.0),
    ("gait1", 0.5, 0.0),
    ("amble", 0.0, 0.0),
    ("amble", 0.6, 0.0),
    ("amble", -0.2, 0.0),
    ("amble", 0.35, 5.0),
    ("amble", 0.35, -5.0),
    ("amble", 0.35, 8.0),
    ("amble", 0.35, 15.0),
    ("amble", 0.35, -15.0),
];

pub fn planned(bench: &Bench) {
    for (name, speed_m_s, slope_deg) in CASES {
        let driven = bench.gait(name);
        let title = format!("{name}_at_{speed_m_s}m_s_on_{slope_deg}deg");
        tell(bench, &format!("driven_{title}"), &driven, speed_m_s, slope_deg);
        let request = request_of(&driven, speed_m_s, slope_deg);
        match bench.plan(&request) {
            Ok(gait) => tell(bench, &format!("planned_{title}"), &gait, speed_m_s, slope_deg),
            Err(reason) => println!("planned_{title} = {reason}"),
        }
    }
}

/// The request of a gait, for another speed and slope.
fn request_of(gait: &Gait, speed_m_s: f64, slope_deg: f64) -> GaitRequest {
    let number = |key: &str| gait.request[key].as_f64().unwrap_or(f64::NAN);
    GaitRequest {
        behaviour: gait.request["behaviour"].as_str().unwrap_or("").to_owned(),
        step_duration_s: number("step_duration_s"),
        clearance_m: number("clearance_m"),
        speed_m_s,
        lateral_speed_m_s: 0.0,
        yaw_rate_rad_s: 0.0,
        height_m: number("height_m"),
        half_width_m: number("half_width_m"),
        slope_rad: slope_deg.to_radians(),
        sideways_slope_rad: 0.0,
        torso_pitch_rad: 0.0,
        torso_roll_rad: 0.0,
        friction: number("friction"),
        torque_limit_nm: std::array::from_fn(|n| gait.request["torque_limit_nm"][n].as_f64().unwrap_or(f64::NAN)),
    }
}

fn tell(bench: &Bench, title: &str, gait: &Gait, speed_m_s: f64, slope_deg: f64) {
    let terrain = Terrain::Slope { uphill_rad: slope_deg.to_radians(), sideways_rad: 0.0 };
    let terrain = if slope_deg == 0.0 { Terrain::Flat } else { terrain };
    let simulator = SimulatorOptions { terrain, seed: 5, ..Trial::default().simulator };
    let base =
        Trial { simulator, asked: vec![(0.0, velocity(speed_m_s, 0.0, 0.0))], seconds: 14.0, ..Trial::default() };
    let outcome = bench.run(gait, base.clone());
    let late: Vec<&Sample> = outcome.samples.iter().filter(|sample| sample.time_s > 5.0).collect();
    let got_m_s = late.iter().map(|sample| sample.velocity[0]).sum::<f64>() / late.len().max(1) as f64;
    let torque = outcome.figures.mean_abs_torque_nm;
    let ended = outcome.ended.as_ref().map_or("up".to_owned(), |(at_s, why)| format!("{why} after {at_s:.1} s"));
    println!(
        "{title} = {ended}, {got_m_s:.3} m/s, torque {:.2} {:.2} {:.2} N m, {:.0} W, roll {:.2} pitch {:.2} deg rms",
        torque.hip_roll, torque.hip_pitch, torque.knee, outcome.power_w, outcome.sway_deg[0], outcome.sway_deg[1]
    );
    for impulse_n_s in [60.0, 80.0] {
        bench.count(&format!("{title}_push_{impulse_n_s}"), pushed(gait, impulse_n_s, &[speed_m_s], &base));
    }
}
