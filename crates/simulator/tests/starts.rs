//! Where a robot is put down.

use gait::Gait;
use robot::Robot;
use simulator::{Posture, Simulator, SimulatorOptions, Terrain};
use std::path::Path;

/// A toe that starts inside a field of heights is held by it for seconds, as by no ground.
#[test]
fn no_toe_starts_inside_rolling_or_rough_ground() {
    let robot = Robot::load(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/robots/vision60")).unwrap();
    let amble = Gait::from_json(include_str!("../../../tests/gaits/amble.json")).unwrap();
    let hills = Terrain::Hills { incline_rad: 10_f64.to_radians(), bump_m: 0.03 };
    for terrain in [hills, Terrain::Rough { height_m: 0.08, cell_m: 0.2 }] {
        for seed in 0..10 {
            let mut simulator =
                Simulator::new(&robot, SimulatorOptions { terrain, seed, ..SimulatorOptions::default() }).unwrap();
            simulator.reset_to_gait(&amble).unwrap();
            assert_eq!(simulator.state().toe_force_n, [[0.0; 3]; 4], "{terrain:?}, seed {seed}: in a gait");
            simulator.reset_to_posture(Posture::Stand);
            assert_eq!(simulator.state().toe_force_n, [[0.0; 3]; 4], "{terrain:?}, seed {seed}: standing");
        }
    }
}
