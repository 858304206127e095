//! What the control loop costs on this machine: `launch-scripts/bench control`.
//!
//! Prints `step_median_us` (one step of a walking controller), `codec_ns` (one command encoded, or one reply decoded,
//! on average), and `loop_p99_us` (lateness of the wakes of a 1 kHz loop that reads twelve emulated drives, steps and
//! writes), with the histogram they come from. An argument is the length of that loop in seconds, 60 by default.

#[path = "../tests/common/mod.rs"]
mod common;
#[path = "../../control/tests/common/mod.rs"]
mod walk;

use control::{Controller, Input, JOINTS, Mode};
use joint_bus::*;
use realtime::{Histogram, Periodic, RealtimeRequest, monotonic_now};
use std::hint::black_box;
use std::time::Duration;

fn main() {
    let seconds: u64 = match std::env::args().nth(1).map(|text| text.parse()) {
        None => 60,
        Some(Ok(seconds)) if seconds > 0 => seconds,
        _ => {
            eprintln!("bench_control: the argument is the loop's length in whole seconds, at least 1");
            std::process::exit(2);
        }
    };
    let step = step_times();
    println!("step_median_us = {:.3}", step.quantile(0.5).as_secs_f64() * 1e6);
    println!("step_p99_us = {:.3}", step.quantile(0.99).as_secs_f64() * 1e6);
    println!("# step mean us: {:.3}", step.mean().as_secs_f64() * 1e6);
    println!("codec_ns = {:.1}", codec_ns());
    for warning in (RealtimeRequest::default()).apply() {
        println!("# {warning}");
    }
    let (latency, compute, missed) = run_loop(seconds);
    println!("loop_p99_us = {:.1}", latency.quantile(0.99).as_secs_f64() * 1e6);
    println!("# 1 kHz for {seconds} s: {} cycles, {missed} missed", latency.count());
    for (name, h) in [("lateness", &latency), ("computing", &compute)] {
        let us = |d: Duration| d.as_secs_f64() * 1e6;
        println!(
            "# {name} us: mean {:.1}, median {:.1}, p90 {:.1}, p99 {:.1}, p99.9 {:.1}, max {:.1}",
            us(h.mean()),
            us(h.quantile(0.5)),
            us(h.quantile(0.9)),
            us(h.quantile(0.99)),
            us(h.quantile(0.999)),
            us(h.max())
        );
    }
}

fn step_times() -> Histogram {
    let mut bench = walk::Bench::walking(walk::config());
    let mut state = bench.state();
    let mut times = Histogram::default();
    for _ in 0..200_000 {
        bench.now += walk::PERIOD;
        state.stamp = bench.now;
        state.arrived = [bench.now; JOINTS];
        let before = monotonic_now();
        let output = black_box(bench.controller.step(&Input { joints: Some(&state), ..Input::default() }, bench.now));
        times.record(monotonic_now() - before);
        state.position_rad = output.command.position_rad;
        state.velocity_rad_s = output.command.velocity_rad_s;
        assert_eq!(output.mode, Mode::Walking);
    }
    times
}

fn codec_ns() -> f64 {
    const ROUNDS: u32 = 2_000_000;
    let (mit, ranges) = (Mit::default(), common::bus_config("mit", 1.0).joints[0].ranges);
    let command = DriveCommand {
        position_rad: 0.3,
        velocity_rad_s: -2.0,
        kp: 230.0,
        kd: 5.0,
        torque_nm: 12.0,
        ..DriveCommand::default()
    };
    let reply = mit.encode_reply(1, &ranges, &DriveReply { position_rad: 0.3, ..DriveReply::default() });
    let before = monotonic_now();
    for _ in 0..ROUNDS {
        black_box(mit.encode_request(1, black_box(&ranges), &DriveRequest::Command(black_box(command))).ok());
        black_box(mit.decode_reply(black_box(&ranges), black_box(&reply)));
    }
    (monotonic_now() - before).as_nanos() as f64 / f64::from(2 * ROUNDS)
}

fn run_loop(seconds: u64) -> (Histogram, Histogram, u64) {
    let config = walk::config();
    let mut controller = Controller::new(config.clone()).expect("the tests' configuration is valid");
    let mut bench = common::Bench::new(Mit::default(), common::bus_config("mit", 1.0), 0.0, 0.0);
    let mut readings = Readings::default();
    let (mut latency, mut compute) = (Histogram::default(), Histogram::default());
    let mut missed = 0;
    let mut periodic = Periodic::new(Duration::from_millis(1));
    for _ in 0..seconds * 1000 {
        let wake = periodic.wait();
        latency.record(wake.latency());
        missed += wake.missed;
        let now = monotonic_now();
        bench.bus().read(now, &mut readings);
        let state = readings.joint_state();
        let output = controller.step(&Input { joints: state.as_ref(), ..Input::default() }, now);
        bench.bus().write(&output.command, output.drives_on, now);
        compute.record(monotonic_now() - now);
        bench.act(now, &config.sit.position_rad, &[0.0; JOINTS], None);
    }
    (latency, compute, missed)
}
