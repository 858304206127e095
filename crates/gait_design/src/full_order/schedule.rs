//! Which legs stand when, and where the unknowns lie: a schedule is domains in their order, and how the last meets the
//! first.

use super::goal;
use super::state::State;
use crate::contact_schedule::{ContactSchedule, Phase};
use crate::refine::finer_grid;
use crate::request::GaitRequest;
pub(super) use crate::terms::COEFFICIENTS;
use crate::terms::{Layout, Mirrored, Step};
use gait::{JOINTS, LEGS};
use robot::{Mirror, Robot};
use std::marker::PhantomData;

pub(super) const DOF: usize = 18;

/// Stance and swing legs of the first step; the second step's are their mirror images.
const STANCE: [usize; 2] = [1, 2];
const SWING: [usize; 2] = [0, 3];
/// Points of a domain in which all legs stand: it is short. Fewer than there are coefficients would leave some of the
/// reference's to nothing.
const POINTS_OF_FOUR_LEGS: usize = 7;

/// The leg whose stance hip roll the fixed distance of the stance toes determines.
const REDUNDANT_LEG: usize = 2;

/// Hermite–Simpson points of a contact schedule's domains.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grid {
    /// Of those in which legs swing.
    pub swing: usize,
    /// Of those on four legs.
    pub four_legs: usize,
}

impl Grid {
    /// The coarsest, for so many points where legs swing.
    pub fn coarse(swing: usize) -> Self {
        Self { swing, four_legs: POINTS_OF_FOUR_LEGS }
    }

    /// With a domain's intervals, and those of its kind, halved: once, no more.
    pub fn finer(self, domain: &Domain, coarse: Self) -> Option<Self> {
        let kind = |grid: Self| if domain.swing.is_empty() { grid.four_legs } else { grid.swing };
        let points = finer_grid(kind(self)).filter(|_| kind(self) == kind(coarse))?;
        Some(if domain.swing.is_empty() { Self { four_legs: points, ..self } } else { Self { swing: points, ..self } })
    }
}

/// Where a point's unknowns lie within it; after them λ of each stance leg.
pub(super) mod at {
    use super::{DOF, JOINTS};
    pub const Q: usize = 0;
    pub const V: usize = Q + DOF;
    pub const A: usize = V + DOF;
    pub const U: usize = A + DOF;
    pub const LAMBDA: usize = U + JOINTS;
}

/// The whole robot's coordinates.
#[derive(Clone, Copy, Debug)]
pub(super) struct Whole;

impl Layout for Whole {
    const COORDINATES: usize = DOF;
    const JOINTS_OF: [usize; LEGS] = [6, 9, 12, 15];
    const Q: usize = at::Q;
    const V: usize = at::V;
    const A: usize = at::A;
    const MIRRORED: Mirrored = Mirror::coordinate_source;
    const ACCELERATIONS_LAST: bool = false;
}

/// A point of a full-order program.
pub(super) type Place = crate::terms::Place<Whole>;

/// Which steps of a stride are planned.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Steps {
    /// The first; the second is its mirror image.
    Mirrored,
    /// Both.
    Both,
}

impl Steps {
    /// What a request needs.
    pub fn of(request: &GaitRequest) -> Self {
        if request.is_mirrored() { Self::Mirrored } else { Self::Both }
    }
}

/// A part of the gait with the same legs on the ground.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Domain {
    /// Legs that stand, in the order of their forces among a point's unknowns.
    pub stance: Vec<usize>,
    /// Legs that swing; where the domain ends they land.
    pub swing: Vec<usize>,
    /// Duration over T.
    pub share: f64,
    /// Hermite–Simpson points, odd.
    pub points: usize,
    /// Joints whose ÿ rows the fixed distances of the stance toes make redundant, where joints are prescribed. Empty
    /// where the domain is planned with the tracking law, which leaves no row redundant.
    pub redundant_joints: Vec<usize>,
    /// Where the legs that newly stand are to land, x and y in m. Empty where the stance toes' distance is bounded.
    pub footholds: Vec<Foothold>,
}

