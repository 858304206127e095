//! Subproblems by elimination in an order that comes with the problem.
//!
//! A program along time has an order in which its equalities are solved without a search and without fill: from a few
//! **inputs** the other unknowns follow **stage** by stage, each stage a small square system on what is known by then
//! ([`Order`]). Equalities that join what happens at different times, the **ties**, are left: they are rows on the
//! inputs alone, and leave few of them free. Where the unknowns of a group of equalities are one more than these
//! determine (the force along the line between two stance toes), that one is an unknown of its own, which meets
//! nothing but its group; in return the group leaves one equality to the stages. So the program that remains is an
//! arrow ([`crate::ArrowQp`]). Which equality belongs to which stage is read off the Jacobian's pattern.
//!
//! The unknowns are followed twice, as functions of all inputs for the ties, and then of what the ties leave free,
//! which costs less than substituting would. Elimination within a stage is found once for both.

mod analysis;
mod arrow;
mod loads;
mod stages;
mod ties;

use crate::arrow_qp::{ArrowQp, ArrowQpError, DualActiveSet};
use crate::problem::{Evaluation, Problem, Step, Subproblem, SubproblemError};
use crate::qp::Qp;
use analysis::Structure;
use loads::Load;
use stages::Factor;

/// In which order a problem's equalities are solved, said by the unknowns that they are solved for.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Order {
    /// Unknowns from which the others follow.
    pub inputs: Vec<usize>,
    /// Groups of unknowns with as many equalities that hold any of them, of which all but one are independent.
    pub loads: Vec<Vec<usize>>,
    /// What follows, one stage after the other.
    pub stages: Vec<Stage>,
    /// Constraints that are left to the end, as rows on the inputs. Unknowns whose bounds leave one value join them:
    /// these have to be inputs.
    pub ties: Vec<usize>,
}

/// Unknowns that follow together.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Stage {
    /// Those that are taken out one by one, each with the shortest of the stage's equalities that holds it.
    pub chain: Vec<usize>,
    /// Those that are left then: a dense system.
    pub core: Vec<usize>,
}

/// Solves the subproblems of a problem with an [`Order`]: at most INPUTS − 1 inputs, of which the ties leave at most
/// FREE − 1. What elimination does not suit Clarabel solves.
pub struct Ordered<const INPUTS: usize, const FREE: usize> {
    structure: Structure,
    numbers: Numbers<INPUTS, FREE>,
    qp: ArrowQp<FREE>,
    solver: DualActiveSet<FREE>,
    sparse: Option<Qp>,
    scale: f64,
}

/// The numbers of an elimination.
struct Numbers<const INPUTS: usize, const FREE: usize> {
    factors: Vec<Factor>,
    loads: Vec<Load>,
    /// Every variable's step as a function of all inputs, where the ties ask for it. The constant is the last entry,
    /// here and below.
    by_inputs: Vec<[f64; INPUTS]>,
    input_rows: Vec<[f64; INPUTS]>,
    /// Every variable's step as a function of the free inputs; what it takes of its load's own unknown is in `own`.
    by_free: Vec<[f64; FREE]>,
    free_rows: Vec<[f64; FREE]>,
    own: Vec<f64>,
    /// How many inputs are free.
    free: usize,
    /// Equalities summed by column.
    work: Vec<f64>,
}

/// What a subproblem is asked about.
#[derive(Clone, Copy)]
struct Asked<'a> {
    x: &'a [f64],
    at: &'a Evaluation,
    constraints: &'a [f64],
    /// Lower bounds of variables and of constraints: of equalities their value.
    variable_values: &'a [f64],
    constraint_values: &'a [f64],
}

impl<const INPUTS: usize, const FREE: usize> Ordered<INPUTS, FREE> {
    /// `scale` multiplies the objective where Clarabel has to help, so that its absolute tolerances fit it. None where
    /// the order does not fit the problem: too many inputs, a stage with more or fewer equalities than unknowns, an
    /// equality that no stage solves, or a Hessian that is not diagonal.
    pub fn new(problem: &impl Problem, order: &Order, scale: f64) -> Option<Self> {
        let structure = Structure::new(problem, order)?;
        let inputs = order.inputs.len();
        if inputs >= INPUTS || inputs >= FREE + structure.ties.len() {
            return None;
        }
        Some(Self {
            numbers: Numbers {
                factors: vec![Factor::default(); structure.stages.len()],
                loads: vec![Load::default(); structure.loads.len()],
                by_inputs: Vec::new(),
                input_rows: Vec::new(),
                by_free: Vec::new(),
                free_rows: Vec::new(),
                own: Vec::new(),
                free: 0,
                work: Vec::new(),
            },
            structure,
            qp: ArrowQp::default(),
            solver: DualActiveSet::default(),
            sparse: None,
            scale,
        })
    }

    /// Whether it can be used for a problem and an order as it is.
    pub fn fits(&self, problem: &impl Problem, order: &Order) -> bool {
        self.structure.fits(problem, order)
    }

