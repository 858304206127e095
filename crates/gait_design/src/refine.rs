//! The same solution on another grid: between the points by the interpolants that Hermite–Simpson collocation stands
//! for.

use crate::program::{DOF, layout as at};
use crate::request::MOST_POINTS;

/// The grids that a refused solution is solved on again, as how often each interval is halved: 11 points, then 21,
/// then 41.
pub(crate) const REFINEMENTS: u32 = 2;

/// The grid with every interval halved.
fn halved(points: usize) -> usize {
    2 * points - 1
}

/// The grid on which a solution that is refused is solved again, unless it has more points than may be asked for.
pub(crate) fn finer_grid(points: usize) -> Option<usize> {
    Some(halved(points)).filter(|&finer| finer <= MOST_POINTS)
}

/// Points of a vector of unknowns, or `None` where it is of no decomposed program.
pub(crate) fn points_of(unknowns: usize) -> Option<usize> {
    let points = unknowns.checked_sub(at::POINTS)?;
    (points % at::POINT == 0).then_some(points / at::POINT)
}

/// The solution on a grid of `points`, where intervals can be halved or joined to get there.
pub(crate) fn on_grid(mut x: Vec<f64>, points: usize) -> Option<Vec<f64>> {
    loop {
        match points_of(x.len())? {
            there if there == points => return Some(x),
            fewer if fewer >= 3 && halved(fewer) <= points => x = finer(&x, fewer),
            more if points >= 3 && more >= halved(points) && more % 2 == 1 => x = coarser(&x, more),
            _ => return None,
        }
    }
}

fn coarser(x: &[f64], points: usize) -> Vec<f64> {
    let kept = (0..points).step_by(2).flat_map(|p| &x[at::point(p)..at::point(p + 1)]);
    x[..at::POINTS].iter().chain(kept).copied().collect()
}

fn finer(x: &[f64], points: usize) -> Vec<f64> {
    let mut fine = x[..at::POINTS].to_vec();
    let h = 2.0 * x[at::T] / (points - 1) as f64;
    for interval in 0..points / 2 {
        let three: [&[f64]; 3] = std::array::from_fn(|k| {
            let start = at::point(2 * interval + k);
            &x[start..start + at::POINT]
        });
        fine.extend_from_slice(three[0]);
        fine.extend(within(three, 0.25, h));
        fine.extend_from_slice(three[1]);
        fine.extend(within(three, 0.75, h));
    }
    fine.extend_from_slice(&x[at::point(points - 1)..at::point(points)]);
    fine
}

/// A point's unknowns at share `s` of an interval of length `h`: forces and accelerations by the quadratic through
/// the three points, velocities and positions by the integral of what they change with.
fn within([p0, p1, p2]: [&[f64]; 3], s: f64, h: f64) -> [f64; at::POINT] {
    let (value, integral) = ([(1.0 - s) * (1.0 - 2.0 * s), 4.0 * s * (1.0 - s), s * (2.0 * s - 1.0)], integral(s));
    std::array::from_fn(|i| {
        let of = |weights: [f64; 3], i: usize| weights[0] * p0[i] + weights[1] * p1[i] + weights[2] * p2[i];
        if i < at::A { p0[i] + h * of(integral, i + DOF) } else { of(value, i) }
    })
}

/// Weights of an interval's three values in the integral of their quadratic from its start to share `s`, in units of
/// its length.
pub(crate) fn integral(s: f64) -> [f64; 3] {
    [s - 1.5 * s * s + 2.0 / 3.0 * s * s * s, 2.0 * s * s - 4.0 / 3.0 * s * s * s, 2.0 / 3.0 * s * s * s - 0.5 * s * s]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::{as_steps, go_on, vision60};
    use crate::{PlanOptions, Planner};

    /// A refusal is for what the plan breaks, and not for points that nobody asked for.
    #[test]
    fn no_grid_is_finer_than_may_be_asked_for() {
        assert_eq!([11, 21, 81, 83, 161].map(finer_grid), [Some(21), Some(41), Some(161), None, None]);
    }

    #[test]
    fn a_solution_halved_twice_keeps_its_points_and_is_solved_in_few_iterations() {
        let robot = vision60();
        let request = as_steps("amble", &robot);
        let mut options = PlanOptions::default();
        let coarse = Planner::new(&robot).solve(&request, &options, go_on).unwrap();
        let fine = on_grid(coarse.x.clone(), 41).unwrap();
        for p in 0..11 {
            assert_eq!(fine[at::point(4 * p)..at::point(4 * p + 1)], coarse.x[at::point(p)..at::point(p + 1)], "{p}");
        }
        assert_eq!(on_grid(fine, 11).unwrap(), coarse.x);
        assert!(on_grid(coarse.x.clone(), 13).is_none() && on_grid(vec![0.0; 700], 11).is_none());
        options.program.points = 21;
        let cold = Planner::new(&robot).solve(&request, &options, go_on).unwrap();
        options.warm_start = Some(crate::WarmStart(crate::Solved::Decomposed(coarse.x)));
        let warm = Planner::new(&robot).solve(&request, &options, go_on).unwrap();
        assert!(warm.iterations() < cold.iterations(), "{} against {}", warm.iterations(), cold.iterations());
        assert!((warm.objective - cold.objective).abs() < 1e-6);
    }
}
