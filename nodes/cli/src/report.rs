//! `tandem report`: recordings as a page, as pictures, or both.

use crate::bag::{export_csv, report_written};
use crate::output;
use crate::progress::Progress;
use crate::robots::RobotArguments;
use anyhow::{Result, bail};
use replay::{BehaviourRun, read_balance, read_run, skeleton};
use simulator::SimulatorOptions;
use simulator::pictures::Studio;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::{SystemTime, UNIX_EPOCH};

/// Make a page of one or more recordings, to look at and to compare
///
/// The page is one file that needs no network: phase portraits, torques beside the paper's Table II, everything over
/// time, footfalls, the control cycle's timing, events, and the robot with a scrubber. Several bags are laid over one
/// another.
///
///   tandem report out/run -o report.html
///   tandem report monday tuesday -o compare.html
///   tandem report out/run --png pictures --csv tables
#[derive(clap::Args)]
#[command(verbatim_doc_comment)]
pub struct Arguments {
    /// Bags: folders, or .mcap or .db3 files
    #[arg(required = true, value_name = "BAG")]
    bags: Vec<PathBuf>,
    /// The page, `-` for standard output [default: report.html, unless --png or --csv is given]
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Write pictures (PNG) into this folder; with several bags, into one folder for each in it
    #[arg(long, value_name = "FOLDER", value_parser = output::folder)]
    png: Option<PathBuf>,
    /// Write every topic as a CSV file into this folder; with several bags, into one folder for each in it
    #[arg(long, value_name = "FOLDER", value_parser = output::folder)]
    csv: Option<PathBuf>,
    /// Samples come from a robot: drawn in blue
    #[arg(long)]
    recorded: bool,
    /// Print one JSON object for each file that is written
    #[arg(long)]
    json: bool,
    /// Leave out the tiles that MuJoCo renders
    #[arg(long)]
    no_tiles: bool,
    #[command(flatten)]
    robot: RobotArguments,
}

/// Runs the subcommand.
pub fn run(arguments: &Arguments) -> Result<ExitCode> {
    output::reserve(arguments.output.as_deref());
    let progress = Progress::begin("drawing");
    let runs = arguments.bags.iter().map(read_run).collect::<Result<Vec<_>, _>>()?;
    let labels = labels(&arguments.bags);
    let mut tiles = Vec::new();
    for (run, label) in runs.iter().zip(&labels) {
        tiles.push(if arguments.no_tiles {
            Vec::new()
        } else {
            render_tiles(arguments, run).or_else(|problem| {
                note(arguments, &format!("{label}: no tiles: {problem:#}"))?;
                anyhow::Ok(Vec::new())
            })?
        });
    }
    if let Some(folder) = &arguments.png {
        for ((run, label), tiles) in runs.iter().zip(&labels).zip(&tiles) {
            let folder = if runs.len() == 1 { folder.clone() } else { folder.join(label) };
            pictures(arguments, run, tiles, &folder)?;
        }
    }
    if let Some(folder) = &arguments.csv {
        for (bag, label) in arguments.bags.iter().zip(&labels) {
            let folder = if runs.len() == 1 { folder.clone() } else { folder.join(label) };
            export_csv(bag, &folder, &[], &mut |written| report_written(&written, arguments.json))?;
        }
    }
    let page = match &arguments.output {
        Some(file) => file.clone(),
        None if arguments.png.is_some() || arguments.csv.is_some() => return Ok(ExitCode::SUCCESS),
        None => PathBuf::from("report.html"),
    };
    let mut page_runs = Vec::new();
    let balanced = balanced(arguments, &labels)?;
    for (((run, label), tiles), balanced) in runs.iter().zip(&labels).zip(&tiles).zip(&balanced) {
        let shape = skeleton(run);
        if let Err(problem) = &shape {
            note(arguments, &format!("{label}: no animation: {problem}"))?;
        }
        let caption = run.gait.as_ref().map_or(label.as_str(), |gait| gait.name.as_str());
        let tiles_png = if tiles.is_empty() { None } else { Some(::report::tile_strip(caption, tiles)?.to_png()?) };
        page_runs.push(::report::PageRun {
            label: label.clone(),
            begun_s: run.begun_s,
            gait: run.gait.as_ref(),
            samples: &run.samples,
            walking_from_s: run.walking_from_s,
            walking_to_s: run.walking_to_s,
            has_body: run.has_body,
            has_truth: run.has_truth,
            balanced,
            has_ground: run.has_ground,
            has_torque: run.has_torque,
            events: &run.events,
            tracking_error: &run.tracking_error,
            cycle_intervals_s: &run.cycle_intervals_s,
            missing_cycles: run.missing_cycles,
            skeleton: shape.ok(),
            tiles_png,
        });
    }
    let title = format!("Tandem: {}", labels.join(", "));
    let html = ::report::page(&title, made_now(), &page_runs)?;
    output::write_file(&page, html.as_bytes())?;
    drop(progress);
    written(arguments, &page, html.len())?;
    Ok(ExitCode::SUCCESS)
}

