//! The torture on emulated CAN drives: joints and inertial unit behind their frames, commands 2 ms late.

use super::cases::{Bench, fail};
use super::ground::tortured;
use joint_bus::{BusConfig, DriveModel};
use std::time::Duration;
use tandem_sim_bridge::simulator::walk::{Drives, End, WalkOptions, walk};

const WIRING: &str = include_str!("../../../../config/hardware/vision60_can.toml");
const SEEDS: u64 = 5;

/// 40 s as the table `torture`, five seeds, both protocols, the law closed at the drive. The inertial unit of this path
/// has no noise but its frames' steps, 200 messages a second.
pub fn can(bench: &Bench) {
    let gait = bench.gait("amble");
    for protocol in ["mit", "registers"] {
        let text = WIRING.replacen("protocol = \"mit\"", &format!("protocol = \"{protocol}\""), 1);
        let text = text + "[inertial]\ninterface = 0\nid = 0x1000000\n";
        let bus = BusConfig::from_toml_str(&text, &bench.robot.name, &bench.robot.joint_names())
            .unwrap_or_else(|error| fail(&error.to_string()));
        let model = DriveModel { latency: Duration::from_millis(2), ..DriveModel::default() };
        let mut survived = 0;
        for seed in 0..SEEDS {
            let trial = tortured(seed, 1.0, 0.03, 25.0);
            let options = WalkOptions {
                seconds: trial.seconds,
                balance: bench.balanced,
                drives: Some(Drives { bus: bus.clone(), model }),
                pushes: trial.pushes,
                velocities: trial.asked,
                simulator: trial.simulator,
                ..WalkOptions::default()
            };
            let walked =
                walk(&bench.robot, &gait, &options, &mut |_, _, _| {}).unwrap_or_else(|error| fail(&error.to_string()));
            if walked.end == End::Upright {
                survived += 1;
            } else {
                println!("# torture_can_{protocol} seed {seed}: {:?}", walked.end);
            }
        }
        println!("torture_can_{protocol} = {survived}/{SEEDS}");
    }
}
