//! `tandem bag`: look at recordings, repair them, play them, run them again.

#[cfg(feature = "network")]
mod controls;
mod export;
#[cfg(feature = "network")]
mod offers;
#[cfg(feature = "network")]
mod play;

use crate::output;
use crate::progress::Progress;
use ::bag::{Bag, Filter};
use anyhow::{Context, Result, bail};
pub use export::{Written, export_csv};
use serde_json::json;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;
use tandem_msgs::text::{SENTENCE_CHARS, printable};

/// Look at recordings (rosbag2), repair them, play them, run them again
///
///   tandem bag info out/run
///   tandem bag verify out/run            run the recorded controller again, compare every command to the bit
///   tandem bag play out/run --rate 0.5   publish it to any ROS 2 tool
///   tandem bag recover out/run           save what a crash left
///   tandem bag filter out/run --topic /joint_states --start 1 -o out/part
///   tandem bag export out/run -o csv     one CSV file for each topic
#[derive(clap::Args)]
#[command(verbatim_doc_comment)]
pub struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(clap::Subcommand)]
enum Command {
    Info(InfoArguments),
    Recover(RecoverArguments),
    Verify(VerifyArguments),
    #[cfg(feature = "network")]
    Play(play::Arguments),
    Filter(FilterArguments),
    Export(ExportArguments),
}

