//! Pictures of a walk: what a person would rather look at than read.
//!
//! [`render_run`] makes everything for one run and writes it into a folder:
//!
//! | file | what it shows |
//! |---|---|
//! | `phase_portraits.png` | joint velocity over position, planned vermilion, simulated green (the paper's figure) |
//! | `torques.png` | mean absolute torque of each joint type beside the paper's Table II |
//! | `time_series.png` | torque, body height, roll and pitch, forward speed over time |
//! | `footfalls.png` | which foot stands when, and the plan |
//! | `tiles.png` | pictures of the robot over one step, side by side (if there are any) |
//!
//! ```no_run
//! # fn show(gait: gait::Gait, samples: Vec<report::Sample>, tiles: Vec<report::Tile>) -> Result<(), report::ReportError> {
//! let run = report::Run {
//!     gait: &gait,
//!     origin: report::Origin::Simulated,
//!     samples: &samples,
//!     walking_from_s: 2.0,
//!     tiles: &tiles,
//! };
//! for file in report::render_run("out".as_ref(), &run)? {
//!     println!("{}", file.display());
//! }
//! # Ok(()) }
//! ```
//!
//! [`driven()`] draws where a driven robot went. [`planned_step()`] draws a plan's step beside its simulation.
//!
//! [`page()`] makes one self-contained HTML page of one or more runs, with a scrubber and an animation of the robot.
//!
//! Samples may come from a simulator, a robot or a bag; nothing here knows where from. Joint vectors have 12 entries in
//! the order of [`gait`]: legs 0 front-left, 1 rear-left, 2 front-right, 3 rear-right, each hip roll, hip pitch, knee.
//!
//! # Invariants
//!
//! - Every axis has a label with its unit, and fonts are built in: the same input gives the same picture on every
//!   machine.
//! - A run with too little in it is an error that says so, never an empty picture.

mod balanced;
mod canvas;
mod driven;
mod error;
mod figures;
mod numbers;
mod page;
mod paper;
mod planned_step;
mod planned_stride;
mod run;
mod tiles;

pub use balanced::Balanced;
pub use canvas::Image;
pub use driven::{Driven, driven};
pub use error::ReportError;
pub use figures::{footfalls, phase_portraits, time_series, torque_bars};
pub use page::{Made, PageRun, Skeleton, page};
pub use paper::{TableTwo, table_two};
pub use planned_step::{PlannedStep, StepPoint, planned_step};
pub use run::{Origin, Run, Sample, mean_absolute_torque_nm, mean_forward_speed_m_s};
pub use tiles::{Tile, tile_strip};

use std::path::{Path, PathBuf};

/// Renders every picture of a run into `folder` (made if it is not there; files of the same names are replaced) and
/// gives the files' paths.
///
/// # Errors
/// [`ReportError::TooLittle`] if the run holds less than two strides of walking; [`ReportError::Io`].
pub fn render_run(folder: &Path, run: &Run) -> Result<Vec<PathBuf>, ReportError> {
    run.check()?;
    std::fs::create_dir_all(folder).map_err(|source| ReportError::Io { path: folder.to_owned(), source })?;
    let mut pictures = vec![
        ("phase_portraits.png", phase_portraits(run)?),
        ("torques.png", torque_bars(run)?),
        ("time_series.png", time_series(run)?),
        ("footfalls.png", footfalls(run)?),
    ];
    if !run.tiles.is_empty() {
        pictures.push(("tiles.png", tile_strip(&run.tiles_caption(), run.tiles)?));
    }
    let mut files = Vec::new();
    for (name, picture) in pictures {
        let path = folder.join(name);
        std::fs::write(&path, picture.to_png()?).map_err(|source| ReportError::Io { path: path.clone(), source })?;
        files.push(path);
    }
    Ok(files)
}
