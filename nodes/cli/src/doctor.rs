//! `tandem doctor`: checks a machine and a robot before the first arm.

mod drives;
mod interface;
mod machine;

use crate::output;
use crate::progress::Progress;
use crate::robots::{self, RobotArguments};
use anyhow::{Context, Result};
use joint_bus::can::CanLink;
use joint_bus::{BusConfig, CanLock, CanLockError, DriveBus};
use realtime::{Periodic, RealtimeRequest, monotonic_now};
use simulator::drives::DriveProtocol;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;
use tandem_msgs::text::{SENTENCE_CHARS, printable};

/// Check this machine and the robot on its buses, before anything is armed
///
/// Wiring file, interfaces, bit rates, every drive and its encoder, temperatures, real-time rights, the loop's
/// punctuality, clocks, versions. Each failure comes with what to do. Drives are only asked where they are: they stay
/// at rest, nothing is armed and nothing moves. First it listens: where another program already sends to the drives,
/// it says nothing to them. Ends with an error code if anything failed; warnings are no failure.
///
///   tandem doctor --bus config/hardware/vision60_can.toml
#[derive(clap::Args)]
#[command(verbatim_doc_comment)]
pub struct Arguments {
    /// Wiring file: which joint hangs on which drive
    #[arg(long, value_name = "FILE", default_value = "config/hardware/vision60_can.toml")]
    bus: PathBuf,
    /// Expected bit rate, bit/s
    #[arg(long, value_name = "BIT/S", default_value_t = 1_000_000)]
    bit_rate: u32,
    /// Expected bit rate of CAN FD's data phase, bit/s, where the drives speak CAN FD
    #[arg(long, value_name = "BIT/S", default_value_t = 5_000_000)]
    data_bit_rate: u32,
    /// How long the drives are listened to at 1 kHz, s
    #[arg(long, value_name = "S", default_value_t = 1.0)]
    seconds: f64,
    /// SCHED_FIFO priority that the controller will ask for
    #[arg(long, default_value_t = 80, value_parser = clap::value_parser!(u8).range(1..=99))]
    priority: u8,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    robot: RobotArguments,
}

/// How bad it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Verdict {
    Good,
    Warning,
    Failure,
}

/// One thing that was looked at.
#[derive(Clone, Debug, PartialEq)]
struct Finding {
    verdict: Verdict,
    what: String,
    /// What to do; empty where nothing is to be done.
    cure: String,
}

fn good(what: impl Into<String>) -> Finding {
    Finding { verdict: Verdict::Good, what: what.into(), cure: String::new() }
}

fn warning(what: impl Into<String>, cure: impl Into<String>) -> Finding {
    Finding { verdict: Verdict::Warning, what: what.into(), cure: cure.into() }
}

fn failure(what: impl Into<String>, cure: impl Into<String>) -> Finding {
    Finding { verdict: Verdict::Failure, what: what.into(), cure: cure.into() }
}

impl Finding {
    fn json(&self) -> serde_json::Value {
        let verdict = match self.verdict {
            Verdict::Good => "good",
            Verdict::Warning => "warning",
            Verdict::Failure => "failure",
        };
        let cure = (!self.cure.is_empty()).then_some(&self.cure);
        serde_json::json!({ "verdict": verdict, "what": self.what, "cure": cure })
    }

    fn print(&self) -> Result<()> {
        let word = match self.verdict {
            Verdict::Good => "good",
            Verdict::Warning => "WARNING",
            Verdict::Failure => "FAILURE",
        };
        // Names of other nodes, topics and types are in it.
        say!("{word:8} {}", printable(&self.what, SENTENCE_CHARS))?;
        if !self.cure.is_empty() {
            say!("         -> {}", printable(&self.cure, SENTENCE_CHARS))?;
        }
        Ok(())
    }
}

/// Runs the subcommand.
pub fn run(arguments: &Arguments) -> Result<ExitCode> {
    anyhow::ensure!(
        (0.1..=600.0).contains(&arguments.seconds),
        "--seconds is {}, expected 0.1 to 600",
        arguments.seconds
    );
    let progress = Progress::begin("listening to the drives");
    let findings = examine(arguments)?;
    drop(progress);
    let count = |verdict| findings.iter().filter(|finding| finding.verdict == verdict).count();
    let (failures, warnings) = (count(Verdict::Failure), count(Verdict::Warning));
    let code = if failures == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE };
    if arguments.json {
        let listed: Vec<_> = findings.iter().map(Finding::json).collect();
        output::json(&serde_json::json!({ "findings": listed, "failures": failures, "warnings": warnings }))?;
        return Ok(code);
    }
    for finding in &findings {
        finding.print()?;
    }
    say!("{failures} failures, {warnings} warnings in {} findings", findings.len())?;
    if failures > 0 {
        say!("do not arm this robot")?;
    }
    Ok(code)
}

