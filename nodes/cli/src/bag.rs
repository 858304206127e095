//! `tandem bag`: look at recordings, repair them, play them, run them again.

mod play;

use ::bag::{Bag, Value, decode};
use anyhow::{Context, Result, bail};
use std::collections::BTreeMap;
use std::io::{BufWriter, Write};
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
    Play(play::Arguments),
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
/// Copies every message that is provably whole into a new bag. The source is only read.
#[derive(clap::Args)]
struct RecoverArguments {
    /// A bag's folder, or one .mcap file
    bag: PathBuf,
    /// Folder of the new bag [default: the source's name with _recovered]
    #[arg(short, long, value_name = "FOLDER")]
    output: Option<PathBuf>,
}

/// Run the recorded controller again and compare every command to the bit
///
/// Feeds the recorded configuration, gaits, joint states and requests to the controller's step. Ends with an error code and
/// the first difference (time, joint, both values) if a command comes out differently.
#[derive(clap::Args)]
struct VerifyArguments {
    /// A bag recorded by `tandem simulate --bag` or by the controller
    bag: PathBuf,
}

/// Write the messages as CSV, one file for each topic
#[derive(clap::Args)]
struct ExportArguments {
    /// A bag's folder, or one .mcap or .db3 file
    bag: PathBuf,
    /// Folder for the files; must be empty or not there
    #[arg(short, long, value_name = "FOLDER")]
    output: PathBuf,
    /// Only these topics
    #[arg(long = "topic", value_name = "NAME")]
    topics: Vec<String>,
}

/// Runs the subcommand.
pub fn run(arguments: &Arguments) -> Result<ExitCode> {
    match &arguments.command {
        Command::Info(a) => info(a),
        Command::Recover(a) => recover(a),
        Command::Verify(a) => verify(a),
        Command::Play(a) => play::run(a),
        Command::Export(a) => export(a),
    }
}

/// Opens a bag, and says what it should have and has not.
fn open(path: &Path) -> Result<Bag> {
    let bag = Bag::open(path)?;
    for note in bag.notes() {
        eprintln!("{note}");
    }
    Ok(bag)
}

fn info(arguments: &InfoArguments) -> Result<ExitCode> {
    let bag = open(&arguments.bag)?;
    let (start_ns, end_ns) = bag.span_ns().unwrap_or((0, 0));
    let duration_s = (end_ns - start_ns) as f64 * 1e-9;
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
            "path": bag.path(), "storage": bag.storage(), "files": bag.files(), "bytes": bag.bytes(), "start_ns": start_ns,
            "end_ns": end_ns, "duration_s": duration_s, "messages": bag.message_count(), "topics": topics,
            "missing_cycles": cycles.map(|cycles| cycles.missing),
            "longest_hole_s": cycles.map(|cycles| cycles.longest.as_secs_f64()),
        });
        println!("{summary}");
        return Ok(ExitCode::SUCCESS);
    }
    println!(
        "{}: {}, {} file(s), {:.2} MB\n  {duration_s:.3} s from {:.3} s, {} messages",
        bag.path().display(),
        bag.storage(),
        bag.files(),
        bag.bytes() as f64 * 1e-6,
        start_ns as f64 * 1e-9,
        bag.message_count()
    );
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
        println!("  {}", printable(&line, SENTENCE_CHARS));
    }
    if let Some(cycles) = cycles {
        println!(
            "  {} control cycles, {} missing between them; at most {:.3} s from one to the next (at {:.3} s of the controller's clock)",
            cycles.cycles,
            cycles.missing,
            cycles.longest.as_secs_f64(),
            cycles.longest_from.as_secs_f64()
        );
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
    let recovery = ::bag::recover(&arguments.bag, &target)?;
    for line in &recovery.damage {
        println!("  {line}");
    }
    let (start_ns, end_ns) = recovery.span_ns.unwrap_or((0, 0));
    println!(
        "{}: {} messages over {:.3} s saved",
        recovery.folder.display(),
        recovery.messages,
        (end_ns - start_ns) as f64 * 1e-9
    );
    if recovery.damage.is_empty() {
        println!("  the source was whole");
    }
    Ok(ExitCode::SUCCESS)
}

