//! Pushes: on the robot as described, on others, and with commands that are late.

use super::cases::{Bench, own_speed, pushed};
use tandem_sim_bridge::simulator::{SimulatorOptions, Variation};
use tandem_sim_bridge::trial::Trial;

/// Standing on the spot, and at the gait's own speed where that is another.
fn speeds(gait: &gait::Gait) -> Vec<f64> {
    let own = own_speed(gait);
    if own.abs() < 0.01 { vec![0.0, 0.3] } else { vec![0.0, own] }
}

pub fn pushes(bench: &Bench) {
    for impulse_n_s in [30.0, 40.0, 60.0] {
        let mut all = Vec::new();
        for name in bench.all_gaits() {
            let gait = bench.gait(&name);
            let trials = pushed(&gait, impulse_n_s, &speeds(&gait), &Trial::default());
            bench.count(&format!("pushes_{impulse_n_s}_{name}"), trials.iter().cloned());
            all.extend(trials);
        }
    }
    let gait = bench.gait("wide");
    for impulse_n_s in [60.0, 80.0, 100.0] {
        bench.count(
            &format!("pushes_{impulse_n_s}_wide"),
            pushed(&gait, impulse_n_s, &speeds(&gait), &Trial::default()),
        );
    }
}

pub fn variations(bench: &Bench) {
    let plain = Variation::default();
    let cases: [(&str, Variation, f64); 10] = [
        ("payload_8kg", Variation { payload_kg: 8.0, payload_at_m: [0.0, 0.0, 0.1], ..plain }, 0.8),
        ("payload_8kg_ahead", Variation { payload_kg: 8.0, payload_at_m: [0.1, 0.0, 0.1], ..plain }, 0.8),
        ("payload_8kg_left", Variation { payload_kg: 8.0, payload_at_m: [0.0, 0.05, 0.1], ..plain }, 0.8),
        ("mass_plus_20", Variation { mass_scale: 1.2, ..plain }, 0.8),
        ("kp_times_0.8", Variation { stiffness_scale: 0.8, ..plain }, 0.8),
        ("shank_plus_3", Variation { shank_scale: 1.03, ..plain }, 0.8),
        ("friction_0.3", plain, 0.3),
        ("torso_com_5cm_ahead", Variation { torso_shift_m: [0.05, 0.0, 0.0], ..plain }, 0.8),
        ("torso_com_5cm_back", Variation { torso_shift_m: [-0.05, 0.0, 0.0], ..plain }, 0.8),
        ("torso_com_5cm_left", Variation { torso_shift_m: [0.0, 0.05, 0.0], ..plain }, 0.8),
    ];
    for (name, variation, friction) in cases {
        for impulse_n_s in [40.0, 60.0] {
            let mut trials = Vec::new();
            for gait in ["amble/step", "amble"] {
                let gait = bench.gait(gait);
                let simulator = SimulatorOptions { variation, friction, ..Trial::default().simulator };
                let base = Trial { simulator, ..Trial::default() };
                trials.extend(pushed(&gait, impulse_n_s, &[0.0], &base));
            }
            bench.count(&format!("{name}_push_{impulse_n_s}"), trials);
        }
    }
}

pub fn delay(bench: &Bench) {
    for name in ["amble/step", "amble", "wide"] {
        let gait = bench.gait(name);
        for delay_cycles in [0, 2, 3, 4, 6] {
            let base = Trial { delay_cycles, ..Trial::default() };
            let outcome = bench.run(&gait, base.clone());
            let [roll, pitch] = outcome.sway_deg;
            let ended = outcome.ended.map_or("up".to_owned(), |(at_s, why)| format!("{why} after {at_s:.1} s"));
            println!(
                "delay_{delay_cycles}ms_{name} = {ended}, roll {roll:.2} deg, pitch {pitch:.2} deg, {:.3} m/s",
                outcome.figures.speed_m_s
            );
            bench.count(&format!("delay_{delay_cycles}ms_{name}_push_40"), pushed(&gait, 40.0, &[0.0], &base));
        }
        let noise = Trial::default().noise.times(3.0);
        let base = Trial { noise, ..Trial::default() };
        bench.count(&format!("noise_times_3_{name}_push_40"), pushed(&gait, 40.0, &[0.0], &base));
    }
}
