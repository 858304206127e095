//! Hermite–Simpson defects of q and q̇ over an interval of length h (paper III).

use super::{At, EQUAL, Layout, Names, Place, Rows, Sink, Term};

/// Over an interval's three points; of q and then of q̇: the middle's defects, the end's.
pub(crate) struct Collocation<L> {
    pub places: [Place<L>; 3],
}

impl<L: Layout> Term for Collocation<L> {
    fn bounds(&self, bounds: &mut Vec<[f64; 2]>) {
        bounds.resize(bounds.len() + 4 * L::COORDINATES, EQUAL);
    }

    fn values(&self, at: &At, rows: &mut [f64]) {
        let n = L::COORDINATES;
        let h = 2.0 * (at.t() * self.places[0].share) / (self.places[0].points - 1) as f64;
        for ((value, slope), rows) in [(L::Q, L::V), (L::V, L::A)].into_iter().zip(rows.chunks_exact_mut(2 * n)) {
            let block = |block: usize| self.places.map(|place| &at.x[place.column + block..][..n]);
            let ([x0, x1, x2], [f0, f1, f2]) = (block(value), block(slope));
            let (middle, end) = rows.split_at_mut(n);
            for i in 0..n {
                middle[i] = x1[i] - (x0[i] + x2[i]) / 2.0 - h / 8.0 * (f0[i] - f2[i]);
                end[i] = x2[i] - x0[i] - h / 6.0 * (f0[i] + 4.0 * f1[i] + f2[i]);
            }
        }
    }

    fn derivatives(&self, at: &At, rows: &mut Rows<impl Sink>) {
        let n = L::COORDINATES;
        // h over T.
        let per_t = 2.0 * self.places[0].share / (self.places[0].points - 1) as f64;
        let h = per_t * at.t();
        let p = self.places.map(|place| place.column);
        for (block, (value, slope)) in [(L::Q, L::V), (L::V, L::A)].into_iter().enumerate() {
            for i in 0..n {
                let [f0, f1, f2] = p.map(|p| at.x[p + slope + i]);
                let row = 2 * n * block + i;
                rows.put(row, p[0] + value + i, -0.5);
                rows.put(row, p[1] + value + i, 1.0);
                rows.put(row, p[2] + value + i, -0.5);
                rows.put(row, p[0] + slope + i, -h / 8.0);
                rows.put(row, p[2] + slope + i, h / 8.0);
                rows.put(row, at.t_column, -per_t / 8.0 * (f0 - f2));
                let row = row + n;
                rows.put(row, p[0] + value + i, -1.0);
                rows.put(row, p[2] + value + i, 1.0);
                rows.put(row, p[0] + slope + i, -h / 6.0);
                rows.put(row, p[1] + slope + i, -4.0 * h / 6.0);
                rows.put(row, p[2] + slope + i, -h / 6.0);
                rows.put(row, at.t_column, -per_t / 6.0 * (f0 + 4.0 * f1 + f2));
            }
        }
    }

    fn name(&self, _: usize, _: &Names) -> String {
        format!("Hermite–Simpson defect, interval {}{}", self.places[0].point / 2 + 1, self.places[0].step)
    }
}