/// A leg's place on the floor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Foothold {
    pub leg: usize,
    /// x, y in the world.
    pub place_m: [f64; 2],
}

/// How a schedule's end meets its beginning.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Closure {
    /// Its mirror image is the beginning, moved ahead.
    Mirrored,
    /// It is the beginning, moved by the planar motion.
    Moved,
    /// It does not: the first state is given, and the second one is to be reached, anywhere on the floor.
    Between(Box<[State; 2]>),
}

/// Domains, and where their unknowns lie: α of each, T, every point's, and then by how much a state that is to be
/// reached is missed.
#[derive(Clone, Debug)]
pub(super) struct Schedule {
    pub domains: Vec<Domain>,
    pub closure: Closure,
    /// All toes land whole strides apart: in the middles of stairs.
    pub on_treads: bool,
    places: Vec<Place>,
    /// First of what is missed.
    missed: usize,
    /// Number of the unknowns.
    pub unknowns: usize,
}

impl Schedule {
    /// One step and its mirror image, or the two steps of a stride.
    pub fn of(robot: &Robot, steps: Steps, points: usize) -> Self {
        let [first, second] = Self::two_steps(robot, points);
        match steps {
            Steps::Mirrored => Self::new(vec![first], Closure::Mirrored),
            Steps::Both => Self::new(vec![first, second], Closure::Moved),
        }
    }

    /// Two steps from a state to a state.
    pub fn between(robot: &Robot, states: [State; 2], points: usize) -> Self {
        Self::new(Self::two_steps(robot, points).into(), Closure::Between(Box::new(states)))
    }

    /// A contact schedule's first half where the second is its mirror image, else a stride. Footholds are none yet.
    pub fn of_contacts(
        mirror: &Mirror,
        request: &GaitRequest,
        contacts: &ContactSchedule,
        grid: Grid,
        on_treads: bool,
    ) -> Self {
        let domain = |phase: Phase| {
            let legs = |stand: bool| (0..LEGS).filter(|leg| phase.stands[*leg] == stand).collect::<Vec<_>>();
            let swing = legs(false);
            let points = if swing.is_empty() { grid.four_legs } else { grid.swing };
            let (redundant_joints, footholds) = (Vec::new(), Vec::new());
            Domain { stance: legs(true), swing, share: phase.share, points, redundant_joints, footholds }
        };
        let mut phases = contacts.phases();
        // Mirror images land half a stride apart.
        let closure = match (contacts.is_mirrored(), request.is_mirrored() && !on_treads) {
            (true, true) => Closure::Mirrored,
            (true, false) => {
                let image = |phase: &Phase| {
                    let mut stands = [false; LEGS];
                    (0..LEGS).for_each(|leg| stands[mirror.leg[leg]] = phase.stands[leg]);
                    Phase { stands, ..*phase }
                };
                let images: Vec<Phase> = phases.iter().map(image).collect();
                phases.extend(images);
                Closure::Moved
            }
            (false, _) => Closure::Moved,
        };
        Self { on_treads, ..Self::new(phases.into_iter().map(domain).collect(), closure) }
    }

    fn two_steps(robot: &Robot, points: usize) -> [Domain; 2] {
        let step = |leg: &dyn Fn(usize) -> usize| Domain {
            stance: STANCE.map(leg).to_vec(),
            swing: SWING.map(leg).to_vec(),
            share: 1.0,
            points,
            redundant_joints: vec![3 * leg(REDUNDANT_LEG)],
            footholds: Vec::new(),
        };
        [step(&|leg| leg), step(&|leg| robot.mirror.leg[leg])]
    }

