//! The order in which the program's equalities are solved ([`nlp::Ordered`]).
//!
//! **Where the joints follow polynomials** and two toes stand, **inputs** are the state of the body and of the stance
//! hip roll at the beginning, the coefficients of the other eleven joints, and T. Then, point by point: the other
//! joints from their polynomials; the seven accelerations that are left, the body's and the stance hip roll's, from
//! the stance toes' six rows and the one row of the dynamics that feels no force on them; a Hermite–Simpson interval
//! couples those of two points. A domain begins where the one before ends, and its joints' first two coefficients are
//! what their angles and rates ask for. Torques and ground forces follow up to the force along the line between the
//! stance toes. **Ties** are what joins the end to the beginning, and what holds where a domain begins or ends.
//!
//! **Where the joints follow a law** about polynomials, all coefficients and the whole state at the beginning are
//! inputs. Torques follow from the law, accelerations and ground forces from the dynamics and the stance toes' rows,
//! at any number of stance toes.

use super::schedule::{COEFFICIENTS, DOF, Place, Schedule, at};
use gait::JOINTS;
use nlp::{Order, Stage};

/// Room for up to two domains whose joints follow polynomials: inputs, and free ones, each with a place for the
/// constant.
pub(super) const INPUTS: usize = 128;
pub(super) const FREE: usize = 72;
/// The same from a state to a state, which is missed by unknowns of its own: 152 and 90.
pub(super) const INPUTS_BETWEEN: usize = 160;
pub(super) const FREE_BETWEEN: usize = 96;
/// The same where they follow the law: 181 and 126.
pub(super) const INPUTS_OF_THE_LAW: usize = 184;
pub(super) const FREE_OF_THE_LAW: usize = 128;

/// The order for a schedule; none where the joints follow polynomials and other than two toes stand.
pub(super) fn of(schedule: &Schedule, ties: Vec<usize>, joints_prescribed: bool) -> Option<Order> {
    if joints_prescribed && schedule.domains.iter().any(|d| d.redundant_joints.len() != 1) {
        return None;
    }
    let inputs = [schedule.t()].into_iter().chain(schedule.missed()).collect();
    let mut order = Order { inputs, loads: Vec::new(), stages: Vec::new(), ties };
    for domain in 0..schedule.domains.len() {
        let along = Along { schedule, domain };
        if joints_prescribed {
            along.put(&mut order);
        } else {
            along.put_of_the_law(&mut order);
        }
    }
    Some(order)
}

fn one(column: usize) -> Stage {
    Stage { chain: vec![column], core: Vec::new() }
}

/// A domain.
struct Along<'a> {
    schedule: &'a Schedule,
    domain: usize,
}

impl Along<'_> {
    fn roll(&self) -> usize {
        self.schedule.domains[self.domain].redundant_joints[0]
    }

    /// Joints whose motion is their polynomials'.
    fn prescribed(&self) -> impl Iterator<Item = usize> {
        let roll = self.roll();
        (0..JOINTS).filter(move |&j| j != roll)
    }

    /// Columns of the coordinates that are left, in one block of a point.
    fn left(&self, place: &Place, block: usize) -> impl Iterator<Item = usize> {
        let first = place.column + block;
        (first..first + 6).chain([first + 6 + self.roll()])
    }

    fn coefficients(&self, joint: usize) -> impl Iterator<Item = usize> {
        (0..COEFFICIENTS).map(move |k| self.schedule.alpha(self.domain, k, joint))
    }

    /// A point's columns from a block on.
    fn columns(&self, place: &Place, block: usize) -> std::ops::Range<usize> {
        let columns = self.schedule.columns(place);
        columns.start + block..columns.end
    }

    fn put(&self, order: &mut Order) {
        let places = self.schedule.places_of(self.domain);
        let forces = |place: &Place| self.columns(place, at::U).collect();
        order.loads.extend(places.iter().map(forces));
        self.begin(&places[0], order);
        for place in places {
            order.stages.extend(self.prescribed().map(|j| one(place.column + at::A + 6 + j)));
        }
        order.stages.push(Stage { chain: Vec::new(), core: self.left(&places[0], at::A).collect() });
        for three in places.windows(3).step_by(2) {
            let [middle, end] = [three[1], three[2]];
            for j in self.prescribed() {
                let joint = |place: &Place, block: usize| one(place.column + block + 6 + j);
                order.stages.extend([
                    joint(&end, at::V),
                    joint(&middle, at::V),
                    joint(&end, at::Q),
                    joint(&middle, at::Q),
                ]);
            }
            let chain = [(&middle, at::Q), (&end, at::Q), (&middle, at::V), (&end, at::V)];
            let core = [&middle, &end];
            order.stages.push(Stage {
                chain: chain.into_iter().flat_map(|(place, block)| self.left(place, block)).collect(),
                core: core.into_iter().flat_map(|place| self.left(place, at::A)).collect(),
            });
        }
        order.stages.push(Stage { chain: Vec::new(), core: self.coefficients(self.roll()).skip(2).collect() });
    }

    /// The state where the domain begins, and its polynomials' first two coefficients.
    fn begin(&self, first: &Place, order: &mut Order) {
        let state = (0..DOF).flat_map(|i| [first.column + at::Q + i, first.column + at::V + i]);
        let given = self.schedule.is_between();
        if self.domain == 0 && !given {
            let body = self.left(first, at::Q).chain(self.left(first, at::V));
            order.inputs.extend(body.chain(self.prescribed().flat_map(|j| self.coefficients(j))));
            let joints = self.prescribed().flat_map(|j| [at::Q, at::V].map(|block| first.column + block + 6 + j));
            order.stages.extend(joints.chain(self.coefficients(self.roll()).take(2)).map(one));
        } else {
            order.inputs.extend(self.prescribed().flat_map(|j| self.coefficients(j).skip(2)));
            let coefficients = (0..JOINTS).flat_map(|j| self.coefficients(j).take(2));
            if self.domain == 0 {
                order.inputs.extend(state);
                order.stages.extend(coefficients.map(one));
            } else {
                order.stages.extend(state.chain(coefficients).map(one));
            }
        }
    }

    fn put_of_the_law(&self, order: &mut Order) {
        let places = self.schedule.places_of(self.domain);
        let block = |place: &Place, from: usize, to: usize| place.column + from..place.column + to;
        order.inputs.extend((0..JOINTS).flat_map(|j| self.coefficients(j)));
        let state = block(&places[0], at::Q, at::A);
        if self.domain == 0 {
            order.inputs.extend(state);
        } else {
            order.stages.extend(state.map(one));
        }
        let accelerations = |place: &Place| block(place, at::A, at::U).chain(self.columns(place, at::LAMBDA));
        let torques = |place: &Place| block(place, at::U, at::LAMBDA);
        order.stages.push(Stage { chain: torques(&places[0]).collect(), core: accelerations(&places[0]).collect() });
        for three in places.windows(3).step_by(2) {
            let [middle, end] = [&three[1], &three[2]];
            let positions = block(middle, at::Q, at::V).chain(block(end, at::Q, at::V));
            let velocities = block(middle, at::V, at::A).chain(block(end, at::V, at::A));
            order.stages.push(Stage {
                chain: torques(middle).chain(torques(end)).chain(positions).chain(velocities).collect(),
                core: accelerations(middle).chain(accelerations(end)).collect(),
            });
        }
    }
}
