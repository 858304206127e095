//! What a planner remembers of the gaits it has solved, and where it starts from with them (Mansard et al., Using a
//! memory of motion to efficiently warm-start a nonlinear predictive controller, ICRA 2018).
//!
//! The unknowns are a smooth function of the request's numbers but for kinks where a limit becomes active. A Gaussian
//! process through the nearest remembered gaits carries them over to a new request.

use crate::request::GaitRequest;
use nalgebra::{DMatrix, DVector};

/// Gaits that are remembered; the oldest is forgotten first.
const REMEMBERED: usize = 256;
/// Gaits that a start is made of.
const NEIGHBOURS: usize = 12;
/// Distance over which gaits are alike, as a share of each field's range.
const LENGTH: f64 = 0.4;
/// Variance of what is no smooth function of the request, as a share of the whole: kinks and the solver's tolerance.
const UNEXPLAINED: f64 = 1e-8;

type Place = [f64; GaitRequest::FIELDS];

/// Solved gaits, the newest last.
#[derive(Default)]
pub(crate) struct Memory {
    gaits: Vec<(Place, Vec<f64>)>,
}

/// A request's numbers in units of the distance over which gaits are alike.
fn place(request: &GaitRequest, leg_length_m: f64) -> Place {
    request.ranges(leg_length_m).map(|(_, value, lower, upper, _)| value / (LENGTH * (upper - lower)))
}

fn distance_squared(a: &Place, b: &Place) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum()
}

impl Memory {
    /// Remembers a solution.
    pub(crate) fn keep(&mut self, request: &GaitRequest, leg_length_m: f64, x: &[f64]) {
        let place = place(request, leg_length_m);
        // A second gait at the same place tells nothing.
        self.gaits.retain(|gait| distance_squared(&gait.0, &place) > 1e-12);
        if self.gaits.len() == REMEMBERED {
            self.gaits.rotate_left(1);
            let oldest = self.gaits.last_mut().expect("as many as are remembered");
            oldest.0 = place;
            oldest.1.clear();
            oldest.1.extend_from_slice(x);
        } else {
            self.gaits.push((place, x.to_vec()));
        }
    }

    /// Where to start a request's solve, if there is anything to start from.
    pub(crate) fn start(&self, request: &GaitRequest, leg_length_m: f64) -> Option<Vec<f64>> {
        let here = place(request, leg_length_m);
        let mut near: Vec<(f64, usize)> =
            self.gaits.iter().enumerate().map(|(i, gait)| (distance_squared(&gait.0, &here), i)).collect();
        near.sort_by(|a, b| a.0.total_cmp(&b.0));
        near.truncate(NEIGHBOURS);
        let (_, nearest) = *near.first()?;
        let alike = |a: &Place, b: &Place| (-0.5 * distance_squared(a, b)).exp();
        let of = |k: usize| &self.gaits[near[k].1].0;
        let covariance = DMatrix::from_fn(near.len(), near.len(), |i, k| {
            alike(of(i), of(k)) + if i == k { UNEXPLAINED } else { 0.0 }
        });
        let with_here = DVector::from_fn(near.len(), |i, _| alike(of(i), &here));
        let weights = covariance.cholesky()?.solve(&with_here);
        // The nearest gait is the expectation where nothing is known; the rest of the weights is its own.
        let rest = 1.0 - weights.sum();
        let mut x: Vec<f64> = self.gaits[nearest].1.iter().map(|x| x * rest).collect();
        for (weight, &(_, gait)) in weights.iter().zip(&near) {
            for (x, theirs) in x.iter_mut().zip(&self.gaits[gait].1) {
                *x += weight * theirs;
            }
        }
        Some(x)
    }
}
