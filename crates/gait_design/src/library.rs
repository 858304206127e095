//! A library of gaits: a grid of requests, solved row by row, each from its neighbours' solutions; and what lies between
//! the grid's points, by interpolation, with the violation that this costs stated.
//!
//! A library is a text file, one line a gait, so that it can be written while it is solved and taken up again after an
//! interruption: a header with the robot and the grid, then one line for each point in any order. Every line begins with the
//! CRC-32 of the rest, in hexadecimal.
//!
//! This module opens no file and starts no thread: [`Library::solve_row`] can be called for different rows at once.

use crate::program::{ProgramSettings, layout};
use crate::request::{GaitRequest, RequestError};
use crate::{PlanError, PlanOptions, Planner, WarmStart, leg_length_m, on_slope, program_of, recompose};
use gait::{Gait, SolverSummary};
use nlp::{Problem, Violation};
use robot::Robot;
use serde::{Deserialize, Serialize};
use std::ops::ControlFlow;

/// `format` of every library file.
pub const FORMAT: &str = "tandem-library";
/// The one version that this software reads and writes.
pub const VERSION: u64 = 1;
/// Most points of a grid.
pub const MOST_POINTS: usize = 1_000_000;

/// A number of a request that a grid can vary.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Field {
    /// T, s.
    StepDurationS,
    /// Swing clearance, m.
    ClearanceM,
    /// Forward speed, m/s.
    SpeedMS,
    /// Hip axes above the toe centres, m.
    HeightM,
    /// Lateral distance of a stance toe from the mid plane, m.
    HalfWidthM,
    /// Slope along the walk, rad.
    SlopeRad,
}

impl Field {
    /// All of them, by their names in a request.
    pub const ALL: [(&'static str, Self); 6] = [
        ("step_duration_s", Self::StepDurationS),
        ("clearance_m", Self::ClearanceM),
        ("speed_m_s", Self::SpeedMS),
        ("height_m", Self::HeightM),
        ("half_width_m", Self::HalfWidthM),
        ("slope_rad", Self::SlopeRad),
    ];

    /// Its name in a request.
    pub fn name(self) -> &'static str {
        Self::ALL.iter().find(|(_, field)| *field == self).expect("all fields are listed").0
    }

    /// Changes it in a request.
    pub fn set(self, request: &mut GaitRequest, value: f64) {
        *self.of(request) = value;
    }

    fn of(self, request: &mut GaitRequest) -> &mut f64 {
        match self {
            Self::StepDurationS => &mut request.step_duration_s,
            Self::ClearanceM => &mut request.clearance_m,
            Self::SpeedMS => &mut request.speed_m_s,
            Self::HeightM => &mut request.height_m,
            Self::HalfWidthM => &mut request.half_width_m,
            Self::SlopeRad => &mut request.slope_rad,
        }
    }
}

/// One axis of a grid.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Axis {
    /// What it varies.
    pub field: Field,
    /// Its values, ascending.
    pub values: Vec<f64>,
}

/// Requests that differ from a base in the axes' fields: every combination of the axes' values. The last axis varies fastest.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Grid {
    base: GaitRequest,
    axes: Vec<Axis>,
}

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
    /// No gait, and why.
    Refused(String),
}

