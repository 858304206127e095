//! Inverse dynamics and the mass matrix.

use nalgebra::Vector3;

use super::links::LimbModel;
use super::pass::{LimbData, TURNS, Torso};
use crate::lanes::{Lane, V3};
use crate::spatial::{Composite, Force, Motion};

impl<T: Lane> LimbData<T> {
    /// τ = M a + h from the last forward pass, of order 2.
    #[inline(always)]
    pub fn inverse_dynamics(&self, model: &LimbModel<T>, gravity: &Vector3<f64>, tau: &mut [f64]) {
        let gravity = V3::new(gravity.x, gravity.y, gravity.z);
        let fall = V3::splat(&gravity);
        let mut sum: Option<Force<V3<T>>> = None;
        for k in (0..3).rev() {
            let (joint, link) = (&model.joints[k], &self.links[k]);
            let place = (&link.rotation, &link.position);
            let own = joint.link.force(place, &link.velocity, &link.acceleration, &fall);
            let force = sum.map_or(own, |below| own + below);
            let torque = link.axis.dot(&force);
            for leg in 0..T::WIDTH {
                tau[joint.dof[leg]] = torque.lane(leg);
            }
            sum = Some(force);
        }
        let torso = &self.torso;
        let own = model.torso.force(
            (&torso.rotation, &V3::zero()),
            &Motion::turn(torso.spin[2]),
            &Motion { angular: torso.spin_rate[2], linear: torso.acceleration },
            &gravity,
        );
        let total = sum.map_or(own, |legs| own + legs.sum());
        tau[..3].copy_from_slice(&[total.force.x, total.force.y, total.force.z]);
        for i in 0..3 {
            tau[TURNS[i]] = torso.axis[i].dot(&total.moment);
        }
    }

    /// M(q) from the last forward pass; `mass` is column-major, n × n. Entries between legs are zero
    /// and not written.
    #[inline(always)]
    pub fn mass_matrix(&self, model: &LimbModel<T>, mass: &mut [f64]) {
        let n = 6 + 3 * T::WIDTH;
        let torso = &self.torso;
        let axes = torso.axis.map(|axis| V3::splat(&axis));
        let mut sum: Option<Composite<V3<T>>> = None;
        for k in (0..3).rev() {
            let (joint, link) = (&model.joints[k], &self.links[k]);
            let own = joint.link.composite(&link.rotation, &link.position);
            let composite = sum.map_or(own, |below| own.plus(&below));
            let momentum = composite.times(&link.axis);
            for j in 0..=k {
                let entry = self.links[j].axis.dot(&momentum);
                for leg in 0..T::WIDTH {
                    let (row, column) = (joint.dof[leg], model.joints[j].dof[leg]);
                    mass[row + n * column] = entry.lane(leg);
                    mass[column + n * row] = entry.lane(leg);
                }
            }
            let base = base_column(&axes, &momentum);
            for leg in 0..T::WIDTH {
                let dof = joint.dof[leg];
                for (row, entry) in base.iter().enumerate() {
                    mass[row + n * dof] = entry.lane(leg);
                    mass[dof + n * row] = entry.lane(leg);
                }
            }
            sum = Some(composite);
        }
        let own = model.torso.composite(&torso.rotation, &V3::zero());
        let total = sum.map_or(own, |legs| own.plus(&legs.sum()));
        torso_mass(torso, &total, mass, n);
    }
}

/// The torso's six rows of a column, given the generalised direction's force.
#[inline(always)]
pub(crate) fn base_column<T: Lane>(axes: &[V3<T>; 3], f: &Force<V3<T>>) -> [T; 6] {
    let [yaw, pitch, roll] = axes;
    let turned = [roll.dot(&f.moment), pitch.dot(&f.moment), yaw.dot(&f.moment)];
    [f.force.x, f.force.y, f.force.z, turned[0], turned[1], turned[2]]
}

/// The torso's 6 × 6 block of the mass matrix, given the whole robot's inertia.
#[inline(always)]
pub(crate) fn torso_mass(torso: &Torso, total: &Composite<V3<f64>>, mass: &mut [f64], n: usize) {
    for i in 0..3 {
        mass[i + n * i] = total.mass;
        let axis = Motion::turn(torso.axis[i]);
        let momentum = total.times(&axis);
        let dof = TURNS[i];
        for (row, entry) in [momentum.force.x, momentum.force.y, momentum.force.z].iter().enumerate() {
            mass[row + n * dof] = *entry;
            mass[dof + n * row] = *entry;
        }
        for j in 0..=i {
            let entry = torso.axis[j].dot(&momentum.moment);
            mass[dof + n * TURNS[j]] = entry;
            mass[TURNS[j] + n * dof] = entry;
        }
    }
}
