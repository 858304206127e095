//! Every example in a `--help` text is run here and does what it says, but for those that another test runs.

mod common;

use common::{Place, one_file};
use serde_json::Value;
use std::collections::BTreeSet;
use std::io::BufRead;
use std::process::Stdio;

/// Examples that need running nodes, a robot or a person, and where they are run.
const ELSEWHERE: [(&str, &str); 11] = [
    ("launch-scripts/demo", "launch-scripts/demo"),
    ("tandem walk gait1 amble --seconds 20 --out out/demo", "launch-scripts/demo"),
    ("tandem show &", "nodes/cli/tests/show.rs"),
    ("tandem show --web", "tests/ros2/test_web.py"),
    ("rviz2 -d config/rviz/tandem.rviz", "config/rviz/tandem.rviz"),
    ("tandem drive", "tests/ros2/test_drive.py"),
    ("tandem drive --joystick /dev/input/js0 --button 1 --release-button 7", "nodes/cli/src/drive/steer.rs"),
    ("tandem stop-button", "tests/ros2/test_stop.py"),
    ("tandem adapt config/adapters/vision60.toml", "tests/ros2/test_adapt.py"),
    ("tandem adapt config/adapters/ros2_control.toml", "tests/ros2/test_adapt.py"),
    (
        "tandem stop-button --joystick /dev/input/js0 --button 1 --release-button 7",
        "nodes/cli/src/stop_button/input.rs",
    ),
];

/// The command of an example's line: what stands after two or more spaces further on is a remark.
fn command(line: &str) -> Option<&str> {
    let line = line.strip_prefix("  ").filter(|line| !line.starts_with([' ', '-', '[']))?;
    let programs = ["tandem ", "launch-scripts/", "rviz2 "];
    programs.iter().any(|program| line.starts_with(program)).then(|| line.split("  ").next().unwrap().trim_end())
}

fn examples(place: &Place) -> BTreeSet<String> {
    let mut commands = place.commands();
    commands.extend(["tandem", "tandem bag", "tandem library", "tandem robot"].map(String::from));
    let helps = commands.iter().map(|command| place.succeeds(&format!("{command} --help")));
    helps.flat_map(|help| help.lines().filter_map(command).map(String::from).collect::<Vec<_>>()).collect()
}

