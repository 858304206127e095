//! Analytic first derivatives of inverse dynamics.

use nalgebra::{Matrix3, Vector3};

use crate::PointForce;
use crate::data::Data;
use crate::dynamics::{inertial_force, limb_force, moment_rate, world_inertia};
use crate::kinematics::{ACCELERATION, for_each_above, forward_pass, limb_pass};
use crate::limbs::with_limbs;
use crate::model::Model;
use crate::spatial::{Force, Motion};

/// τ = M a + h − Σ Jᵀ f with its derivatives: fills `data.tau`, `data.dtau_dq` (the contact forces'
/// share included, forces constant in the world), `data.dtau_dv` and `data.mass_matrix` = ∂τ/∂a.
///
/// The recursion is Singh, Russell and Wensing's (2022), with a shorter form of their operator B.
/// For a particle m at p that moves with ṗ, B u = m (p × (ω_u × ṗ), ω_u × ṗ): it depends on the
/// angular part of u alone. With N = Σ m ṗ pᵀ and P = Σ m ṗ over a subtree,
///
/// > B u = (tr(N) ω_u − N ω_u, ω_u × P),
///
/// and N and P of a subtree are plain sums. With Ṡ_j = v_λ × S_j, S̈_j = (a_λ − g) × S_j + v_λ × Ṡ_j
/// (λ the joint above j), I, B and f those of the subtree of i, and j above i or i itself,
///
/// > ∂τ_i/∂q_j = S_iᵀ (2 B Ṡ_j + I S̈_j),   ∂τ_j/∂q_i = S_jᵀ (2 B Ṡ_i + I S̈_i + S_i ×* f),
/// > ∂τ_i/∂v_j = S_iᵀ (2 B S_j + 2 I Ṡ_j),   ∂τ_j/∂v_i = S_jᵀ (2 B S_i + 2 I Ṡ_i).
///
/// A point force's share is minus the Hessian of p·f, with entries J_i·(ω_j × f).
///
/// # Panics
///
/// If q, v or a does not have `dof` entries, or a frame is not part of the model.
pub fn rnea_derivatives(model: &Model, data: &mut Data, q: &[f64], v: &[f64], a: &[f64], forces: &[PointForce]) {
    if limb_pass::<ACCELERATION>(model, data, q, v, a) {
        let Data { limbs: work, tau, mass_matrix, dtau_dq, dtau_dv, .. } = data;
        let (Some(limbs), Some(work)) = (&model.limbs, work) else { unreachable!() };
        let (mass, dq) = (mass_matrix.as_mut_slice(), dtau_dq.as_mut_slice());
        let (tau, dv) = (tau.as_mut_slice(), dtau_dv.as_mut_slice());
        with_limbs!(limbs, work, |m, d| d.inverse_dynamics_derivatives(m, &model.gravity, tau, mass, dq, dv));
    } else {
        tree_derivatives(model, data, q, v, a);
    }
    for (frame, force) in forces {
        let (body, frame) = model.body_of(*frame);
        if !limb_force::<true>(model, data, (body, &frame.translation, force)) {
            data.bring(model, body);
            subtract_force(model, data, (body, &frame.translation, force));
        }
    }
}

/// The derivatives for any tree, without point forces. Entries that are zero by structure are zero
/// from the start and stay so.
fn tree_derivatives(model: &Model, data: &mut Data, q: &[f64], v: &[f64], a: &[f64]) {
    forward_pass::<ACCELERATION>(model, data, q, v, a);
    let Data { bodies, tau, mass_matrix, dtau_dq, dtau_dv, .. } = data;

    for (i, joint) in model.joints.iter().enumerate() {
        let (above, rest) = bodies.split_at_mut(i);
        let body = &mut rest[0];
        let (velocity, mut acceleration) = match joint.parent {
            Some(parent) => (above[parent].velocity, above[parent].acceleration),
            None => (Motion::ZERO, Motion::ZERO),
        };
        acceleration.linear -= model.gravity;
        body.axis_rate_2 = acceleration.cross(&body.axis) + velocity.cross(&body.axis_rate);
        body.force = inertial_force(joint, body, &model.gravity);
        body.composite = world_inertia(joint, body);
        if joint.inertia.mass_kg == 0.0 {
            body.moment_rate = Matrix3::zeros();
            body.momentum = Vector3::zeros();
        } else {
            body.moment_rate = moment_rate(body);
            body.momentum =
                body.velocity.linear * body.composite.mass + body.velocity.angular.cross(&body.composite.first);
        }
    }

    for (i, joint) in model.joints.iter().enumerate().rev() {
        let (above, rest) = bodies.split_at_mut(i);
        let body = &rest[0];
        let axis = &body.axis;
        let dof = joint.dof;
        tau[dof] = axis.dot(&body.force);

        let trace = body.moment_rate.trace();
        // 2 B u.
        let twice_b = |u: &Vector3<f64>| Force {
            moment: (u * trace - body.moment_rate * u) * 2.0,
            force: u.cross(&body.momentum) * 2.0,
        };
        let momentum = body.composite.times(axis);
        // Column i of ∂τ/∂q and ∂τ/∂v, for the rows above.
        let column_q =
            twice_b(&body.axis_rate.angular) + body.composite.times(&body.axis_rate_2) + axis.cross_force(&body.force);
        let rate = body.composite.times(&body.axis_rate);
        let column_v = twice_b(&axis.angular) + rate + rate;
        // Row i: 2 Bᵀ S_i has no linear part.
        let row =
            (axis.angular * trace - body.moment_rate.tr_mul(&axis.angular) + body.momentum.cross(&axis.linear)) * 2.0;

        let mut next = Some(i);
        while let Some(j) = next {
            let up = if j == i { body } else { &above[j] };
            let other = model.joints[j].dof;
            let m = up.axis.dot(&momentum);
            mass_matrix[(dof, other)] = m;
            mass_matrix[(other, dof)] = m;
            dtau_dq[(other, dof)] = up.axis.dot(&column_q);
            dtau_dv[(other, dof)] = up.axis.dot(&column_v);
            dtau_dq[(dof, other)] = up.axis_rate.angular.dot(&row) + up.axis_rate_2.dot(&momentum);
            dtau_dv[(dof, other)] = up.axis.angular.dot(&row) + 2.0 * up.axis_rate.dot(&momentum);
            next = model.joints[j].parent;
        }
        if let Some(parent) = joint.parent {
            let parent = &mut above[parent];
            parent.force += body.force;
            parent.composite = parent.composite.plus(&body.composite);
            parent.moment_rate += body.moment_rate;
            parent.momentum += body.momentum;
        }
    }
}

/// Takes a point force's share off τ and ∂τ/∂q.
fn subtract_force(model: &Model, data: &mut Data, (body, offset, force): (usize, &Vector3<f64>, &Vector3<f64>)) {
    let Data { bodies, tau, dtau_dq, .. } = data;
    let p = bodies[body].position + bodies[body].rotation * offset;
    for_each_above(model, body, |i, dof| {
        let column = bodies[i].axis.at(&p);
        tau[dof] -= column.dot(force);
        let across = force.cross(&column);
        dtau_dq[(dof, dof)] += bodies[i].axis.angular.dot(&across);
        if let Some(parent) = model.joints[i].parent {
            for_each_above(model, parent, |j, other| {
                let share = bodies[j].axis.angular.dot(&across);
                dtau_dq[(dof, other)] += share;
                dtau_dq[(other, dof)] += share;
            });
        }
    });
}
