//! Renders the pictures of a run from two JSON files: a gait file, and a list of samples.
//!
//! `cargo run --release -p report --example render_run -- GAIT.json SAMPLES.json WALKING_FROM_S FOLDER`

use std::fs::read_to_string;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [gait, samples, walking_from_s, folder] = arguments.as_slice() else {
        return Err("usage: render_run GAIT.json SAMPLES.json WALKING_FROM_S FOLDER".into());
    };
    let gait = gait::Gait::from_json(&read_to_string(gait)?)?;
    let samples: Vec<report::Sample> = serde_json::from_str(&read_to_string(samples)?)?;
    let run = report::Run {
        gait: &gait,
        origin: report::Origin::Simulated,
        samples: &samples,
        walking_from_s: walking_from_s.parse()?,
        tiles: &[],
    };
    for file in report::render_run(folder.as_ref(), &run)? {
        println!("{}", file.display());
    }
    Ok(())
}
