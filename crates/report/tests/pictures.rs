//! The pictures, by what must be in them.

use std::f64::consts::TAU;

use gait::Gait;
use report::{Image, Origin, ReportError, Run, Sample, Tile, render_run, tile_strip};

/// A step in which a swing leg bends its knee by a quarter radian.
fn gait() -> Gait {
    let row = |leg: usize, joint: usize| -> [f64; 6] {
        let side = if leg < 2 { 1.0 } else { -1.0 };
        match joint {
            0 => [0.1 * side; 6],
            1 => [1.0; 6],
            _ if leg == 0 || leg == 3 => [2.0, 2.0, 2.4, 2.4, 2.0, 2.0],
            _ => [2.0; 6],
        }
    };
    let rows: Vec<[f64; 6]> = (0..12).map(|j| row(j / 3, j % 3)).collect();
    let names: Vec<String> = (0..12).map(|j| format!("joint_{j}")).collect();
    let text = serde_json::json!({
        "format": "tandem-gait", "version": 1, "robot": "vision60", "name": "gait1", "joint_names": names,
        "step_duration_s": 0.4, "step_length_m": 0.1, "bezier_degree": 5, "coefficients_rad": rows,
        "mirror": { "leg": [2, 3, 0, 1], "sign": [-1, 1, 1] },
        "initial": {
            "base_position_m": [0, 0, 0.6], "base_quaternion_xyzw": [0, 0, 0, 1], "base_linear_velocity_world": [0, 0, 0],
            "base_angular_velocity_body": [0, 0, 0], "joint_position_rad": rows.iter().map(|r| r[0]).collect::<Vec<_>>(),
            "joint_velocity_rad_s": vec![0; 12],
        },
        "reference_coefficients_rad": rows, "gains": { "kp": vec![200; 12], "kd": vec![5; 12] }, "torque_limit_nm": vec![50; 12],
        "request": {},
        "solver": { "status": "converged", "iterations": 1, "solve_time_s": 0.1, "max_violation": 0, "objective": 1 },
    });
    Gait::from_json(&text.to_string()).unwrap()
}

/// Walks at 0.25 m/s with hip torques of 3 and 5 N m and a knee torque that swings by 10 N m.
fn samples(seconds: f64) -> Vec<Sample> {
    (0..(seconds * 500.0) as usize)
        .map(|index| {
            let time_s = index as f64 * 0.002;
            let phase = TAU * time_s / 0.8;
            let joints = |hip_roll: f64, hip_pitch: f64, knee: f64| -> [f64; 12] {
                std::array::from_fn(|j| [hip_roll, hip_pitch, knee][j % 3])
            };
            Sample {
                time_s,
                base_position_m: [0.25 * time_s, 0.0, 0.6 + 0.005 * phase.sin()],
                base_roll_pitch_yaw_rad: [0.01 * phase.sin(), 0.01 * phase.cos(), 0.0],
                base_linear_velocity_m_s: [0.25, 0.0, 0.0],
                joint_position_rad: joints(0.1, 1.0, 2.1 + 0.1 * phase.sin()),
                joint_velocity_rad_s: joints(0.0, 0.0, 0.8 * phase.cos()),
                joint_torque_nm: joints(3.0, -5.0, if phase.sin() > 0.0 { 10.0 } else { -10.0 }),
                ground_force_n: std::array::from_fn(|leg| {
                    if (phase.sin() > 0.0) == matches!(leg, 1 | 2) { 190.0 } else { 0.0 }
                }),
            }
        })
        .collect()
}

fn run<'a>(gait: &'a Gait, samples: &'a [Sample]) -> Run<'a> {
    Run { gait, origin: Origin::Simulated, samples, walking_from_s: 1.0, tiles: &[] }
}

/// Pixels close to a colour.
fn pixels_like(image: &Image, colour: [u8; 3]) -> usize {
    let near = |pixel: &&[u8]| pixel.iter().zip(colour).all(|(a, b)| a.abs_diff(b) < 24);
    image.rgb().chunks_exact(3).filter(near).count()
}

const VERMILION: [u8; 3] = [0xd5, 0x5e, 0x00];
const GREEN: [u8; 3] = [0x00, 0x9e, 0x73];
const BLUE: [u8; 3] = [0x00, 0x72, 0xb2];

#[test]
fn phase_portraits_show_the_plan_and_the_run_in_its_own_colour() {
    let (gait, samples) = (gait(), samples(6.0));
    let simulated = report::phase_portraits(&run(&gait, &samples)).unwrap();
    assert!(pixels_like(&simulated, VERMILION) > 1000);
    assert!(pixels_like(&simulated, GREEN) > 100 && pixels_like(&simulated, BLUE) == 0);
    let recorded = report::phase_portraits(&Run { origin: Origin::Recorded, ..run(&gait, &samples) }).unwrap();
    assert!(pixels_like(&recorded, BLUE) > 100 && pixels_like(&recorded, GREEN) == 0);
}

