//! What the ground does to the toes.

use super::Simulator;
use joints::LEGS;
use nalgebra::{Matrix3, Vector3};

impl Simulator {
    /// The ground's force on each toe in the last physics step, world axes, N.
    pub(super) fn toe_forces(&self) -> [[f64; 3]; LEGS] {
        let mut forces = [[0.0; 3]; LEGS];
        for (i, contact) in self.data.contact().iter().enumerate() {
            for (leg, &toe) in self.toe_geoms.iter().enumerate() {
                // The normal, first row of the contact frame, points from the first geom to the second.
                let sign = match toe as i32 {
                    t if t == contact.geom[1] => 1.0,
                    t if t == contact.geom[0] => -1.0,
                    _ => continue,
                };
                let force = self.data.contact_force(i);
                let frame = Matrix3::from_row_slice(&contact.frame);
                let in_world = frame.transpose() * Vector3::new(force[0], force[1], force[2]) * sign;
                for axis in 0..3 {
                    forces[leg][axis] += in_world[axis];
                }
            }
        }
        forces
    }
}
