//! Which equality belongs where, found once from the Jacobian's pattern.

use super::Order;
use crate::problem::{Pattern, Problem};

/// An entry of a row: the variable and the place of its number among the row's numbers.
pub(super) type Entry = (usize, usize);

/// Where an equality of a stage comes from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Source {
    Constraint(usize),
    /// What a load leaves.
    Left(usize),
}

/// An equality of a stage.
pub(super) struct StageRow {
    pub source: Source,
    /// The stage's own unknowns, counted within it.
    pub inside: Vec<Entry>,
    /// Variables that are known before.
    pub known: Vec<Entry>,
}

/// As many equalities as unknowns. The first `chain` of both belong together.
pub(super) struct StagePattern {
    pub rows: Vec<StageRow>,
    pub columns: Vec<usize>,
    pub chain: usize,
    /// Whether the ties hang on it.
    pub tied: bool,
}

/// A group's equalities; their entries are split like a stage's. Behind the `core` first of both, each unknown belongs
/// to the equality at its place, the only one that holds it.
pub(super) struct LoadPattern {
    pub rows: Vec<StageRow>,
    pub columns: Vec<usize>,
    pub core: usize,
    /// Variables of the equality that is left.
    pub others: Vec<usize>,
}

/// An equality on the inputs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Tie {
    Constraint(usize),
    Variable(usize),
}

/// The patterns of an elimination.
pub(super) struct Structure {
    pub variables: usize,
    /// Entries of every constraint.
    pub rows: Vec<Vec<Entry>>,
    pub inputs: Vec<usize>,
    pub loads: Vec<LoadPattern>,
    pub stages: Vec<StagePattern>,
    pub ties: Vec<Tie>,
    /// Constraints that are no equalities, and the load that they meet; 0 where they meet none.
    pub inequalities: Vec<(usize, usize)>,
    /// Variables with bounds that leave more than one value.
    pub bounded: Vec<usize>,
    /// The load that each variable belongs to; 0 where it belongs to none.
    pub load_of: Vec<usize>,
    /// Place of each variable among the Hessian's values, where it has one.
    pub hessian: Vec<Option<usize>>,
    /// What it was read off.
    of: Of,
}

/// What decides where equalities belong.
#[derive(PartialEq)]
struct Of {
    order: Order,
    jacobian: Pattern,
    hessian: Pattern,
    /// Of variables and constraints.
    kinds: [Vec<Kind>; 2],
}

/// What bounds leave.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    OneValue,
    Some,
    All,
}

/// Empty lists, with room for as many entries as each is named.
fn with_capacities<T>(lists: usize, named: impl Iterator<Item = usize>) -> Vec<Vec<T>> {
    let mut counts = vec![0; lists];
    named.for_each(|list| counts[list] += 1);
    counts.into_iter().map(Vec::with_capacity).collect()
}

fn kinds(lower: &[f64], upper: &[f64]) -> Vec<Kind> {
    let of = |(lower, upper): (&f64, &f64)| match lower.is_finite() || upper.is_finite() {
        _ if lower == upper => Kind::OneValue,
        true => Kind::Some,
        false => Kind::All,
    };
    lower.iter().zip(upper).map(of).collect()
}

impl Of {
    fn new(problem: &impl Problem, order: &Order) -> Self {
        let b = problem.bounds();
        Self {
            order: order.clone(),
            jacobian: problem.jacobian_pattern().clone(),
            hessian: problem.hessian_pattern().clone(),
            kinds: [kinds(&b.variable_lower, &b.variable_upper), kinds(&b.constraint_lower, &b.constraint_upper)],
        }
    }
}

