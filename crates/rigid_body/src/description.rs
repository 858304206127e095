//! A URDF as it was read, once, for every part that needs it: the model, the robot's limits, the simulator.

use nalgebra::{Rotation3, Unit, Vector3};
use urdf_rs::JointType;

use crate::error::ModelError;

/// A URDF's links and joints after the changes that every reader of it must see, and what was changed.
#[derive(Debug, Clone)]
pub struct Description {
    pub(crate) robot: urdf_rs::Robot,
    notes: Vec<String>,
}

impl Description {
    /// Reads a URDF's text. A floating joint from a root link without mass is removed: a robot's base floats anyway.
    ///
    /// # Errors
    ///
    /// A [`ModelError`] for a text that is no URDF, or holds what is no number.
    pub fn read(text: &str) -> Result<Self, ModelError> {
        let parts = crate::shape::check(text)?;
        let robot = urdf_rs::read_from_string(text)
            .map_err(|error| crate::shape::with_place(text, &parts, error.to_string()))?;
        let mut description = Self { robot, notes: Vec::new() };
        description.remove_floating_joint();
        description.note_degrees();
        Ok(description)
    }

    /// Links and joints.
    pub fn robot(&self) -> &urdf_rs::Robot {
        &self.robot
    }

    /// What was changed, a line each, for a person to read.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// A joint by its name.
    pub fn joint(&self, name: &str) -> Option<&urdf_rs::Joint> {
        self.robot.joints.iter().find(|joint| joint.name == name)
    }

    /// Makes a joint fixed where it stands at `position`, rad or m: its link's mass counts where it is then.
    ///
    /// # Errors
    ///
    /// If there is no such joint, it does not move along or about an axis, or the position is not finite.
    pub fn lock(&mut self, name: &str, position: f64) -> Result<(), ModelError> {
        let known = || {
            let movable = self.robot.joints.iter().filter(|joint| joint.joint_type != JointType::Fixed);
            movable.map(|joint| joint.name.clone()).collect::<Vec<_>>().join(", ")
        };
        let Some(at) = self.robot.joints.iter().position(|joint| joint.name == name) else {
            return Err(ModelError::UnknownJoint { joint: name.to_owned(), known: known() });
        };
        let joint = &mut self.robot.joints[at];
        if !position.is_finite() {
            let owner = format!("joint '{name}'");
            return Err(ModelError::NotFinite { owner, field: "locked position", value: position });
        }
        let axis = Vector3::from(joint.axis.xyz.0);
        let length = axis.norm();
        let turns = matches!(joint.joint_type, JointType::Revolute | JointType::Continuous);
        let moves = turns || joint.joint_type == JointType::Prismatic;
        if moves && position != 0.0 {
            if !(1e-6..1e6).contains(&length) {
                return Err(ModelError::BadAxis { joint: name.to_owned(), length });
            }
            let [roll, pitch, yaw] = joint.origin.rpy.0;
            let placed = Rotation3::from_euler_angles(roll, pitch, yaw);
            if turns {
                let turned = placed * Rotation3::from_axis_angle(&Unit::new_normalize(axis), position);
                let (roll, pitch, yaw) = turned.euler_angles();
                joint.origin.rpy.0 = [roll, pitch, yaw];
            } else {
                let moved = Vector3::from(joint.origin.xyz.0) + placed * axis * (position / length);
                joint.origin.xyz.0 = moved.into();
            }
        }
        joint.joint_type = JointType::Fixed;
        joint.mimic = None;
        Ok(())
    }

    /// A line for origins turned by more than a turn: degrees, mostly. They are used as they are.
    fn note_degrees(&mut self) {
        /// One turn, rad.
        const MOST_RAD: f64 = 6.3;
        let turned = |pose: &urdf_rs::Pose| pose.rpy.0.into_iter().find(|angle| angle.abs() > MOST_RAD);
        let joints = self.robot.joints.iter().map(|joint| ("joint", &joint.name, &joint.origin));
        let links = self.robot.links.iter().map(|link| ("inertial of link", &link.name, &link.inertial.origin));
        for (kind, name, origin) in joints.chain(links) {
            if let Some(angle) = turned(origin) {
                self.notes.push(format!(
                    "the origin of the {kind} '{name}' has the angle {angle}: more than a turn, or degrees ({:.5} rad)?",
                    angle.to_radians()
                ));
            }
        }
    }

    fn remove_floating_joint(&mut self) {
        let robot = &self.robot;
        let found = robot.joints.iter().position(|joint| {
            let parent = &joint.parent.link;
            let bare = robot.links.iter().any(|link| link.name == *parent && link.inertial.mass.value == 0.0);
            let joints_at = robot.joints.iter().filter(|other| other.parent.link == *parent).count();
            let is_root = robot.joints.iter().all(|other| other.child.link != *parent);
            joint.joint_type == JointType::Floating && bare && is_root && joints_at == 1
        });
        let Some(at) = found else { return };
        let joint = self.robot.joints.remove(at);
        self.robot.links.retain(|link| link.name != joint.parent.link);
        self.notes.push(format!(
            "the floating joint '{}' and the link '{}' that it hangs from are left out: the base floats without them",
            joint.name, joint.parent.link
        ));
    }
}
