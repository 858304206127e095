//! Kinematics of one leg for the control cycle: plain numbers, built once, no allocation.
//!
//! A leg is three revolute joints, hip roll, hip pitch and knee, in the torso's axes at zero joint angles: the
//! axes a₁, a₂, a₃, the vectors between the joints and to the toe, and so (product of exponentials)
//!
//! > p(θ) = h + E₁ (d₁ + E₂ (d₂ + E₃ d₃)),  E_k = exp(θ_k a_k×).
//!
//! That holds for any leg of three joints. The closed inverse also needs the pitch and knee axes parallel and the
//! roll axis square to them: [`LegKinematics::of`] refuses others.

use nalgebra::{Matrix3, Vector3};
use rigid_body::{Data, JointKind, Model, forward_kinematics, frame_position, frame_rotation};
use serde::{Deserialize, Serialize};

use crate::{Robot, RobotError};

/// Axes that differ by less are parallel, or square to each other: URDFs write angles with few digits.
const SHAPE_TOLERANCE: f64 = 1e-3;
/// Where the shape is exact to this, the closed inverse is exact and is not refined.
const EXACT: f64 = 1e-13;
/// A leg is never asked to be straighter than this share of its length (4 mm of the 0.68 m of the Vision 60):
/// beyond, the knee would have to move infinitely fast.
const STRAIGHT_SHARE: f64 = 0.006;

/// One leg. `Copy`, and written down with the controller's configuration.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LegKinematics {
    /// A point of the hip-roll axis, from the torso's origin, m: the hip.
    hip_m: [f64; 3],
    /// From the roll axis to the pitch axis, to the knee's axis, and to the toe's centre, m.
    links_m: [[f64; 3]; 3],
    /// Unit axes of the joints.
    axes: [[f64; 3]; 3],
    position_min_rad: [f64; 3],
    position_max_rad: [f64; 3],
    /// The posture on whose side the inverse stays.
    stand_rad: [f64; 3],
    planar: Planar,
}

/// The leg as a roll of a plane in which two links turn: constants of the closed inverse. Coordinates (x, y, z)
/// along a₂ × u₃, a₂ and u₃ = a₁ × a₂ made square.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Planar {
    /// Rows: the basis in torso axes.
    basis: [[f64; 3]; 3],
    /// From the roll axis to the pitch axis, in the plane, m.
    offset_m: [f64; 2],
    /// From the roll axis to the plane, m.
    lateral_m: f64,
    /// Thigh and shank, m, and their directions at zero angles, rad, from z towards x.
    length_m: [f64; 2],
    direction_rad: [f64; 2],
    /// Whether a positive knee angle turns as a positive pitch (1) or the other way (−1).
    knee_sign: f64,
    /// Sign of the toe's z below the hip and of the knee's bend in the standing posture.
    toe_sign: f64,
    bend_sign: f64,
    exact: bool,
}

/// Toe and Jacobian at joint angles.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ToeKinematics {
    /// The toe's centre from the torso's origin, m, torso axes.
    pub position_m: Vector3<f64>,
    /// d position / d θ, m/rad: a column a joint.
    pub jacobian: Matrix3<f64>,
    /// Unit axes of the joints in torso axes: Σ axis θ̇ is the shank's angular velocity against the torso.
    pub axes: Matrix3<f64>,
}

/// Joint angles that put a toe somewhere.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LegSolution {
    /// Joint angles, rad, within the limits.
    pub joints_rad: [f64; 3],
    /// Whether the limits or the leg's reach keep the toe from where it was asked to be.
    pub limited: bool,
}

impl LegKinematics {
    /// Leg `leg` of the robot.
    ///
    /// # Errors
    ///
    /// [`RobotError::LegShape`] if the leg is not a roll joint that carries two parallel joints.
    ///
    /// # Panics
    ///
    /// If the leg is not 0 to 3.
    pub fn of(robot: &Robot, leg: usize) -> Result<Self, RobotError> {
        let about = &robot.legs[leg];
        let refuse = |problem: String| RobotError::LegShape { leg: about.name.clone(), problem };
        let (points, axes) = chain(&robot.model, 6 + 3 * leg, robot, leg)
            .ok_or_else(|| refuse("has other than three revolute joints in a row".into()))?;
        let [hip, pitch, knee, toe] = points;
        let links = [pitch - hip, knee - pitch, toe - knee];
        let planar = Planar::of(&links, &axes, &about.stand_rad).map_err(refuse)?;
        Ok(Self {
            hip_m: hip.into(),
            links_m: links.map(Into::into),
            axes: axes.map(Into::into),
            position_min_rad: about.position_min_rad,
            position_max_rad: about.position_max_rad,
            stand_rad: about.stand_rad,
            planar,
        })
    }

