//! Rigid-body dynamics of a robot made of a tree of one-degree-of-freedom joints.
//!
//! # Conventions
//!
//! A floating base is the chain of joints x, y, z, yaw, pitch, roll, so that
//! R = R_z(yaw) R_y(pitch) R_x(roll) turns torso axes into world axes. Its six coordinates are ordered
//!
//! > q = (x, y, z, roll, pitch, yaw, joints …),
//!
//! and the velocity v = dq/dt is the plain derivative, so q and v live in vector spaces and
//! collocation acts on them directly. The price is the usual one of Euler angles: the mass matrix is
//! singular at pitch = ±90°.
//!
//! Units are SI and angles radians. The equation of motion is
//!
//! > M(q) a + h(q, v) = τ + Σ J_k(q)ᵀ f_k,
//!
//! with f_k a point force in newtons, in world axes, at the origin of frame k.
//!
//! # Model and Data
//!
//! [`Model`] is constant; every algorithm takes a [`Data`] that holds all workspaces and results.
//! Nothing allocates after `Data::new`.
//!
//! # How it computes
//!
//! All spatial quantities are written in world axes about one point, the torso's origin at the
//! instant of the call. Transforms between links then vanish from the recursions, and a position far
//! from the world's origin costs no precision. A spatial motion is (angular ω, linear v of the body's
//! point at the reference), a spatial force (moment n about the reference, force f). The sources are
//! Featherstone, *Rigid Body Dynamics Algorithms* (2008), chapters 5–7, and, for the derivatives of
//! inverse dynamics, Singh, Russell and Wensing, *Efficient Analytical Derivatives of Rigid-Body
//! Dynamics using Spatial Vector Algebra* (2022).

mod body;
mod data;
mod derivatives;
mod description;
mod dynamics;
mod error;
mod forward;
mod inertia;
mod joint;
mod kinematics;
mod lanes;
mod limbs;
mod model;
mod point;
mod shape;
mod space;
mod spatial;
mod urdf;

pub use data::Data;
pub use derivatives::rnea_derivatives;
pub use description::Description;
pub use dynamics::{bias_forces, crba, rnea};
pub use error::ModelError;
pub use forward::aba;
pub use inertia::Inertia;
pub use joint::{FrameId, JointKind};
pub use kinematics::{
    CenterOfMass, center_of_mass, forward_kinematics, frame_position, frame_rotation, kinetic_energy,
    last_point_kinematics, last_point_kinematics_derivatives, point_kinematics, point_kinematics_derivatives,
    potential_energy,
};
pub use model::Model;
pub use point::PointKinematics;

/// A force of constant direction in world axes, in newtons, that acts at a frame's origin.
pub type PointForce = (FrameId, nalgebra::Vector3<f64>);
