//! The simulator against closed forms, against the project's own dynamics, and against itself.

use control::JointCommand;
use gait::{Gait, StepSide};
use robot::Robot;
use simulator::measure::Measure;
use simulator::{
    Camera, Fall, GRAVITY_M_S2, Image, PictureError, Posture, Push, Renderer, Simulator, SimulatorOptions, Terrain,
};
use std::path::Path;

fn vision60() -> Robot {
    Robot::load(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/robots/vision60")).unwrap()
}

fn amble() -> Gait {
    Gait::from_json(include_str!("../../../tests/gaits/amble.json")).unwrap()
}

fn simulator(options: SimulatorOptions) -> Simulator {
    Simulator::new(&vision60(), options).unwrap()
}

fn hold(position_rad: [f64; 12]) -> JointCommand {
    JointCommand { position_rad, velocity_rad_s: [0.0; 12], kp: [300.0; 12], kd: [10.0; 12], torque_nm: [0.0; 12] }
}

/// Commands every millisecond, two physics steps each.
fn run(simulator: &mut Simulator, seconds: f64, mut command: impl FnMut(f64) -> JointCommand) {
    let end = simulator.time_s() + seconds;
    while simulator.time_s() < end - 1e-9 {
        let now = simulator.time_s();
        simulator.command(&command(now));
        simulator.step();
        simulator.step();
    }
}

/// The paper's bare law.
fn law(gait: &Gait, time_s: f64) -> JointCommand {
    let steps = time_s / gait.step_duration_s;
    let index = (steps + 1e-9).floor();
    let (position_rad, velocity_rad_s) = gait.reference(StepSide::of_step(index as u64), (steps - index).max(0.0));
    JointCommand { position_rad, velocity_rad_s, kp: gait.gains.kp, kd: gait.gains.kd, torque_nm: [0.0; 12] }
}

#[test]
fn the_model_weighs_what_the_robot_weighs() {
    let mass = simulator(SimulatorOptions::default()).total_mass_kg();
    assert!((mass - vision60().model.total_mass()).abs() < 1e-9, "{mass}");
}

/// In the air MuJoCo's accelerations are those of the project's own articulated-body algorithm.
#[test]
fn accelerations_in_flight_agree_with_our_own_dynamics() {
    let robot = vision60();
    let mut data = rigid_body::Data::new(&robot.model);
    let mut gait = amble();
    gait.initial.base_position_m = [0.0, 0.0, 5.0];
    gait.initial.base_quaternion_xyzw = [0.0, 0.0, 0.0, 1.0];
    gait.initial.base_angular_velocity_body = [0.3, -0.2, 0.5];
    gait.initial.joint_velocity_rad_s = std::array::from_fn(|j| 0.7 - 0.15 * j as f64);
    let mut sim = simulator(SimulatorOptions::default());
    sim.reset_to_gait(&gait).unwrap();
    let before = sim.state();
    let torque_nm = std::array::from_fn(|j| 20.0 - 3.0 * j as f64);
    sim.command(&JointCommand { torque_nm, kp: [0.0; 12], kd: [0.0; 12], ..hold([0.0; 12]) });
    sim.step();
    let after = sim.state();
    // Level and heading along x: the roll, pitch and yaw rates are the angular velocity.
    let mut q = [0.0; 18];
    let mut v = [0.0; 18];
    let mut tau = [0.0; 18];
    q[..3].copy_from_slice(&before.base_position_m);
    v[..3].copy_from_slice(&before.base_linear_velocity_world);
    v[3..6].copy_from_slice(&before.base_angular_velocity_body);
    q[6..].copy_from_slice(&before.joint_position_rad);
    v[6..].copy_from_slice(&before.joint_velocity_rad_s);
    tau[6..].copy_from_slice(&torque_nm);
    let ours = rigid_body::aba(&robot.model, &mut data, &q, &v, &tau, &[]);
    let dt = sim.options().timestep_s;
    for axis in 0..3 {
        let theirs = (after.base_linear_velocity_world[axis] - before.base_linear_velocity_world[axis]) / dt;
        assert!((theirs - ours[axis]).abs() < 1e-6, "base axis {axis}: {theirs} and {}", ours[axis]);
    }
    for j in 0..12 {
        let theirs = (after.joint_velocity_rad_s[j] - before.joint_velocity_rad_s[j]) / dt;
        assert!(
            (theirs - ours[6 + j]).abs() < 1e-6 * (1.0 + ours[6 + j].abs()),
            "joint {j}: {theirs} and {}",
            ours[6 + j]
        );
    }
}

#[test]
fn the_ground_carries_a_standing_robot() {
    let mut sim = simulator(SimulatorOptions::default());
    let stand = vision60().stand_rad();
    run(&mut sim, 1.0, |_| hold(stand));
    let mut vertical = 0.0;
    for _ in 0..2000 {
        sim.command(&hold(stand));
        sim.step();
        vertical += sim.state().toe_force_n.iter().map(|f| f[2]).sum::<f64>() / 2000.0;
    }
    let weight = sim.total_mass_kg() * GRAVITY_M_S2;
    assert!((vertical / weight - 1.0).abs() < 0.01, "{vertical} N for a weight of {weight} N");
    assert_eq!(sim.fallen(), None);
    assert!((sim.state().base_specific_force_body[2] - GRAVITY_M_S2).abs() < 0.5);
    let lowest = sim.toe_positions_m().iter().map(|p| p[2]).fold(f64::INFINITY, f64::min);
    assert!((lowest - vision60().toe_radius_m).abs() < 2e-3, "toe centre at {lowest} m");
}

#[test]
fn one_seed_one_walk_to_the_bit() {
    let walk = |seed| {
        let mut sim = simulator(SimulatorOptions { joint_noise_rad: 0.03, seed, ..SimulatorOptions::default() });
        let gait = amble();
        sim.reset_to_gait(&gait).unwrap();
        run(&mut sim, 3.0, |t| law(&gait, t));
        assert_eq!(sim.fallen(), None);
        sim.state()
    };
    assert_eq!(walk(5), walk(5));
    assert_ne!(walk(5), walk(6));
}

#[test]
fn a_reset_forgets_everything() {
    let mut sim = simulator(SimulatorOptions::default());
    let gait = amble();
    let walk = |sim: &mut Simulator| {
        sim.reset_to_gait(&gait).unwrap();
        run(sim, 1.0, |t| law(&gait, t));
        sim.state()
    };
    let first = walk(&mut sim);
    sim.push(Push { start_s: 1.0, duration_s: 1.0, force_n: [100.0, 100.0, 0.0] }).unwrap();
    run(&mut sim, 0.5, |t| law(&gait, t));
    assert_eq!(walk(&mut sim), first);
}

/// Speed and mean torques of the amble as an independent MuJoCo program measured them on the same gait file.
#[test]
fn the_amble_walks_as_it_does_elsewhere() {
    let gait = amble();
    let mut sim = simulator(SimulatorOptions::default());
    sim.reset_to_gait(&gait).unwrap();
    let mut measure = Measure::new(gait.step_duration_s, [87.5; 12]);
    for _ in 0..20_000 {
        let now = sim.time_s();
        sim.command(&law(&gait, now));
        sim.step();
        sim.step();
        measure.sample(&sim.state(), sim.height_m());
        assert_eq!(sim.fallen(), None, "at {now} s");
    }
    let figures = measure.figures();
    let torque: [f64; 3] = figures.mean_abs_torque_nm.into();
    for (ours, theirs) in torque.into_iter().zip([10.87, 5.84, 17.27]) {
        assert!((ours / theirs - 1.0).abs() < 0.05, "{torque:?}");
    }
    assert!((figures.speed_m_s - 0.3605).abs() < 0.01 && figures.lateral_speed_m_s.abs() < 0.02, "{figures:?}");
    assert!((figures.height_m - 0.5593).abs() < 0.002, "{figures:?}");
}

#[test]
fn a_command_that_is_not_finite_damps_until_a_good_one_comes() {
    let mut sim = simulator(SimulatorOptions::default());
    let stand = vision60().stand_rad();
    run(&mut sim, 0.1, |_| hold(stand));
    let mut bad = hold(stand);
    bad.kp[7] = f64::NAN;
    sim.command(&bad);
    sim.step();
    assert_eq!(sim.rejected_commands(), 1);
    let state = sim.state();
    let kd = vision60().gains.kd_nm_s_per_rad;
    // The torque is that of the velocity before the step, which one step of damping cannot turn round.
    for j in 0..12 {
        assert!(state.joint_torque_nm[j].abs() <= kd[j % 3] * 2.0, "{:?}", state.joint_torque_nm);
    }
    let mut negative = hold(stand);
    negative.kd[0] = -1.0;
    sim.command(&negative);
    assert_eq!(sim.rejected_commands(), 2);
    sim.command(&hold(stand));
    sim.step();
    assert!(sim.state().joint_torque_nm.iter().any(|t| t.abs() > 5.0));
}

#[test]
fn without_commands_the_joints_are_damped() {
    let mut sim = simulator(SimulatorOptions { command_timeout_s: 0.05, ..SimulatorOptions::default() });
    assert!(sim.command_is_stale());
    let stand = vision60().stand_rad();
    sim.command(&hold(stand));
    for _ in 0..99 {
        sim.step();
        assert!(!sim.command_is_stale());
    }
    sim.step();
    assert!(sim.command_is_stale());
    let before = sim.state();
    sim.step();
    let kd = vision60().gains.kd_nm_s_per_rad;
    for j in 0..12 {
        let damping = -kd[j % 3] * before.joint_velocity_rad_s[j];
        assert!((sim.state().joint_torque_nm[j] - damping).abs() < 1e-12);
    }
}

#[test]
fn torques_are_limited_to_what_the_drives_can_give() {
    let mut sim = simulator(SimulatorOptions::default());
    sim.command(&JointCommand { torque_nm: [1e6; 12], ..hold([0.0; 12]) });
    sim.step();
    assert_eq!(sim.state().joint_torque_nm, [87.5; 12]);
}

#[test]
fn a_push_gives_its_momentum() {
    let mut sim = simulator(SimulatorOptions::default());
    let mut gait = amble();
    gait.initial.base_position_m[2] = 20.0;
    gait.initial.base_linear_velocity_world = [0.0; 3];
    sim.reset_to_gait(&gait).unwrap();
    sim.push(Push { start_s: 0.05, duration_s: 0.1, force_n: [0.0, 100.0, 0.0] }).unwrap();
    let velocity = |sim: &Simulator| sim.state().base_linear_velocity_world[1];
    // Stiff joints, so that the whole robot moves as one.
    let stiff = hold(gait.initial.joint_position_rad);
    run(&mut sim, 0.05, |_| stiff);
    let before = velocity(&sim);
    run(&mut sim, 0.5, |_| stiff);
    let gained = velocity(&sim) - before;
    assert!((gained - 10.0 / 38.0).abs() < 0.03, "{gained} m/s");
    assert!(sim.push(Push { start_s: 0.0, duration_s: f64::NAN, force_n: [0.0; 3] }).is_err());
}

#[test]
fn on_a_slope_the_imu_sees_the_true_vertical() {
    let slope = Terrain::Slope { uphill_rad: 0.1, sideways_rad: 0.0 };
    let mut sim = simulator(SimulatorOptions { terrain: slope, ..SimulatorOptions::default() });
    let [x, y, z, w] = sim.imu_quaternion_xyzw();
    // Nose up, that is negative pitch.
    let pitch = (2.0 * (w * y - z * x)).asin();
    assert!((pitch + 0.1).abs() < 1e-9 && x.abs() < 1e-9, "{pitch}");
    let stand = vision60().stand_rad();
    run(&mut sim, 1.0, |_| hold(stand));
    let mut along = 0.0;
    for _ in 0..2000 {
        sim.command(&hold(stand));
        sim.step();
        along += sim.state().toe_force_n.iter().map(|f| f[0]).sum::<f64>() / 2000.0;
    }
    assert!((along / (38.0 * GRAVITY_M_S2 * 0.1f64.sin()) - 1.0).abs() < 0.05, "{along} N along the slope");
}

#[test]
fn the_robot_stands_on_every_terrain() {
    let stand = vision60().stand_rad();
    for terrain in [
        Terrain::Rough { height_m: 0.02, cell_m: 0.1 },
        Terrain::Steps { rise_m: 0.05, run_m: 0.4 },
        Terrain::Slope { uphill_rad: 0.05, sideways_rad: 0.05 },
    ] {
        let mut sim = simulator(SimulatorOptions { terrain, seed: 3, ..SimulatorOptions::default() });
        run(&mut sim, 1.5, |_| hold(stand));
        assert_eq!(sim.fallen(), None, "{terrain:?}");
        assert!(
            sim.state().toe_force_n.iter().filter(|f| f[2] > 5.0).count() >= 3,
            "{terrain:?} {:?}",
            sim.state().toe_force_n
        );
    }
}

#[test]
fn limp_legs_let_the_robot_down() {
    let mut sim = simulator(SimulatorOptions::default());
    sim.reset_to_posture(Posture::Stand);
    let limp = JointCommand { kp: [0.0; 12], kd: [0.0; 12], ..hold([0.0; 12]) };
    run(&mut sim, 1.5, |_| limp);
    assert!(matches!(sim.fallen(), Some(Fall::Low | Fall::Tilted)), "{:?}", sim.fallen());
}

/// A robot that sits is at rest, within its joints' limits, and stays so when it is limp.
#[test]
fn a_sitting_robot_rests_on_the_ground() {
    let robot = vision60();
    for joint_noise_rad in [0.0, 0.03] {
        let mut sim = simulator(SimulatorOptions { joint_noise_rad, seed: 2, ..SimulatorOptions::default() });
        sim.reset_to_posture(Posture::Sit);
        assert_eq!(sim.state().time_s, 0.0);
        let first = sim.state().base_position_m[2];
        // Its belly is 95 mm below the base's origin.
        assert!((0.09..0.15).contains(&first), "{first} m");
        for now in 0..1000 {
            sim.command(&JointCommand::LIMP);
            sim.step();
            let state = sim.state();
            for j in 0..12 {
                let (q, v) = (state.joint_position_rad[j], state.joint_velocity_rad_s[j]);
                let (low, high) = (robot.position_min_rad()[j] - 0.25, robot.position_max_rad()[j] + 0.25);
                assert!((low..=high).contains(&q) && v.abs() < 0.5, "step {now}, joint {j}: {q} rad, {v} rad/s");
            }
        }
        assert!((sim.state().base_position_m[2] - first).abs() < 0.01);
    }
}

#[test]
fn bad_options_are_named() {
    let robot = vision60();
    let default = SimulatorOptions::default;
    for (options, expected) in [
        (SimulatorOptions { friction: f64::NAN, ..default() }, "friction is NaN"),
        (SimulatorOptions { timestep_s: 0.1, ..default() }, "timestep_s is 0.1"),
        (
            SimulatorOptions { terrain: Terrain::Slope { uphill_rad: 1.5, sideways_rad: 0.0 }, ..default() },
            "slope_uphill_deg",
        ),
        (
            SimulatorOptions { terrain: Terrain::Rough { height_m: -1.0, cell_m: 0.1 }, ..default() },
            "bump_height_m is -1",
        ),
    ] {
        let error = Simulator::new(&robot, options).unwrap_err().to_string();
        assert!(error.contains(expected), "{error}");
    }
    let mut gait = amble();
    gait.robot = "solo12".into();
    let error = simulator(default()).reset_to_gait(&gait).unwrap_err().to_string();
    assert!(error.contains("solo12"), "{error}");
}

/// The robot is seen whole and in colour, or there is one line that says what to install.
#[test]
fn pictures_show_the_whole_robot() {
    let mut sim = simulator(SimulatorOptions { fine_pictures: true, ..SimulatorOptions::default() });
    let mut renderer = match Renderer::new(&sim, 480, 300) {
        Ok(renderer) => renderer,
        Err(e @ PictureError::NoDisplay(_)) => {
            assert!(e.to_string().contains("apt-get install libegl1 libgl1-mesa-dri"), "{e}");
            assert!(!e.to_string().contains('\n'), "{e}");
            return;
        }
        Err(e) => panic!("{e}"),
    };
    for camera in [Camera::Side, Camera::ThreeQuarter] {
        let image = renderer.draw(&mut sim, camera).unwrap();
        let pixel = |x: usize, y: usize| &image.rgb[3 * (y * image.width + x)..][..3];
        // The torso's paint and the toes' rubber are the only near-black things.
        let dark = |x, y| pixel(x, y).iter().all(|&c| c < 75);
        let orange = |x, y| pixel(x, y)[0] > 170 && pixel(x, y)[2] < 90;
        let count = |test: &dyn Fn(usize, usize) -> bool| {
            (0..image.height).flat_map(|y| (0..image.width).map(move |x| (x, y))).filter(|&(x, y)| test(x, y)).count()
        };
        assert!(
            count(&dark) > 2000 && count(&orange) > 200,
            "{camera:?}: {} dark, {} orange",
            count(&dark),
            count(&orange)
        );
        for x in 0..image.width {
            for y in [0, image.height - 1] {
                assert!(!dark(x, y) && !orange(x, y), "{camera:?}: the robot touches the edge at {x}, {y}");
            }
        }
        for y in 0..image.height {
            for x in [0, image.width - 1] {
                assert!(!dark(x, y) && !orange(x, y), "{camera:?}: the robot touches the edge at {x}, {y}");
            }
        }
    }
    assert!(matches!(Renderer::new(&sim, 0, 300), Err(PictureError::Size { .. })));
}

#[test]
fn images_join_and_encode() {
    let image = |width, value| Image { width, height: 2, rgb: vec![value; 3 * width * 2] };
    let joined = Image::side_by_side(&[image(2, 10), image(1, 20)], 1);
    assert_eq!((joined.width, joined.height), (4, 2));
    assert_eq!(joined.rgb[..12], [10, 10, 10, 10, 10, 10, 255, 255, 255, 20, 20, 20]);
    assert_eq!(&joined.to_png().unwrap()[..8], b"\x89PNG\r\n\x1a\n");
    let error = joined.write_png(Path::new("/nowhere/picture.png")).unwrap_err().to_string();
    assert!(error.contains("/nowhere/picture.png"), "{error}");
}