    /// The four legs of the robot.
    ///
    /// # Errors
    ///
    /// As [`LegKinematics::of`].
    pub fn all(robot: &Robot) -> Result<[Self; 4], RobotError> {
        let [a, b, c, d] = [0, 1, 2, 3].map(|leg| Self::of(robot, leg));
        Ok([a?, b?, c?, d?])
    }

    /// The hip-roll axis' point from the torso's origin, m.
    pub fn hip_m(&self) -> Vector3<f64> {
        self.hip_m.into()
    }

    /// Length of thigh and shank, m.
    pub fn length_m(&self) -> f64 {
        self.planar.length_m[0] + self.planar.length_m[1]
    }

    /// The toe's centre from the torso's origin, m, torso axes.
    pub fn toe_m(&self, joints_rad: &[f64; 3]) -> Vector3<f64> {
        let mut point = Vector3::zeros();
        for k in (0..3).rev() {
            point = turned(&self.axes[k].into(), joints_rad[k], &(Vector3::from(self.links_m[k]) + point));
        }
        Vector3::from(self.hip_m) + point
    }

    /// The toe with its Jacobian.
    pub fn toe(&self, joints_rad: &[f64; 3]) -> ToeKinematics {
        // From the toe inward: the part of the leg below each joint, and the axes below it, in that joint's axes.
        let mut below = [Vector3::zeros(); 3];
        let mut axes: [Vector3<f64>; 3] = self.axes.map(Into::into);
        let mut point = Vector3::zeros();
        for k in (0..3).rev() {
            let axis = self.axes[k].into();
            let sine_cosine = joints_rad[k].sin_cos();
            point = turned_by(&axis, sine_cosine, &(Vector3::from(self.links_m[k]) + point));
            below[k] = point;
            for n in k + 1..3 {
                axes[n] = turned_by(&axis, sine_cosine, &axes[n]);
                below[n] = turned_by(&axis, sine_cosine, &below[n]);
            }
        }
        let columns: [Vector3<f64>; 3] = std::array::from_fn(|k| axes[k].cross(&below[k]));
        ToeKinematics {
            position_m: Vector3::from(self.hip_m) + point,
            jacobian: Matrix3::from_columns(&columns),
            axes: Matrix3::from_columns(&axes),
        }
    }

    /// Joint angles that put the toe's centre at `target` (m, torso axes), on the side of the standing posture.
    /// Where limits or reach forbid it: roll at its stop keeps the toe's height, a leg too short keeps its
    /// direction.
    pub fn joints(&self, target: &Vector3<f64>) -> LegSolution {
        let mut solution = self.planar_joints(target);
        if !self.planar.exact && !solution.limited {
            for _ in 0..2 {
                let toe = self.toe(&solution.joints_rad);
                let Some(inverse) = toe.jacobian.try_inverse() else { break };
                let step = inverse * (target - toe.position_m);
                for k in 0..3 {
                    solution.joints_rad[k] += step[k];
                }
            }
        }
        for k in 0..3 {
            let (low, high) = (self.position_min_rad[k], self.position_max_rad[k]);
            let allowed = solution.joints_rad[k].clamp(low, high);
            solution.limited |= (solution.joints_rad[k] - allowed).abs() > 1e-9;
            solution.joints_rad[k] = allowed;
        }
        solution
    }

    fn planar_joints(&self, target: &Vector3<f64>) -> LegSolution {
        let p = &self.planar;
        let from_hip = target - Vector3::from(self.hip_m);
        let [x, y, z] = p.basis.map(|row| Vector3::from(row).dot(&from_hip));
        let mut limited = false;
        let mut bounded = |value: f64, low: f64, high: f64| {
            let inside = value.clamp(low, high);
            limited |= (value - inside).abs() > 1e-9;
            inside
        };
        let (l1, l2) = (p.length_m[0], p.length_m[1]);
        // The plane's z of the toe: below the hip, and never through the roll axis.
        let square = bounded(y * y + z * z - p.lateral_m * p.lateral_m, 1e-4 * (l1 + l2) * (l1 + l2), f64::MAX);
        let mut depth = p.toe_sign * square.sqrt();
        let roll = near(z.atan2(y) - depth.atan2(p.lateral_m), self.stand_rad[0]);
        // Rounding at a stop must not count as being stopped, nor move the toe.
        let allowed = bounded(roll, self.position_min_rad[0], self.position_max_rad[0]);
        if (allowed - roll).abs() > 1e-9 {
            let (sine, cosine) = allowed.sin_cos();
            depth = (z - p.lateral_m * sine) / cosine;
        }
        let (wx, wz) = (x - p.offset_m[0], depth - p.offset_m[1]);
        let distance = (wx * wx + wz * wz).sqrt();
        let reach = bounded(distance, 1.01 * (l1 - l2).abs() + 1e-3 * (l1 + l2), (1.0 - STRAIGHT_SHARE) * (l1 + l2));
        let cosine = ((reach * reach - l1 * l1 - l2 * l2) / (2.0 * l1 * l2)).clamp(-1.0, 1.0);
        let to_knee = p.direction_rad[0] - p.direction_rad[1];
        let knee = near(p.knee_sign * (p.bend_sign * cosine.acos() + to_knee), self.stand_rad[2]);
        let knee = bounded(knee, self.position_min_rad[2], self.position_max_rad[2]);
        let bend = p.knee_sign * knee - to_knee;
        let (sine, cosine) = bend.sin_cos();
        let pitch = wx.atan2(wz) - p.direction_rad[0] - (l2 * sine).atan2(l1 + l2 * cosine);
        LegSolution { joints_rad: [allowed, near(pitch, self.stand_rad[1]), knee], limited }
    }
}

