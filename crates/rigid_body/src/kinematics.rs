//! The forward pass, points and their derivatives, centre of mass, energy.

use nalgebra::{Matrix3, Vector3};

use crate::body::Body;
use crate::data::{Data, Pass};
use crate::joint::{FrameId, JointKind};
use crate::limbs::{TORSO, with_limbs};
use crate::model::Model;
use crate::point::PointKinematics;
use crate::spatial::Motion;

/// How far the forward pass goes.
pub(crate) const POSITION: u8 = 0;
pub(crate) const VELOCITY: u8 = 1;
pub(crate) const ACCELERATION: u8 = 2;

#[inline(always)]
fn check_lengths<const ORDER: u8>(model: &Model, q: &[f64], v: &[f64], a: &[f64]) {
    let n = model.dof();
    assert_eq!(q.len(), n, "q has the wrong length");
    if ORDER >= VELOCITY {
        assert_eq!(v.len(), n, "v has the wrong length");
    }
    if ORDER >= ACCELERATION {
        assert_eq!(a.len(), n, "a has the wrong length");
    }
}

/// The forward pass of a torso with legs, if the model is one: false if it is not.
#[inline(always)]
pub(crate) fn limb_pass<const ORDER: u8>(model: &Model, data: &mut Data, q: &[f64], v: &[f64], a: &[f64]) -> bool {
    let (Some(limbs), Some(work)) = (&model.limbs, &mut data.limbs) else { return false };
    check_lengths::<ORDER>(model, q, v, a);
    with_limbs!(limbs, work, |m, d| d.forward::<ORDER>(m, q, v, a));
    data.pass = Pass::Limbs { exported: [false; 4] };
    true
}

/// Placements, and with `ORDER` velocities and accelerations, of all bodies. Slices that the order
/// does not need may be empty.
#[inline(always)]
pub(crate) fn forward_pass<const ORDER: u8>(model: &Model, data: &mut Data, q: &[f64], v: &[f64], a: &[f64]) {
    check_lengths::<ORDER>(model, q, v, a);
    data.pass = Pass::Tree;
    data.origin = Vector3::zeros();
    for (i, joint) in model.joints.iter().enumerate() {
        let (above, rest) = data.bodies.split_at_mut(i);
        let body = &mut rest[0];
        let parent = joint.parent.map(|parent| &above[parent]);
        let (parent_rotation, parent_position) = match parent {
            Some(parent) => (parent.rotation, parent.position),
            None => (Matrix3::identity(), Vector3::zeros()),
        };
        let coordinate = q[joint.dof];
        let place = parent_position + parent_rotation * joint.translation;
        match joint.kind {
            JointKind::Revolute => {
                let (sine, cosine) = coordinate.sin_cos();
                let turn = joint.turn.fixed + joint.turn.cosine * cosine + joint.turn.sine * sine;
                body.rotation = parent_rotation * turn;
                body.position = place;
                let axis = body.rotation * joint.axis;
                body.axis = Motion { angular: axis, linear: place.cross(&axis) };
            }
            JointKind::Prismatic => {
                body.rotation = parent_rotation * joint.rotation;
                let axis = body.rotation * joint.axis;
                body.axis = Motion { angular: Vector3::zeros(), linear: axis };
                if i < model.carriers {
                    // The whole robot slides: move the reference point along with it.
                    data.origin += place + axis * coordinate;
                    body.position = Vector3::zeros();
                } else {
                    body.position = place + axis * coordinate;
                }
            }
        }
        if ORDER >= VELOCITY {
            let up = parent.map_or(Motion::ZERO, |parent| parent.velocity);
            body.axis_rate = up.cross(&body.axis);
            body.velocity = up;
            body.velocity.add_scaled(&body.axis, v[joint.dof]);
            if ORDER >= ACCELERATION {
                body.acceleration = parent.map_or(Motion::ZERO, |parent| parent.acceleration);
                body.acceleration.add_scaled(&body.axis, a[joint.dof]);
                body.acceleration.add_scaled(&body.axis_rate, v[joint.dof]);
            }
        }
    }
}

/// Placements, velocities and accelerations of all bodies, for [`frame_position`],
/// [`last_point_kinematics`] and [`last_point_kinematics_derivatives`].
///
/// # Panics
///
/// If q, v or a does not have `dof` entries.
pub fn forward_kinematics(model: &Model, data: &mut Data, q: &[f64], v: &[f64], a: &[f64]) {
    if !limb_pass::<ACCELERATION>(model, data, q, v, a) {
        forward_pass::<ACCELERATION>(model, data, q, v, a);
    }
}

