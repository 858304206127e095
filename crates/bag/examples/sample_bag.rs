//! Writes a bag whose content `tests/bag/check_recording.py` knows: every known type as a topic, messages on four of
//! them.
//!
//! `cargo run --release -p bag --example sample_bag -- FOLDER [SECONDS [SPLIT_BYTES]]`

use bag::{Qos, Recorder, RecorderOptions, known_types};
use serde::Serialize;

// Field by field as in the .msg texts; a CDR structure is its fields one after the other.
#[derive(Serialize)]
struct Header {
    stamp: (i32, u32),
    frame_id: String,
}

#[derive(Serialize)]
struct JointState {
    header: Header,
    name: Vec<String>,
    position: Vec<f64>,
    velocity: Vec<f64>,
    effort: Vec<f64>,
}

#[derive(Serialize)]
struct JointCommand {
    header: Header,
    name: Vec<String>,
    position: Vec<f64>,
    velocity: Vec<f64>,
    kp: Vec<f64>,
    kd: Vec<f64>,
    torque: Vec<f64>,
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let folder = arguments.next().ok_or("usage: sample_bag FOLDER [SECONDS [SPLIT_BYTES]]")?;
    let seconds: f64 = arguments.next().map_or(Ok(2.0), |text| text.parse())?;
    let split_bytes = arguments.next().map(|text| text.parse()).transpose()?;
    let options = RecorderOptions { split_bytes, ..RecorderOptions::default() };
    let recorder = Recorder::start(folder, options)?;
    for (index, name) in known_types().iter().enumerate() {
        recorder.topic(&format!("/empty_{index}"), name, Qos::reliable(10))?;
    }
    let states = recorder.topic("/joint_states", "sensor_msgs/msg/JointState", Qos::sensor(1))?;
    let commands = recorder.topic("/joint_command", "tandem_msgs/msg/JointCommand", Qos::sensor(1))?;
    let clock = recorder.topic("/clock", "rosgraph_msgs/msg/Clock", Qos::sensor(1))?;
    let description = recorder.topic("/robot_description", "std_msgs/msg/String", Qos::latched())?;
    let names: Vec<String> = (0..12).map(|joint| format!("joint_{joint}")).collect();
    recorder.push_message(&description, 1_000_000_000, &"<robot name=\"größe\"/>".to_owned())?;
    for cycle in 0..(seconds * 1000.0) as u64 {
        let stamp_ns = 1_000_000_000 + cycle * 1_000_000;
        let stamp = ((stamp_ns / 1_000_000_000) as i32, (stamp_ns % 1_000_000_000) as u32);
        let header = |frame: &str| Header { stamp, frame_id: frame.to_owned() };
        let value = |joint: usize, scale: f64| scale * (cycle as f64 * 0.001 + joint as f64);
        let array = |scale: f64| (0..12).map(|joint| value(joint, scale)).collect::<Vec<f64>>();
        let state = JointState {
            header: header("base_link"),
            name: names.clone(),
            position: array(1.0),
            velocity: array(2.0),
            effort: array(3.0),
        };
        let command = JointCommand {
            header: header(""),
            name: names.clone(),
            position: array(4.0),
            velocity: array(5.0),
            kp: array(6.0),
            kd: array(7.0),
            torque: array(8.0),
        };
        let mut all_taken = recorder.push_message(&states, stamp_ns, &state)?;
        all_taken &= recorder.push_message(&commands, stamp_ns, &command)?;
        all_taken &= recorder.push_message(&clock, stamp_ns, &stamp)?;
        if !all_taken {
            // This writes as fast as it can, so it may outrun the disk; a robot does not.
            return Err("the queue was full; run this on a machine with a faster disk".into());
        }
        if cycle % 500 == 499 {
            std::thread::sleep(std::time::Duration::from_millis(20));
        }
    }
    let summary = recorder.finish()?;
    println!("{} messages written, {} dropped, {} bytes", summary.written(), summary.dropped(), summary.bytes);
    Ok(())
}