/// `angle` plus whole turns, within half a turn of `about`.
fn near(angle: f64, about: f64) -> f64 {
    angle - std::f64::consts::TAU * ((angle - about) / std::f64::consts::TAU).round()
}

fn turned(axis: &Vector3<f64>, angle_rad: f64, v: &Vector3<f64>) -> Vector3<f64> {
    turned_by(axis, angle_rad.sin_cos(), v)
}

/// Rodrigues' formula.
fn turned_by(axis: &Vector3<f64>, (sine, cosine): (f64, f64), v: &Vector3<f64>) -> Vector3<f64> {
    v * cosine + axis.cross(v) * sine + axis * (axis.dot(v) * (1.0 - cosine))
}

/// Points of the three joints and the toe, and the joints' axes, in torso axes at zero angles.
type Chain = ([Vector3<f64>; 4], [Vector3<f64>; 3]);

fn chain(model: &Model, first: usize, robot: &Robot, leg: usize) -> Option<Chain> {
    let row = (first..first + 3).all(|dof| model.joint_kind(dof) == JointKind::Revolute)
        && model.parent_dof(first).is_some_and(|above| above < 6)
        && model.parent_dof(first + 1) == Some(first)
        && model.parent_dof(first + 2) == Some(first + 1)
        && model.frame_dof(robot.legs[leg].toe) == Some(first + 2);
    if !row {
        return None;
    }
    let mut data = Data::new(model);
    let zero = vec![0.0; model.dof()];
    let frame = |dof: usize| model.frame_id(model.link_name(dof)).expect("a moving link is a frame");
    forward_kinematics(model, &mut data, &zero, &zero, &zero);
    let at = [0, 1, 2].map(|k| frame_position(model, &data, frame(first + k)));
    let still = [0, 1, 2].map(|k| frame_rotation(model, &data, frame(first + k)));
    let toe = frame_position(model, &data, robot.legs[leg].toe);
    let axes = [0, 1, 2].map(|k| {
        let mut q = zero.clone();
        q[first + k] = std::f64::consts::FRAC_PI_2;
        forward_kinematics(model, &mut data, &q, &zero, &zero);
        // A quarter turn: its skew part is the axis.
        let turn = frame_rotation(model, &data, frame(first + k)) * still[k].transpose();
        0.5 * Vector3::new(turn.m32 - turn.m23, turn.m13 - turn.m31, turn.m21 - turn.m12)
    });
    Some(([at[0], at[1], at[2], toe], axes))
}

impl Planar {
    fn of(links: &[Vector3<f64>; 3], axes: &[Vector3<f64>; 3], stand_rad: &[f64; 3]) -> Result<Self, String> {
        let knee_sign = axes[1].dot(&axes[2]).signum();
        let askew = (axes[1].cross(&axes[2]).norm()).max(axes[0].dot(&axes[1]).abs());
        if askew > SHAPE_TOLERANCE {
            return Err(format!("has axes {askew:.1e} away from a roll square to parallel pitch and knee"));
        }
        let u1 = axes[0];
        let u2 = (axes[1] - u1 * u1.dot(&axes[1])).normalize();
        let basis = [u1, u2, u1.cross(&u2)];
        let parts = links.map(|link| basis.map(|u| u.dot(&link)));
        let length_m = [1, 2].map(|k: usize| parts[k][0].hypot(parts[k][2]));
        if length_m.iter().any(|&l| l < 1e-3) {
            return Err("has a thigh or shank without length".into());
        }
        let direction_rad = [1, 2].map(|k: usize| parts[k][0].atan2(parts[k][2]));
        let bend = near(direction_rad[1] - direction_rad[0] + knee_sign * stand_rad[2], 0.0);
        let thigh = direction_rad[0] + stand_rad[1];
        let depth = parts[0][2] + length_m[0] * thigh.cos() + length_m[1] * (thigh + bend).cos();
        Ok(Self {
            basis: basis.map(Into::into),
            offset_m: [parts[0][0], parts[0][2]],
            lateral_m: parts[0][1] + parts[1][1] + parts[2][1],
            length_m,
            direction_rad,
            knee_sign,
            toe_sign: depth.signum(),
            bend_sign: bend.signum(),
            exact: askew < EXACT,
        })
    }
}
