//! What the balanced law survives: `launch-scripts/bench robustness [TABLE …]`.
//!
//! Every line is `name = survived/of`, or `name = value` for what is no survival. Seeded: the same lines on every
//! run. Tables: see [`TABLES`]; without an argument all of them. `--bare` walks the paper's law instead,
//! `--quick` takes one case in eight, `--unwatched` lets the law walk where the controller's watch over joints and tilt
//! would have ended the walk, `--cases` says of each case that did not survive what it was and how it ended, and
//! `--robot=FOLDER` walks another robot. The table `robot` is for that; it is made only where it is named, and so are
//! `planned`, `turning` and `can`.

#[path = "bench_robustness/can.rs"]
mod can;
#[path = "bench_robustness/cases.rs"]
mod cases;
#[path = "bench_robustness/driving.rs"]
mod driving;
#[path = "bench_robustness/ground.rs"]
mod ground;
#[path = "bench_robustness/multipliers.rs"]
mod multipliers;
#[path = "bench_robustness/planned.rs"]
mod planned;
#[path = "bench_robustness/pushes.rs"]
mod pushes;
#[path = "bench_robustness/robots.rs"]
mod robots;
#[path = "bench_robustness/turning.rs"]
mod turning;

use cases::Bench;

/// A table's name and what prints it.
type Table = (&'static str, fn(&Bench));

const TABLES: [Table; 17] = [
    ("undisturbed", driving::undisturbed),
    ("multipliers", multipliers::multipliers),
    ("pushes", pushes::pushes),
    ("slopes", ground::slopes),
    ("ramps", ground::ramps),
    ("kerbs", ground::kerbs),
    ("bumps", ground::bumps),
    ("stairs", ground::stairs),
    ("torture", ground::torture),
    ("variations", pushes::variations),
    ("delay", pushes::delay),
    ("driving", driving::driving),
    ("eight", driving::eight),
    ("planned", planned::planned),
    ("turning", turning::turning),
    ("can", can::can),
    ("robot", robots::robot),
];
/// Tables that are made only where they are named.
const NAMED_ONLY: [&str; 4] = ["planned", "turning", "can", "robot"];
const ROBOT: &str = "--robot=";

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let (flags, names): (Vec<&String>, Vec<&String>) = arguments.iter().partition(|a| a.starts_with("--"));
    let unknown = flags
        .iter()
        .find(|flag| {
            !["--bare", "--quick", "--unwatched", "--cases"].contains(&flag.as_str()) && !flag.starts_with(ROBOT)
        })
        .or_else(|| names.iter().find(|name| !TABLES.iter().any(|(known, _)| *known == name.as_str())));
    if let Some(unknown) = unknown {
        let known: Vec<&str> = TABLES.iter().map(|(name, _)| *name).collect();
        eprintln!(
            "bench_robustness: \"{unknown}\" is unknown: expected --bare, --quick, --unwatched, --cases, --robot=FOLDER or some of {}",
            known.join(", ")
        );
        std::process::exit(2);
    }
    let has = |flag: &str| flags.iter().any(|given| given.as_str() == flag);
    let bench = Bench {
        balanced: !has("--bare"),
        quick: has("--quick"),
        watched: !has("--unwatched"),
        tells_cases: has("--cases"),
        ..Bench::new(flags.iter().find_map(|flag| flag.strip_prefix(ROBOT)))
    };
    for (name, table) in TABLES {
        if names.is_empty() && !NAMED_ONLY.contains(&name) || names.iter().any(|asked| asked.as_str() == name) {
            table(&bench);
        }
    }
}