    /// Forgets which rows were active: what it gives next depends on nothing before.
    pub fn forget(&mut self) {
        self.solver.forget();
    }

    #[inline(always)]
    fn step_of_any_width(&mut self, problem: &impl Problem, asked: Asked) -> Result<Step, SubproblemError> {
        let (numbers, structure) = (&mut self.numbers, &self.structure);
        numbers.reduce(structure, asked)?;
        numbers.assemble(structure, problem, asked, &mut self.qp);
        self.solver.solve(&self.qp).map_err(|e| match e {
            ArrowQpError::Infeasible { .. } => SubproblemError::Infeasible,
            e => SubproblemError::Stopped(e.to_string()),
        })?;
        let step = numbers.expand(structure, &self.solver);
        if step.iter().any(|p| !p.is_finite()) {
            return Err(SubproblemError::Stopped("the step is not a number".into()));
        }
        Ok(Step { step, multipliers: None, iterations: self.solver.iterations })
    }

    /// [`Self::step_of_any_width`] for processors with registers twice as wide. Without fused multiplications every sum
    /// is rounded as it is elsewhere, so both give the same step to the bit.
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    fn step_with_avx2(&mut self, problem: &impl Problem, asked: Asked) -> Result<Step, SubproblemError> {
        self.step_of_any_width(problem, asked)
    }

    fn step(&mut self, problem: &impl Problem, asked: Asked) -> Result<Step, SubproblemError> {
        #[cfg(target_arch = "x86_64")]
        if std::arch::is_x86_feature_detected!("avx2") {
            // SAFETY: this processor has the instructions that the function is compiled for.
            return unsafe { self.step_with_avx2(problem, asked) };
        }
        self.step_of_any_width(problem, asked)
    }
}

impl<P: Problem, const INPUTS: usize, const FREE: usize> Subproblem<P> for Ordered<INPUTS, FREE> {
    fn solve(&mut self, problem: &P, x: &[f64], at: &Evaluation, constraints: &[f64]) -> Result<Step, SubproblemError> {
        let bounds = problem.bounds();
        let (variable_values, constraint_values) = (&bounds.variable_lower[..], &bounds.constraint_lower[..]);
        match self.step(problem, Asked { x, at, constraints, variable_values, constraint_values }) {
            // Clarabel tells what is the matter.
            Err(SubproblemError::Stopped(_)) => {
                let scale = self.scale;
                self.sparse.get_or_insert_with(|| Qp::new(problem, false, scale)).solve(problem, x, at, constraints)
            }
            found => found,
        }
    }
}

#[inline(always)]
fn add<const W: usize>(to: &mut [f64; W], scale: f64, from: &[f64; W]) {
    for (to, from) in to.iter_mut().zip(from) {
        *to += scale * from;
    }
}

impl<const INPUTS: usize, const FREE: usize> Numbers<INPUTS, FREE> {
    /// Every variable as a function of what the ties leave free.
    #[inline(always)]
    fn reduce(&mut self, structure: &Structure, asked: Asked) -> Result<(), SubproblemError> {
        self.work.resize(structure.variables, 0.0);
        self.own.clear();
        self.own.resize(structure.variables, 0.0);
        for (load, pattern) in self.loads.iter_mut().zip(&structure.loads) {
            load.factorise(pattern, asked, &mut self.work)?;
            for (&column, share) in pattern.columns.iter().zip(&load.own) {
                self.own[column] = *share;
            }
        }
        for (factor, pattern) in self.factors.iter_mut().zip(&structure.stages) {
            factor.factorise(pattern, asked, &self.loads)?;
        }
        if self.by_inputs.len() != structure.variables {
            // New memory is 0 already, which filling it does not know.
            self.by_inputs = vec![[0.0; INPUTS]; structure.variables];
            self.by_free = vec![[0.0; FREE]; structure.variables];
        }
        for (k, &input) in structure.inputs.iter().enumerate() {
            self.by_inputs[input] = [0.0; INPUTS];
            self.by_inputs[input][k] = 1.0;
        }
        let rows = &mut self.input_rows;
        for (factor, pattern) in self.factors.iter().zip(&structure.stages).filter(|(_, pattern)| pattern.tied) {
            factor.follow(pattern, asked, &self.loads, &mut self.by_inputs, rows);
        }
        let (free, inputs) = ties::solve::<INPUTS, FREE>(structure, asked, &self.by_inputs)?;
        self.free = free;
        for (&input, row) in structure.inputs.iter().zip(inputs) {
            self.by_free[input] = row;
        }
        let rows = &mut self.free_rows;
        for (factor, pattern) in self.factors.iter().zip(&structure.stages) {
            factor.follow(pattern, asked, &self.loads, &mut self.by_free, rows);
        }
        for (load, pattern) in self.loads.iter().zip(&structure.loads) {
            load.follow(pattern, asked, &mut self.by_free, rows);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
