//! The program in a shell: pipes that are closed, disks that are full, signals, `-`, paths, JSON.

mod common;

use common::Place;
use serde_json::Value;
use std::fs::File;
use std::process::Stdio;
use std::time::{Duration, Instant};

/// A line for each command; the code with a closed pipe, and with a full disk.
const LINES: [(&str, i32, i32); 29] = [
    ("tandem plan amble", 141, 1),
    ("tandem plan --table", 141, 1),
    ("tandem plan amble --verbose --verify --stability", 141, 1),
    ("tandem plan amble --verbose --schedule crawl", 141, 1),
    ("tandem library solve amble --axis speed_m_s=0.3:0.35:2 -o vision60.gaits", 141, 1),
    ("tandem library show vision60.gaits", 141, 1),
    ("tandem library gait vision60.gaits", 141, 1),
    ("tandem library gait vision60.gaits -o -", 141, 1),
    ("tandem simulate amble.json --seconds 0.2", 141, 1),
    ("tandem simulate amble.json --seconds 0.2 --json", 141, 1),
    ("tandem walk gait1 --out out/walk", 141, 1),
    ("tandem bag info out/run", 141, 1),
    ("tandem bag recover out/run -o out/saved", 141, 1),
    ("tandem bag verify out/run", 141, 1),
    ("tandem bag play out/run --rate 10 --delay 0", 141, 1),
    ("tandem bag filter out/run -o out/part", 141, 1),
    ("tandem bag export out/run -o out/csv", 141, 1),
    ("tandem report out/run --no-tiles -o report.html", 141, 1),
    ("tandem report out/run --no-tiles -o -", 141, 1),
    ("tandem show", 141, 1),
    ("tandem adapt config/adapters/vision60.toml", 141, 1),
    ("tandem robot init my_robot.urdf -o robot --force", 141, 1),
    ("tandem robot check", 141, 1),
    ("tandem doctor --seconds 0.1", 141, 1),
    // It has nothing to say on standard output, and no keys to listen to here.
    ("tandem stop-button", 1, 1),
    ("tandem drive", 1, 1),
    ("tandem completions bash", 141, 1),
    ("tandem man man1", 141, 1),
    ("tandem --help", 141, 1),
];

#[test]
fn a_closed_pipe_or_a_full_disk_ends_every_command_without_a_panic() {
    let place = Place::new();
    for command in place.commands() {
        assert!(LINES.iter().any(|(line, ..)| line.starts_with(&command)), "no line tries {command}");
    }
    let mut lines: Vec<(String, i32, i32)> = LINES.map(|(line, closed, full)| (line.to_owned(), closed, full)).into();
    lines.extend(place.commands().into_iter().map(|command| (format!("{command} --help"), 141, 1)));
    for (line, closed, full) in lines {
        for (code, name) in [(closed, "a closed pipe"), (full, "a full disk")] {
            for folder in ["saved", "part", "csv"] {
                // They must not be there: nothing is written over. They are not there the first time.
                let _ = std::fs::remove_dir_all(place.path().join("out").join(folder));
            }
            let (reader, writer) = std::io::pipe().unwrap();
            drop(reader);
            let stdout = if code == closed && name.contains("pipe") {
                Stdio::from(writer)
            } else {
                File::create("/dev/full").unwrap().into()
            };
            let output = place.shell(&format!("exec {line}")).stdout(stdout).output().unwrap();
            let errors = String::from_utf8_lossy(&output.stderr);
            assert!(!errors.contains("panicked"), "{line} into {name}: {errors}");
            assert_eq!(output.status.code(), Some(code), "{line} into {name}: {errors}");
            let summary = errors.lines().filter(|line| line.contains("cannot write to standard output")).count();
            assert_eq!(summary, usize::from(name.contains("disk") && code != closed), "{line} into {name}: {errors}");
        }
    }
}

#[test]
fn standard_error_that_cannot_be_written_is_no_panic() {
    let place = Place::new();
    for line in ["tandem plan nothing", "tandem bag info nowhere", "tandem --nothing", "tandem show --rate 0"] {
        let full = File::create("/dev/full").unwrap();
        let status = place.shell(&format!("exec {line}")).stderr(full).status().unwrap();
        assert!(matches!(status.code(), Some(1 | 2)), "{line}: {status}");
    }
}

