//! Points of the last forward pass with their derivatives, and what forces at them do.

use nalgebra::Vector3;

use super::links::LimbModel;
use super::pass::{LimbData, TURNS};
use crate::lanes::{Lane, V3};
use crate::point::PointKinematics;
use crate::spatial::Motion;

/// Where a point is from the torso's origin, and the chain that it hangs from: so many links of a leg.
struct Point {
    leg: usize,
    links: usize,
    position: Vector3<f64>,
}

/// A turning joint: its coordinate, its axis, and how the body moves that it hangs from. As in the recursions, seen by
/// somebody who moves with the torso's origin.
#[derive(Clone, Copy)]
struct Turn {
    dof: usize,
    axis: Motion,
    velocity: Motion,
    acceleration: Motion,
}

#[inline(always)]
fn outer(v: &V3<f64>) -> Vector3<f64> {
    Vector3::new(v.x, v.y, v.z)
}

impl<T: Lane> LimbData<T> {
    #[inline(always)]
    fn point(&self, model: &LimbModel<T>, place: usize, offset: &Vector3<f64>) -> Point {
        let Some(leg) = model.leg_of(place) else {
            return Point { leg: 0, links: 0, position: self.torso.rotation.lane(0) * offset };
        };
        let k = (0..3).find(|&k| model.joints[k].place[leg] == place).expect("the leg was found by this joint");
        let link = &self.links[k];
        let turned = link.rotation.lane(leg) * (model.joints[k].to_urdf[leg] * offset);
        Point { leg, links: k + 1, position: link.position.lane(leg) + turned }
    }

    /// How the torso moves below its i-th turning joint.
    #[inline(always)]
    fn torso_motion(&self, i: usize) -> [Motion; 2] {
        let torso = &self.torso;
        let acceleration = Motion { angular: outer(&torso.spin_rate[i]), linear: outer(&torso.acceleration) };
        [Motion { angular: outer(&torso.spin[i]), ..Motion::ZERO }, acceleration]
    }

    /// How the body moves that is so many links down a leg.
    #[inline(always)]
    fn link_motion(&self, leg: usize, links: usize) -> [Motion; 2] {
        match links {
            0 => self.torso_motion(2),
            _ => [self.links[links - 1].velocity.lane(leg), self.links[links - 1].acceleration.lane(leg)],
        }
    }

    /// The i-th turning joint above a point, from yaw on.
    #[inline(always)]
    fn turn(&self, model: &LimbModel<T>, point: &Point, i: usize) -> Turn {
        if i >= 3 {
            let [velocity, acceleration] = self.link_motion(point.leg, i - 3);
            let axis = self.links[i - 3].axis.lane(point.leg);
            return Turn { dof: model.joints[i - 3].dof[point.leg], axis, velocity, acceleration };
        }
        let axis = Motion { angular: outer(&self.torso.axis[i]), ..Motion::ZERO };
        let [velocity, acceleration] = match i {
            0 => [Motion::ZERO, Motion { linear: outer(&self.torso.acceleration), ..Motion::ZERO }],
            _ => self.torso_motion(i - 1),
        };
        Turn { dof: TURNS[i], axis, velocity, acceleration }
    }

    /// [`crate::last_point_kinematics`] and, with DERIVATIVES, [`crate::last_point_kinematics_derivatives`].
    #[inline(always)]
    pub fn point_kinematics<const DERIVATIVES: bool>(
        &self,
        model: &LimbModel<T>,
        place: usize,
        offset: &Vector3<f64>,
        out: &mut PointKinematics,
    ) {
        let point = self.point(model, place, offset);
        let p = &point.position;
        let motion = self.link_motion(point.leg, point.links);
        let [position, carried, _] = self.carrier.map(|v| outer(&v));
        let (velocity, acceleration) = motion_at(&motion, p);
        (out.position, out.velocity, out.acceleration) = (position + p, carried + velocity, acceleration);
        let jacobian = out.jacobian.as_mut_slice();
        let dvelocity_dq = out.dvelocity_dq.as_mut_slice();
        let dacceleration_dq = out.dacceleration_dq.as_mut_slice();
        let dacceleration_dv = out.dacceleration_dv.as_mut_slice();
        jacobian.fill(0.0);
        for axis in 0..3 {
            jacobian[4 * axis] = 1.0;
        }
        if DERIVATIVES {
            dvelocity_dq.fill(0.0);
            dacceleration_dq.fill(0.0);
            dacceleration_dv.fill(0.0);
        }
        for i in 0..3 + point.links {
            let turn = self.turn(model, &point, i);
            let column = turn.axis.at(p);
            let entries = 3 * turn.dof..3 * turn.dof + 3;
            jacobian[entries.clone()].copy_from_slice(column.as_slice());
            if DERIVATIVES {
                let (spin, axis) = (&turn.velocity.angular, &turn.axis.angular);
                let (velocity_there, acceleration_there) = motion_at(&[turn.velocity, turn.acceleration], p);
                let relative_velocity = velocity - velocity_there;
                let relative_acceleration = acceleration - acceleration_there - spin.cross(&relative_velocity) * 2.0;
                let (swept, turned) = (spin.cross(&column), axis.cross(&relative_velocity));
                let dvelocity = swept + turned;
                let dacceleration = turn.acceleration.angular.cross(&column)
                    + spin.cross(&(swept + turned * 2.0))
                    + axis.cross(&relative_acceleration);
                dvelocity_dq[entries.clone()].copy_from_slice(dvelocity.as_slice());
                dacceleration_dq[entries.clone()].copy_from_slice(dacceleration.as_slice());
                dacceleration_dv[entries].copy_from_slice((dvelocity * 2.0).as_slice());
            }
        }
    }

    /// Takes the share of a force at a point off τ and, with DERIVATIVES, off ∂τ/∂q, column-major, n × n.
    #[inline(always)]
    pub fn subtract_force<const DERIVATIVES: bool>(
        &self,
        model: &LimbModel<T>,
        (place, offset, force): (usize, &Vector3<f64>, &Vector3<f64>),
        tau: &mut [f64],
        dtau_dq: &mut [f64],
    ) {
        let point = self.point(model, place, offset);
        let n = 6 + 3 * T::WIDTH;
        for axis in 0..3 {
            tau[axis] -= force[axis];
        }
        let mut above = [(0, Vector3::zeros()); 6];
        for i in 0..3 + point.links {
            let turn = self.turn(model, &point, i);
            let column = turn.axis.at(&point.position);
            tau[turn.dof] -= column.dot(force);
            if DERIVATIVES {
                let across = force.cross(&column);
                for (dof, axis) in &above[..i] {
                    let share = axis.dot(&across);
                    dtau_dq[dof + n * turn.dof] += share;
                    dtau_dq[turn.dof + n * dof] += share;
                }
                dtau_dq[turn.dof + n * turn.dof] += turn.axis.angular.dot(&across);
                above[i] = (turn.dof, turn.axis.angular);
            }
        }
    }
}

/// Velocity and classical acceleration of the point p of a body.
#[inline(always)]
fn motion_at([velocity, acceleration]: &[Motion; 2], p: &Vector3<f64>) -> (Vector3<f64>, Vector3<f64>) {
    let at_p = velocity.at(p);
    (at_p, acceleration.at(p) + velocity.angular.cross(&at_p))
}