fn json_lines(text: &str) -> Vec<Value> {
    text.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

/// By the estimate, which is not recorded, beside the truth and what was asked for.
/// The estimate drifts by 1 cm/s: loaded feet creep down the 10° in the simulator, and the push makes them slip.
fn its_page_shows_where_it_went(place: &Place) {
    place.succeeds("tandem report balanced -o balanced.html --no-tiles");
    let page = std::fs::read_to_string(place.path().join("balanced.html")).unwrap();
    let data = page.split_once("id=\"data\">").unwrap().1.split_once("</script>").unwrap().0;
    let data: Value = serde_json::from_str(data).unwrap();
    let balance = &data["runs"][0]["balance"];
    let number = |name: &str| balance[name].as_f64().unwrap_or(f64::NAN);
    assert!(
        number("drift_m") < 0.05 * number("way_m") && number("way_m") > 1.0,
        "{} {}",
        balance["drift_m"],
        balance["way_m"]
    );
    assert!(number("hurried") >= 1.0 && number("fastest") > 1.05 && number("farthest_m") > 0.05);
    let points =
        |name: &str| balance[name].as_array().unwrap().iter().map(|list| list.as_array().unwrap().len()).collect();
    let (ahead, asked): (Vec<usize>, Vec<usize>) = (points("ahead"), points("asked"));
    let times = balance["t"].as_array().unwrap().len();
    assert!(ahead == [times; 3] && asked[0] > times / 2, "{ahead:?} {asked:?}");
}

/// Width and duration were left open: others than the robot's own are chosen.
fn is_called_stable(place: &Place, line: &str) {
    let gait = json_lines(&place.succeeds(&format!("{line} --json"))).remove(0);
    assert!(gait["certificate"]["stable"] == true && gait["half_width_m"] != 0.341, "{gait}");
}

/// The gait file is walked, drawn, recorded, replayed and reported.
fn crawls(place: &Place, line: &str) {
    place.succeeds(line);
    let walked = place.succeeds("tandem simulate crawl.json --start stand --seconds 5 --bag crawl --out out/crawl");
    assert!(walked.contains("amble_crawl on ") && walked.contains("upright to the end"), "{walked}");
    assert!(place.path().join("out/crawl/footfalls.png").exists());
    assert!(place.succeeds("tandem bag verify crawl").contains("every command the same, to the bit"));
    place.succeeds("tandem report crawl -o crawl.html --no-tiles");
}

/// Stairs of a rise of 0.1 m and a depth of 0.3 m, climbed one a stride.
fn climbs(place: &Place, line: &str) {
    place.succeeds(line);
    let gait = std::fs::read_to_string(place.path().join("stairs.json")).unwrap();
    let gait: serde_json::Value = serde_json::from_str(&gait).unwrap();
    assert_eq!(gait["request"]["slope_rad"].as_f64(), Some(0.1_f64.atan2(0.3)));
    let walked = place.succeeds("tandem simulate stairs.json --staircase --seconds 6");
    assert!(walked.contains("a staircase of 101 mm") && walked.contains("upright to the end"), "{walked}");
}

/// Tries one; what is needed for it is there. False if nobody knows what it must do.
fn does_what_it_says(place: &Place, line: &str) -> bool {
    let there = |file: &str| place.path().join(file).exists();
    match line {
        "tandem plan amble -o amble.json" => {
            place.succeeds(line);
            assert!(there("amble.json"));
        }
        "tandem plan amble --slope 5 -o uphill.json" => {
            place.succeeds(line);
            assert!(there("uphill.json"));
        }
        "tandem plan amble --speed 0.5 --step-duration 0.35" | "tandem plan gait1 --clearance 0.08 --height 0.52" => {
            assert!(place.succeeds(line).contains("not written: give -o FILE"));
        }
        "tandem plan amble --speed 0.4 --stable" => is_called_stable(place, line),
        "tandem plan amble --schedule crawl --step-duration 0.4 --speed 0.1 --clearance 0.08 -o crawl.json" => {
            crawls(place, line);
        }
        line if line.contains("--stairs 0.1 0.3") => climbs(place, line),
        "tandem plan amble --schedule trot --four-leg-share 0.25 --speed 0.3 --clearance 0.08" => {
            let planned = json_lines(&place.succeeds(&format!("{line} --json"))).remove(0);
            assert_eq!(planned["contact_schedule"]["trot"]["four_leg_share"], 0.25);
        }
        "tandem plan all -o gaits" => {
            place.succeeds(line);
            assert_eq!(std::fs::read_dir(place.path().join("gaits")).unwrap().count(), 5);
        }
        "tandem plan --table" => assert_eq!(place.succeeds(line).lines().count(), 8),
        "tandem simulate amble.json" | "tandem simulate amble.json --noise 0.03 --seed 4" => {
            assert!(place.succeeds(line).contains("upright to the end"));
        }
        "tandem simulate gaits/*.json --seconds 60 --json" => {
            let output = json_lines(&place.succeeds(line));
            assert!(output.len() == 5 && output.iter().all(|output| output["upright"] == true), "{output:?}");
        }
        "tandem simulate uphill.json --slope 5 --mu 0.5 --push 3 0.1 0 100" => the_push_acts(place, line),
        "tandem simulate amble.json --slope 10 --balance --push 3 0.1 0 300 --velocity 5 0.2 0 0.3" => {
            let with = json_lines(&place.succeeds(&format!("{line} --json --seconds 12 --bag balanced")))[0].clone();
            assert!(with["upright"] == true && with["figures"]["turned_deg"].as_f64().unwrap() > 60.0, "{with}");
            assert!(place.succeeds("tandem bag verify balanced").contains("every command the same, to the bit"));
            its_page_shows_where_it_went(place);
            let bare = line.split(" --velocity").next().unwrap().replace(" --balance", "");
            assert!(!place.run(&bare).status.success(), "the paper's law walks it too");
        }
        "tandem simulate amble.json --start sit --out out/amble" => {
            assert!(place.succeeds(line).contains("upright to the end"));
            assert!(there("out/amble/gait.json") && there("out/amble/torques.png"));
        }
        "tandem robot init my_robot.urdf -o config/robots/my_robot" => {
            assert!(place.succeeds(line).contains("Look at:") && there("config/robots/my_robot/robot.toml"));
        }
        "tandem robot check config/robots/my_robot" => assert!(place.succeeds(line).contains("toe")),
        // No robot hangs here: it says so, and ends with an error code.
        "tandem doctor --bus config/hardware/vision60_can.toml" => {
            let output = place.run(line);
            assert!(String::from_utf8_lossy(&output.stdout).contains(" warnings in "), "{output:?}");
        }
        "tandem completions bash > tandem.bash" => {
            place.succeeds(line);
            assert!(there("tandem.bash"));
        }
        "tandem man man1" => {
            place.succeeds(line);
            assert!(there("man1/tandem-plan.1"));
        }
        _ => return solves_libraries(place, line) || looks_at_bags(place, line),
    }
    true
}

/// The same of the commands that make a library and read it.
fn solves_libraries(place: &Place, line: &str) -> bool {
    let there = |file: &str| place.path().join(file).exists();
    match line {
        "tandem library solve amble --axis clearance_m=0.06:0.15:10 --axis speed_m_s=0:0.5:100 -o vision60.gaits" => {
            let _ = std::fs::remove_file(place.path().join("vision60.gaits")); // another grid's is not taken up
            assert!(place.succeeds(line).contains("speed_m_s        100 values from 0 to 0.5"));
        }
        "tandem library solve amble --axis speed_m_s=-0.3:0.6:7 --axis yaw_rate_rad_s=-0.6:0.6:7 -o driving.gaits" => {
            assert!(place.succeeds(line).contains("28 gaits, ") && there("driving.gaits"));
            let gait = "tandem library gait driving.gaits --set speed_m_s=0.2 --set yaw_rate_rad_s=-0.3 --solve";
            assert!(place.succeeds(gait).contains("solved from there in"));
        }
        "tandem library show vision60.gaits" => assert!(place.succeeds(line).contains("gaits, ")),
        "tandem library gait vision60.gaits --set speed_m_s=0.33 --set clearance_m=0.1 -o gait.json" => {
            place.succeeds(line);
            assert!(there("gait.json"));
        }
        _ => return false,
    }
    true
}

/// The same of the commands that read a bag.
fn looks_at_bags(place: &Place, line: &str) -> bool {
    let there = |file: &str| place.path().join(file).exists();
    match line {
        "tandem bag info out/run" => assert!(place.succeeds(line).contains("control cycles, 0 missing")),
        "tandem bag verify out/run" => assert!(place.succeeds(line).contains("the same, to the bit")),
        "tandem bag recover out/run" => {
            assert!(place.succeeds(line).contains("the source was whole") && there("out/run_recovered"));
        }
        "tandem bag filter out/run --topic /joint_states --start 1 -o out/part" => {
            assert!(place.succeeds(line).contains(" messages on 1 topics"));
        }
        "tandem bag export out/run -o csv" => {
            place.succeeds(line);
            one_file(&place.path().join("csv"), "joint_states.csv");
        }
        "tandem report out/run -o report.html" => {
            place.succeeds(line);
            assert!(there("report.html"));
        }
        "tandem report monday tuesday -o compare.html" => {
            place.succeeds("cp -r out/run monday && cp -r out/run tuesday");
            place.succeeds(line);
            assert!(there("compare.html"));
        }
        "tandem report out/run --png pictures --csv tables" => {
            place.succeeds(line);
            assert!(there("pictures/torques.png"));
            one_file(&place.path().join("tables"), "joint_states.csv");
        }
        _ if line.starts_with("tandem bag play out/run") => plays(place, line),
        _ => return false,
    }
    true
}

/// It walks on until the push and beyond; without the push it walks another way from then on, and not before.
fn the_push_acts(place: &Place, line: &str) {
    let with = json_lines(&place.succeeds(&format!("{line} --json --seconds 6")))[0].clone();
    let without = line.split(" --push").next().unwrap();
    let without = json_lines(&place.succeeds(&format!("{without} --json --seconds 6")))[0].clone();
    assert!(with["upright"] == true && with["figures"] != without["figures"], "{with} {without}");
    let before =
        |line: &str| json_lines(&place.succeeds(&format!("{line} --json --seconds 2.9")))[0]["figures"].clone();
    assert_eq!(before(line), before(line.split(" --push").next().unwrap()));
    assert!(place.succeeds(line).contains("upright to the end (20.0 s)"));
}

/// Plays until it has reported that it does.
fn plays(place: &Place, line: &str) {
    let mut child = place.shell(&format!("exec {}", line)).stdout(Stdio::piped()).spawn().unwrap();
    let mut first = String::new();
    std::io::BufReader::new(child.stdout.as_mut().unwrap()).read_line(&mut first).unwrap();
    assert!(first.contains(" messages on "), "{line}: {first}");
    place.succeeds(&format!("kill -INT {}", child.id()));
    child.wait().unwrap();
}

#[test]
fn every_example_in_a_help_text_does_what_it_says() {
    let place = Place::new();
    let found = examples(&place);
    assert!(found.len() > 30, "{found:?}");
    let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    for (line, test) in ELSEWHERE {
        assert!(found.contains(line), "no help text has the example {line:?} any more");
        assert!(root.join(test).exists(), "{test}");
    }
    // Plans and libraries first, because others take what they make.
    let mut lines: Vec<&String> =
        found.iter().filter(|line| !ELSEWHERE.iter().any(|(other, _)| other == line)).collect();
    lines.sort_by_key(|line| (!line.starts_with("tandem plan"), !line.contains("solve"), !line.contains("init")));
    for line in lines {
        let begun = std::time::Instant::now();
        assert!(does_what_it_says(&place, line), "nothing says what the example {line:?} must do: add it here");
        println!("{:6.2} s  {line}", begun.elapsed().as_secs_f64());
    }
}
