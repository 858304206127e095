//! `tandem library`: many gaits solved ahead of time.

use crate::output;
use crate::progress::Progress;
use crate::robots::{self, RobotArguments};
use anyhow::{Context, Result, bail};
use gait_design::library::{Axis, Entry, Field, Grid, Library};
use gait_design::{GaitRequest, PlanOptions};
use indicatif::{ProgressBar, ProgressStyle};
use std::io::Write;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc;
use std::time::Instant;

/// Solve a grid of requests ahead of time, and take gaits from it
///
///   tandem library solve amble --axis clearance_m=0.06:0.15:10 --axis speed_m_s=0:0.5:100 -o vision60.gaits
///   tandem library solve amble --axis speed_m_s=-0.3:0.6:7 --axis yaw_rate_rad_s=-0.6:0.6:7 -o driving.gaits
///   tandem library show vision60.gaits
///   tandem library gait vision60.gaits --set speed_m_s=0.33 --set clearance_m=0.1 -o gait.json
#[derive(clap::Args)]
#[command(verbatim_doc_comment)]
pub struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(clap::Subcommand)]
enum Command {
    Solve(SolveArguments),
    Show(ShowArguments),
    Gait(GaitArguments),
}

/// Solve every combination of the axes' values, on all cores
///
/// The file is written while it is solved; the same command again takes up an interrupted one. The last axis is walked
/// along, each gait from those before it: give it the most values.
#[derive(clap::Args)]
struct SolveArguments {
    /// gait1, gait2, gait3, gait4 or amble: gives what no axis varies
    behaviour: String,
    /// An axis: first value, last value, how many. Fields: step_duration_s, clearance_m, speed_m_s, height_m,
    /// half_width_m, slope_rad, and for gaits that go aside or turn lateral_speed_m_s, yaw_rate_rad_s
    #[arg(long = "axis", value_name = "FIELD=FROM:TO:COUNT", required = true, value_parser = axis, allow_hyphen_values = true)]
    axes: Vec<Axis>,
    /// The library's file
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Solve on so many threads instead of one a core
    #[arg(long, value_name = "N")]
    threads: Option<usize>,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    robot: RobotArguments,
}

/// Say what is in a library
#[derive(clap::Args)]
struct ShowArguments {
    /// The library's file
    file: PathBuf,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    robot: RobotArguments,
}

/// Take a gait out of a library: a grid point's own, or interpolated between its neighbours, saying how far it breaks
/// the constraints
#[derive(clap::Args)]
struct GaitArguments {
    /// The library's file
    file: PathBuf,
    /// A field of the request; what is not given is as at the grid's first point
    #[arg(long = "set", value_name = "FIELD=VALUE", value_parser = assignment, allow_hyphen_values = true)]
    values: Vec<(Field, f64)>,
    /// Solve from the interpolated gait, so that it breaks no constraint
    #[arg(long)]
    solve: bool,
    /// Where to write the gait file, `-` for standard output
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    robot: RobotArguments,
}

fn field(name: &str) -> Result<Field, String> {
    let found = Field::ALL.iter().find(|(known, _)| *known == name);
    found.map(|(_, field)| *field).ok_or_else(|| {
        let known: Vec<&str> = Field::ALL.iter().map(|(known, _)| *known).collect();
        format!("\"{name}\" is not a field of a library, expected one of {}", known.join(", "))
    })
}

fn number(text: &str) -> Result<f64, String> {
    let value: f64 = text.parse().map_err(|_| format!("\"{text}\" is not a number"))?;
    if value.is_finite() { Ok(value) } else { Err(format!("{value} is not a finite number")) }
}

fn assignment(text: &str) -> Result<(Field, f64), String> {
    let (name, value) = text.split_once('=').ok_or("expected FIELD=VALUE")?;
    Ok((field(name)?, number(value)?))
}

fn axis(text: &str) -> Result<Axis, String> {
    let (name, range) = text.split_once('=').ok_or("expected FIELD=FROM:TO:COUNT")?;
    let field = field(name)?;
    let [from, to, count] = range.split(':').collect::<Vec<_>>()[..] else {
        return Err(format!("\"{range}\": expected FROM:TO:COUNT"));
    };
    let (from, to) = (number(from)?, number(to)?);
    let count: usize = count.parse().map_err(|_| format!("\"{count}\" is not a count"))?;
    if count == 0 || count > gait_design::library::MOST_POINTS {
        return Err(format!("{count} values, expected 1 to {}", gait_design::library::MOST_POINTS));
    }
    let values = (0..count)
        .map(|k| if k + 1 == count && k > 0 { to } else { from + (to - from) * k as f64 / (count.max(2) - 1) as f64 });
    Ok(Axis { field, values: values.collect() })
}