/// A grid of requests on one robot with what came of them.
#[derive(Clone, Debug, PartialEq)]
pub struct Library {
    header: Header,
    entries: Vec<Option<Entry>>,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Header {
    format: String,
    version: u64,
    robot: String,
    /// Of the robot's description: solutions of one robot mean nothing on another.
    robot_crc32: u32,
    /// Hermite–Simpson points of the programs.
    points: usize,
    grid: Grid,
}

/// Read before everything else, so that a file of another version is named as such.
#[derive(Deserialize)]
struct Beginning {
    format: String,
    version: u64,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Line {
    index: usize,
    entry: Entry,
}

/// A gait taken from a library.
#[derive(Clone, Debug)]
pub struct Found {
    /// The gait. Between the grid's points its solver status is `interpolated`.
    pub gait: Gait,
    /// The constraint that it breaks most, and by how much: the solver's tolerance at a grid point, more in between.
    pub violation: Violation,
    /// The grid's points that it was made from, with their shares.
    pub neighbours: Vec<(usize, f64)>,
    /// A start for the solver, to remove the violation.
    pub warm_start: WarmStart,
}

/// What is wrong with a library or with a question to it.
#[derive(Debug, thiserror::Error)]
pub enum LibraryError {
    /// The grid cannot be meant.
    #[error("the grid {0}")]
    Grid(String),
    /// A base request or a grid's end that cannot be meant.
    #[error(transparent)]
    Request(#[from] RequestError),
    /// Not a library, or not of this version.
    #[error("line {line} of the library: {problem}")]
    File {
        /// Line number, from 1.
        line: usize,
        /// What is wrong with it and what was expected.
        problem: String,
    },
    /// Made for another robot, or for another description of it.
    #[error(
        "the library was solved for robot \"{library}\" as it was described then (crc {library_crc32:08x}), not for \"{robot}\" as it is now ({robot_crc32:08x}): solve it again"
    )]
    Robot {
        /// The library's robot.
        library: String,
        /// The crc of its description.
        library_crc32: u32,
        /// The robot at hand.
        robot: String,
        /// The crc of its description.
        robot_crc32: u32,
    },
    /// Points of the grid are missing.
    #[error("{missing} of the library's {all} gaits are not solved yet: resume `tandem library solve` on it")]
    Incomplete {
        /// How many are missing.
        missing: usize,
        /// How many there are to be.
        all: usize,
    },
    /// A request outside the grid, or that differs from it in a field that is no axis.
    #[error("{field} is {value}; the library has {expected}")]
    Outside {
        /// Which field.
        field: &'static str,
        /// Its value.
        value: f64,
        /// What the library offers.
        expected: String,
    },
    /// A neighbour has no gait.
    #[error("there is no gait beside the request, at {at}: {why}")]
    Hole {
        /// The grid's point.
        at: String,
        /// Why it has none.
        why: String,
    },
    /// The gait could not be put together.
    #[error(transparent)]
    Plan(#[from] PlanError),
}

impl Grid {
    /// Checks that the axes are ascending, different and not too many points, and that the grid's two ends are requests that can
    /// be meant.
    pub fn new(robot: &Robot, base: GaitRequest, axes: Vec<Axis>) -> Result<Self, LibraryError> {
        let grid = Self { base, axes };
        grid.check()?;
        for pick in [0, 1] {
            let mut request = grid.base.clone();
            for axis in &grid.axes {
                *axis.field.of(&mut request) = axis.values[pick * (axis.values.len() - 1)];
            }
            request.validate(leg_length_m(robot))?;
        }
        Ok(grid)
    }

    fn check(&self) -> Result<(), LibraryError> {
        let wrong = |problem: String| Err(LibraryError::Grid(problem));
        if !self.base.is_decomposable() {
            return wrong(
                "is on a sideways slope or leans the torso, for which the library's program does not plan: use `tandem plan`".into(),
            );
        }
        if self.axes.is_empty() {
            return wrong("has no axis: give at least one".into());
        }
        let mut points = 1_usize;
        for (index, axis) in self.axes.iter().enumerate() {
            let name = axis.field.name();
            if self.axes[..index].iter().any(|other| other.field == axis.field) {
                return wrong(format!("has two axes {name}: give each once"));
            }
            if axis.values.is_empty() || axis.values.iter().any(|v| !v.is_finite()) {
                return wrong(format!("axis {name} has no values or one that is not finite"));
            }
            if axis.values.windows(2).any(|w| w[0] >= w[1]) {
                return wrong(format!("axis {name} is not ascending: {:?}", axis.values));
            }
            points = points.saturating_mul(axis.values.len());
        }
        if points > MOST_POINTS {
            return wrong(format!("has {points} points, expected at most {MOST_POINTS}"));
        }
        Ok(())
    }