#[test]
fn ctrl_c_loses_nothing_of_a_simulation_that_writes_a_bag() {
    let place = Place::new();
    let line = "exec tandem simulate amble.json --seconds 30000 --json --bag out/long --out out/pictures";
    for (signal, code) in [("INT", 130), ("TERM", 143)] {
        let _ = std::fs::remove_dir_all(place.path().join("out/long")); // not there the first time
        let mut child = place.shell(line).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        let file = place.path().join("out/long/long_0.mcap");
        let begun = Instant::now();
        while file.metadata().map_or(0, |found| found.len()) < 100_000 {
            assert!(
                begun.elapsed() < Duration::from_secs(60) && child.try_wait().unwrap().is_none(),
                "nothing is recorded"
            );
            std::thread::sleep(Duration::from_millis(20));
        }
        place.succeeds(&format!("kill -{signal} {}", child.id()));
        let asked = Instant::now();
        let output = child.wait_with_output().unwrap();
        assert!(asked.elapsed() < Duration::from_secs(60), "it took {:?}", asked.elapsed());
        assert_eq!(output.status.code(), Some(code), "{}", String::from_utf8_lossy(&output.stderr));
        let summary: Value = serde_json::from_slice(&output.stdout).unwrap();
        assert_eq!(
            (&summary["interrupted"], &summary["upright"], &summary["fault"]),
            (&true.into(), &false.into(), &Value::Null)
        );
        let info: Value = serde_json::from_str(&place.succeeds("tandem bag info --json out/long")).unwrap();
        let cycles = info["topics"].as_array().unwrap().iter().find(|topic| topic["name"] == "/control_cycle").unwrap();
        assert_eq!(cycles["messages"], summary["cycles"], "every cycle that was simulated is in the bag");
        assert_eq!(info["missing_cycles"], 0);
        place.succeeds("tandem bag verify out/long");
    }
}

#[test]
fn ctrl_c_ends_a_command_that_waits() {
    let place = Place::new();
    let mut child = place.shell("exec tandem bag play out/run --delay 3000").stdout(Stdio::piped()).spawn().unwrap();
    let mut line = String::new();
    std::io::BufRead::read_line(&mut std::io::BufReader::new(child.stdout.as_mut().unwrap()), &mut line).unwrap();
    assert!(line.contains("messages on"), "{line}");
    place.succeeds(&format!("kill -INT {}", child.id()));
    let asked = Instant::now();
    child.wait().unwrap();
    assert!(asked.elapsed() < Duration::from_secs(60), "it took {:?}", asked.elapsed());
}

#[test]
fn a_dash_is_standard_output_and_nothing_else_is_printed_there() {
    let place = Place::new();
    let gait = std::fs::read_to_string(place.path().join("amble.json")).unwrap();
    let keys = |text: &str| {
        serde_json::from_str::<Value>(text).unwrap().as_object().unwrap().keys().cloned().collect::<Vec<_>>()
    };
    let mut fields = keys(&gait);
    assert_eq!(keys(&place.succeeds("tandem plan amble -o -")), fields);
    // A gait out of a library has no certificate.
    fields.retain(|key| key != "certificate");
    assert_eq!(keys(&place.succeeds("tandem library gait vision60.gaits -o -")), fields);
    assert!(place.succeeds("tandem report out/run --no-tiles -o -").starts_with("<!"));
    let summary = place.run("tandem plan all -o -");
    assert!(
        !summary.status.success() && String::from_utf8_lossy(&summary.stderr).contains("standard output"),
        "{summary:?}"
    );
    // A device is written to, not replaced.
    place.succeeds("ln -s /dev/null sink && tandem plan amble -o sink && test -L sink && ! test -e sink.partial");
    let full = place.run("ln -s /dev/full full && tandem plan amble -o full");
    let errors = String::from_utf8_lossy(&full.stderr);
    assert!(full.status.code() == Some(1) && errors.contains("cannot write full: No space left"), "{errors}");
}

#[test]
fn relative_paths_are_searched_alike_for_every_option() {
    let place = Place::new();
    // None of these is below the working folder; all are in the project that the program was built in.
    for line in [
        "tandem simulate amble.json --seconds 0.2 --robot config/robots/vision60",
        "tandem simulate amble.json --seconds 0.2 --robot vision60 --bus config/hardware/vision60_can.toml",
        "tandem simulate tests/gaits/amble.json --seconds 0.2",
        "tandem robot check config/robots/vision60",
        "tandem doctor --seconds 0.1 --bus config/hardware/vision60_can.toml; test $? -le 1",
    ] {
        let output = place.run(line);
        let errors = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success() && !errors.contains("cannot read"), "{line}: {errors}");
    }
    let wiring = concat!(env!("CARGO_MANIFEST_DIR"), "/../../config/hardware/vision60_can.toml");
    place.succeeds(&format!("mkdir -p mine/hardware && cp {wiring} mine/hardware/only_mine.toml"));
    let line = "TANDEM_CONFIG=mine tandem simulate amble.json --seconds 0.2 --bus config/hardware/vision60_can.toml";
    place.succeeds(line);
    place.succeeds("TANDEM_CONFIG=mine tandem simulate amble.json --seconds 0.2 --bus config/hardware/only_mine.toml");
}