/// What is in a bag
#[derive(clap::Args)]
struct InfoArguments {
    /// A bag's folder, or one .mcap or .db3 file
    bag: PathBuf,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// Make a whole bag of what a crash or a broken disk left
///
/// Copies every message that is provably whole into a new bag, byte for byte. The source is only read.
#[derive(clap::Args)]
struct RecoverArguments {
    /// A bag's folder, or one .mcap file
    bag: PathBuf,
    /// Folder of the new bag [default: the source's name with _recovered]
    #[arg(short, long, value_name = "FOLDER", value_parser = output::folder)]
    output: Option<PathBuf>,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// Run the recorded controller again and compare every command to the bit
///
/// Feeds the recorded configuration, gaits, joint states and requests to the controller's step. Ends with an error code
/// and the first difference (time, joint, both values) if a command comes out differently.
#[derive(clap::Args)]
struct VerifyArguments {
    /// A bag recorded by `tandem simulate --bag` or by the controller
    bag: PathBuf,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// Copy a part of a bag into a new one, byte for byte
///
/// Messages of any type and serialisation are kept as they are, with what describes them. The source is only read.
#[derive(clap::Args)]
struct FilterArguments {
    /// A bag's folder, or one .mcap or .db3 file
    bag: PathBuf,
    /// Folder of the new bag; must be empty or not there
    #[arg(short, long, value_name = "FOLDER", value_parser = output::folder)]
    output: PathBuf,
    /// Only these topics
    #[arg(long = "topic", value_name = "NAME")]
    topics: Vec<String>,
    /// Nothing before this, s after the first message
    #[arg(long, value_name = "S", default_value_t = 0.0)]
    start: f64,
    /// Nothing after this, s after the first message
    #[arg(long, value_name = "S")]
    end: Option<f64>,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// Write the messages as CSV, one file for each topic
#[derive(clap::Args)]
struct ExportArguments {
    /// A bag's folder, or one .mcap or .db3 file
    bag: PathBuf,
    /// Folder for the files; must be empty or not there
    #[arg(short, long, value_name = "FOLDER", value_parser = output::folder)]
    output: PathBuf,
    /// Only these topics
    #[arg(long = "topic", value_name = "NAME")]
    topics: Vec<String>,
    /// Print one JSON object for each file
    #[arg(long)]
    json: bool,
}

/// Runs the subcommand.
pub fn run(arguments: &Arguments) -> Result<ExitCode> {
    match &arguments.command {
        Command::Info(a) => info(a),
        Command::Recover(a) => recover(a),
        Command::Verify(a) => verify(a),
        #[cfg(feature = "network")]
        Command::Play(a) => play::run(a),
        Command::Filter(a) => filter(a),
        Command::Export(a) => export(a),
    }
}

/// Opens a bag, and says what it should have and has not.
fn open(path: &Path) -> Result<Bag> {
    let bag = Bag::open(path)?;
    for note in bag.notes() {
        note!("{note}");
    }
    Ok(bag)
}

fn info(arguments: &InfoArguments) -> Result<ExitCode> {
    let bag = open(&arguments.bag)?;
    let span = Span(bag.span_ns());
    let cycles = replay::continuity(&bag)?;
    if arguments.json {
        let topics: Vec<serde_json::Value> = bag
            .topics()
            .iter()
            .map(|topic| {
                serde_json::json!({
                    "name": topic.name, "type": topic.type_name, "messages": topic.messages,
                    "decodable": topic.parsed_definition().is_ok(),
                })
            })
            .collect();
        let summary = serde_json::json!({
            "path": bag.path(), "storage": bag.storage(), "files": bag.files(), "bytes": bag.bytes(), "notes": bag.notes(),
            "start_ns": span.start_ns(), "end_ns": span.end_ns(), "duration_s": span.duration_s(), "messages": bag.message_count(), "topics": topics,
            "missing_cycles": cycles.map(|cycles| cycles.missing),
            "longest_hole_s": cycles.map(|cycles| cycles.longest.as_secs_f64()),
        });
        output::json(&summary)?;
        return Ok(ExitCode::SUCCESS);
    }
    say!(
        "{}: {}, {} file(s), {:.2} MB\n  {}{} messages",
        bag.path().display(),
        bag.storage(),
        bag.files(),
        bag.bytes() as f64 * 1e-6,
        span.text(),
        bag.message_count()
    )?;
    let duration_s = span.duration_s().unwrap_or_default();
    let width = bag.topics().iter().map(|topic| topic.name.len()).max().unwrap_or(0);
    for topic in bag.topics() {
        let rate = if duration_s > 0.0 { topic.messages as f64 / duration_s } else { 0.0 };
        let note = match topic.parsed_definition() {
            Ok(_) => String::new(),
            Err(error) => format!("  ({error})"),
        };
        // The file may be anybody's.
        let line =
            format!("{:width$}  {:>9} messages {rate:>8.1} Hz  {}{note}", topic.name, topic.messages, topic.type_name);
        say!("  {}", printable(&line, SENTENCE_CHARS))?;
    }
    if let Some(cycles) = cycles {
        say!(
            "  {} control cycles, {} missing between them; at most {:.3} s from one to the next (at {:.3} s of the controller's clock)",
            cycles.cycles,
            cycles.missing,
            cycles.longest.as_secs_f64(),
            cycles.longest_from.as_secs_f64()
        )?;
    }
    Ok(ExitCode::SUCCESS)
}

fn recover(arguments: &RecoverArguments) -> Result<ExitCode> {
    let target = match &arguments.output {
        Some(target) => target.clone(),
        None => {
            let source =
                arguments.bag.canonicalize().with_context(|| format!("cannot open {}", arguments.bag.display()))?;
            let stem = if source.is_dir() { source.file_name() } else { source.file_stem() };
            let name = format!("{}_recovered", stem.unwrap_or_default().to_string_lossy());
            source.with_file_name(name)
        }
    };
    let progress = Progress::begin("recovering");
    let recovery = ::bag::recover(&arguments.bag, &target)?;
    drop(progress);
    let span = Span(recovery.span_ns);
    if arguments.json {
        output::json(&json!({
            "folder": recovery.folder, "messages": recovery.messages, "start_ns": span.start_ns(), "end_ns": span.end_ns(),
            "duration_s": span.duration_s(), "damage": recovery.damage,
        }))?;
        return Ok(ExitCode::SUCCESS);
    }
    for line in &recovery.damage {
        say!("  {line}")?;
    }
    say!("{}: {}{} messages saved", recovery.folder.display(), span.text(), recovery.messages)?;
    if recovery.damage.is_empty() {
        say!("  the source was whole")?;
    }
    Ok(ExitCode::SUCCESS)
}

fn verify(arguments: &VerifyArguments) -> Result<ExitCode> {
    let begun = Instant::now();
    let progress = Progress::begin("running again");
    drop(open(&arguments.bag)?);
    let result = replay::verify(&arguments.bag)?;
    drop(progress);
    let took_s = begun.elapsed().as_secs_f64();
    let code = if result.first.is_none() { ExitCode::SUCCESS } else { ExitCode::FAILURE };
    if arguments.json {
        output::json(&json!({
            "bag": arguments.bag, "cycles": result.cycles, "duration_s": result.duration_s, "wall_s": took_s,
            "same": result.first.is_none(), "different_cycles": result.different,
            "first_difference": result.first.as_ref().map(|first| json!({
                "time_s": first.time_s, "cycle": first.cycle, "joint": first.joint, "what": first.what,
                "recorded": first.recorded, "computed": first.computed,
            })),
        }))?;
        return Ok(code);
    }
    say!(
        "{}: {} cycles over {:.3} s run again in {took_s:.2} s ({:.0} times real time)",
        arguments.bag.display(),
        result.cycles,
        result.duration_s,
        result.duration_s / took_s
    )?;
    match &result.first {
        None => say!("  every command the same, to the bit")?,
        Some(first) => say!(
            "  {} cycles differ; the first at {:.6} s, cycle {}: {} {}\n    recorded {}\n    computed {}",
            result.different,
            first.time_s,
            first.cycle,
            first.joint,
            first.what,
            first.recorded,
            first.computed
        )?,
    }
    Ok(code)
}

fn filter(arguments: &FilterArguments) -> Result<ExitCode> {
    let bag = open(&arguments.bag)?;
    check_topics(&bag, &arguments.topics)?;
    let first_ns = bag.span_ns().map_or(0, |(start, _)| start);
    let at = |name: &str, seconds: f64| {
        if !(0.0..=1e10).contains(&seconds) {
            bail!("{name} is {seconds}; expected 0 to 1e10 s");
        }
        Ok(first_ns.saturating_add((seconds * 1e9) as u64))
    };
    let from_ns = at("--start", arguments.start)?;
    let to_ns = arguments.end.map(|end| at("--end", end)).transpose()?;
    let progress = Progress::begin("copying");
    let wanted = Filter { topics: arguments.topics.clone(), from_ns, to_ns };
    let filtered = ::bag::filter(&bag, &arguments.output, &wanted)?;
    drop(progress);
    let span = Span(filtered.span_ns);
    if arguments.json {
        output::json(&json!({
            "folder": filtered.folder, "topics": filtered.topics, "messages": filtered.messages, "start_ns": span.start_ns(),
            "end_ns": span.end_ns(), "duration_s": span.duration_s(),
        }))?;
    } else {
        let (folder, messages) = (filtered.folder.display(), filtered.messages);
        say!("{folder}: {}{messages} messages on {} topics", span.text(), filtered.topics)?;
    }
    Ok(ExitCode::SUCCESS)
}

fn export(arguments: &ExportArguments) -> Result<ExitCode> {
    export_csv(&arguments.bag, &arguments.output, &arguments.topics, &mut |written| {
        report_written(&written, arguments.json)
    })?;
    Ok(ExitCode::SUCCESS)
}

/// Says what was exported.
pub fn report_written(written: &Written, as_json: bool) -> Result<()> {
    let Written { file, rows, columns } = written;
    if as_json {
        output::json(&json!({ "file": file, "rows": rows, "columns": columns }))?;
    } else {
        say!("{}: {rows} rows, {columns} columns", file.display())?;
    }
    Ok(())
}

/// Topics that were asked for are there.
fn check_topics(bag: &Bag, topics: &[String]) -> Result<()> {
    for wanted in topics {
        if bag.topic(wanted).is_none() {
            let known: Vec<&str> = bag.topics().iter().map(|topic| topic.name.as_str()).collect();
            bail!("there is no topic '{wanted}' in {}; it has {}", bag.path().display(), known.join(", "));
        }
    }
    Ok(())
}

/// From the first to the last message, where there is one.
#[derive(Clone, Copy)]
struct Span(Option<(u64, u64)>);

impl Span {
    fn start_ns(self) -> Option<u64> {
        self.0.map(|(start, _)| start)
    }

    fn end_ns(self) -> Option<u64> {
        self.0.map(|(_, end)| end)
    }

    fn duration_s(self) -> Option<f64> {
        self.0.map(|(start, end)| (end - start) as f64 * 1e-9)
    }

    fn text(self) -> String {
        let Some((start, _)) = self.0 else { return String::new() };
        let duration_s = self.duration_s().unwrap_or_default();
        format!("{duration_s:.3} s from {:.3} s, ", start as f64 * 1e-9)
    }
}