/// Runs the subcommand.
pub fn run(arguments: &Arguments) -> Result<ExitCode> {
    match &arguments.command {
        Command::Solve(a) => solve(a),
        Command::Show(a) => show(a),
        Command::Gait(a) => gait(a),
    }?;
    Ok(ExitCode::SUCCESS)
}

fn read(file: &Path) -> Result<String> {
    let file = &robots::file(file);
    std::fs::read_to_string(file).with_context(|| format!("cannot read {}", file.display()))
}

fn solve(arguments: &SolveArguments) -> Result<()> {
    let robot = arguments.robot.load()?;
    let file = &arguments.output;
    let named = || file.display().to_string();
    let base = GaitRequest::named(&arguments.behaviour, &robot)?;
    let grid = Grid::new(&robot, base, arguments.axes.clone())?;
    let mut library = Library::new(&robot, grid);
    let mut out;
    if file.exists() {
        let text = read(file)?;
        let (old, used) = Library::resume(&text, &robot)
            .with_context(|| format!("{}: remove it to begin anew, or give another file", named()))?;
        if old.grid() != library.grid() {
            bail!("{} has another grid: remove it to begin anew, or give another file", named());
        }
        out = std::fs::OpenOptions::new().append(true).open(file).with_context(named)?;
        out.set_len(used as u64).with_context(named)?;
        library = old;
    } else {
        out = std::fs::File::create(file).with_context(|| format!("cannot make {}", named()))?;
        out.write_all(library.header_line().as_bytes()).with_context(named)?;
    }
    let (all, before) = (library.grid().points(), library.missing());
    if before < all {
        note!("{} of {all} gaits are in {} already", all - before, named());
    }
    let threads = match arguments.threads {
        Some(0) => bail!("--threads is 0, expected at least 1"),
        Some(threads) => threads,
        None => std::thread::available_parallelism().map_or(1, usize::from),
    };
    let bar = ProgressBar::new(all as u64).with_position((all - before) as u64);
    let style = ProgressStyle::with_template("{bar:40} {pos} of {len} gaits, {per_sec}, {eta} left{msg}");
    bar.set_style(style.expect("the template is a constant"));
    let start = Instant::now();
    let (next_row, stop) = (AtomicUsize::new(0), AtomicBool::new(false));
    let (sender, solved) = mpsc::channel::<(usize, Entry)>();
    let (mut refused, mut new) = (0, Vec::new());
    std::thread::scope(|scope| -> Result<()> {
        for _ in 0..threads {
            let (sender, library, robot, next_row, stop) = (sender.clone(), &library, &robot, &next_row, &stop);
            scope.spawn(move || {
                loop {
                    let row = next_row.fetch_add(1, Ordering::Relaxed);
                    if row >= library.grid().rows() || stop.load(Ordering::Relaxed) {
                        break;
                    }
                    library.solve_row(robot, row, |index, entry| {
                        if sender.send((index, entry)).is_ok() && !stop.load(Ordering::Relaxed) {
                            ControlFlow::Continue(())
                        } else {
                            ControlFlow::Break(())
                        }
                    });
                }
            });
        }
        drop(sender);
        for (index, entry) in solved {
            let written = out.write_all(Library::entry_line(index, &entry).as_bytes());
            if let Err(e) = written {
                stop.store(true, Ordering::Relaxed);
                return Err(e).with_context(|| format!("cannot write {}", named()));
            }
            if matches!(entry, Entry::Refused(_)) {
                refused += 1;
                bar.set_message(format!(", {refused} refused"));
            }
            bar.inc(1);
            new.push((index, entry));
        }
        Ok(())
    })?;
    bar.finish_and_clear();
    for (index, entry) in new {
        library.insert(index, entry);
    }
    drop(out);
    // In the grid's order, so that the file does not depend on which thread was faster.
    output::write_file(file, library.to_text().as_bytes())?;
    note!("solved {} gaits in {:.2} s on {threads} threads", before, start.elapsed().as_secs_f64());
    describe(&library, file, arguments.json)
}

