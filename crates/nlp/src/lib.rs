//! Nonlinear programs
//!
//! ```text
//!     minimise    f(x)
//!     subject to  g_L ≤ g(x) ≤ g_U
//!                 x_L ≤  x   ≤ x_U
//! ```
//!
//! with sparse analytic first derivatives and a positive semidefinite approximation of the Hessian (Gauss–Newton, or
//! exact where the objective is convex), and a sequential quadratic programming solver. Its convex subproblems are
//! solved by Clarabel, by elimination ([`NullSpace`]), or by whatever knows the problem's structure ([`Subproblem`]).
//! This crate knows no robot: it names a constraint by asking the problem.

mod arrow_qp;
mod null_space;
mod ordered;
mod problem;
mod qp;
mod sqp;

pub use arrow_qp::{ArrowQp, ArrowQpError, ArrowRow, DualActiveSet, Own};
pub use null_space::NullSpace;
pub use ordered::{Order, Ordered, Stage};
pub use problem::{Bounds, Evaluation, Multipliers, Pattern, Problem, ProblemError, Step, Subproblem, SubproblemError};
pub use sqp::{Iteration, Settings, SettingsError, Solution, SqpSolver, Status, Violation, Workspace, most_broken};