fn examine(arguments: &Arguments) -> Result<Vec<Finding>> {
    let robot = arguments.robot.load()?;
    let config = control::Config::for_robot(&robot);
    let file = &robots::file(&arguments.bus);
    let text = std::fs::read_to_string(file).with_context(|| format!("cannot read {}", file.display()))?;
    let bus = BusConfig::from_toml_str(&text, &robot.name, &config.joint_names)
        .with_context(|| file.display().to_string())?;
    let mut findings = machine::versions(&robot, &bus);
    findings.push(match bus.check_ranges(&config.command_range()) {
        Ok(()) => good(format!("{}: twelve drives, whose numbers carry what the controller sends", file.display())),
        Err(error) => failure(error.to_string(), "set the drives' ranges, and the same numbers in the wiring file"),
    });
    findings.extend(machine::clocks(&machine::ClockFacts::gather()));

    let mut all_up = true;
    for name in &bus.interfaces {
        let expected = interface::Expected {
            protocol: bus.protocol,
            bit_rate: arguments.bit_rate,
            data_bit_rate: arguments.data_bit_rate,
        };
        let found = interface::findings(name, &interface::ask(name), &expected);
        all_up &= found.iter().all(|finding| finding.verdict != Verdict::Failure);
        findings.extend(found);
    }

    let Looked { refused, pace, seen } = look(arguments, &bus)?;
    findings.extend(machine::rights(&refused, arguments.priority));
    findings.push(pace.finding());
    let asked = matches!(seen, Ok(Some(_)));
    findings.extend(match seen {
        Ok(Some(seen)) => drives::findings(&seen, &bus, &config),
        Ok(None) => bus
            .joints
            .iter()
            .map(|joint| {
                let interface = &bus.interfaces[joint.interface];
                failure(
                    format!("{} (drive {} on {interface}): not asked", joint.name, joint.id),
                    "bring all interfaces up first",
                )
            })
            .collect(),
        Err(error) => vec![failure(
            format!("{error}: the drives were not asked"),
            "the robot must be disarmed, sitting or hung up, and nothing else must send to its drives; then look again",
        )],
    });
    if !all_up && asked {
        findings.push(warning(
            "what the drives say was received on interfaces that are not as they should be",
            "mend the interfaces first, then look again",
        ));
    }
    Ok(findings)
}

/// What was seen of the machine and of the drives.
struct Looked {
    refused: Vec<realtime::Warning>,
    pace: machine::LoopTiming,
    /// None where an interface cannot be opened, which its own findings explain; an error where a controller is its
    /// master.
    seen: Result<Option<drives::Seen>, CanLockError>,
}

/// Asks the drives where they are, on a thread with the rights of a controller's. As their master for that time: a
/// controller that is one keeps them to itself, and none becomes it meanwhile.
fn look(arguments: &Arguments, bus: &BusConfig) -> Result<Looked> {
    let request = RealtimeRequest { priority: Some(arguments.priority), ..RealtimeRequest::default() };
    let cycles = (arguments.seconds * 1e3).ceil() as u32;
    let locks = bus.interfaces.iter().map(|name| CanLock::take(name)).collect::<Result<Vec<_>, _>>();
    let links = locks.map(|locks| {
        let links = bus.interfaces.iter().map(|name| CanLink::open(name)).collect::<Result<Vec<_>, _>>();
        links.ok().map(|links| (links, locks))
    });
    let looked = std::thread::scope(|scope| {
        scope
            .spawn(|| {
                let refused = request.apply();
                let mut periodic = Periodic::new(Duration::from_millis(1));
                let mut pace = machine::LoopTiming::default();
                let mut wait = || {
                    pace.record(&periodic.wait());
                    monotonic_now()
                };
                let seen = links.map(|ours| {
                    let (links, _locks) = ours?;
                    let wiring = BusConfig { ask_before_arming: true, ..bus.clone() };
                    Some(drives::ask(&mut DriveBus::new(wiring, DriveProtocol::of(bus), links), cycles, &mut wait))
                });
                // The loop's pace is measured all the same.
                if !matches!(seen, Ok(Some(_))) {
                    for _ in 0..cycles {
                        wait();
                    }
                }
                Looked { refused, pace, seen }
            })
            .join()
    });
    looked.map_err(|_| anyhow::anyhow!("the thread that asks the drives panicked"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[derive(clap::Parser)]
    struct Line {
        #[command(flatten)]
        arguments: Arguments,
    }

    #[test]
    fn without_interfaces_every_drive_is_missed_and_the_machine_is_reported() {
        let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../../config");
        let text = std::fs::read_to_string(format!("{folder}/hardware/vision60_can.toml")).unwrap();
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), text.replace("\"can", "\"nocan")).unwrap();
        let line = ["doctor", "--seconds", "0.1", "--bus", file.path().to_str().unwrap()];
        let findings = examine(&Line::parse_from(line).arguments).unwrap();
        let failed = |text: &str| {
            findings.iter().any(|finding| finding.verdict == Verdict::Failure && finding.what.contains(text))
        };
        for n in 0..4 {
            assert!(failed(&format!("nocan{n} is not there")), "{findings:?}");
        }
        assert!(failed("front_left_hip_roll (drive 1 on nocan0): not asked"), "{findings:?}");
        assert!(findings.iter().all(|finding| finding.verdict == Verdict::Good || !finding.cure.is_empty()));
        assert!(findings.iter().any(|finding| finding.what.contains("Linux")), "{findings:?}");
    }

    #[test]
    fn where_a_controller_is_master_of_an_interface_no_drive_is_asked() {
        let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../../config");
        let text = std::fs::read_to_string(format!("{folder}/hardware/vision60_can.toml")).unwrap();
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), text.replace("\"can", "\"mastered")).unwrap();
        let line = ["doctor", "--seconds", "0.1", "--bus", file.path().to_str().unwrap()];
        let master = CanLock::take("mastered2").unwrap();
        let refused = |findings: &[Finding]| {
            findings.iter().any(|finding| {
                finding.verdict == Verdict::Failure
                    && finding.what.contains("mastered2 has a master already")
                    && finding.what.contains("the drives were not asked")
                    && finding.cure.contains("disarmed")
            })
        };
        let findings = examine(&Line::parse_from(line).arguments).unwrap();
        assert!(refused(&findings), "{findings:?}");
        drop(master);
        let findings = examine(&Line::parse_from(line).arguments).unwrap();
        assert!(!refused(&findings), "{findings:?}");
    }
}
