//! The gait at a request: a grid point's own, or interpolated.

use super::contents::Library;
use super::error::LibraryError;
use crate::program::layout;
use crate::request::GaitRequest;
use crate::{PlanError, WarmStart, full_order, leg_length_m, on_slope, program_of, recompose};
use gait::{Gait, SolverSummary};
use nlp::{Problem, Violation};
use robot::Robot;

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

impl Library {
    /// The gait at a request: a grid point's own, or between them the multilinear interpolation of all the programs'
    /// unknowns, whose violation of the constraints is stated.
    pub fn find(&self, robot: &Robot, request: &GaitRequest) -> Result<Found, LibraryError> {
        self.check_robot(robot)?;
        request.validate(leg_length_m(robot))?;
        self.check_base(robot, request)?;
        let corners = self.corners(request)?;
        let (x, iterations) = self.interpolated(robot, &corners)?;
        let summary = SolverSummary {
            status: if corners.len() == 1 { "converged" } else { "interpolated" }.into(),
            iterations,
            solve_time_s: 0.0,
            max_violation: f64::NAN,
            objective: f64::NAN,
        };
        let (gait, violation) = if self.header.grid.is_of_strides() {
            full_order::interpolated_stride(robot, request, &self.options(), &x, summary)?
        } else {
            self.interpolated_step(robot, request, &x, summary)?
        };
        Ok(Found { gait, violation, neighbours: corners, warm_start: self.warm_start(x) })
    }

    /// The gait of a decomposed program's unknowns, and which constraint they break most.
    fn interpolated_step(
        &self,
        robot: &Robot,
        request: &GaitRequest,
        x: &[f64],
        summary: SolverSummary,
    ) -> Result<(Gait, Violation), PlanError> {
        let robot = &on_slope(robot, request);
        let mut program = program_of(robot, request, self.options().program)?;
        let mut constraints = vec![0.0; program.bounds().constraint_lower.len()];
        let objective = program.values(x, &mut constraints);
        let violation = nlp::most_broken(&program, x, &constraints);
        let summary = SolverSummary { max_violation: violation.amount, objective, ..summary };
        let points = recompose::points(robot, &program, x, f64::INFINITY)?;
        let coefficients = recompose::coefficients(&program, x);
        let gait = recompose::gait(robot, coefficients, x[layout::T], request, &points, summary, None)?;
        Ok((gait, violation))
    }

    /// All that is no axis must be the base's.
    fn check_base(&self, robot: &Robot, request: &GaitRequest) -> Result<(), LibraryError> {
        let grid = &self.header.grid;
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
        Ok(())
    }

    /// The grid's points around a request, with their shares.
    fn corners(&self, request: &GaitRequest) -> Result<Vec<(usize, f64)>, LibraryError> {
        let mut corners = vec![(0_usize, 1.0)];
        for axis in &self.header.grid.axes {
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
        Ok(corners)
    }

    /// The unknowns between the corners, and the solver's iterations where it is one corner's own gait.
    fn interpolated(&self, robot: &Robot, corners: &[(usize, f64)]) -> Result<(Vec<f64>, u32), LibraryError> {
        let (mut x, mut own_iterations) = (Vec::new(), 0);
        for &(index, share) in corners {
            let (unknowns, iterations) = self.unknowns(robot, index)?;
            x.resize(unknowns.len(), 0.0);
            for (x, u) in x.iter_mut().zip(unknowns.iter()) {
                *x += share * u;
            }
            if corners.len() == 1 {
                own_iterations = iterations;
            }
        }
        Ok((x, own_iterations))
    }
}