#[test]
fn bars_are_as_high_as_the_torque_they_stand_for() {
    let (gait, mut samples) = (gait(), samples(6.0));
    let low = pixels_like(&report::torque_bars(&run(&gait, &samples)).unwrap(), GREEN);
    for sample in &mut samples {
        for torque in &mut sample.joint_torque_nm {
            *torque *= 1.5; // the paper's knee bar, 18.49 N m, stays the highest: the axis is the same
        }
    }
    let high = pixels_like(&report::torque_bars(&run(&gait, &samples)).unwrap(), GREEN);
    let ratio = high as f64 / low as f64;
    assert!((ratio - 1.5).abs() < 0.05, "{ratio}");
}

#[test]
fn footfalls_fill_half_of_each_row() {
    let (gait, samples) = (gait(), samples(6.0));
    let image = report::footfalls(&run(&gait, &samples)).unwrap();
    let (green, vermilion) = (pixels_like(&image, GREEN) as f64, pixels_like(&image, VERMILION) as f64);
    // The run's bars are 0.44 of a row high and the plan's 0.12; both stand half of the time.
    assert!((green / vermilion / (0.44 / 0.12) - 1.0).abs() < 0.15, "{green} {vermilion}");
}

#[test]
fn the_same_run_gives_the_same_bytes() {
    let (gait, samples) = (gait(), samples(6.0));
    let picture = || report::time_series(&run(&gait, &samples)).unwrap().to_png().unwrap();
    assert_eq!(picture(), picture());
}

#[test]
fn everything_of_a_run_goes_into_a_folder_as_readable_png() {
    let (gait, samples) = (gait(), samples(6.0));
    let tile = |time_s: f64| Tile { time_s, image: Image::new(64, 48, vec![90; 64 * 48 * 3]).unwrap() };
    let tiles: Vec<Tile> = (0..6).map(|index| tile(f64::from(index) * 0.08)).collect();
    let folder = tempfile::tempdir().unwrap();
    let files = render_run(&folder.path().join("new"), &Run { tiles: &tiles, ..run(&gait, &samples) }).unwrap();
    let names: Vec<String> =
        files.iter().map(|file| file.file_name().unwrap().to_string_lossy().into_owned()).collect();
    assert_eq!(names, ["phase_portraits.png", "torques.png", "time_series.png", "footfalls.png", "tiles.png"]);
    for file in files {
        let decoder = png::Decoder::new(std::io::BufReader::new(std::fs::File::open(&file).unwrap()));
        let mut reader = decoder.read_info().unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut pixels).unwrap();
        assert!(info.width >= 800 && info.height >= 400, "{}", file.display());
        let white = pixels.iter().filter(|value| **value == 255).count();
        assert!(white < pixels.len(), "{} is empty", file.display());
    }
}

#[test]
fn a_strip_holds_every_tile_in_its_place() {
    let tile = |grey: u8| Tile { time_s: 0.0, image: Image::new(60, 45, vec![grey; 60 * 45 * 3]).unwrap() };
    let strip = tile_strip("two", &[tile(40), tile(200)]).unwrap();
    let count = |grey: u8| pixels_like(&strip, [grey; 3]);
    assert!(count(40) > 360 * 270 * 9 / 10 && count(200) > 360 * 270 * 9 / 10);
    let middle = |x: u32| strip.rgb()[((180 * strip.width() + x) * 3) as usize];
    assert_eq!((middle(180), middle(540)), (40, 200));
}

#[test]
fn bad_input_is_one_clear_error() {
    let gait = gait();
    let message = |samples: &[Sample]| report::phase_portraits(&run(&gait, samples)).unwrap_err().to_string();
    assert!(message(&[]).contains("expected at least two strides"));
    assert!(message(&samples(1.5)).contains("expected at least two strides"));
    let mut broken = samples(6.0);
    broken[100].joint_torque_nm[3] = f64::NAN;
    assert!(message(&broken).contains("0.2 s: a value is not a finite number"), "{}", message(&broken));
    let mut backwards = samples(6.0);
    backwards[7].time_s = 0.001;
    assert!(message(&backwards).contains("time does not rise"));
    let sparse: Vec<Sample> = samples(6.0).into_iter().step_by(100).collect();
    assert!(message(&sparse).contains("expected at least"), "{}", message(&sparse));
    assert!(matches!(Image::new(2, 2, vec![0; 11]), Err(ReportError::BadImage(_))));
    assert!(matches!(Image::new(0, 2, vec![]), Err(ReportError::BadImage(_))));
    assert!(matches!(tile_strip("none", &[]), Err(ReportError::BadImage(_))));
}

#[test]
fn means_are_what_they_say() {
    let samples = samples(6.0);
    let [hip_roll, hip_pitch, knee] = report::mean_absolute_torque_nm(&samples);
    assert!((hip_roll - 3.0).abs() < 1e-12 && (hip_pitch - 5.0).abs() < 1e-12 && (knee - 10.0).abs() < 1e-12);
    assert!((report::mean_forward_speed_m_s(&samples) - 0.25).abs() < 1e-12);
    assert_eq!(report::mean_forward_speed_m_s(&samples[..1]), 0.0);
}
