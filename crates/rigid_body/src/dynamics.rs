//! Inverse dynamics and the mass matrix.

use nalgebra::{DMatrix, DVector, Matrix3, Vector3};

use crate::PointForce;
use crate::body::Body;
use crate::data::{Data, Pass};
use crate::joint::Joint;
use crate::kinematics::{ACCELERATION, POSITION, for_each_above, forward_pass, limb_pass};
use crate::limbs::{TORSO, with_limbs};
use crate::model::Model;
use crate::spatial::{self, BodyInertia, Composite, Force};

/// Inverse dynamics by the recursive Newton–Euler algorithm (Featherstone, section 5.3):
/// τ = M(q) a + h(q, v) − Σ J_kᵀ f_k, dof entries, N and N m.
///
/// # Panics
///
/// If q, v or a does not have `dof` entries, or a frame is not part of the model.
pub fn rnea<'d>(
    model: &Model,
    data: &'d mut Data,
    q: &[f64],
    v: &[f64],
    a: &[f64],
    forces: &[PointForce],
) -> &'d DVector<f64> {
    if limb_pass::<ACCELERATION>(model, data, q, v, a) {
        let (Some(limbs), Some(work)) = (&model.limbs, &data.limbs) else { unreachable!() };
        let tau = data.tau.as_mut_slice();
        with_limbs!(limbs, work, |m, d| d.inverse_dynamics(m, &model.gravity, tau));
        for (frame, force) in forces {
            let (body, frame) = model.body_of(*frame);
            if !limb_force::<false>(model, data, (body, &frame.translation, force)) {
                data.bring(model, body);
                let Data { bodies, tau, .. } = data;
                let p = bodies[body].position + bodies[body].rotation * frame.translation;
                for_each_above(model, body, |i, dof| tau[dof] -= bodies[i].axis.at(&p).dot(force));
            }
        }
        return &data.tau;
    }
    forward_pass::<ACCELERATION>(model, data, q, v, a);
    for (joint, body) in model.joints.iter().zip(&mut data.bodies) {
        body.force = inertial_force(joint, body, &model.gravity);
    }
    for (frame, force) in forces {
        let (body, frame) = model.body_of(*frame);
        let body = &mut data.bodies[body];
        let p = body.position + body.rotation * frame.translation;
        body.force.moment -= p.cross(force);
        body.force.force -= force;
    }
    for (i, joint) in model.joints.iter().enumerate().rev() {
        let (above, rest) = data.bodies.split_at_mut(i);
        data.tau[joint.dof] = rest[0].axis.dot(&rest[0].force);
        if let Some(parent) = joint.parent {
            above[parent].force += rest[0].force;
        }
    }
    &data.tau
}

/// Takes the share of a force at a body's point off τ and, with DERIVATIVES, off ∂τ/∂q, if the last forward pass was of
/// a torso with legs: false if it was not.
#[inline(always)]
pub(crate) fn limb_force<const DERIVATIVES: bool>(
    model: &Model,
    data: &mut Data,
    force: (usize, &Vector3<f64>, &Vector3<f64>),
) -> bool {
    let Data { limbs: work, pass, tau, dtau_dq, .. } = data;
    let (Pass::Limbs { .. }, Some(limbs), Some(work)) = (pass, &model.limbs, work) else { return false };
    let is_limb = force.0 >= TORSO;
    if is_limb {
        let (tau, dtau_dq) = (tau.as_mut_slice(), dtau_dq.as_mut_slice());
        with_limbs!(limbs, work, |m, d| d.subtract_force::<DERIVATIVES>(m, force, tau, dtau_dq));
    }
    is_limb
}

/// h(q, v): Coriolis, centrifugal and gravity terms, dof entries, N and N m.
///
/// # Panics
///
/// If q or v does not have `dof` entries.
pub fn bias_forces<'d>(model: &Model, data: &'d mut Data, q: &[f64], v: &[f64]) -> &'d DVector<f64> {
    let zero = std::mem::take(&mut data.zero);
    rnea(model, data, q, v, &zero, &[]);
    data.zero = zero;
    &data.tau
}

/// I a + v ×* I v − I g of one body about the reference point.
#[inline(always)]
pub(crate) fn inertial_force(joint: &Joint, body: &Body, gravity: &Vector3<f64>) -> Force {
    let inertia = &joint.inertia;
    if inertia.mass_kg == 0.0 {
        return Force::ZERO;
    }
    let own = BodyInertia { mass: inertia.mass_kg, center: &inertia.center_m, rotational: &inertia.rotational_kg_m2 };
    spatial::inertial_force(own, (&body.rotation, &body.position), &body.velocity, &body.acceleration, gravity)
}

/// The inertia of one body about the reference point, in world axes.
#[inline(always)]
pub(crate) fn world_inertia(joint: &Joint, body: &Body) -> Composite {
    let mass = joint.inertia.mass_kg;
    if mass == 0.0 {
        return Composite::ZERO;
    }
    let c = body.position + body.rotation * joint.inertia.center_m;
    let first = c * mass;
    Composite {
        mass,
        first,
        second: body.rotation * joint.inertia.second_moment() * body.rotation.transpose() + first * c.transpose(),
    }
}

/// The mass matrix M(q), dof × dof, full, by the composite-rigid-body algorithm (Featherstone,
/// section 6.2).
///
/// # Panics
///
/// If q does not have `dof` entries.
pub fn crba<'d>(model: &Model, data: &'d mut Data, q: &[f64]) -> &'d DMatrix<f64> {
    if limb_pass::<POSITION>(model, data, q, &[], &[]) {
        let (Some(limbs), Some(work)) = (&model.limbs, &data.limbs) else { unreachable!() };
        let mass = data.mass_matrix.as_mut_slice();
        with_limbs!(limbs, work, |m, d| d.mass_matrix(m, mass));
        return &data.mass_matrix;
    }
    forward_pass::<POSITION>(model, data, q, &[], &[]);
    let Data { bodies, mass_matrix, .. } = data;
    for (joint, body) in model.joints.iter().zip(bodies.iter_mut()) {
        body.composite = world_inertia(joint, body);
    }
    for (i, joint) in model.joints.iter().enumerate().rev() {
        let (above, rest) = bodies.split_at_mut(i);
        let body = &rest[0];
        let momentum = body.composite.times(&body.axis);
        mass_matrix[(joint.dof, joint.dof)] = body.axis.dot(&momentum);
        let mut next = joint.parent;
        while let Some(j) = next {
            let m = above[j].axis.dot(&momentum);
            mass_matrix[(joint.dof, model.joints[j].dof)] = m;
            mass_matrix[(model.joints[j].dof, joint.dof)] = m;
            next = model.joints[j].parent;
        }
        if let Some(parent) = joint.parent {
            above[parent].composite = above[parent].composite.plus(&body.composite);
        }
    }
    mass_matrix
}

/// Σ m ṗ pᵀ of one body, given its inertia about the reference point: v firstᵀ + ω × second.
#[inline(always)]
pub(crate) fn moment_rate(body: &Body) -> Matrix3<f64> {
    body.velocity.linear * body.composite.first.transpose()
        + body.velocity.angular.cross_matrix() * body.composite.second
}
