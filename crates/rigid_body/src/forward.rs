//! Forward dynamics by the articulated-body algorithm.

use nalgebra::{DVector, Matrix3};

use crate::PointForce;
use crate::data::{Data, Pass};
use crate::dynamics::world_inertia;
use crate::kinematics::{VELOCITY, for_each_above, forward_pass, limb_pass};
use crate::limbs::with_limbs;
use crate::model::Model;
use crate::spatial::Motion;

/// Forward dynamics by the articulated-body algorithm (Featherstone, section 7.3): the a that solves
/// M(q) a + h(q, v) = τ + Σ J_kᵀ f_k, dof entries. Not finite where M is singular: a floating base at a pitch of ±90°.
///
/// # Panics
///
/// If q, v or tau does not have `dof` entries, or a frame is not part of the model.
pub fn aba<'d>(
    model: &Model,
    data: &'d mut Data,
    q: &[f64],
    v: &[f64],
    tau: &[f64],
    forces: &[PointForce],
) -> &'d DVector<f64> {
    assert_eq!(tau.len(), model.dof(), "tau has the wrong length");
    if limb_pass::<VELOCITY>(model, data, q, v, &[]) {
        data.drive.copy_from_slice(tau);
        for (frame, force) in forces {
            let (body, frame) = model.body_of(*frame);
            data.bring(model, body);
            let Data { bodies, drive, .. } = data;
            let p = bodies[body].position + bodies[body].rotation * frame.translation;
            for_each_above(model, body, |i, dof| drive[dof] += bodies[i].axis.at(&p).dot(force));
        }
        let Data { limbs: work, drive, acceleration, .. } = data;
        let (Some(limbs), Some(work)) = (&model.limbs, work) else { unreachable!() };
        let found = acceleration.as_mut_slice();
        with_limbs!(limbs, work, |m, d| d.forward_dynamics(m, &model.gravity, v, drive, found));
        // The accelerations are new since.
        data.pass = Pass::Limbs { exported: [false; 4] };
        return &data.acceleration;
    }
    forward_pass::<VELOCITY>(model, data, q, v, &[]);
    let Data { bodies, articulated, acceleration, .. } = data;

    for ((joint, body), art) in model.joints.iter().zip(bodies.iter_mut()).zip(&mut *articulated) {
        let inertia = world_inertia(joint, body);
        art.inertia.rotational = Matrix3::identity() * inertia.second.trace() - inertia.second;
        art.inertia.coupling = inertia.first.cross_matrix();
        art.inertia.translational = Matrix3::identity() * inertia.mass;
        art.inertia.bias = body.velocity.cross_force(&inertia.times(&body.velocity));
        art.inertia.bias.moment -= inertia.first.cross(&model.gravity);
        art.inertia.bias.force -= model.gravity * inertia.mass;
    }
    for (frame, force) in forces {
        let (place, frame) = model.body_of(*frame);
        let body = &bodies[place];
        let p = body.position + body.rotation * frame.translation;
        articulated[place].inertia.bias.moment -= p.cross(force);
        articulated[place].inertia.bias.force -= force;
    }
    for (i, joint) in model.joints.iter().enumerate().rev() {
        let (above, rest) = articulated.split_at_mut(i);
        let (art, body) = (&mut rest[0], &bodies[i]);
        art.reaction = art.inertia.times(&body.axis);
        art.inverse = 1.0 / body.axis.dot(&art.reaction);
        art.drive = tau[joint.dof] - body.axis.dot(&art.inertia.bias);
        let Some(parent) = joint.parent else { continue };
        let up = &mut above[parent];
        let (moment, force) = (&art.reaction.moment, &art.reaction.force);
        let scaled_moment = moment * art.inverse;
        let scaled_force = force * art.inverse;
        art.inertia.rotational -= scaled_moment * moment.transpose();
        art.inertia.coupling -= scaled_moment * force.transpose();
        art.inertia.translational -= scaled_force * force.transpose();
        up.inertia.rotational += art.inertia.rotational;
        up.inertia.coupling += art.inertia.coupling;
        up.inertia.translational += art.inertia.translational;
        let mut drift = Motion::ZERO;
        drift.add_scaled(&body.axis_rate, v[joint.dof]);
        let carried = art.inertia.times(&drift);
        up.inertia.bias += art.inertia.bias + carried;
        up.inertia.bias.moment += scaled_moment * art.drive;
        up.inertia.bias.force += scaled_force * art.drive;
    }
    for (i, joint) in model.joints.iter().enumerate() {
        let (above, rest) = bodies.split_at_mut(i);
        let (art, body) = (&articulated[i], &mut rest[0]);
        body.acceleration = joint.parent.map_or(Motion::ZERO, |parent| above[parent].acceleration);
        body.acceleration.add_scaled(&body.axis_rate, v[joint.dof]);
        let rate = (art.drive - body.acceleration.dot(&art.reaction)) * art.inverse;
        acceleration[joint.dof] = rate;
        body.acceleration.add_scaled(&body.axis, rate);
    }
    acceleration
}
