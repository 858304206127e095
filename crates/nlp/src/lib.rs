//! Nonlinear programs: the problem trait, a sequential quadratic programming solver, and honest statuses.
