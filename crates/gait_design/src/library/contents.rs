//! What a library holds, and how it is solved.

use super::error::LibraryError;
use super::grid::Grid;
use crate::limits::ProgramSettings;
use crate::{GaitRequest, PlanOptions, Planner, Solved, WarmStart, full_order};
use nlp::Iteration;
use robot::Robot;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::ops::ControlFlow;

/// `format` of every library file.
pub const FORMAT: &str = "tandem-library";
/// `version` of a library whose gaits are a step and its mirror image.
pub const VERSION: u64 = 1;
/// `version` of a library of strides: both steps of each are planned.
pub const VERSION_STRIDES: u64 = 2;

/// What came of one point of the grid.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "snake_case")]
pub enum Entry {
    /// A converged gait.
    Gait {
        /// Iterations of the solver.
        iterations: u32,
        /// The cost.
        objective: f64,
        /// Largest violation of a constraint.
        max_violation: f64,
        /// The program's unknowns.
        unknowns: Vec<f64>,
    },
    /// What came of another point, seen in the mirror.
    Mirror {
        /// Which point.
        of: usize,
    },
    /// No gait, and why.
    Refused(String),
}

/// A grid of requests on one robot with what came of them.
#[derive(Clone, Debug, PartialEq)]
pub struct Library {
    pub(super) header: Header,
    pub(super) entries: Vec<Option<Entry>>,
}

/// The file's first line.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Header {
    pub format: String,
    pub version: u64,
    pub robot: String,
    /// Of the robot's description: solutions of one robot mean nothing on another.
    pub robot_crc32: u32,
    /// Hermite–Simpson points of the programs.
    pub points: usize,
    pub grid: Grid,
}

impl Library {
    /// A library with nothing solved yet.
    pub fn new(robot: &Robot, grid: Grid) -> Self {
        let entries = vec![None; grid.points()];
        let header = Header {
            format: FORMAT.into(),
            version: if grid.is_of_strides() { VERSION_STRIDES } else { VERSION },
            robot: robot.name.clone(),
            robot_crc32: description_crc32(robot),
            points: ProgramSettings::default().points,
            grid,
        };
        Self { header, entries }
    }

    /// The grid.
    pub fn grid(&self) -> &Grid {
        &self.header.grid
    }

    /// What came of each point; none where it is not solved yet.
    pub fn entries(&self) -> &[Option<Entry>] {
        &self.entries
    }

    /// Puts in what [`Self::solve_row`] gave.
    pub fn insert(&mut self, index: usize, entry: Entry) {
        self.entries[index] = Some(entry);
    }

    /// Points not solved yet.
    pub fn missing(&self) -> usize {
        self.entries.iter().filter(|entry| entry.is_none()).count()
    }

    /// Solves what is missing of a row, each point from the two before it, and gives each to `each`, which may stop.
    /// What a row gives does not depend on other rows, nor on where an earlier attempt was interrupted.
    pub fn solve_row(&self, robot: &Robot, row: usize, mut each: impl FnMut(usize, Entry) -> ControlFlow<()>) {
        let grid = &self.header.grid;
        let length = grid.row_length();
        let fast = &grid.axes.last().expect("a grid has axes").values;
        let mut planner = Planner::new(robot);
        // The last two solved points: place along the row, unknowns.
        let mut solved: [Option<(f64, Vec<f64>)>; 2] = [None, None];
        for place in 0..length {
            let index = row * length + place;
            let entry = match (&self.entries[index], grid.mirror_of(index)) {
                (Some(entry), _) => entry.clone(),
                (None, Some(of)) => Entry::Mirror { of },
                (None, None) => self.solve(&mut planner, &grid.request(index), continued(&solved, fast[place])),
            };
            if self.entries[index].is_none() && each(index, entry.clone()).is_break() {
                return;
            }
            if let Entry::Gait { unknowns, .. } = entry {
                let [_, last] = &mut solved;
                solved = [last.take(), Some((fast[place], unknowns))];
            }
        }
    }

