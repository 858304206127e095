//! What a program's derivatives are written to.

/// Takes the Jacobian's nonzeros in one fixed order.
pub(crate) trait Sink {
    fn put(&mut self, row: usize, column: usize, value: f64);
}

/// Their rows and columns.
pub(super) struct Places(pub Vec<(usize, usize)>);

/// Their values.
pub(super) struct Values<'a>(pub std::slice::IterMut<'a, f64>);

/// Of each row the size of its largest entry.
pub(super) struct Steepest<'a>(pub &'a mut [f64]);

impl Sink for Places {
    fn put(&mut self, row: usize, column: usize, _: f64) {
        self.0.push((row, column));
    }
}

impl Sink for Values<'_> {
    fn put(&mut self, _: usize, _: usize, value: f64) {
        *self.0.next().expect("there are as many values as places") = value;
    }
}

impl Sink for Steepest<'_> {
    #[inline(always)]
    fn put(&mut self, row: usize, _: usize, value: f64) {
        // A comparison, for `f64::max` minds values that are not numbers and takes three times as long.
        if value.abs() > self.0[row] {
            self.0[row] = value.abs();
        }
    }
}

/// Takes the derivatives of a term's rows, counted from its first.
pub(crate) struct Rows<'a, S: Sink> {
    pub(super) first: usize,
    pub(super) sink: &'a mut S,
}

impl<S: Sink> Rows<'_, S> {
    #[inline(always)]
    pub fn put(&mut self, row: usize, column: usize, value: f64) {
        self.sink.put(self.first + row, column, value);
    }
}