fn made_now() -> ::report::Made<'static> {
    // A machine whose clock stands before 1970 has no date to tell.
    let at_s = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs());
    ::report::Made { at_s, by: concat!("tandem ", env!("CARGO_PKG_VERSION")) }
}

fn written(arguments: &Arguments, page: &Path, bytes: usize) -> Result<()> {
    if arguments.json {
        output::json(&serde_json::json!({ "file": page, "bytes": bytes }))?;
    } else {
        say!("{}: {:.1} MB", output::shown(page), bytes as f64 * 1e-6)?;
    }
    Ok(())
}

/// What the balanced law saw and did, of each bag. A page of a bag that cannot be run again does without.
fn balanced(arguments: &Arguments, labels: &[String]) -> Result<Vec<Vec<::report::Balanced>>> {
    let of = |(bag, label): (&PathBuf, &String)| match read_balance(bag) {
        Ok(balanced) => Ok(balanced),
        Err(problem) => note(arguments, &format!("{label}: no estimate: {problem}")).map(|()| Vec::new()),
    };
    arguments.bags.iter().zip(labels).map(of).collect()
}

/// A remark: beside JSON objects on standard error.
fn note(arguments: &Arguments, words: &str) -> Result<()> {
    if arguments.json {
        note!("{words}")
    } else {
        say!("{words}")?
    }
    Ok(())
}

/// The bags' own names; as much of their paths as it takes to tell them apart.
fn labels(bags: &[PathBuf]) -> Vec<String> {
    for parts in 1..8 {
        let labels: Vec<String> = bags
            .iter()
            .map(|bag| {
                let bag = bag.canonicalize().unwrap_or_else(|_| bag.clone());
                let all: Vec<_> = bag.iter().map(|part| part.to_string_lossy().into_owned()).collect();
                all[all.len().saturating_sub(parts)..].join("/")
            })
            .collect();
        let mut sorted = labels.clone();
        sorted.sort();
        sorted.dedup();
        if sorted.len() == labels.len() {
            return labels;
        }
    }
    bags.iter().enumerate().map(|(number, bag)| format!("{} ({})", bag.display(), number + 1)).collect()
}

fn render_tiles(arguments: &Arguments, run: &BehaviourRun) -> Result<Vec<::report::Tile>> {
    let Some(gait) = &run.gait else { bail!("the bag holds no gait") };
    if !run.has_body {
        bail!("the bag does not say where the base was");
    }
    let robot = arguments.robot.load()?;
    let options = SimulatorOptions::default();
    Ok(Studio::new(&robot, &options, gait, &run.samples, run.walking_from_s)?.tiles()?)
}

fn pictures(arguments: &Arguments, run: &BehaviourRun, tiles: &[::report::Tile], folder: &Path) -> Result<()> {
    let Some(gait) = &run.gait else {
        bail!("{}: it holds no gait, which pictures are drawn against; make a page instead (-o)", run.path.display());
    };
    if !(run.has_body && run.has_torque && run.has_ground) {
        bail!(
            "{}: it lacks the base's motion, torques or ground forces, which pictures show; make a page instead (-o)",
            run.path.display()
        );
    }
    let origin = if arguments.recorded { ::report::Origin::Recorded } else { ::report::Origin::Simulated };
    // The pictures are of the walk; stopping and sitting down are in the bag.
    let walked = &run.samples[..run.samples.partition_point(|sample| sample.time_s <= run.walking_to_s)];
    let drawn = ::report::Run { gait, origin, samples: walked, walking_from_s: run.walking_from_s, tiles };
    for file in ::report::render_run(folder, &drawn)? {
        if arguments.json {
            output::json(&serde_json::json!({ "file": file }))?;
        } else {
            say!("{}", file.display())?;
        }
    }
    Ok(())
}
