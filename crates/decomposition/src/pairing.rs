use crate::DynamicsError;

/// How the rear biped's joints follow the front one's (paper, section II-C): y_r = M y_f + b, with
/// y_f = (θ0, θ2), y_r = (θ1, θ3) and M a signed permutation, so q_r = A q_f + (0; b) with
/// A = blkdiag(I₆, M).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pairing {
    /// Per joint of y_r, which joint of y_f it follows.
    source: [usize; 6],
    /// Per joint of y_r, +1 or −1.
    sign: [f64; 6],
    /// b, rad.
    offset_rad: [f64; 6],
}

impl Pairing {
    /// Joint k of y_r is `sign[k]` times joint `source[k]` of y_f plus `offset_rad[k]`.
    ///
    /// # Errors
    ///
    /// If `source` is not a permutation of 0..6, a sign is not ±1 or an offset is not finite.
    pub fn new(source: [usize; 6], sign: [f64; 6], offset_rad: [f64; 6]) -> Result<Self, DynamicsError> {
        for k in 0..6 {
            if !source.contains(&k) {
                return Err(DynamicsError::BadPairing(format!("no joint follows joint {k}")));
            }
            if sign[k].abs() != 1.0 {
                return Err(DynamicsError::BadPairing(format!("sign {k} is {}", sign[k])));
            }
            if !offset_rad[k].is_finite() {
                return Err(DynamicsError::BadPairing(format!("offset {k} is {}", offset_rad[k])));
            }
        }
        Ok(Self { source, sign, offset_rad })
    }

    /// The diagonal gait: leg 1 mirrors leg 2 and leg 3 mirrors leg 0, M = [[0, m], [m, 0]] with m
    /// the mirror's signs. (The paper prints a diagonal M, which is right only for y_r = (θ3, θ1).)
    pub fn diagonal(joint_sign: [f64; 3]) -> Self {
        let [a, b, c] = joint_sign;
        Self { source: [3, 4, 5, 0, 1, 2], sign: [a, b, c, a, b, c], offset_rad: [0.0; 6] }
    }

    /// The pace: the legs of one side do the same, M = 1.
    pub fn pace() -> Self {
        Self { source: [0, 1, 2, 3, 4, 5], sign: [1.0; 6], offset_rad: [0.0; 6] }
    }

    /// The bound: the rear legs swing about their standing posture against the front ones, M = −1
    /// and b the sum of the standing postures of y_f and y_r.
    pub fn bound(front_stand_rad: [f64; 6], rear_stand_rad: [f64; 6]) -> Self {
        Self {
            source: [0, 1, 2, 3, 4, 5],
            sign: [-1.0; 6],
            offset_rad: std::array::from_fn(|k| front_stand_rad[k] + rear_stand_rad[k]),
        }
    }

    /// The same with another offset b: a leaned torso, for example.
    #[must_use]
    pub fn with_offset_rad(mut self, offset_rad: [f64; 6]) -> Self {
        self.offset_rad = offset_rad;
        self
    }

    /// q_r of q_f.
    pub fn position(&self, q_f: &[f64; 12]) -> [f64; 12] {
        let mut q_r = self.rate(q_f);
        for k in 0..6 {
            q_r[6 + k] += self.offset_rad[k];
        }
        q_r
    }

    /// A x: velocities and accelerations of r from those of f.
    pub fn rate(&self, x_f: &[f64; 12]) -> [f64; 12] {
        std::array::from_fn(|i| if i < 6 { x_f[i] } else { self.sign[i - 6] * x_f[6 + self.source[i - 6]] })
    }

    /// The coordinate of q_f that coordinate i of q_r follows, and its factor: row i of A.
    pub fn row(&self, i: usize) -> (usize, f64) {
        if i < 6 { (i, 1.0) } else { (6 + self.source[i - 6], self.sign[i - 6]) }
    }

    /// How the front biped follows the rear one: y_f = Mᵀ (y_r − b).
    #[must_use]
    pub fn inverse(&self) -> Self {
        let mut inverse = *self;
        for k in 0..6 {
            let j = self.source[k];
            inverse.source[j] = k;
            inverse.sign[j] = self.sign[k];
            inverse.offset_rad[j] = -self.sign[k] * self.offset_rad[k];
        }
        inverse
    }

    /// The whole robot's q from q_f.
    pub fn recompose_position(&self, q_f: &[f64; 12]) -> [f64; 18] {
        join(q_f, &self.position(q_f))
    }

    /// The whole robot's velocity or acceleration from that of f.
    pub fn recompose_rate(&self, x_f: &[f64; 12]) -> [f64; 18] {
        join(x_f, &self.rate(x_f))
    }
}

/// (q_b, θ0, θ1, θ2, θ3) of (q_b, θ0, θ2) and (q_b, θ1, θ3); the torso's coordinates are f's.
pub(crate) fn join(f: &[f64; 12], r: &[f64; 12]) -> [f64; 18] {
    std::array::from_fn(|i| match i {
        0..9 => f[i],
        9..12 => r[i - 3],
        12..15 => f[i - 3],
        _ => r[i - 6],
    })
}
