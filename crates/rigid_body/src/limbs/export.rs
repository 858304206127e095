//! What the general algorithms read of the last forward pass.

use nalgebra::{Matrix3, Vector3};

use super::links::LimbModel;
use super::pass::LimbData;
use crate::body::Body;
use crate::lanes::{Lane, V3};
use crate::spatial::Motion;

impl<T: Lane> LimbData<T> {
    /// Rotation of a body's URDF axes, and its position in the world.
    pub fn pose(&self, model: &LimbModel<T>, place: usize) -> (Matrix3<f64>, Vector3<f64>) {
        let origin = self.carrier[0].lane(0);
        let Some(leg) = model.leg_of(place) else {
            return (self.torso.rotation.lane(0), origin);
        };
        let k = (0..3).find(|&k| model.joints[k].place[leg] == place);
        let k = k.expect("the leg was found by this joint");
        let link = &self.links[k];
        let rotation = link.rotation.lane(leg) * model.joints[k].to_urdf[leg];
        (rotation, origin + link.position.lane(leg))
    }

    /// Writes what the last forward pass found in the form of the general tree: the torso's chain and
    /// the leg of lane `leg`.
    pub fn export(&self, model: &LimbModel<T>, leg: usize, bodies: &mut [Body], origin: &mut Vector3<f64>) {
        let outer = |v: &V3<f64>| Vector3::new(v.x, v.y, v.z);
        let torso = &self.torso;
        let [position, velocity, acceleration] = self.carrier.map(|v| outer(&v));
        *origin = position;
        // Seen from a point at rest, velocities gain the carrier's, and spatial accelerations lose
        // ω × that velocity.
        let fill = |body: &mut Body, axis: Motion, v: Motion, a: Motion| {
            body.axis = axis;
            body.velocity = Motion { linear: v.linear + velocity, ..v };
            body.acceleration = Motion { linear: a.linear - v.angular.cross(&velocity), ..a };
        };
        for i in 0..3 {
            // The sliding joints: the motion so far of the chain.
            let body = &mut bodies[i];
            let so_far = |v: &Vector3<f64>| Vector3::from_fn(|k, _| if k <= i { v[k] } else { 0.0 });
            body.position = Vector3::zeros();
            body.axis = Motion { linear: Vector3::ith(i, 1.0), ..Motion::ZERO };
            body.velocity = Motion { linear: so_far(&velocity), ..Motion::ZERO };
            body.acceleration = Motion { linear: so_far(&acceleration), ..Motion::ZERO };
        }
        for i in 0..3 {
            let body = &mut bodies[3 + i];
            body.position = Vector3::zeros();
            let turning = |v: &V3<f64>| Motion { angular: outer(v), ..Motion::ZERO };
            let a = Motion { angular: outer(&torso.spin_rate[i]), linear: acceleration };
            fill(body, turning(&torso.axis[i]), turning(&torso.spin[i]), a);
        }
        bodies[5].rotation = torso.rotation.lane(0);
        for k in 0..3 {
            let (joint, link) = (&model.joints[k], &self.links[k]);
            let body = &mut bodies[joint.place[leg]];
            body.rotation = link.rotation.lane(leg) * joint.to_urdf[leg];
            body.position = link.position.lane(leg);
            let (v, a) = (link.velocity.lane(leg), link.acceleration.lane(leg));
            fill(body, link.axis.lane(leg), v, a);
        }
    }
}