fn verify(arguments: &VerifyArguments) -> Result<ExitCode> {
    let begun = Instant::now();
    drop(open(&arguments.bag)?);
    let result = replay::verify(&arguments.bag)?;
    let took_s = begun.elapsed().as_secs_f64();
    println!(
        "{}: {} cycles over {:.3} s run again in {took_s:.2} s ({:.0} times real time)",
        arguments.bag.display(),
        result.cycles,
        result.duration_s,
        result.duration_s / took_s
    );
    match &result.first {
        None => {
            println!("  every command the same, to the bit");
            Ok(ExitCode::SUCCESS)
        }
        Some(first) => {
            println!(
                "  {} cycles differ; the first at {:.6} s, cycle {}: {} {}\n    recorded {}\n    computed {}",
                result.different, first.time_s, first.cycle, first.joint, first.what, first.recorded, first.computed
            );
            Ok(ExitCode::FAILURE)
        }
    }
}

/// A topic's file while it is written.
struct Table {
    file: BufWriter<std::fs::File>,
    path: PathBuf,
    columns: Columns,
    rows: u64,
}

fn export(arguments: &ExportArguments) -> Result<ExitCode> {
    export_csv(&arguments.bag, &arguments.output, &arguments.topics)?;
    Ok(ExitCode::SUCCESS)
}

/// Writes a bag's topics as CSV, one file for each, into a folder that is empty or not there. `topics`: only these; none: all.
pub fn export_csv(bag: &Path, folder: &Path, topics: &[String]) -> Result<()> {
    let bag = open(bag)?;
    for wanted in topics {
        if bag.topic(wanted).is_none() {
            let known: Vec<&str> = bag.topics().iter().map(|topic| topic.name.as_str()).collect();
            bail!("there is no topic '{wanted}' in {}; it has {}", bag.path().display(), known.join(", "));
        }
    }
    std::fs::create_dir_all(folder).with_context(|| format!("cannot make the folder {}", folder.display()))?;
    if std::fs::read_dir(folder)?.next().is_some() {
        bail!("{} is not empty; nothing was written; choose another folder", folder.display());
    }
    let mut definitions = Vec::new();
    for topic in bag.topics() {
        let wanted = topics.is_empty() || topics.contains(&topic.name);
        definitions.push(match topic.parsed_definition() {
            _ if !wanted => None,
            Ok(definition) => Some(definition),
            // Asked for by name it is an error, else a topic that cannot be written.
            Err(error) if !topics.is_empty() => return Err(error.into()),
            Err(error) => {
                println!("  left out: {error}");
                None
            }
        });
    }
    // Once for the columns, because a list may be longer in a later message, and once for the rows.
    let mut columns: BTreeMap<usize, Columns> = BTreeMap::new();
    for message in bag.messages()? {
        let message = message?;
        let Some(definition) = &definitions[message.topic] else { continue };
        let value =
            decode(definition, &message.data).with_context(|| format!("topic {}", bag.topics()[message.topic].name))?;
        columns.entry(message.topic).or_default().take(&value);
    }
    let mut tables: BTreeMap<usize, Table> = BTreeMap::new();
    for (topic, columns) in columns {
        tables.insert(topic, Table::begin(folder, &bag.topics()[topic].name, columns)?);
    }
    for message in bag.messages()? {
        let message = message?;
        let (Some(definition), Some(table)) = (&definitions[message.topic], tables.get_mut(&message.topic)) else {
            continue;
        };
        table.row(message.stamp_ns, &decode(definition, &message.data)?)?;
    }
    for table in tables.values_mut() {
        table.file.flush().with_context(|| format!("cannot write {}", table.path.display()))?;
        println!("{}: {} rows, {} columns", table.path.display(), table.rows, table.columns.0.len() + 1);
    }
    Ok(())
}

