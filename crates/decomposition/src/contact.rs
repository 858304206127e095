//! The whole robot (or any model) with point contacts: constrained dynamics and plastic impact.

use nalgebra::{DMatrix, DVector, Vector3};
use rigid_body::{Data, FrameId, Model, bias_forces, crba, forward_kinematics, last_point_kinematics};

use crate::DynamicsError;

/// A row of the contacts' Delassus matrix this much smaller than the largest adds nothing.
const RANK_TOLERANCE: f64 = 1e-11;

/// Accelerations and ground forces of eq. 1.
#[derive(Debug, Clone)]
pub struct ContactMotion {
    /// q̈, dof entries.
    pub acceleration: DVector<f64>,
    /// λ, N, in world axes, one for each contact in the order given.
    pub forces: Vec<Vector3<f64>>,
}

/// Velocities and impulses of eq. 2.
#[derive(Debug, Clone)]
pub struct Impact {
    /// q̇⁺, dof entries.
    pub velocity: DVector<f64>,
    /// Λ, N s, in world axes, one for each contact in the order given.
    pub impulses: Vec<Vector3<f64>>,
}

/// Workspace for the dynamics of a model whose toes stand on the ground without slipping.
#[derive(Debug, Clone)]
pub struct ContactDynamics {
    data: Data,
    /// Lower Cholesky factor of M.
    factor: DMatrix<f64>,
    /// L⁻¹ Jᵀ, dof × 3 per contact.
    scaled: DMatrix<f64>,
    jacobian: DMatrix<f64>,
    delassus: DMatrix<f64>,
    right: DVector<f64>,
    zero: Vec<f64>,
    motion: ContactMotion,
    impact: Impact,
}

impl ContactDynamics {
    /// Memory for this model with at most `contacts` contacts.
    pub fn new(model: &Model, contacts: usize) -> Self {
        let (n, m) = (model.dof(), 3 * contacts);
        Self {
            data: Data::new(model),
            factor: DMatrix::zeros(n, n),
            scaled: DMatrix::zeros(n, m),
            jacobian: DMatrix::zeros(m, n),
            delassus: DMatrix::zeros(m, m),
            right: DVector::zeros(m),
            zero: vec![0.0; n],
            motion: ContactMotion { acceleration: DVector::zeros(n), forces: Vec::with_capacity(contacts) },
            impact: Impact { velocity: DVector::zeros(n), impulses: Vec::with_capacity(contacts) },
        }
    }

    /// Constrained dynamics (paper eq. 1) for any contacts, none included:
    /// D q̈ + H = τ + Σ Jᵀλ with J q̈ + J̇ q̇ = 0. `tau` has dof entries; for a floating base the
    /// first six are zero.
    ///
    /// # Errors
    ///
    /// If the mass matrix or the set of contacts is singular.
    ///
    /// # Panics
    ///
    /// If a slice does not have `dof` entries, or there are more contacts than memory was asked for.
    pub fn motion(
        &mut self,
        model: &Model,
        q: &[f64],
        v: &[f64],
        tau: &[f64],
        contacts: &[FrameId],
    ) -> Result<&ContactMotion, DynamicsError> {
        let n = model.dof();
        assert_eq!(tau.len(), n, "tau has the wrong length");
        self.factor_mass(model, q)?;
        let bias = bias_forces(model, &mut self.data, q, v);
        for i in 0..n {
            self.motion.acceleration[i] = tau[i] - bias[i];
        }
        solve_lower(&self.factor, self.motion.acceleration.as_mut_slice());
        // The last pass was at zero acceleration, so a point's acceleration is now J̇ q̇.
        self.gather(model, contacts, |point| point.acceleration);
        self.contact_forces(model, contacts, &Unconstrained::Acceleration)?;
        let Self { factor, scaled, right, motion, .. } = self;
        add_forces(&mut motion.acceleration, scaled, right, 3 * contacts.len());
        solve_upper(factor, motion.acceleration.as_mut_slice());
        collect(&mut motion.forces, right, contacts.len());
        Ok(&self.motion)
    }

    /// Plastic impact (paper eq. 2): D (q̇⁺ − q̇⁻) = Σ JᵀΛ with J q̇⁺ = 0 at the toes that land (and
    /// at those that are to stay).
    ///
    /// # Errors
    ///
    /// If the mass matrix or the set of contacts is singular.
    ///
    /// # Panics
    ///
    /// As [`ContactDynamics::motion`].
    pub fn impact(
        &mut self,
        model: &Model,
        q: &[f64],
        v: &[f64],
        contacts: &[FrameId],
    ) -> Result<&Impact, DynamicsError> {
        self.factor_mass(model, q)?;
        forward_kinematics(model, &mut self.data, q, v, &self.zero);
        self.gather(model, contacts, |point| point.velocity);
        self.contact_forces(model, contacts, &Unconstrained::Velocity)?;
        let Self { factor, scaled, right, impact, .. } = self;
        impact.velocity.fill(0.0);
        add_forces(&mut impact.velocity, scaled, right, 3 * contacts.len());
        solve_upper(factor, impact.velocity.as_mut_slice());
        for (after, before) in impact.velocity.iter_mut().zip(v) {
            *after += before;
        }
        collect(&mut impact.impulses, right, contacts.len());
        Ok(&self.impact)
    }

