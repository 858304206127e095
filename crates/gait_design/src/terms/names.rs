//! What coordinates, joints and toes are called.

use gait::LEGS;
use robot::Robot;

/// The legs' names, for people.
#[derive(Clone, Debug)]
pub(crate) struct Names {
    legs: [String; LEGS],
    /// Legs whose joints a program's coordinates are, in their order.
    order: &'static [usize],
    /// Whether rows are told apart that differ by an axis or by a rate only.
    pub apart: bool,
}

impl Names {
    /// Of the whole robot's coordinates.
    pub fn of(robot: &Robot) -> Self {
        Self {
            legs: std::array::from_fn(|leg| robot.legs[leg].name.replace('_', " ")),
            order: &[0, 1, 2, 3],
            apart: false,
        }
    }

    /// Of coordinates that are the joints of some legs; rows that differ by an axis or by a rate only are told apart.
    pub fn of_legs(robot: &Robot, order: &'static [usize]) -> Self {
        Self { order, apart: true, ..Self::of(robot) }
    }

    /// ", x", where rows are told apart by their axes.
    pub fn axis(&self, axis: usize) -> &'static str {
        if self.apart { [", x", ", y", ", z"][axis] } else { "" }
    }

    /// A joint of a leg.
    pub fn joint_of(&self, leg: usize, joint: usize) -> String {
        format!("{} {}", self.legs[leg], ["hip roll", "hip pitch", "knee"][joint])
    }

    /// One of the program's joints.
    pub fn joint(&self, joint: usize) -> String {
        self.joint_of(self.order[joint / 3], joint % 3)
    }

    /// One of the base's coordinates.
    pub fn base(&self, coordinate: usize) -> &'static str {
        ["base x", "base y", "base z", "base roll", "base pitch", "base yaw"][coordinate]
    }

    /// One of the program's coordinates.
    pub fn coordinate(&self, coordinate: usize) -> String {
        if coordinate < 6 { self.base(coordinate).into() } else { self.joint(coordinate - 6) }
    }

    pub fn toe(&self, leg: usize) -> String {
        format!("the {} toe", self.legs[leg])
    }
}