impl Structure {
    pub fn new(problem: &impl Problem, order: &Order) -> Option<Self> {
        let of = Of::new(problem, order);
        let [variables, constraints] = &of.kinds;
        let (n, m) = (variables.len(), constraints.len());
        let mut rows = with_capacities(m, of.jacobian.0.iter().map(|entry| entry.0));
        for (place, &(row, column)) in of.jacobian.0.iter().enumerate() {
            rows[row].push((column, place));
        }
        let mut hessian = vec![None; n];
        for (place, &(row, column)) in of.hessian.0.iter().enumerate() {
            if row != column {
                return None;
            }
            hessian[row] = Some(place);
        }
        let mut ties: Vec<Tie> = (0..n).filter(|&i| variables[i] == Kind::OneValue).map(Tie::Variable).collect();
        ties.extend(order.ties.iter().map(|&row| Tie::Constraint(row)));

        let mut sorter = Sorter::new(n, rows, constraints, order);
        let loads = sorter.loads(&order.loads)?;
        let stages = order.stages.iter().map(|stage| sorter.stage(&stage.chain, &stage.core)).collect::<Option<_>>()?;
        if !sorter.is_complete() {
            return None;
        }
        let rows = sorter.rows;
        let mut met_by = vec![None; n];
        for (k, load) in loads.iter().enumerate() {
            load.columns.iter().for_each(|&column| met_by[column] = Some(k));
        }
        let mut inequalities = Vec::new();
        for i in (0..m).filter(|&i| constraints[i] == Kind::Some) {
            let mut met: Vec<usize> = rows[i].iter().filter_map(|e| met_by[e.0]).collect();
            met.dedup();
            if met.len() > 1 {
                return None;
            }
            inequalities.push((i, met.first().copied().unwrap_or(0)));
        }
        let bounded = (0..n).filter(|&i| variables[i] == Kind::Some).collect();
        let inputs = order.inputs.clone();
        let load_of = met_by.into_iter().map(|load| load.unwrap_or(0)).collect();
        let mut structure =
            Self { variables: n, rows, inputs, loads, stages, ties, inequalities, bounded, load_of, hessian, of };
        structure.find_tied();
        Some(structure)
    }

    /// Whether it is that of a problem and an order.
    pub fn fits(&self, problem: &impl Problem, order: &Order) -> bool {
        let (b, of) = (problem.bounds(), &self.of);
        of.order == *order
            && of.jacobian == *problem.jacobian_pattern()
            && of.hessian == *problem.hessian_pattern()
            && of.kinds[0] == kinds(&b.variable_lower, &b.variable_upper)
            && of.kinds[1] == kinds(&b.constraint_lower, &b.constraint_upper)
    }

    /// Marks the stages that the ties hang on.
    fn find_tied(&mut self) {
        let mut wanted = vec![false; self.variables];
        for tie in &self.ties {
            match *tie {
                Tie::Variable(column) => wanted[column] = true,
                Tie::Constraint(row) => self.rows[row].iter().for_each(|e| wanted[e.0] = true),
            }
        }
        for stage in self.stages.iter_mut().rev() {
            stage.tied = stage.columns.iter().any(|&column| wanted[column]);
            if stage.tied {
                stage.rows.iter().flat_map(|row| &row.known).for_each(|e| wanted[e.0] = true);
            }
        }
    }
}

/// Hands equalities to the stages.
struct Sorter {
    rows: Vec<Vec<Entry>>,
    /// What loads leave.
    left: Vec<Vec<Entry>>,
    /// Equalities that hold each variable.
    holders: Vec<Vec<Source>>,
    known: Vec<bool>,
    /// Whether each constraint, and what each load leaves, is still to be handed out.
    waits: [Vec<bool>; 2],
    /// Each variable's place within the stage at hand.
    place: Vec<Option<usize>>,
}

impl Sorter {
    fn new(variables: usize, rows: Vec<Vec<Entry>>, constraints: &[Kind], order: &Order) -> Self {
        let mut known = vec![false; variables];
        order.inputs.iter().for_each(|&input| known[input] = true);
        let mut waits: Vec<bool> = constraints.iter().map(|kind| *kind == Kind::OneValue).collect();
        order.ties.iter().for_each(|&row| waits[row] = false);
        let waiting = || rows.iter().enumerate().filter(|(row, _)| waits[*row]);
        let mut holders = with_capacities(variables, waiting().flat_map(|(_, entries)| entries).map(|e| e.0));
        for (row, entries) in waiting() {
            entries.iter().for_each(|e| holders[e.0].push(Source::Constraint(row)));
        }
        Self { rows, left: Vec::new(), holders, known, waits: [waits, Vec::new()], place: vec![None; variables] }
    }

    fn waits(&mut self, source: Source) -> &mut bool {
        match source {
            Source::Constraint(row) => &mut self.waits[0][row],
            Source::Left(load) => &mut self.waits[1][load],
        }
    }

    fn entries(&self, source: Source) -> &[Entry] {
        match source {
            Source::Constraint(row) => &self.rows[row],
            Source::Left(load) => &self.left[load],
        }
    }