/// As `cargo install` leaves it: the program alone, far from the clone that it was built from and from where it is
/// called.
#[test]
fn a_program_that_stands_elsewhere_finds_mujoco_and_the_robots_of_its_clone() {
    let place = Place::new();
    place.succeeds(&format!("mkdir -p root/bin empty && cp {} root/bin/tandem", env!("CARGO_BIN_EXE_tandem")));
    for line in [
        "plan amble -o amble.json",
        "simulate amble.json --seconds 0.2 --bus config/hardware/vision60_can.toml",
        "robot check",
        "bag verify ../out/run",
    ] {
        place.succeeds(&format!("cd empty && ../root/bin/tandem {line}"));
    }
    let output = place.shell("cd empty && ../root/bin/tandem plan amble --robot nobody").output().unwrap();
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success() && errors.contains("TANDEM_CONFIG"), "{errors}");
}

#[test]
fn a_plan_that_eleven_points_cannot_hold_says_how_many_it_took_and_is_verified() {
    let place = Place::new();
    let summary: Value = serde_json::from_str(
        &place.succeeds("tandem plan amble --step-frequency 2.83 --half-width 0.25 --speed 0.5 --verify --json"),
    )
    .unwrap();
    assert_eq!(summary["points"], 21, "{summary}");
    assert_eq!(summary["verified"][0]["follows_plan"], true, "{summary}");
    assert_eq!(summary["verified"][0]["between_points"]["kept"], true, "{summary}");
    let asked: Value = serde_json::from_str(&place.succeeds("tandem plan amble --points 31 --json")).unwrap();
    assert_eq!(asked["points"], 31, "{asked}");
    let refused = place.run("tandem plan amble --points 12");
    let errors = String::from_utf8_lossy(&refused.stderr);
    assert!(refused.status.code() == Some(1) && errors.contains("points is 12, expected an odd number"), "{errors}");
}

#[test]
fn every_command_that_reports_does_so_in_json_and_says_null_for_what_it_does_not_know() {
    let place = Place::new();
    let lines = |line: &str| -> Vec<Value> {
        let output = place.run(line);
        let text = String::from_utf8(output.stdout).unwrap();
        text.lines()
            .map(|each| serde_json::from_str(each).unwrap_or_else(|error| panic!("{line}: {error}: {each}")))
            .collect()
    };
    for (line, count) in [
        ("tandem plan amble --json --verify --stability", 1),
        ("tandem plan --table --json", 5),
        ("tandem library solve amble --axis speed_m_s=0.3:0.35:2 -o vision60.gaits --json", 1),
        ("tandem library show vision60.gaits --json", 1),
        ("tandem library gait vision60.gaits --json --solve", 1),
        ("tandem simulate amble.json --seconds 0.2 --json", 1),
        ("tandem bag info out/run --json", 1),
        ("tandem bag recover out/run -o out/saved --json", 1),
        ("tandem bag filter out/run -o out/part --topic /joint_states --json", 1),
        ("tandem bag verify out/run --json", 1),
        ("tandem robot check --json", 1),
        ("tandem doctor --seconds 0.1 --json", 1),
        ("tandem report out/run --no-tiles --json", 1),
    ] {
        assert_eq!(lines(line).len(), count, "{line}");
    }
    assert!(lines("tandem bag export out/run -o out/csv --json").len() > 3);
    let short = &lines("tandem simulate amble.json --seconds 0.2 --json")[0];
    assert!(short["figures"]["speed_m_s"].is_null() && short["figures"]["height_m"].is_null(), "{short}");
    place.succeeds("tandem bag filter out/run -o out/empty --topic /joint_states --start 100");
    let empty = &lines("tandem bag info out/empty --json")[0];
    assert!(empty["start_ns"].is_null() && empty["duration_s"].is_null() && empty["messages"] == 0, "{empty}");
}

#[test]
fn completions_and_manual_pages_know_every_command() {
    let place = Place::new();
    for shell in ["bash", "zsh", "fish"] {
        let text = place.succeeds(&format!("tandem completions {shell}"));
        assert!(text.contains("stop-button") && text.contains("recover"), "{shell}");
    }
    place.succeeds("tandem completions bash > t.bash && bash -n t.bash");
    place.succeeds("tandem man man1");
    for command in place.commands() {
        let page = place.path().join("man1").join(command.replace(' ', "-") + ".1");
        let text = std::fs::read_to_string(&page).unwrap_or_else(|error| panic!("{}: {error}", page.display()));
        assert!(text.contains(".TH"), "{command}");
    }
}

#[test]
fn nothing_is_drawn_without_a_terminal() {
    let place = Place::new();
    let output = place.run("tandem simulate amble.json --seconds 120");
    assert!(output.status.success());
    assert_eq!(String::from_utf8_lossy(&output.stderr), "");
}