    /// Number of points.
    pub fn points(&self) -> usize {
        self.axes.iter().map(|axis| axis.values.len()).product()
    }

    /// Points of a row: those that differ in the last axis only. Point `index` belongs to row `index / row_length`.
    pub fn row_length(&self) -> usize {
        self.axes.last().map_or(1, |axis| axis.values.len())
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.points() / self.row_length()
    }

    /// The axes.
    pub fn axes(&self) -> &[Axis] {
        &self.axes
    }

    /// The request of a point.
    pub fn request(&self, mut index: usize) -> GaitRequest {
        let mut request = self.base.clone();
        for axis in self.axes.iter().rev() {
            *axis.field.of(&mut request) = axis.values[index % axis.values.len()];
            index /= axis.values.len();
        }
        request
    }

    fn describe(&self, index: usize) -> String {
        let mut request = self.request(index);
        let parts: Vec<String> =
            self.axes.iter().map(|a| format!("{} {}", a.field.name(), a.field.of(&mut request))).collect();
        parts.join(", ")
    }
}

impl Library {
    /// A library with nothing solved yet.
    pub fn new(robot: &Robot, grid: Grid) -> Self {
        let entries = vec![None; grid.points()];
        let header = Header {
            format: FORMAT.into(),
            version: VERSION,
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

    /// Solves what is missing of a row, each point from the two before it, and gives each to `each`, which may stop. What a row
    /// gives does not depend on other rows, nor on where an earlier attempt was interrupted.
    pub fn solve_row(&self, robot: &Robot, row: usize, mut each: impl FnMut(usize, Entry) -> ControlFlow<()>) {
        let grid = &self.header.grid;
        let length = grid.row_length();
        let fast = &grid.axes.last().expect("a grid has axes").values;
        let mut options = PlanOptions::default();
        options.program.points = self.header.points;
        let mut planner = Planner::new(robot);
        // The last two solved points: place along the row, unknowns.
        let mut solved: [Option<(f64, Vec<f64>)>; 2] = [None, None];
        for place in 0..length {
            let index = row * length + place;
            let entry = if let Some(entry) = &self.entries[index] {
                entry.clone()
            } else {
                let request = grid.request(index);
                let start = continued(&solved, fast[place]);
                let mut result = None;
                if start.is_some() {
                    options.warm_start = start.map(WarmStart);
                    result = planner.solve(&request, &options, |_| ControlFlow::Continue(())).ok();
                }
                options.warm_start = None;
                let result = match result {
                    Some(solution) => Ok(solution),
                    None => planner.solve(&request, &options, |_| ControlFlow::Continue(())),
                };
                let entry = match result {
                    Ok(s) => Entry::Gait {
                        iterations: s.iterations(),
                        objective: s.objective,
                        max_violation: s.worst.amount,
                        unknowns: s.x,
                    },
                    Err(e) => Entry::Refused(e.to_string()),
                };
                if each(index, entry.clone()).is_break() {
                    return;
                }
                entry
            };
            if let Entry::Gait { unknowns, .. } = entry {
                let [_, last] = &mut solved;
                solved = [last.take(), Some((fast[place], unknowns))];
            }
        }
    }

    /// The gait at a request: a grid point's own, or between them the multilinear interpolation of all the programs' unknowns,
    /// whose violation of the constraints is stated.
    pub fn find(&self, robot: &Robot, request: &GaitRequest) -> Result<Found, LibraryError> {
        self.check_robot(robot)?;
        request.validate(leg_length_m(robot))?;
        let grid = &self.header.grid;
        // All that is no axis must be the base's.
        let mut same = request.clone();
        let mut base = grid.base.clone();
        same.behaviour.clone_from(&base.behaviour);
        for axis in &grid.axes {
            *axis.field.of(&mut same) = *axis.field.of(&mut base);
        }
        let leg_length = leg_length_m(robot);
        for (asked, has) in same.ranges(leg_length).into_iter().zip(base.ranges(leg_length)) {
            if asked.1 != has.1 {
                return Err(LibraryError::Outside { field: asked.0, value: asked.1, expected: has.1.to_string() });
            }
        }
        let mut corners = vec![(0_usize, 1.0)];
        for axis in &grid.axes {
            let value = *axis.field.of(&mut request.clone());
            let (first, last) = (axis.values[0], axis.values[axis.values.len() - 1]);
            if !(first..=last).contains(&value) {
                let expected = format!("{first} to {last}");
                return Err(LibraryError::Outside { field: axis.field.name(), value, expected });
            }
            let above = axis.values.partition_point(|v| *v < value);
            let ends = if axis.values[above] == value {
                vec![(above, 1.0)]
            } else {
                let (a, b) = (axis.values[above - 1], axis.values[above]);
                let share = (value - a) / (b - a);
                vec![(above - 1, 1.0 - share), (above, share)]
            };
            corners = corners
                .iter()
                .flat_map(|&(index, w)| ends.iter().map(move |&(place, v)| (index * axis.values.len() + place, w * v)))
                .collect();
        }
        let mut x: Vec<f64> = Vec::new();
        let mut summary = SolverSummary {
            status: if corners.len() == 1 { "converged" } else { "interpolated" }.into(),
            iterations: 0,
            solve_time_s: 0.0,
            max_violation: 0.0,
            objective: 0.0,
        };
        for &(index, share) in &corners {
            match &self.entries[index] {
                Some(Entry::Gait { unknowns, iterations, .. }) => {
                    x.resize(unknowns.len(), 0.0);
                    for (x, u) in x.iter_mut().zip(unknowns) {
                        *x += share * u;
                    }
                    if corners.len() == 1 {
                        summary.iterations = *iterations;
                    }
                }
                Some(Entry::Refused(why)) => {
                    return Err(LibraryError::Hole { at: grid.describe(index), why: why.clone() });
                }
                None => {
                    let why = "it is not solved yet: resume `tandem library solve`".into();
                    return Err(LibraryError::Hole { at: grid.describe(index), why });
                }
            }
        }
        let robot = &on_slope(robot, request);
        let settings = ProgramSettings { points: self.header.points, ..ProgramSettings::default() };
        let mut program = program_of(robot, request, settings)?;
        let mut constraints = vec![0.0; program.bounds().constraint_lower.len()];
        summary.objective = program.values(&x, &mut constraints);
        let violation = nlp::most_broken(&program, &x, &constraints);
        summary.max_violation = violation.amount;
        let points = recompose::points(robot, &program, &x, f64::INFINITY)?;
        let gait = recompose::gait(
            robot,
            recompose::coefficients(&program, &x),
            x[layout::T],
            request,
            &points,
            summary,
            None,
        )?;
        Ok(Found { gait, violation, neighbours: corners, warm_start: WarmStart(x) })
    }

    fn check_robot(&self, robot: &Robot) -> Result<(), LibraryError> {
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

    /// First line of the file.
    pub fn header_line(&self) -> String {
        checked_line(&self.header)
    }

    /// The line of one point.
    pub fn entry_line(index: usize, entry: &Entry) -> String {
        checked_line(&Line { index, entry: entry.clone() })
    }

    /// The whole file, in the grid's order: the same library gives the same bytes however it was solved.
    pub fn to_text(&self) -> String {
        let mut text = self.header_line();
        for (index, entry) in self.entries.iter().enumerate() {
            if let Some(entry) = entry {
                text += &Self::entry_line(index, entry);
            }
        }
        text
    }

    /// Reads a complete library, checked against the robot.
    pub fn from_text(text: &str, robot: &Robot) -> Result<Self, LibraryError> {
        let (library, used) = Self::resume(text, robot)?;
        if used < text.len() {
            let line = text[..used].lines().count() + 1;
            return Err(LibraryError::File { line, problem: "it is cut short".into() });
        }
        match library.missing() {
            0 => Ok(library),
            missing => Err(LibraryError::Incomplete { missing, all: library.entries.len() }),
        }
    }

    /// Reads a library that may be incomplete: whatever follows the last line's end, left by an interruption, is not used. Gives
    /// the number of bytes that are good; writing goes on there.
    pub fn resume(text: &str, robot: &Robot) -> Result<(Self, usize), LibraryError> {
        let used = text.rfind('\n').map_or(0, |end| end + 1);
        let mut lines = text[..used].lines();
        let at = |line: usize| move |problem: String| LibraryError::File { line, problem };
        let first = lines.next().ok_or_else(|| at(1)("it is missing or cut short: this is no library".into()))?;
        let json = checked(first).map_err(at(1))?;
        let beginning: Beginning =
            serde_json::from_str(json).map_err(|e| at(1)(format!("it is not a library's header: {e}")))?;
        if beginning.format != FORMAT || beginning.version != VERSION {
            return Err(at(1)(format!(
                "the file is \"{}\" version {}, expected \"{FORMAT}\" version {VERSION}",
                beginning.format, beginning.version
            )));
        }
        let header: Header = serde_json::from_str(json).map_err(|e| at(1)(e.to_string()))?;
        header.grid.check()?;
        if header.points < 5 || header.points.is_multiple_of(2) {
            return Err(at(1)(format!("points is {}, expected an odd number from 5", header.points)));
        }
        let entries = vec![None; header.grid.points()];
        let unknowns = layout::point(header.points);
        let mut library = Self { header, entries };
        library.check_robot(robot)?;
        for (number, line) in (2..).zip(lines) {
            let json = checked(line).map_err(at(number))?;
            let Line { index, entry } = serde_json::from_str(json).map_err(|e| at(number)(e.to_string()))?;
            let all = library.entries.len();
            let place = library
                .entries
                .get_mut(index)
                .ok_or_else(|| at(number)(format!("gait number {index}, the grid has {all}")))?;
            if place.is_some() {
                return Err(at(number)(format!("gait number {index} comes a second time")));
            }
            if let Entry::Gait { unknowns: x, .. } = &entry
                && (x.len() != unknowns || x.iter().any(|v| !v.is_finite()))
            {
                return Err(at(number)(format!("{} unknowns, expected {unknowns} finite ones", x.len())));
            }
            *place = Some(entry);
        }
        Ok((library, used))
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

fn description_crc32(robot: &Robot) -> u32 {
    let Robot { urdf, legs, toe_radius_m, mirror, nominal, gains, limits, .. } = robot;
    // Written as it was when the first libraries were: they stay readable.
    let mirror = format!("Mirror {{ leg: {:?}, joint_sign: {:?} }}", mirror.leg, mirror.sign);
    crc32fast::hash(format!("{urdf}{legs:?}{toe_radius_m}{mirror}{nominal:?}{gains:?}{limits:?}").as_bytes())
}

fn checked_line(value: &impl Serialize) -> String {
    let json = serde_json::to_string(value).expect("a library has only strings, numbers and arrays");
    format!("{:08x} {json}\n", crc32fast::hash(json.as_bytes()))
}

fn checked(line: &str) -> Result<&str, String> {
    let (crc, json) =
        line.split_once(' ').ok_or("it does not begin with a checksum and a space: this is no library's line")?;
    let found = crc32fast::hash(json.as_bytes());
    if crc.len() != 8 || u32::from_str_radix(crc, 16) != Ok(found) {
        return Err(format!("its checksum is {found:08x}, the line says {crc:?}: the file is damaged"));
    }
    Ok(json)
}
