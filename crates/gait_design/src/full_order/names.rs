//! What coordinates, joints and toes are called.

use robot::Robot;

/// The legs' names, for people.
#[derive(Clone, Debug)]
pub(super) struct Names([String; 4]);

impl Names {
    pub fn of(robot: &Robot) -> Self {
        Self(std::array::from_fn(|leg| robot.legs[leg].name.replace('_', " ")))
    }

    /// One of the twelve joints.
    pub fn joint(&self, joint: usize) -> String {
        format!("{} {}", self.0[joint / 3], ["hip roll", "hip pitch", "knee"][joint % 3])
    }

    /// One of the eighteen coordinates.
    pub fn coordinate(&self, coordinate: usize) -> String {
        const BASE: [&str; 6] = ["base x", "base y", "base z", "base roll", "base pitch", "base yaw"];
        if coordinate < 6 { BASE[coordinate].into() } else { self.joint(coordinate - 6) }
    }

    pub fn toe(&self, leg: usize) -> String {
        format!("the {} toe", self.0[leg])
    }
}