    /// What comes of a request, from a start or else from none.
    fn solve(&self, planner: &mut Planner, request: &GaitRequest, start: Option<Vec<f64>>) -> Entry {
        let mut options = self.options();
        let mut solve = |warm_start: Option<WarmStart>| {
            options.warm_start = warm_start;
            let progress = |_: &Iteration| ControlFlow::Continue(());
            if self.header.grid.is_of_strides() {
                planner.solve_stride(request, &options, progress)
            } else {
                planner.solve(request, &options, progress)
            }
        };
        let from_start = start.and_then(|x| solve(Some(self.warm_start(x))).ok());
        match from_start.map_or_else(|| solve(None), Ok) {
            Ok(s) => Entry::Gait {
                iterations: s.iterations(),
                objective: s.objective,
                max_violation: s.worst.amount,
                unknowns: s.x,
            },
            Err(e) => Entry::Refused(e.to_string()),
        }
    }

    /// How its gaits are planned.
    pub(super) fn options(&self) -> PlanOptions {
        let mut options = PlanOptions::default();
        options.program.points = self.header.points;
        options
    }

    /// Unknowns of its program, to start from.
    pub(super) fn warm_start(&self, x: Vec<f64>) -> WarmStart {
        if self.header.grid.is_of_strides() {
            let of = full_order::Program::of_stride(self.header.points, self.options().reference);
            return WarmStart(Solved::FullOrder(of, x));
        }
        WarmStart(Solved::Decomposed(x))
    }

    /// A point's unknowns and the iterations that they took, in the mirror where it is another's mirror image.
    pub(super) fn unknowns(&self, robot: &Robot, index: usize) -> Result<(Cow<'_, [f64]>, u32), LibraryError> {
        let grid = &self.header.grid;
        let hole = |why: &str| LibraryError::Hole { at: grid.describe(index), why: why.into() };
        match &self.entries[index] {
            Some(Entry::Gait { unknowns, iterations, .. }) => Ok((Cow::Borrowed(unknowns), *iterations)),
            Some(Entry::Mirror { of }) => match &self.entries[*of] {
                Some(Entry::Gait { unknowns, iterations, .. }) => {
                    let image = full_order::mirrored_stride(robot, &grid.request(*of), self.header.points, unknowns);
                    Ok((Cow::Owned(image), *iterations))
                }
                Some(Entry::Refused(why)) => Err(hole(why)),
                _ => Err(hole("its mirror image is not solved yet: resume `tandem library solve`")),
            },
            Some(Entry::Refused(why)) => Err(hole(why)),
            None => Err(hole("it is not solved yet: resume `tandem library solve`")),
        }
    }

    pub(super) fn check_robot(&self, robot: &Robot) -> Result<(), LibraryError> {
        let (h, robot_crc32) = (&self.header, description_crc32(robot));
        if h.robot != robot.name || h.robot_crc32 != robot_crc32 {
            return Err(LibraryError::Robot {
                library: h.robot.clone(),
                library_crc32: h.robot_crc32,
                robot: robot.name.clone(),
                robot_crc32,
            });
        }
        Ok(())
    }
}

/// From the solutions at the last two places of a row, what to expect at the next.
fn continued(solved: &[Option<(f64, Vec<f64>)>; 2], at: f64) -> Option<Vec<f64>> {
    match solved {
        [Some((a, x)), Some((b, y))] => {
            let share = (at - b) / (b - a);
            Some(x.iter().zip(y).map(|(x, y)| y + share * (y - x)).collect())
        }
        [_, Some((_, y))] => Some(y.clone()),
        _ => None,
    }
}

/// Of all that a robot's gaits depend on.
fn description_crc32(robot: &Robot) -> u32 {
    let Robot { urdf, legs, toe_radius_m, mirror, nominal, gains, limits, .. } = robot;
    // Written as it was when the first libraries were: they stay readable.
    let mirror = format!("Mirror {{ leg: {:?}, joint_sign: {:?} }}", mirror.leg, mirror.sign);
    crc32fast::hash(format!("{urdf}{legs:?}{toe_radius_m}{mirror}{nominal:?}{gains:?}{limits:?}").as_bytes())
}
