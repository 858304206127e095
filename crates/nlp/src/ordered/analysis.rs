//! Which equality belongs where, found once from the Jacobian's pattern.

use super::Order;
use crate::problem::Problem;

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

/// A group's equalities; their entries are split like a stage's.
pub(super) struct LoadPattern {
    pub rows: Vec<StageRow>,
    pub columns: Vec<usize>,
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
}

impl Structure {
    pub fn new(problem: &impl Problem, order: &Order) -> Option<Self> {
        let b = problem.bounds();
        let (n, m) = (b.variable_lower.len(), b.constraint_lower.len());
        let mut rows: Vec<Vec<Entry>> = vec![Vec::new(); m];
        for (place, &(row, column)) in problem.jacobian_pattern().0.iter().enumerate() {
            rows[row].push((column, place));
        }
        let mut hessian = vec![None; n];
        for (place, &(row, column)) in problem.hessian_pattern().0.iter().enumerate() {
            if row != column {
                return None;
            }
            hessian[row] = Some(place);
        }
        let is_equality = |i: usize| b.constraint_lower[i] == b.constraint_upper[i];
        let is_fixed = |i: usize| b.variable_lower[i] == b.variable_upper[i];
        let finite = |lower: f64, upper: f64| lower.is_finite() || upper.is_finite();
        let mut ties: Vec<Tie> = (0..n).filter(|&i| is_fixed(i)).map(Tie::Variable).collect();
        ties.extend(order.ties.iter().map(|&row| Tie::Constraint(row)));

        let mut sorter = Sorter::new(n, rows, (0..m).map(is_equality).collect(), order);
        let loads = sorter.loads(&order.loads)?;
        let stages = order.stages.iter().map(|stage| sorter.stage(&stage.chain, &stage.core)).collect::<Option<_>>()?;
        if !sorter.is_complete() {
            return None;
        }
        let mut met_by = vec![None; n];
        for (k, load) in loads.iter().enumerate() {
            load.columns.iter().for_each(|&column| met_by[column] = Some(k));
        }
        let rows = sorter.rows;
        let mut inequalities = Vec::new();
        for i in (0..m).filter(|&i| !is_equality(i) && finite(b.constraint_lower[i], b.constraint_upper[i])) {
            let mut met: Vec<usize> = rows[i].iter().filter_map(|e| met_by[e.0]).collect();
            met.dedup();
            if met.len() > 1 {
                return None;
            }
            inequalities.push((i, met.first().copied().unwrap_or(0)));
        }
        let bounded = (0..n).filter(|&i| !is_fixed(i) && finite(b.variable_lower[i], b.variable_upper[i])).collect();
        let inputs = order.inputs.clone();
        let load_of = met_by.into_iter().map(|load| load.unwrap_or(0)).collect();
        let mut structure =
            Self { variables: n, rows, inputs, loads, stages, ties, inequalities, bounded, load_of, hessian };
        structure.find_tied();
        Some(structure)
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
    /// Equalities still to be handed out that hold each variable.
    holders: Vec<Vec<Source>>,
    known: Vec<bool>,
    waiting: usize,
    /// Each variable's place within the stage at hand.
    place: Vec<Option<usize>>,
}

impl Sorter {
    fn new(variables: usize, rows: Vec<Vec<Entry>>, is_equality: Vec<bool>, order: &Order) -> Self {
        let mut known = vec![false; variables];
        order.inputs.iter().for_each(|&input| known[input] = true);
        let mut waits = is_equality;
        order.ties.iter().for_each(|&row| waits[row] = false);
        let mut holders = vec![Vec::new(); variables];
        for (row, entries) in rows.iter().enumerate().filter(|(row, _)| waits[*row]) {
            entries.iter().for_each(|e| holders[e.0].push(Source::Constraint(row)));
        }
        let waiting = waits.iter().filter(|waits| **waits).count();
        Self { rows, left: Vec::new(), holders, known, waiting, place: vec![None; variables] }
    }

    fn entries(&self, source: Source) -> &[Entry] {
        match source {
            Source::Constraint(row) => &self.rows[row],
            Source::Left(load) => &self.left[load],
        }
    }

    /// The equalities that hold any of the variables, each once.
    fn holding(&self, columns: &[usize]) -> Vec<Source> {
        let mut found = Vec::new();
        for source in columns.iter().flat_map(|&column| &self.holders[column]) {
            if !found.contains(source) {
                found.push(*source);
            }
        }
        found
    }

    /// Takes equalities out of those to be handed out, and splits their entries.
    fn take(&mut self, sources: &[Source], columns: &[usize]) -> Vec<StageRow> {
        for (place, &column) in columns.iter().enumerate() {
            self.place[column] = Some(place);
        }
        let split = |&source: &Source| {
            let mut row = StageRow { source, inside: Vec::new(), known: Vec::new() };
            for &(column, number) in self.entries(source) {
                match self.place[column] {
                    Some(place) => row.inside.push((place, number)),
                    None => row.known.push((column, number)),
                }
            }
            row
        };
        let rows: Vec<StageRow> = sources.iter().map(split).collect();
        columns.iter().for_each(|&column| self.place[column] = None);
        for &source in sources {
            let columns: Vec<usize> = self.entries(source).iter().map(|e| e.0).collect();
            columns.into_iter().for_each(|column| self.holders[column].retain(|s| *s != source));
        }
        self.waiting -= sources.len();
        rows
    }

    fn loads(&mut self, groups: &[Vec<usize>]) -> Option<Vec<LoadPattern>> {
        let mut loads = Vec::new();
        for (k, columns) in groups.iter().enumerate() {
            let sources = self.holding(columns);
            if sources.len() != columns.len() {
                return None;
            }
            let rows = self.take(&sources, columns);
            let mut others: Vec<usize> = rows.iter().flat_map(|row| &row.known).map(|e| e.0).collect();
            others.sort_unstable();
            others.dedup();
            others.iter().for_each(|&column| self.holders[column].push(Source::Left(k)));
            self.left.push(others.iter().enumerate().map(|(place, &column)| (column, place)).collect());
            self.waiting += 1;
            loads.push(LoadPattern { rows, columns: columns.clone(), others });
        }
        Some(loads)
    }

    /// The equalities on a stage's unknowns and on what is known; those of its chain first.
    fn stage(&mut self, chain: &[usize], core: &[usize]) -> Option<StagePattern> {
        let columns: Vec<usize> = chain.iter().chain(core).copied().collect();
        if columns.iter().any(|&column| self.known[column]) {
            return None;
        }
        columns.iter().for_each(|&column| self.known[column] = true);
        let is_ready = |source: &Source| self.entries(*source).iter().all(|e| self.known[e.0]);
        let mut sources = self.holding(&columns);
        sources.retain(is_ready);
        if sources.len() != columns.len() {
            return None;
        }
        let mut rows = self.take(&sources, &columns);
        for k in 0..chain.len() {
            let holds = |row: &StageRow| row.inside.iter().any(|e| e.0 == k);
            let shortest = (k..rows.len()).filter(|&r| holds(&rows[r])).min_by_key(|&r| rows[r].inside.len())?;
            rows.swap(k, shortest);
        }
        Some(StagePattern { rows, columns, chain: chain.len(), tied: true })
    }

    /// Whether every equality has found its place.
    fn is_complete(&self) -> bool {
        self.waiting == 0
    }
}