/// Position of a frame's origin in the world, m, at the q of the last call of any algorithm.
pub fn frame_position(model: &Model, data: &Data, frame: FrameId) -> Vector3<f64> {
    let (body, frame) = model.body_of(frame);
    let (rotation, position) = data.pose(model, body);
    position + rotation * frame.translation
}

/// Rotation from a frame's axes to world axes, at the q of the last call of any algorithm.
pub fn frame_rotation(model: &Model, data: &Data, frame: FrameId) -> Matrix3<f64> {
    let (body, frame) = model.body_of(frame);
    data.pose(model, body).0 * frame.rotation
}

/// Position, velocity, acceleration and Jacobian of a frame's origin, in world axes.
///
/// # Panics
///
/// If q, v or a does not have `dof` entries, or the frame is not part of the model.
pub fn point_kinematics<'d>(
    model: &Model,
    data: &'d mut Data,
    q: &[f64],
    v: &[f64],
    a: &[f64],
    frame: FrameId,
) -> &'d PointKinematics {
    forward_kinematics(model, data, q, v, a);
    last_point_kinematics(model, data, frame)
}

/// [`point_kinematics`] with its derivatives with respect to q and v.
///
/// # Panics
///
/// As [`point_kinematics`].
pub fn point_kinematics_derivatives<'d>(
    model: &Model,
    data: &'d mut Data,
    q: &[f64],
    v: &[f64],
    a: &[f64],
    frame: FrameId,
) -> &'d PointKinematics {
    forward_kinematics(model, data, q, v, a);
    last_point_kinematics_derivatives(model, data, frame)
}

/// [`point_kinematics`] at the q, v, a of the last [`forward_kinematics`], `rnea` or
/// `rnea_derivatives`: several points then share one pass.
pub fn last_point_kinematics<'d>(model: &Model, data: &'d mut Data, frame: FrameId) -> &'d PointKinematics {
    if limb_point::<false>(model, data, frame) {
        return &data.point;
    }
    let (body, frame) = model.body_of(frame);
    data.bring(model, body);
    let Data { bodies, point, origin, .. } = data;
    let p = bodies[body].position + bodies[body].rotation * frame.translation;
    point.position = *origin + p;
    (point.velocity, point.acceleration) = motion_at(&bodies[body], &p);
    point.jacobian.as_mut_slice().fill(0.0);
    for_each_above(model, body, |i, dof| {
        point.jacobian.set_column(dof, &bodies[i].axis.at(&p));
    });
    point
}

/// [`last_point_kinematics`] with its derivatives with respect to q and v.
///
/// With J_j the Jacobian's column of joint j, ω_j its axis, P the body that the joint hangs from,
/// and ṗ_r, p̈_r the point's velocity and acceleration relative to P, turning joint j by a little
/// turns ṗ_r and p̈_r about ω_j and shifts the point by J_j, so
///
/// > ∂ṗ/∂q_j = Ω_P × J_j + ω_j × ṗ_r,
/// > ∂p̈/∂q_j = α_P × J_j + Ω_P × (Ω_P × J_j) + 2 Ω_P × (ω_j × ṗ_r) + ω_j × p̈_r.
pub fn last_point_kinematics_derivatives<'d>(model: &Model, data: &'d mut Data, frame: FrameId) -> &'d PointKinematics {
    if limb_point::<true>(model, data, frame) {
        return &data.point;
    }
    let (body, frame) = model.body_of(frame);
    data.bring(model, body);
    let Data { bodies, point, origin, .. } = data;
    let p = bodies[body].position + bodies[body].rotation * frame.translation;
    point.position = *origin + p;
    (point.velocity, point.acceleration) = motion_at(&bodies[body], &p);
    point.jacobian.as_mut_slice().fill(0.0);
    point.dvelocity_dq.fill(0.0);
    point.dacceleration_dq.fill(0.0);
    point.dacceleration_dv.fill(0.0);
    let (jacobian, dvelocity_dq) = (point.jacobian.as_mut_slice(), point.dvelocity_dq.as_mut_slice());
    let dacceleration_dq = point.dacceleration_dq.as_mut_slice();
    let dacceleration_dv = point.dacceleration_dv.as_mut_slice();
    let mut set = |dof: usize, column: &Vector3<f64>, dvelocity: &Vector3<f64>, dacceleration: &Vector3<f64>| {
        for axis in 0..3 {
            let entry = 3 * dof + axis;
            jacobian[entry] = column[axis];
            dvelocity_dq[entry] = dvelocity[axis];
            dacceleration_dq[entry] = dacceleration[axis];
            dacceleration_dv[entry] = 2.0 * dvelocity[axis];
        }
    };
    for_each_above(model, body, |i, dof| {
        let axis = &bodies[i].axis;
        let column = axis.at(&p);
        let Some(parent) = model.joints[i].parent else {
            // Hangs from the world, which does not move.
            let turn = |v: &Vector3<f64>| axis.angular.cross(v);
            set(dof, &column, &turn(&point.velocity), &turn(&point.acceleration));
            return;
        };
        let parent = &bodies[parent];
        let spin = &parent.velocity.angular;
        let carried = spin.cross(&column);
        let swept = parent.acceleration.angular.cross(&column);
        if model.joints[i].kind == JointKind::Prismatic {
            set(dof, &column, &carried, &(swept + spin.cross(&carried)));
            return;
        }
        let (carried_velocity, carried_acceleration) = motion_at(parent, &p);
        let relative_velocity = point.velocity - carried_velocity;
        let relative_acceleration = point.acceleration - carried_acceleration - spin.cross(&relative_velocity) * 2.0;
        let turned = axis.angular.cross(&relative_velocity);
        let dacceleration = swept + spin.cross(&(carried + turned * 2.0)) + axis.angular.cross(&relative_acceleration);
        set(dof, &column, &(carried + turned), &dacceleration);
    });
    point
}

