//! The controller and the simulator together.

use control::{DriveMode, Mode, Velocity};
use gait::Gait;
use gait_design::{GaitRequest, PlanOptions};
use joint_bus::{BusConfig, DriveModel};
use robot::Robot;
use simulator::pictures::{self, Studio};
use simulator::walk::{Drives, End, Start, Walk, WalkError, WalkOptions, walk};
use simulator::{Posture, Push, SimulatorOptions, Terrain};
use std::ops::ControlFlow;
use std::path::Path;
use std::time::Duration;

fn vision60() -> Robot {
    Robot::load(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/robots/vision60")).unwrap()
}

fn amble() -> Gait {
    Gait::from_json(include_str!("../../../tests/gaits/amble.json")).unwrap()
}

fn run(options: WalkOptions) -> Result<Walk, WalkError> {
    walk(&vision60(), &amble(), &options, &mut |_, _, _| {})
}

/// The controller's own step walks as an independent program's bare law does on the same gait file (mean torques within
/// 5 %).
#[test]
fn the_controller_walks_the_amble_as_the_bare_law_does_elsewhere() {
    let walk = run(WalkOptions::default()).unwrap();
    assert_eq!(walk.end, End::Upright);
    assert_eq!(walk.cycles, 20_000);
    let torque: [f64; 3] = walk.figures.mean_abs_torque_nm.into();
    for (ours, theirs) in torque.into_iter().zip([10.87, 5.84, 17.27]) {
        assert!((ours / theirs - 1.0).abs() < 0.05, "{torque:?}");
    }
    assert!((walk.figures.speed_m_s - 0.3605).abs() < 0.01, "{:?}", walk.figures);
}

/// The amble as it is by default, and with longer steps: its frequency counts steps, at a half-width of 0.25 m.
#[derive(Clone, Copy, PartialEq)]
enum Amble {
    Strides,
    Steps,
}

/// Plans the amble for a slope (degrees up ahead, up to the left) and walks it there for 20 s; without a plan of its
/// own, the flat ground's.
fn on_slope(amble: Amble, planned_deg: [f64; 2], walked_deg: [f64; 2]) -> Walk {
    let robot = vision60();
    let mut request = GaitRequest::named("amble", &robot).unwrap();
    if amble == Amble::Steps {
        (request.step_duration_s, request.half_width_m) = (2.0 * request.step_duration_s, 0.25);
    }
    [request.slope_rad, request.sideways_slope_rad] = planned_deg.map(f64::to_radians);
    let plan = gait_design::plan(&robot, &request, &PlanOptions::default(), |_| ControlFlow::Continue(())).unwrap();
    let [uphill_rad, sideways_rad] = walked_deg.map(f64::to_radians);
    let terrain = Terrain::Slope { uphill_rad, sideways_rad };
    let simulator = SimulatorOptions { terrain, ..SimulatorOptions::default() };
    // As it comes out of the file.
    let gait = Gait::from_json(&plan.gait.to_json()).unwrap();
    walk(&robot, &gait, &WalkOptions { simulator, ..WalkOptions::default() }, &mut |_, _, _| {}).unwrap()
}

#[test]
fn ambles_planned_for_slopes_up_and_down_stay_up_on_them() {
    // Short steps lose more of their speed uphill.
    for (amble, uphill_deg, speed_m_s) in [
        (Amble::Strides, 10.0, 0.20),
        (Amble::Strides, -10.0, 0.36),
        (Amble::Steps, 10.0, 0.28),
        (Amble::Steps, -10.0, 0.37),
    ] {
        let walk = on_slope(amble, [uphill_deg, 0.0], [uphill_deg, 0.0]);
        assert_eq!(walk.end, End::Upright, "{uphill_deg} degrees: {walk:?}");
        assert!((walk.figures.speed_m_s - speed_m_s).abs() < 0.03, "{uphill_deg} degrees: {:?}", walk.figures);
    }
}

#[test]
fn an_amble_planned_for_a_sideways_slope_stays_up_on_it_and_the_flat_one_does_not() {
    let walk = on_slope(Amble::Steps, [0.0, 5.0], [0.0, 5.0]);
    assert_eq!(walk.end, End::Upright, "{walk:?}");
    assert!((walk.figures.speed_m_s - 0.35).abs() < 0.05, "{:?}", walk.figures);
    let flat = on_slope(Amble::Steps, [0.0, 0.0], [0.0, 5.0]);
    assert_ne!(flat.end, End::Upright, "{flat:?}");
}

/// In place and turning, and sideways and turning: (speed ahead, to the left, yaw rate).
#[test]
fn ambles_planned_to_turn_and_to_step_aside_do_so() {
    let robot = vision60();
    for (speed_m_s, lateral_speed_m_s, yaw_rate_rad_s) in [(0.0, 0.0, 0.4), (0.35, 0.1, -0.2)] {
        let own = GaitRequest::named("amble", &robot).unwrap();
        let steps = GaitRequest { step_duration_s: 0.22, clearance_m: 0.08, ..own };
        let request = GaitRequest { speed_m_s, lateral_speed_m_s, yaw_rate_rad_s, ..steps };
        let plan = gait_design::plan(&robot, &request, &PlanOptions::default(), |_| ControlFlow::Continue(())).unwrap();
        let gait = Gait::from_json(&plan.gait.to_json()).unwrap();
        let walk = walk(&robot, &gait, &WalkOptions::default(), &mut |_, _, _| {}).unwrap();
        assert_eq!(walk.end, End::Upright, "{request:?}: {walk:?}");
        let figures = &walk.figures;
        assert!((figures.speed_m_s - speed_m_s).abs() < 0.03, "{figures:?}");
        assert!((figures.lateral_speed_m_s - lateral_speed_m_s).abs() < 0.02, "{figures:?}");
        let turned_rad_s = figures.turned_deg.to_radians() / figures.time_s;
        assert!((turned_rad_s - yaw_rate_rad_s).abs() < 0.06, "{figures:?}");
    }
}

#[test]
fn it_stands_up_from_sitting_and_walks() {
    let mut modes = Vec::new();
    let options = WalkOptions { seconds: 6.0, start: Start::Posture(Posture::Sit), ..WalkOptions::default() };
    let walk = walk(&vision60(), &amble(), &options, &mut |_, _, cycle| {
        if modes.last() != Some(&cycle.output.mode) {
            modes.push(cycle.output.mode);
        }
    })
    .unwrap();
    assert_eq!(walk.end, End::Upright, "{modes:?}");
    assert_eq!(modes, [Mode::StandingUp, Mode::Starting, Mode::Walking]);
    assert!((walk.figures.speed_m_s - 0.35).abs() < 0.05, "{:?}", walk.figures);
}

#[test]
fn one_seed_one_walk_to_the_bit() {
    let options = |seed| WalkOptions {
        seconds: 2.0,
        simulator: SimulatorOptions { joint_noise_rad: 0.03, seed, ..SimulatorOptions::default() },
        ..WalkOptions::default()
    };
    assert_eq!(run(options(1)).unwrap(), run(options(1)).unwrap());
    assert_ne!(run(options(1)).unwrap().state, run(options(2)).unwrap().state);
}

#[test]
fn a_push_too_strong_ends_in_a_fall_that_is_reported() {
    let push = Push { start_s: 1.0, duration_s: 0.2, force_n: [0.0, 600.0, 0.0] };
    let walk = run(WalkOptions { pushes: vec![push], ..WalkOptions::default() }).unwrap();
    let (End::Fell { at_s, .. } | End::Fault { at_s, .. }) = walk.end else { panic!("{:?}", walk.end) };
    assert!((1.0..4.0).contains(&at_s), "{at_s}");
}

#[test]
fn options_that_cannot_be_are_named() {
    for (options, expected) in [
        (WalkOptions { seconds: f64::NAN, ..WalkOptions::default() }, "seconds is NaN"),
        (WalkOptions { period_s: 0.00077, ..WalkOptions::default() }, "control period is 0.00077"),
        (WalkOptions { command_delay_s: 0.0015, ..WalkOptions::default() }, "delay is 0.0015"),
    ] {
        let error = run(options).unwrap_err().to_string();
        assert!(error.contains(expected), "{error}");
    }
    let mut other = amble();
    other.robot = "solo12".into();
    let error = walk(&vision60(), &other, &WalkOptions::default(), &mut |_, _, _| {}).unwrap_err().to_string();
    assert!(error.contains("solo12"), "{error}");
}

#[test]
fn a_stride_is_pictured_from_samples() {
    let (robot, gait, options) = (vision60(), amble(), WalkOptions { seconds: 3.0, ..WalkOptions::default() });
    let mut samples = Vec::new();
    walk(&robot, &gait, &options, &mut |_, state, _| samples.push(pictures::sample(state))).unwrap();
    let mut studio = Studio::new(&robot, &options.simulator, &gait, &samples, 0.0).unwrap();
    match studio.tiles() {
        Ok(tiles) => {
            assert_eq!(tiles.len(), 8);
            assert!(tiles.windows(2).all(|pair| pair[0].time_s < pair[1].time_s && pair[0].image != pair[1].image));
            assert!((tiles[7].time_s - 2.0 * gait.step_duration_s).abs() < 1e-9);
        }
        Err(e) => assert!(e.to_string().contains("apt-get install libegl1 libgl1-mesa-dri"), "{e}"),
    }
    let short = Studio::new(&robot, &options.simulator, &gait, &samples[..800], 0.0).err().unwrap().to_string();
    assert!(short.contains("0.80 s"), "{short}");
}

/// The wiring file, frames and drives that are meant for the robot, moved by MuJoCo.
#[test]
fn it_walks_on_emulated_drives_over_both_protocols() {
    let robot = vision60();
    let file = include_str!("../../../config/hardware/vision60_can.toml");
    for protocol in ["mit", "registers"] {
        let text = file.replacen("protocol = \"mit\"", &format!("protocol = \"{protocol}\""), 1);
        let bus = BusConfig::from_toml_str(&text, "vision60", &robot.joint_names()).unwrap();
        for (start, drive_mode) in [
            (Start::Gait, DriveMode::Impedance),
            (Start::Posture(Posture::Sit), DriveMode::Impedance),
            (Start::Gait, DriveMode::Torque),
        ] {
            let drives = Some(Drives { bus: bus.clone(), model: DriveModel::default() });
            let walk = run(WalkOptions { seconds: 6.0, start, drive_mode, drives, ..WalkOptions::default() }).unwrap();
            assert_eq!(walk.end, End::Upright, "{protocol} {start:?} {drive_mode:?}");
            assert!(
                (walk.figures.speed_m_s - 0.36).abs() < 0.05,
                "{protocol} {start:?} {drive_mode:?} {:?}",
                walk.figures
            );
        }
    }
}

/// Joints and inertial unit behind their frames, commands 2 ms late: pushed to either side it walks on.
#[test]
fn on_emulated_drives_it_walks_in_balance_on_what_the_inertial_units_frames_say() {
    let robot = vision60();
    let file = include_str!("../../../config/hardware/vision60_can.toml");
    for protocol in ["mit", "registers"] {
        let text = file.replacen("protocol = \"mit\"", &format!("protocol = \"{protocol}\""), 1);
        let text = text + "[inertial]\ninterface = 0\nid = 0x1000000\n";
        let bus = BusConfig::from_toml_str(&text, "vision60", &robot.joint_names()).unwrap();
        let model = DriveModel { latency: Duration::from_millis(2), ..DriveModel::default() };
        let push = |start_s, y| Push { start_s, duration_s: 0.1, force_n: [0.0, y, 0.0] };
        let options = WalkOptions {
            seconds: 7.0,
            balance: true,
            drives: Some(Drives { bus, model }),
            pushes: vec![push(2.0, 300.0), push(4.5, -300.0)],
            velocities: vec![(0.0, Velocity { forward_m_s: 0.2, ..Velocity::default() })],
            ..WalkOptions::default()
        };
        let step = 160.0 / 32767.0;
        let walk = walk(&robot, &amble(), &options, &mut |_, _, cycle| {
            assert!(cycle.output.balance.is_some(), "{protocol}, {:?}: the paper's law", cycle.now);
            let force = cycle.input.inertial.unwrap().acceleration_m_s2.unwrap();
            // As whole steps of the frames' numbers, in the controller's resolution.
            assert!(force.iter().all(|a| (a / step - (a / step).round()).abs() * step < 5e-4), "{force:?}");
        })
        .unwrap();
        assert_eq!(walk.end, End::Upright, "{protocol}");
        assert!((walk.figures.speed_m_s - 0.2).abs() < 0.1, "{protocol}: {:?}", walk.figures);
    }
}

/// Out of standing the drives need hardly more than while walking. Asked for the whole amble at once they reached their
/// limit in its second step.
#[test]
fn no_gait_started_from_standing_comes_near_the_drives_limit() {
    let robot = vision60();
    let file = include_str!("../../../config/hardware/vision60_can.toml");
    let bus = BusConfig::from_toml_str(file, "vision60", &robot.joint_names()).unwrap();
    for name in ["gait1", "gait2", "gait3", "gait4", "amble"] {
        let request = GaitRequest::named(name, &robot).unwrap();
        let plan = gait_design::plan(&robot, &request, &PlanOptions::default(), |_| ControlFlow::Continue(())).unwrap();
        for drive_mode in [DriveMode::Impedance, DriveMode::Torque] {
            let options = WalkOptions {
                seconds: 6.0,
                start: Start::Posture(Posture::Stand),
                drive_mode,
                drives: Some(Drives { bus: bus.clone(), model: DriveModel::default() }),
                ..WalkOptions::default()
            };
            let mut largest = 0.0_f64;
            let walk = walk(&robot, &plan.gait, &options, &mut |_, state, _| {
                largest = state.joint_torque_nm.iter().fold(largest, |m, torque| m.max(torque.abs()));
            })
            .unwrap();
            println!("{name} {drive_mode:?} from standing: at most {largest:.1} N m");
            assert_eq!(walk.end, End::Upright, "{name} {drive_mode:?}");
            assert!(largest < 66.0, "{name} {drive_mode:?}: {largest} N m of 87.5");
        }
    }
}

/// What docs/measurements/simulation.md says of latency, at its two ends: the whole table takes minutes.
#[test]
fn latency_is_borne_where_the_drives_close_the_law_and_ends_in_a_fault_where_the_controller_does() {
    let robot = vision60();
    let file = include_str!("../../../config/hardware/vision60_can.toml");
    let bus = BusConfig::from_toml_str(file, "vision60", &robot.joint_names()).unwrap();
    let walked = |drive_mode, latency_ms| {
        let model = DriveModel { latency: std::time::Duration::from_millis(latency_ms), ..DriveModel::default() };
        let drives = Some(Drives { bus: bus.clone(), model });
        run(WalkOptions { seconds: 5.0, drive_mode, drives, ..WalkOptions::default() }).unwrap()
    };
    for (drive_mode, latency_ms) in [(DriveMode::Impedance, 4), (DriveMode::Torque, 1)] {
        let walk = walked(drive_mode, latency_ms);
        assert_eq!(walk.end, End::Upright, "{drive_mode:?} {latency_ms} ms");
        let knee = walk.figures.mean_abs_torque_nm.knee;
        assert!((16.0..19.0).contains(&knee), "{drive_mode:?} {latency_ms} ms: {knee} Nm at the knees");
    }
    let walk = walked(DriveMode::Torque, 6);
    let End::Fault { at_s, fault } = walk.end else { panic!("{:?}", walk.end) };
    assert!(at_s < 3.0 && fault.starts_with("tracking_error"), "{at_s}: {fault}");
}

#[test]
fn drives_whose_numbers_cannot_carry_the_commands_are_refused() {
    let file =
        include_str!("../../../config/hardware/vision60_can.toml").replacen("torque_nm = 90.0", "torque_nm = 40.0", 1);
    let bus = BusConfig::from_toml_str(&file, "vision60", &vision60().joint_names()).unwrap();
    let drives = Some(Drives { bus, model: DriveModel::default() });
    let error = run(WalkOptions { drives, ..WalkOptions::default() }).unwrap_err().to_string();
    assert!(error.contains("ranges.torque_nm"), "{error}");
}
