//! A domain of a gait made ready for the control cycle, and which domains the controller walks.

use crate::JOINTS;
use crate::step::LEAD_STEPS;
use gait::{Coefficients, Domain, Gait, GaitError, LEG_NAMES, LEGS, MAX_CYCLE_DOMAINS, StepSide};

/// The legs of a side, and of an end.
const ONE_SIDED: [[bool; LEGS]; 4] =
    [[true, true, false, false], [false, false, true, true], [true, false, true, false], [false, true, false, true]];

/// A domain: which legs stand, how long, and how the joints move.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub(crate) struct PreparedDomain {
    pub stands: [bool; LEGS],
    pub duration_s: f64,
    pub polynomials: Polynomials,
}

/// A step's polynomials.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub(crate) struct Polynomials {
    pub planned_rad: [Coefficients; JOINTS],
    /// Reference minus plan.
    pub compensation_rad: [Coefficients; JOINTS],
}

/// A gait's cycle in a fixed room, none behind the last; empty: the gait is the trot's two steps.
pub(crate) type Cycle = [Option<PreparedDomain>; MAX_CYCLE_DOMAINS];

impl Polynomials {
    pub fn new(planned_rad: &[Coefficients; JOINTS], reference_rad: &[Coefficients; JOINTS]) -> Self {
        Self { planned_rad: *planned_rad, compensation_rad: compensation(reference_rad, planned_rad) }
    }
}

impl PreparedDomain {
    fn new(domain: &Domain) -> Self {
        let Domain { stands, duration_s, planned_rad, reference_rad } = domain;
        Self { stands: *stands, duration_s: *duration_s, polynomials: Polynomials::new(planned_rad, reference_rad) }
    }
}

/// `reference` minus `planned`.
pub(crate) fn compensation(
    reference: &[Coefficients; JOINTS],
    planned: &[Coefficients; JOINTS],
) -> [Coefficients; JOINTS] {
    std::array::from_fn(|j| std::array::from_fn(|i| reference[j][i] - planned[j][i]))
}

/// The two steps of a gait's lead, if it has one; else what is wrong with it. Into the trot they are two of its steps.
pub(crate) fn lead(gait: &Gait) -> Result<Option<[PreparedDomain; LEAD_STEPS]>, GaitError> {
    if gait.lead.is_empty() {
        return Ok(None);
    }
    let of_trot = |(index, domain): (usize, &Domain)| domain.stands == StepSide::of_step(index as u64).stands();
    let fits = !gait.cycle.is_empty() || gait.lead.iter().enumerate().all(of_trot);
    if gait.lead.len() != LEAD_STEPS || !fits {
        let problem = "is none that is walked: expected two domains, into the trot with rear_left and front_right \
                       standing in the first, front_left and rear_right in the second";
        return Err(GaitError::Value { gait: gait.name.clone(), field: "lead".into(), problem: problem.into() });
    }
    Ok(Some(std::array::from_fn(|index| PreparedDomain::new(&gait.lead[index]))))
}

/// The domains of a gait's cycle; it was validated, and there is room for all.
pub(crate) fn cycle(gait: &Gait) -> Cycle {
    std::array::from_fn(|index| gait.cycle.get(index).map(PreparedDomain::new))
}

/// Refuses a gait of steps over the legs of one side or of one end alone: the body rolls or pitches in them as planned,
/// and the balanced law, to which the gait does not say so, would answer that as a fall.
pub(crate) fn check_balanced(gait: &Gait) -> Result<(), GaitError> {
    let lead = if gait.cycle.is_empty() { &[][..] } else { &gait.lead[..] };
    for (list, domains) in [("lead", lead), ("cycle", &gait.cycle[..])] {
        let one_sided = |domain: &Domain| ONE_SIDED.contains(&domain.stands);
        let Some(index) = domains.iter().position(one_sided) else { continue };
        let legs = (0..LEGS).filter(|leg| domains[index].stands[*leg]).map(|leg| LEG_NAMES[leg]);
        let problem = format!(
            "are {}, expected a diagonal or more than two: the balanced law knows of no planned rolling or pitching; \
             walk it under the bare law, without balance",
            legs.collect::<Vec<_>>().join(" and ")
        );
        return Err(GaitError::Value {
            gait: gait.name.clone(),
            field: format!("{list}[{index}].stance_legs"),
            problem,
        });
    }
    Ok(())
}

/// Whether there is none: for gaits and recordings without.
pub(crate) fn is_no_cycle(cycle: &Cycle) -> bool {
    cycle[0].is_none()
}

/// No cycle.
pub(crate) fn no_cycle() -> Cycle {
    [None; MAX_CYCLE_DOMAINS]
}