    /// The equalities still to be handed out that hold any of the variables and fit, each once. They count as handed
    /// out.
    fn holding(&mut self, columns: &[usize], fits: impl Fn(&Self, Source) -> bool) -> Vec<Source> {
        let mut found = Vec::new();
        for &column in columns {
            for k in 0..self.holders[column].len() {
                let source = self.holders[column][k];
                if *self.waits(source) && fits(self, source) {
                    *self.waits(source) = false;
                    found.push(source);
                }
            }
        }
        found
    }

    /// Splits the entries of equalities that are handed out.
    fn split(&mut self, sources: &[Source], columns: &[usize]) -> Vec<StageRow> {
        for (place, &column) in columns.iter().enumerate() {
            self.place[column] = Some(place);
        }
        let split = |&source: &Source| {
            let entries = self.entries(source);
            let inside = entries.iter().filter(|e| self.place[e.0].is_some()).count();
            let (inside, known) = (Vec::with_capacity(inside), Vec::with_capacity(entries.len() - inside));
            let mut row = StageRow { source, inside, known };
            for &(column, number) in entries {
                match self.place[column] {
                    Some(place) => row.inside.push((place, number)),
                    None => row.known.push((column, number)),
                }
            }
            row
        };
        let rows: Vec<StageRow> = sources.iter().map(split).collect();
        columns.iter().for_each(|&column| self.place[column] = None);
        rows
    }

    fn loads(&mut self, groups: &[Vec<usize>]) -> Option<Vec<LoadPattern>> {
        let mut loads = Vec::new();
        for (k, columns) in groups.iter().enumerate() {
            let sources = self.holding(columns, |_, _| true);
            if sources.len() != columns.len() {
                return None;
            }
            let (core, sources, columns) = self.with_singles_last(sources, columns)?;
            let rows = self.split(&sources, &columns);
            let mut others: Vec<usize> = rows[..core].iter().flat_map(|row| &row.known).map(|e| e.0).collect();
            others.sort_unstable();
            others.dedup();
            others.iter().for_each(|&column| self.holders[column].push(Source::Left(k)));
            self.left.push(others.iter().enumerate().map(|(place, &column)| (column, place)).collect());
            self.waits[1].push(true);
            loads.push(LoadPattern { rows, columns, core, others });
        }
        Some(loads)
    }

    /// A load's equalities and unknowns, those last that belong together because no other equality holds the unknown,
    /// and how many are before them. None where two unknowns have one equality to themselves.
    fn with_singles_last(&self, sources: Vec<Source>, columns: &[usize]) -> Option<(usize, Vec<Source>, Vec<usize>)> {
        let holds = |source: &Source, column: usize| self.entries(*source).iter().any(|e| e.0 == column);
        let mut singles: Vec<(Source, usize)> = Vec::new();
        let mut core = Vec::new();
        for &column in columns {
            let mut holding = sources.iter().filter(|source| holds(source, column));
            match (holding.next(), holding.next()) {
                (Some(source), None) => singles.push((*source, column)),
                _ => core.push(column),
            }
        }
        let is_single = |source: &Source| singles.iter().any(|single| single.0 == *source);
        let mut rows: Vec<Source> = sources.iter().filter(|source| !is_single(source)).copied().collect();
        let count = core.len();
        if rows.len() != count {
            return None;
        }
        rows.extend(singles.iter().map(|single| single.0));
        core.extend(singles.iter().map(|single| single.1));
        Some((count, rows, core))
    }

    /// The equalities on a stage's unknowns and on what is known; those of its chain first.
    fn stage(&mut self, chain: &[usize], core: &[usize]) -> Option<StagePattern> {
        let columns: Vec<usize> = chain.iter().chain(core).copied().collect();
        if columns.iter().any(|&column| self.known[column]) {
            return None;
        }
        columns.iter().for_each(|&column| self.known[column] = true);
        let is_ready = |all: &Self, source: Source| all.entries(source).iter().all(|e| all.known[e.0]);
        let sources = self.holding(&columns, is_ready);
        if sources.len() != columns.len() {
            return None;
        }
        let mut rows = self.split(&sources, &columns);
        for k in 0..chain.len() {
            let holds = |row: &StageRow| row.inside.iter().any(|e| e.0 == k);
            let shortest = (k..rows.len()).filter(|&r| holds(&rows[r])).min_by_key(|&r| rows[r].inside.len())?;
            rows.swap(k, shortest);
        }
        Some(StagePattern { rows, columns, chain: chain.len(), tied: true })
    }

    /// Whether every equality has found its place.
    fn is_complete(&self) -> bool {
        self.waits.iter().flatten().all(|waits| !waits)
    }
}
