//! What the balanced law survives: `launch-scripts/bench robustness [TABLE …]`.
//!
//! Every line is `name = survived/of`, or `name = value` for what is no survival. Seeded: the same lines on every
//! run. Tables: see [`TABLES`]; without an argument all of them. `--bare` walks the paper's law instead,
//! `--quick` takes one case in eight, `--unwatched` lets the law walk where the controller's watch over joints and tilt
//! would have ended the walk, `--cases` says of each case that did not survive what it was and how it ended.

#[path = "bench_robustness/cases.rs"]
mod cases;
#[path = "bench_robustness/driving.rs"]
mod driving;
#[path = "bench_robustness/ground.rs"]
mod ground;
#[path = "bench_robustness/multipliers.rs"]
mod multipliers;
#[path = "bench_robustness/pushes.rs"]
mod pushes;

use cases::Bench;

/// A table's name and what prints it.
type Table = (&'static str, fn(&Bench));

const TABLES: [Table; 13] = [
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
];

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let (flags, names): (Vec<&String>, Vec<&String>) = arguments.iter().partition(|a| a.starts_with("--"));
    let unknown = flags
        .iter()
        .find(|flag| !["--bare", "--quick", "--unwatched", "--cases"].contains(&flag.as_str()))
        .or_else(|| names.iter().find(|name| !TABLES.iter().any(|(known, _)| *known == name.as_str())));
    if let Some(unknown) = unknown {
        let known: Vec<&str> = TABLES.iter().map(|(name, _)| *name).collect();
        eprintln!(
            "bench_robustness: \"{unknown}\" is unknown: expected --bare, --quick, --unwatched, --cases or some of {}",
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
        ..Bench::new()
    };
    for (name, table) in TABLES {
        if names.is_empty() || names.iter().any(|asked| asked.as_str() == name) {
            table(&bench);
        }
    }
}