    pub fn new(domains: Vec<Domain>, closure: Closure) -> Self {
        let mut places = Vec::new();
        let several = domains.len() > 1;
        let (mut column, mut before) = (domains.len() * COEFFICIENTS * JOINTS + 1, 0.0);
        for (domain, d) in domains.iter().enumerate() {
            for point in 0..d.points {
                let phase = point as f64 / (d.points - 1) as f64;
                places.push(Place {
                    layout: PhantomData,
                    index: places.len(),
                    column,
                    domain,
                    point,
                    points: d.points,
                    phase,
                    share: d.share,
                    time: before + d.share * phase,
                    step: Step(several.then_some(domain + 1)),
                });
                column += at::LAMBDA + 3 * d.stance.len();
            }
            before += d.share;
        }
        let missed = match (&closure, domains.last()) {
            (Closure::Between(_), Some(last)) => goal::parts(&last.stance, &last.swing).count(),
            _ => 0,
        };
        Self { domains, closure, on_treads: false, places, missed: column, unknowns: column + missed }
    }

    /// Column of coefficient `k` of a joint's polynomial in a domain.
    pub fn alpha(&self, domain: usize, k: usize, joint: usize) -> usize {
        (domain * COEFFICIENTS + k) * JOINTS + joint
    }

    /// Column of T.
    pub fn t(&self) -> usize {
        self.domains.len() * COEFFICIENTS * JOINTS
    }

    /// Columns of what is missed of the state that is to be reached.
    pub fn missed(&self) -> std::ops::Range<usize> {
        self.missed..self.unknowns
    }

    /// Whether it leads from a state to a state.
    pub fn is_between(&self) -> bool {
        matches!(self.closure, Closure::Between(_))
    }

    /// Every point.
    pub fn places(&self) -> &[Place] {
        &self.places
    }

    /// A domain's points.
    pub fn places_of(&self, domain: usize) -> &[Place] {
        let first = self.domains[..domain].iter().map(|d| d.points).sum::<usize>();
        &self.places[first..first + self.domains[domain].points]
    }

    /// Legs that stand at a point, with the first column of each one's force.
    pub fn forces(&self, place: &Place) -> impl Iterator<Item = (usize, usize)> {
        let first = place.column + at::LAMBDA;
        self.domains[place.domain].stance.iter().enumerate().map(move |(k, &leg)| (leg, first + 3 * k))
    }

    /// A point's columns.
    pub fn columns(&self, place: &Place) -> std::ops::Range<usize> {
        place.column..place.column + at::LAMBDA + 3 * self.domains[place.domain].stance.len()
    }

    /// The whole schedule's duration over T.
    pub fn duration(&self) -> f64 {
        self.domains.iter().map(|d| d.share).sum()
    }

    /// Legs that stand in the domain before, where there is one: the last one's, as the schedule closes, for the first.
    fn stance_before(&self, mirror: &Mirror, domain: usize) -> Option<Vec<usize>> {
        let last = &self.domains[(domain + self.domains.len() - 1) % self.domains.len()].stance;
        match (&self.closure, domain) {
            (Closure::Between(_), 0) => None,
            (Closure::Mirrored, 0) => Some(last.iter().map(|&leg| mirror.leg[leg]).collect()),
            _ => Some(last.clone()),
        }
    }

    /// Legs that stand in a domain and did not before, or all where nothing is before.
    pub fn newly_standing(&self, mirror: &Mirror, domain: usize) -> Vec<usize> {
        let before = self.stance_before(mirror, domain).unwrap_or_default();
        self.domains[domain].stance.iter().copied().filter(|leg| !before.contains(leg)).collect()
    }

    /// Legs that swing in a domain and stand in the next one, the first as the schedule closes.
    pub fn landing(&self, mirror: &Mirror, domain: usize) -> Vec<usize> {
        let next = &self.domains[(domain + 1) % self.domains.len()].stance;
        let is_mirrored = domain + 1 == self.domains.len() && self.closure == Closure::Mirrored;
        let stands = |leg: &usize| next.contains(&if is_mirrored { mirror.leg[*leg] } else { *leg });
        self.domains[domain].swing.iter().copied().filter(stands).collect()
    }

    /// Whether legs are to land at places of their own.
    pub fn has_footholds(&self) -> bool {
        self.domains.iter().any(|d| !d.footholds.is_empty())
    }
}