fn describe(library: &Library, file: &Path, as_json: bool) -> Result<()> {
    let (mut gaits, mut mirrored, mut iterations, mut refused) = (0, 0, 0, Vec::new());
    for (index, entry) in library.entries().iter().enumerate() {
        match entry {
            Some(Entry::Gait { iterations: i, .. }) => {
                gaits += 1;
                iterations += u64::from(*i);
            }
            Some(Entry::Mirror { of }) => match &library.entries()[*of] {
                Some(Entry::Gait { .. }) => mirrored += 1,
                Some(Entry::Refused(why)) => refused.push((index, why)),
                Some(Entry::Mirror { .. }) | None => {}
            },
            Some(Entry::Refused(why)) => refused.push((index, why)),
            None => {}
        }
    }
    if as_json {
        let axes = library.grid().axes().iter().map(|axis| {
            serde_json::json!({
                "field": axis.field.name(), "values": axis.values.len(), "from": axis.values.first(), "to": axis.values.last(),
            })
        });
        let refused = refused.iter().map(|(index, why)| {
            let r = library.grid().request(*index);
            serde_json::json!({
                "clearance_m": r.clearance_m, "speed_m_s": r.speed_m_s, "step_duration_s": r.step_duration_s,
                "lateral_speed_m_s": r.lateral_speed_m_s, "yaw_rate_rad_s": r.yaw_rate_rad_s, "why": why,
            })
        });
        let each = (gaits > 0).then(|| iterations as f64 / f64::from(gaits));
        output::json(&serde_json::json!({
            "file": file, "gaits": gaits + mirrored, "mirror_images": mirrored, "missing": library.missing(), "iterations_each": each,
            "axes": axes.collect::<Vec<_>>(), "refused": refused.collect::<Vec<_>>(),
        }))?;
        return Ok(());
    }
    let each = iterations as f64 / f64::from(gaits.max(1));
    let images = if mirrored > 0 { format!(" and {mirrored} mirror images") } else { String::new() };
    say!("{}: {gaits} gaits, {each:.1} iterations each{images}", file.display())?;
    for axis in library.grid().axes() {
        let (first, last) = (axis.values[0], axis.values[axis.values.len() - 1]);
        say!("  {:16} {} values from {first} to {last}", axis.field.name(), axis.values.len())?;
    }
    const SHOWN: usize = 5;
    for (index, why) in refused.iter().take(SHOWN) {
        say!("  refused: {}: {why}", library.grid().describe(*index))?;
    }
    if refused.len() > SHOWN {
        say!("  and {} more refused", refused.len() - SHOWN)?;
    }
    Ok(())
}

fn show(arguments: &ShowArguments) -> Result<()> {
    let robot = arguments.robot.load()?;
    let library =
        Library::from_text(&read(&arguments.file)?, &robot).with_context(|| arguments.file.display().to_string())?;
    describe(&library, &arguments.file, arguments.json)
}

fn gait(arguments: &GaitArguments) -> Result<()> {
    output::reserve(arguments.output.as_deref());
    let robot = arguments.robot.load()?;
    let library =
        Library::from_text(&read(&arguments.file)?, &robot).with_context(|| arguments.file.display().to_string())?;
    let mut request = library.grid().request(0);
    for &(field, value) in &arguments.values {
        field.set(&mut request, value);
    }
    let found = library.find(&robot, &request)?;
    let (status, neighbours) = (found.gait.solver.status.clone(), found.neighbours.len());
    if !arguments.json {
        say!(
            "{status} from {neighbours} of the library's gaits: the most broken constraint is {} (by {:.1e})",
            found.violation.name,
            found.violation.amount
        )?;
    }
    let mut gait = found.gait;
    if arguments.solve {
        let progress = Progress::begin("solving");
        let start = Instant::now();
        let options = PlanOptions { warm_start: Some(found.warm_start), ..PlanOptions::default() };
        gait = gait_design::plan(&robot, &request, &options, |_| ControlFlow::Continue(()))?.gait;
        gait.solver.solve_time_s = start.elapsed().as_secs_f64();
        drop(progress);
        if !arguments.json {
            let time_ms = 1e3 * gait.solver.solve_time_s;
            say!("solved from there in {} iterations, {time_ms:.1} ms", gait.solver.iterations)?;
        }
    }
    if let Some(file) = &arguments.output {
        output::write_file(file, gait.to_json().as_bytes())?;
    }
    if arguments.json {
        output::json(&serde_json::json!({
            "gait": gait.name, "status": status, "neighbours": neighbours, "violation": found.violation.amount,
            "violated": found.violation.name, "iterations": arguments.solve.then_some(gait.solver.iterations),
            "solve_time_s": arguments.solve.then_some(gait.solver.solve_time_s), "file": arguments.output,
        }))?;
    } else if let Some(file) = &arguments.output {
        say!("{}", output::shown(file))?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_axis_has_its_ends_exactly_and_mistakes_are_named() {
        let a = axis("speed_m_s=-0.3:0.5:9").unwrap();
        assert_eq!((a.field, a.values.len(), a.values[0], a.values[8]), (Field::SpeedMS, 9, -0.3, 0.5));
        assert_eq!(axis("height_m=0.55:0.55:1").unwrap().values, [0.55]);
        for (text, expected) in [
            ("speed=0:1:2", "\"speed\" is not a field"),
            ("speed_m_s", "FIELD=FROM:TO:COUNT"),
            ("speed_m_s=0:1", "FROM:TO:COUNT"),
            ("speed_m_s=0:fast:3", "\"fast\" is not a number"),
            ("speed_m_s=0:inf:3", "not a finite number"),
            ("speed_m_s=0:1:0", "0 values"),
        ] {
            let e = axis(text).unwrap_err();
            assert!(e.contains(expected), "expected {expected:?} in {e:?}");
        }
    }
}
