//! Rigid-body dynamics of a floating-base robot: URDF to Model, kinematics, dynamics and their analytic derivatives.