/// Names of the columns, in the order of the message's fields.
#[derive(Default)]
struct Columns(Vec<String>);

impl Columns {
    /// Adds what the message has and no one before it had: each after the value that stands before it in the message.
    fn take(&mut self, value: &Value) {
        let mut place = 0;
        value.for_each_leaf(&mut |name, _| {
            // Most messages have the columns that are known, in their order.
            place = match self.0[place..].iter().position(|known| known == name) {
                Some(ahead) => place + ahead + 1,
                None => {
                    self.0.insert(place, name.to_owned());
                    place + 1
                }
            };
        });
    }
}

impl Table {
    fn begin(folder: &Path, topic: &str, columns: Columns) -> Result<Table> {
        let path = folder.join(format!("{}.csv", topic.trim_matches('/').replace('/', "__")));
        let file = std::fs::File::create_new(&path).with_context(|| format!("cannot write {}", path.display()))?;
        let mut table = Table { file: BufWriter::new(file), path, columns, rows: 0 };
        let head: Vec<String> = table.columns.0.iter().map(|name| quoted(name)).collect();
        table.line(&format!("stamp_ns,{}", head.join(",")))?;
        Ok(table)
    }

    /// Columns that this message has no value for stay empty.
    fn row(&mut self, stamp_ns: u64, value: &Value) -> Result<()> {
        let mut line = stamp_ns.to_string();
        let mut place = 0;
        value.for_each_leaf(&mut |name, leaf| {
            while self.columns.0[place] != name {
                line.push(',');
                place += 1;
            }
            line.push(',');
            line.push_str(&cell(leaf));
            place += 1;
        });
        line.extend(std::iter::repeat_n(',', self.columns.0.len() - place));
        self.rows += 1;
        self.line(&line)
    }

    fn line(&mut self, text: &str) -> Result<()> {
        writeln!(self.file, "{text}").with_context(|| format!("cannot write {}", self.path.display()))
    }
}

fn cell(value: &Value) -> String {
    match value {
        Value::Bool(value) => u8::from(*value).to_string(),
        Value::Integer(value) => value.to_string(),
        Value::Unsigned(value) => value.to_string(),
        // The shortest text that reads back as the same number.
        Value::Number(value) => format!("{value:?}"),
        Value::Text(text) => quoted(text),
        Value::List(_) | Value::Fields(_) => String::new(),
    }
}

fn quoted(text: &str) -> String {
    if text.contains([',', '"', '\n', '\r']) { format!("\"{}\"", text.replace('"', "\"\"")) } else { text.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_of_lists_that_grow_keep_the_order_of_the_fields() {
        let list = |values: &[i64]| Value::List(values.iter().map(|value| Value::Integer(*value)).collect());
        let message = |a: &[i64], b: &[i64]| Value::Fields(vec![("a".into(), list(a)), ("b".into(), list(b))]);
        let messages = [message(&[], &[1]), message(&[2, 3], &[4]), message(&[5], &[6, 7]), message(&[], &[])];
        let mut columns = Columns::default();
        messages.iter().for_each(|message| columns.take(message));
        assert_eq!(columns.0, ["a[0]", "a[1]", "b[0]", "b[1]"]);
        let folder = tempfile::tempdir().unwrap();
        let mut table = Table::begin(folder.path(), "/some/topic", columns).unwrap();
        for (stamp, message) in messages.iter().enumerate() {
            table.row(stamp as u64, message).unwrap();
        }
        table.file.flush().unwrap();
        let text = std::fs::read_to_string(folder.path().join("some__topic.csv")).unwrap();
        assert_eq!(text, "stamp_ns,a[0],a[1],b[0],b[1]\n0,,,1,\n1,2,3,4,\n2,5,,6,7\n3,,,,\n");
    }
}
