//! A simulated robot that is not as its description says: what a controller must bear.

use robot::Robot;
use urdf_rs::{Joint, JointType, Pose};

/// Differences from the description. None by default.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Variation {
    /// A weight on the torso, kg …
    pub payload_kg: f64,
    /// … at this place, m, in the base's axes.
    pub payload_at_m: [f64; 3],
    /// All masses and moments of inertia times this.
    pub mass_scale: f64,
    /// The torso's centre of mass lies this far away, m, in the torso's axes.
    pub torso_shift_m: [f64; 3],
    /// The drives' stiffness kp times this.
    pub stiffness_scale: f64,
    /// The first leg's shank is this many times as long: its toe lies there, on a link of its own.
    pub shank_scale: f64,
}

impl Default for Variation {
    fn default() -> Self {
        Self {
            payload_kg: 0.0,
            payload_at_m: [0.0; 3],
            mass_scale: 1.0,
            torso_shift_m: [0.0; 3],
            stiffness_scale: 1.0,
            shank_scale: 1.0,
        }
    }
}

impl Variation {
    /// Where a joint places its child.
    pub(crate) fn origin(&self, robot: &Robot, joint: &Joint) -> Pose {
        let mut origin = joint.origin.clone();
        let toe = robot.model.frame_name(robot.legs[0].toe);
        if joint.joint_type == JointType::Fixed && joint.child.link == toe {
            origin.xyz.0 = origin.xyz.0.map(|x| self.shank_scale * x);
        }
        origin
    }

    /// The payload as a body of the base, in MuJoCo's format: a cube of 0.2 m.
    pub(crate) fn payload(&self) -> String {
        if self.payload_kg == 0.0 {
            return String::new();
        }
        let [x, y, z] = self.payload_at_m;
        let (kg, moment) = (self.payload_kg, self.payload_kg * 0.2 * 0.2 / 6.0);
        format!(
            r#"<body name="payload" pos="{x} {y} {z}"><inertial pos="0 0 0" mass="{kg}" diaginertia="{moment} {moment} {moment}"/></body>"#
        )
    }
}
