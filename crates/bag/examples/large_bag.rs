//! Writes a bag of large messages, for `tests/ros2/test_large.py`: `/large` of std_msgs/String, "NUMBER " and then x to
//! the size.
//!
//! `cargo run --release -p bag --example large_bag -- FOLDER BYTES COUNT PERIOD_S`

use bag::{Qos, Recorder, RecorderOptions, WhenFull};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [folder, bytes, count, period_s] = arguments.as_slice() else {
        return Err("usage: large_bag FOLDER BYTES COUNT PERIOD_S".into());
    };
    let (bytes, count, period_s): (usize, u64, f64) = (bytes.parse()?, count.parse()?, period_s.parse()?);
    let recorder =
        Recorder::start(folder, RecorderOptions { when_full: WhenFull::Wait, ..RecorderOptions::default() })?;
    let topic = recorder.topic("/large", "std_msgs/msg/String", Qos::reliable(10))?;
    for number in 0..count {
        let stamp_ns = 1_000_000_000 + (number as f64 * period_s * 1e9) as u64;
        let mut text = format!("{number} ");
        text.extend(std::iter::repeat_n('x', bytes.saturating_sub(text.len())));
        if !recorder.push_message(&topic, stamp_ns, &text)? {
            return Err("the queue was full".into());
        }
    }
    println!("{} messages written", recorder.finish()?.written());
    Ok(())
}
