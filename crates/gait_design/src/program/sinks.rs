//! What a program's derivatives are written to.

/// Takes the Jacobian's nonzeros in one fixed order: once their places, afterwards their values.
pub(crate) trait Sink {
    fn put(&mut self, row: usize, column: usize, value: f64);
}

pub(crate) struct Places(pub Vec<(usize, usize)>);
impl Sink for Places {
    fn put(&mut self, row: usize, column: usize, _: f64) {
        self.0.push((row, column));
    }
}

/// Counts them.
pub(crate) struct Count(pub usize);
impl Sink for Count {
    fn put(&mut self, _: usize, _: usize, _: f64) {
        self.0 += 1;
    }
}

/// Keeps of each row the size of its largest entry.
pub(crate) struct Steepest<'a>(pub &'a mut [f64]);
impl Sink for Steepest<'_> {
    #[inline(always)]
    fn put(&mut self, row: usize, _: usize, value: f64) {
        // A comparison, for `f64::max` minds values that are not numbers and takes three times as long.
        if value.abs() > self.0[row] {
            self.0[row] = value.abs();
        }
    }
}

pub(crate) struct ValuesSink<'a> {
    pub values: &'a mut [f64],
    pub next: usize,
}
impl Sink for ValuesSink<'_> {
    fn put(&mut self, _: usize, _: usize, value: f64) {
        self.values[self.next] = value;
        self.next += 1;
    }
}
