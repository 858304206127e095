//! What a program's derivatives are written to.

use nlp::Pattern;

/// Takes the Jacobian's nonzeros in one fixed order.
pub(crate) enum Sink<'a> {
    /// Their rows and columns.
    Places(Vec<(usize, usize)>),
    /// Their values.
    Values(std::slice::IterMut<'a, f64>),
    /// Of each row the size of its largest entry.
    Steepest(&'a mut [f64]),
}

impl Sink<'_> {
    /// The places that it took.
    pub fn into_pattern(self) -> Pattern {
        match self {
            Self::Places(places) => Pattern(places),
            Self::Values(_) | Self::Steepest(_) => unreachable!("it takes no places"),
        }
    }
}

/// Takes the derivatives of a term's rows, counted from its first.
pub(crate) struct Rows<'a, 'b> {
    first: usize,
    sink: &'a mut Sink<'b>,
}

impl<'a, 'b> Rows<'a, 'b> {
    pub fn new(first: usize, sink: &'a mut Sink<'b>) -> Self {
        Self { first, sink }
    }

    #[inline(always)]
    pub fn put(&mut self, row: usize, column: usize, value: f64) {
        let row = self.first + row;
        match self.sink {
            Sink::Places(places) => places.push((row, column)),
            Sink::Values(values) => *values.next().expect("there are as many values as places") = value,
            // A comparison, for `f64::max` minds values that are not numbers and takes three times as long.
            Sink::Steepest(steepest) if value.abs() > steepest[row] => steepest[row] = value.abs(),
            Sink::Steepest(_) => {}
        }
    }
}