    fn factor_mass(&mut self, model: &Model, q: &[f64]) -> Result<(), DynamicsError> {
        self.factor.copy_from(crba(model, &mut self.data, q));
        cholesky(&mut self.factor, model.dof(), 1e-13).map_err(|coordinate| DynamicsError::SingularMassMatrix {
            coordinate,
            pitch_rad: q.get(4).copied().unwrap_or(f64::NAN),
        })
    }

    /// Fills J, L⁻¹Jᵀ and the right-hand side from the kinematics of the last pass.
    fn gather(
        &mut self,
        model: &Model,
        contacts: &[FrameId],
        target: impl Fn(&rigid_body::PointKinematics) -> Vector3<f64>,
    ) {
        let n = model.dof();
        assert!(3 * contacts.len() <= self.right.len(), "more contacts than memory was asked for");
        for (k, &contact) in contacts.iter().enumerate() {
            let point = last_point_kinematics(model, &mut self.data, contact);
            let value = target(point);
            for axis in 0..3 {
                let row = 3 * k + axis;
                self.right[row] = -value[axis];
                for i in 0..n {
                    let entry = point.jacobian[(axis, i)];
                    self.jacobian[(row, i)] = entry;
                    self.scaled[(i, row)] = entry;
                }
                solve_lower(&self.factor, &mut self.scaled.as_mut_slice()[row * n..(row + 1) * n]);
            }
        }
    }

    /// Solves (J M⁻¹ Jᵀ) λ = right − J M⁻¹ (…) and leaves λ in `right`.
    fn contact_forces(
        &mut self,
        model: &Model,
        contacts: &[FrameId],
        unconstrained: &Unconstrained,
    ) -> Result<(), DynamicsError> {
        let m = 3 * contacts.len();
        for row in 0..m {
            let scaled = self.scaled.column(row);
            for column in 0..=row {
                self.delassus[(row, column)] = scaled.dot(&self.scaled.column(column));
            }
            if let Unconstrained::Acceleration = unconstrained {
                self.right[row] -= scaled.dot(&self.motion.acceleration);
            }
        }
        cholesky(&mut self.delassus, m, RANK_TOLERANCE).map_err(|_| DynamicsError::SingularContacts {
            toes: names(model, contacts),
            rows: m,
            rank: self.jacobian.rows(0, m).into_owned().rank(1e-6),
        })?;
        let right = &mut self.right.as_mut_slice()[..m];
        solve_lower(&self.delassus, right);
        solve_upper(&self.delassus, right);
        Ok(())
    }
}

/// What the contacts act against.
enum Unconstrained {
    /// L⁻¹ (τ − H) is in `motion.acceleration`.
    Acceleration,
    /// The velocity before impact is already in the right-hand side.
    Velocity,
}

pub(crate) fn names(model: &Model, contacts: &[FrameId]) -> String {
    let names: Vec<&str> = contacts.iter().map(|&toe| model.frame_name(toe)).collect();
    format!("({})", names.join(", "))
}

fn add_forces(to: &mut DVector<f64>, scaled: &DMatrix<f64>, forces: &DVector<f64>, rows: usize) {
    for row in 0..rows {
        to.axpy(forces[row], &scaled.column(row), 1.0);
    }
}

fn collect(to: &mut Vec<Vector3<f64>>, from: &DVector<f64>, contacts: usize) {
    to.clear();
    to.extend((0..contacts).map(|k| Vector3::new(from[3 * k], from[3 * k + 1], from[3 * k + 2])));
}

/// Lower Cholesky factor of the leading n × n block, in place in the lower triangle. The error is the
/// first row whose pivot falls below `tolerance` of its diagonal entry.
fn cholesky(matrix: &mut DMatrix<f64>, n: usize, tolerance: f64) -> Result<(), usize> {
    for row in 0..n {
        let own = matrix[(row, row)];
        for column in 0..=row {
            let mut sum = matrix[(row, column)];
            for k in 0..column {
                sum -= matrix[(row, k)] * matrix[(column, k)];
            }
            if column < row {
                matrix[(row, column)] = sum / matrix[(column, column)];
            } else if sum > tolerance * own {
                matrix[(row, row)] = sum.sqrt();
            } else {
                return Err(row);
            }
        }
    }
    Ok(())
}

/// L x = right, with L the leading block of as many rows as `right` has.
fn solve_lower(factor: &DMatrix<f64>, right: &mut [f64]) {
    for column in 0..right.len() {
        right[column] /= factor[(column, column)];
        let x = right[column];
        for row in column + 1..right.len() {
            right[row] -= factor[(row, column)] * x;
        }
    }
}

/// Lᵀ x = right.
fn solve_upper(factor: &DMatrix<f64>, right: &mut [f64]) {
    for row in (0..right.len()).rev() {
        let mut sum = right[row];
        for k in row + 1..right.len() {
            sum -= factor[(k, row)] * right[k];
        }
        right[row] = sum / factor[(row, row)];
    }
}