/// The point of a torso with legs, if the last forward pass was of one: false if it was not.
#[inline(always)]
fn limb_point<const DERIVATIVES: bool>(model: &Model, data: &mut Data, frame: FrameId) -> bool {
    let Data { limbs: work, pass, point, .. } = data;
    let (Pass::Limbs { .. }, Some(limbs), Some(work)) = (pass, &model.limbs, work) else { return false };
    let (body, frame) = model.body_of(frame);
    let is_limb = body >= TORSO;
    if is_limb {
        with_limbs!(limbs, work, |m, d| d.point_kinematics::<DERIVATIVES>(m, body, &frame.translation, point));
    }
    is_limb
}

/// Velocity and classical acceleration of the point p of a body.
#[inline(always)]
fn motion_at(body: &Body, p: &Vector3<f64>) -> (Vector3<f64>, Vector3<f64>) {
    let velocity = body.velocity.at(p);
    (velocity, body.acceleration.at(p) + body.velocity.angular.cross(&velocity))
}

/// Calls `each(place, dof)` for the body's joint and all above it.
#[inline(always)]
pub(crate) fn for_each_above(model: &Model, body: usize, mut each: impl FnMut(usize, usize)) {
    let mut next = Some(body);
    while let Some(i) = next {
        each(i, model.joints[i].dof);
        next = model.joints[i].parent;
    }
}

/// The centre of mass in world axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CenterOfMass {
    /// Position, m.
    pub position: Vector3<f64>,
    /// Velocity, m/s.
    pub velocity: Vector3<f64>,
}

/// Position and velocity of the robot's centre of mass.
///
/// # Panics
///
/// If q or v does not have `dof` entries.
pub fn center_of_mass(model: &Model, data: &mut Data, q: &[f64], v: &[f64]) -> CenterOfMass {
    forward_pass::<VELOCITY>(model, data, q, v, &[]);
    let mut mass = 0.0;
    let (mut first, mut momentum) = (Vector3::zeros(), Vector3::zeros());
    for (joint, body) in model.joints.iter().zip(&data.bodies) {
        let m = joint.inertia.mass_kg;
        let c = body.position + body.rotation * joint.inertia.center_m;
        mass += m;
        first += c * m;
        momentum += body.velocity.at(&c) * m;
    }
    CenterOfMass { position: data.origin + first / mass, velocity: momentum / mass }
}

/// ½ vᵀ M(q) v, J.
///
/// # Panics
///
/// If q or v does not have `dof` entries.
pub fn kinetic_energy(model: &Model, data: &mut Data, q: &[f64], v: &[f64]) -> f64 {
    forward_pass::<VELOCITY>(model, data, q, v, &[]);
    let mut energy = 0.0;
    for (joint, body) in model.joints.iter().zip(&data.bodies) {
        let c = body.rotation * joint.inertia.center_m + body.position;
        let spin = body.rotation.tr_mul(&body.velocity.angular);
        energy += 0.5 * joint.inertia.mass_kg * body.velocity.at(&c).norm_squared()
            + 0.5 * spin.dot(&(joint.inertia.rotational_kg_m2 * spin));
    }
    energy
}

/// −Σ m g·c, J: the work against gravity from the world's origin.
///
/// # Panics
///
/// If q does not have `dof` entries.
pub fn potential_energy(model: &Model, data: &mut Data, q: &[f64]) -> f64 {
    forward_pass::<POSITION>(model, data, q, &[], &[]);
    let mut energy = 0.0;
    for (joint, body) in model.joints.iter().zip(&data.bodies) {
        let c = data.origin + body.position + body.rotation * joint.inertia.center_m;
        energy -= joint.inertia.mass_kg * model.gravity.dot(&c);
    }
    energy
}
