//! The balanced law in MuJoCo, with noisy sensors and commands that are 2 ms late. `launch-scripts/bench
//! robustness` makes the whole tables of docs/balance.md; these are some of their cases.

use control::Velocity;
use gait::Gait;
use gait_design::{GaitRequest, PlanOptions, plan};
use robot::Robot;
use std::ops::ControlFlow;
use std::path::Path;
use tandem_sim_bridge::simulator::{Push, SimulatorOptions, Terrain, Variation};
use tandem_sim_bridge::trial::{Outcome, Trial, run};

fn vision60() -> Robot {
    Robot::load(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/robots/vision60")).unwrap()
}

/// The default amble, but for what `change` asks for.
fn amble(change: impl FnOnce(&mut GaitRequest)) -> Gait {
    let robot = vision60();
    let mut request = GaitRequest::named("amble", &robot).unwrap();
    change(&mut request);
    plan(&robot, &request, &PlanOptions::default(), |_| ControlFlow::Continue(())).unwrap().gait
}

fn walked(trial: &Trial) -> Outcome {
    let gait = Gait::from_json(include_str!("../../../tests/gaits/amble.json")).unwrap();
    run(&vision60(), None, &gait, trial).unwrap()
}

fn ahead(forward_m_s: f64) -> Vec<(f64, Velocity)> {
    vec![(0.0, Velocity { forward_m_s, ..Velocity::default() })]
}

fn pushed(impulse_n_s: f64, y: f64, at_s: f64, trial: &Trial) -> Outcome {
    let push = Push { start_s: at_s, duration_s: 0.1, force_n: [0.0, y * impulse_n_s / 0.1, 0.0] };
    walked(&Trial { seconds: 5.5, pushes: vec![push], asked: ahead(0.35), ..trial.clone() })
}

const PUSHED_AT: [(f64, f64); 4] = [(1.0, 2.0), (-1.0, 2.1), (1.0, 2.2), (-1.0, 2.3)];

/// At the feet's worst moments, under the controller's watch.
#[test]
fn pushes_that_topple_the_bare_law_are_caught() {
    for impulse_n_s in [40.0, 60.0] {
        let trial = Trial::default();
        for (y, at_s) in PUSHED_AT {
            let outcome = pushed(impulse_n_s, y, at_s, &trial);
            assert!(outcome.survived(), "{impulse_n_s} {y} {at_s}: {:?}", outcome.ended);
            assert!(outcome.samples.iter().any(|s| s.pace > 1.2), "no step was hurried");
        }
    }
    let bare = Trial { balanced: false, watched: false, ..Trial::default() };
    assert!(PUSHED_AT.iter().any(|&(_, at_s)| !pushed(40.0, 1.0, at_s, &bare).survived()));
}

/// The place that it holds is where it came to rest, not where it still went on.
#[test]
fn a_robot_that_is_told_to_stand_still_does_not_walk_back() {
    let asked = vec![ahead(0.35)[0], (3.0, Velocity::default())];
    let outcome = walked(&Trial { seconds: 10.0, asked, ..Trial::default() });
    assert!(outcome.survived(), "{:?}", outcome.ended);
    let after = || outcome.samples.iter().filter(|sample| sample.time_s > 3.0);
    let slowest_m_s = after().map(|sample| sample.velocity[0]).fold(0.0, f64::min);
    let farthest_m = after().map(|sample| sample.position_m[0]).fold(0.0, f64::max);
    let back_m = farthest_m - outcome.samples.last().unwrap().position_m[0];
    println!("at least {slowest_m_s:.3} m/s, {back_m:.3} m back");
    assert!(slowest_m_s > -0.1 && back_m < 0.05, "{slowest_m_s} m/s, {back_m} m back");
}

/// The slope used to count twice, in the plan and by the law: told 0.35 m/s on 5° it ran uphill
/// at 1.1.
#[test]
fn a_gait_that_is_planned_for_a_slope_does_not_run_away_on_it() {
    const SLOPE_RAD: f64 = 0.087;
    let gait = amble(|request| request.slope_rad = SLOPE_RAD);
    let terrain = Terrain::Slope { uphill_rad: SLOPE_RAD, sideways_rad: 0.0 };
    let simulator = SimulatorOptions { terrain, ..Trial::default().simulator };
    for speed_m_s in [0.0, 0.35] {
        let trial = Trial { seconds: 8.0, asked: ahead(speed_m_s), simulator: simulator.clone(), ..Trial::default() };
        let outcome = run(&vision60(), None, &gait, &trial).unwrap();
        assert!(outcome.survived(), "{speed_m_s} m/s: {:?}", outcome.ended);
        let late: Vec<f64> = outcome.samples.iter().filter(|s| s.time_s > 4.0).map(|s| s.velocity[0]).collect();
        let mean_m_s = late.iter().sum::<f64>() / late.len() as f64;
        println!("asked for {speed_m_s} m/s: {mean_m_s:.3}");
        assert!((mean_m_s - speed_m_s).abs() < 0.15, "asked for {speed_m_s} m/s: {mean_m_s:.3}");
    }
}

/// Mean velocity ahead, in m/s, of the default amble from the sixth second of `trial` on.
fn ambled_m_s(trial: &Trial) -> f64 {
    let outcome = run(&vision60(), None, &amble(|_| ()), trial).unwrap();
    assert!(outcome.survived(), "{:?}", outcome.ended);
    let late: Vec<f64> = outcome.samples.iter().filter(|s| s.time_s > 6.0).map(|s| s.velocity[0]).collect();
    late.iter().sum::<f64>() / late.len() as f64
}

/// The default amble stands wide: shifted as a whole over a steep hill's side, its lower legs were at their stops, and
/// after half a second of that its balance counted as lost.
#[test]
fn a_wide_gait_walks_across_a_steep_hill() {
    for sideways_rad in [-0.262, 0.262] {
        let terrain = Terrain::Slope { uphill_rad: 0.0, sideways_rad };
        let simulator = SimulatorOptions { terrain, ..Trial::default().simulator };
        ambled_m_s(&Trial { seconds: 10.0, asked: ahead(0.3), simulator, ..Trial::default() });
    }
}

/// It slid down at 0.1 to 0.3 m/s on 10°, told to stand still or to walk up, and fell on 15°.
#[test]
fn uphill_it_goes_as_fast_as_it_is_told() {
    for (speed_m_s, incline_rad) in [(0.0, 0.175), (0.35, 0.175), (0.0, 0.262), (0.35, 0.262)] {
        let terrain = Terrain::Slope { uphill_rad: incline_rad, sideways_rad: 0.0 };
        let simulator = SimulatorOptions { terrain, ..Trial::default().simulator };
        let trial = Trial { seconds: 12.0, asked: ahead(speed_m_s), simulator, ..Trial::default() };
        let walked_m_s = ambled_m_s(&trial);
        println!("asked for {speed_m_s} m/s up {incline_rad} rad: {walked_m_s:.3}");
        assert!((walked_m_s - speed_m_s).abs() < 0.04, "asked for {speed_m_s} m/s: {walked_m_s:.3}");
    }
}

/// Planned to turn by 0.4 rad/s it held its heading, unless a command said the same: 22° in 20 s in place of 458.
#[test]
fn a_gait_that_is_planned_to_turn_turns_by_itself_and_goes_straight_where_it_is_told_to() {
    let gait = amble(|request| {
        (request.step_duration_s, request.clearance_m) = (0.22, 0.08);
        (request.lateral_speed_m_s, request.yaw_rate_rad_s) = (0.1, 0.4);
    });
    let told = |left_m_s: f64, yaw_rad_s: f64| Velocity { forward_m_s: 0.35, left_m_s, yaw_rad_s };
    for (asked, left_m_s, yaw_rad_s) in [
        (None, 0.1, 0.4),
        (Some(told(0.1, 0.4)), 0.1, 0.4),
        (Some(told(0.0, 0.0)), 0.0, 0.0),
        (Some(told(0.0, -0.2)), 0.0, -0.2),
    ] {
        let asked = asked.map(|velocity| (0.0, velocity)).into_iter().collect();
        let outcome = run(&vision60(), None, &gait, &Trial { seconds: 10.0, asked, ..Trial::default() }).unwrap();
        assert!(outcome.survived(), "{:?}", outcome.ended);
        let late: Vec<[f64; 3]> = outcome.samples.iter().filter(|s| s.time_s > 3.0).map(|s| s.velocity).collect();
        let mean = |axis: usize| late.iter().map(|velocity| velocity[axis]).sum::<f64>() / late.len() as f64;
        let got = [0, 1, 2].map(mean);
        println!("{left_m_s} m/s, {yaw_rad_s} rad/s: {got:.3?}, sway {:.2?} deg", outcome.sway_deg);
        for (axis, wanted, allowed) in [(0, 0.35, 0.03), (1, left_m_s, 0.02), (2, yaw_rad_s, 0.03)] {
            assert!((got[axis] - wanted).abs() < allowed, "{wanted} asked for: {got:?}");
        }
    }
}

/// As above across the walk, where the second step is none that mirrors the first. It goes uphill at 0.014 and 0.034
/// m/s; told that the ground rises to the other side, the same gait goes at 0.084 and 0.097: the sign matters.
#[test]
fn a_gait_that_is_planned_for_a_sideways_slope_is_not_carried_off_on_it() {
    const SLOPE_RAD: f64 = 0.087;
    let gait = amble(|request| request.sideways_slope_rad = SLOPE_RAD);
    let mut mistaken = gait.clone();
    mistaken.request["sideways_slope_rad"] = (-SLOPE_RAD).into();
    let terrain = Terrain::Slope { uphill_rad: 0.0, sideways_rad: SLOPE_RAD };
    let simulator = SimulatorOptions { terrain, ..Trial::default().simulator };
    let aside_m_s = |gait: &Gait, speed_m_s: f64| {
        let trial = Trial { seconds: 10.0, asked: ahead(speed_m_s), simulator: simulator.clone(), ..Trial::default() };
        let outcome = run(&vision60(), None, gait, &trial).unwrap();
        // It begins beside its place: the trial puts every robot on a slope as one that was not told of it.
        let late: Vec<f64> = outcome.samples.iter().filter(|s| s.time_s > 4.0).map(|s| s.velocity[1]).collect();
        let mean_m_s = late.iter().sum::<f64>() / late.len() as f64;
        println!("{speed_m_s} m/s: {mean_m_s:.3} m/s aside, {:?}", outcome.ended);
        if outcome.survived() { mean_m_s.abs() } else { f64::INFINITY }
    };
    let right = [0.0, 0.35].map(|speed_m_s| aside_m_s(&gait, speed_m_s));
    let wrong = [0.0, 0.35].map(|speed_m_s| aside_m_s(&mistaken, speed_m_s));
    assert!(right.iter().all(|aside_m_s| *aside_m_s < 0.05), "{right:?} m/s aside");
    assert!(wrong.iter().all(|aside_m_s| *aside_m_s > 0.07), "{wrong:?} m/s aside: this test would not see the sign");
}

/// What is thrown so hard that joints leave what the robot may do is damped by a fault with a name, and not walked on.
#[test]
fn what_cannot_be_caught_ends_in_a_named_fault() {
    let named = [
        "overspeed",
        "tracking_error",
        "joint_stuck",
        "tilt",
        "balance_lost",
        "position_out_of_range",
        "estimate_lost",
    ];
    for (y, at_s) in PUSHED_AT {
        let (_, why) = pushed(120.0, y, at_s, &Trial::default()).ended.expect("120 N s is more than it can catch");
        assert!(named.iter().any(|name| why.ends_with(name)), "{why}");
    }
}

#[test]
fn slopes_ramps_kerbs_and_bumps_that_nobody_announced_are_walked() {
    let slope = |degrees: f64| Terrain::Slope { uphill_rad: degrees.to_radians(), sideways_rad: 0.1 };
    for terrain in [
        slope(10.0),
        slope(-10.0),
        Terrain::Ramp { incline_rad: 0.2 },
        Terrain::Kerb { height_m: 0.05 },
        Terrain::Rough { height_m: 0.05, cell_m: 0.2 },
        Terrain::Hills { incline_rad: 0.1, bump_m: 0.03 },
    ] {
        let simulator = SimulatorOptions { terrain, ..Trial::default().simulator };
        let outcome = walked(&Trial { seconds: 10.0, asked: ahead(0.3), simulator, ..Trial::default() });
        assert!(outcome.survived(), "{terrain:?}: {:?}", outcome.ended);
    }
}

#[test]
fn undisturbed_it_sways_less_than_the_bare_law_and_keeps_its_heading_and_torques() {
    let balanced = walked(&Trial::default());
    let bare = walked(&Trial { balanced: false, ..Trial::default() });
    assert!(balanced.survived() && bare.survived());
    assert!(balanced.sway_deg.iter().all(|sway| *sway < 0.25), "{:?}", balanced.sway_deg);
    assert!(balanced.figures.turned_deg.abs() < 2.0, "{}", balanced.figures.turned_deg);
    let torques = |outcome: &Outcome| -> [f64; 3] { outcome.figures.mean_abs_torque_nm.into() };
    for (with, without) in torques(&balanced).into_iter().zip(torques(&bare)) {
        assert!((with / without - 1.0).abs() < 0.05, "{with} N m against {without}");
    }
}

/// The estimate beside the truth, and where the robot goes.
#[test]
fn it_goes_where_it_is_commanded_and_its_odometry_agrees() {
    let asked = vec![
        (0.0, Velocity { forward_m_s: 0.3, ..Velocity::default() }),
        (4.0, Velocity { left_m_s: 0.15, ..Velocity::default() }),
        (8.0, Velocity { yaw_rad_s: 0.4, ..Velocity::default() }),
        (12.0, Velocity::default()),
    ];
    let outcome = walked(&Trial { seconds: 14.0, asked: asked.clone(), ..Trial::default() });
    assert!(outcome.survived(), "{:?}", outcome.ended);
    for (n, (from_s, v)) in asked.iter().enumerate() {
        let to_s = asked.get(n + 1).map_or(14.0, |next| next.0);
        let within: Vec<_> = outcome.samples.iter().filter(|s| (from_s + 1.4..to_s).contains(&s.time_s)).collect();
        let mean = |of: &dyn Fn(usize) -> f64| (0..within.len()).map(of).sum::<f64>() / within.len() as f64;
        for (axis, wanted, allowed) in [(0, v.forward_m_s, 0.1), (1, v.left_m_s, 0.05), (2, v.yaw_rad_s, 0.1)] {
            let got = mean(&|i| within[i].velocity[axis]);
            assert!((got - wanted).abs() < allowed, "{v:?} axis {axis}: {got}");
        }
    }
    let samples = &outcome.samples;
    let squares: f64 =
        samples.iter().map(|s| (0..2).map(|i| (s.estimated[i] - s.velocity[i]).powi(2)).sum::<f64>()).sum();
    let rms = (squares / samples.len() as f64).sqrt();
    assert!(rms < 0.05, "velocity's error {rms} m/s");
    let (first, last) = (samples[0], samples[samples.len() - 1]);
    let drift = (0..2)
        .map(|i| ((last.odometry_m[i] - first.odometry_m[i]) - (last.position_m[i] - first.position_m[i])).powi(2))
        .sum::<f64>()
        .sqrt();
    assert!(drift < 0.1, "odometry {drift} m off");
}

#[test]
fn a_robot_that_is_not_as_described_is_carried_too() {
    let plain = Variation::default();
    for variation in [
        Variation { payload_kg: 8.0, payload_at_m: [0.1, 0.0, 0.1], ..plain },
        Variation { mass_scale: 1.2, ..plain },
        Variation { stiffness_scale: 0.8, ..plain },
        Variation { shank_scale: 1.03, ..plain },
        Variation { torso_shift_m: [0.0, 0.05, 0.0], ..plain },
    ] {
        let simulator = SimulatorOptions { variation, ..Trial::default().simulator };
        let outcome = walked(&Trial { seconds: 8.0, simulator, ..Trial::default() });
        assert!(outcome.survived(), "{variation:?}: {:?}", outcome.ended);
    }
}

#[test]
fn one_seed_one_trial_to_the_bit() {
    let end = |seed: u64| {
        let mut trial = Trial { seconds: 2.0, ..Trial::default() };
        trial.simulator.seed = seed;
        walked(&trial).samples.last().unwrap().position_m.map(f64::to_bits)
    };
    assert_eq!(end(1), end(1));
    assert_ne!(end(1), end(2));
}
