//! Faults: what can go wrong, by name. A fault latches until it is cleared by that name.

/// What went wrong. The discriminant is the fault's bit in a [`FaultSet`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[repr(u8)]
pub enum Fault {
    /// A measured position, velocity or temperature, or a number of the inertial unit's, was NaN or infinite.
    InvalidInput,
    /// A measured position lies where the joint cannot be.
    PositionOutOfRange,
    /// A measured velocity is higher than the joint can turn.
    VelocityOutOfRange,
    /// A measured position changed faster than the joint can turn.
    EncoderJump,
    /// A joint turned faster than its velocity limit for longer than allowed.
    Overspeed,
    /// A joint did not follow its command.
    TrackingError,
    /// A joint did not move at all while its command did.
    JointStuck,
    /// The base is tilted further than allowed.
    Tilt,
    /// A drive is too hot to go on.
    OverTemperature,
    /// A drive is hot: the robot comes to a controlled stop and does not walk until this is cleared.
    DriveHot,
    /// A drive reported an error of its own.
    DriveError,
    /// A bus to the drives is down.
    BusDown,
    /// Two control cycles lay further apart than allowed.
    Overrun,
    /// The clock, or the stamp of the joint states, went backwards.
    ClockJump,
    /// The controller computed a number that is not finite. It was not sent.
    InternalError,
    /// Another program commands the same robot.
    SecondController,
    /// Walking in balance, there was no good estimate of the base for longer than allowed.
    EstimateLost,
    /// Walking in balance, steps could not be placed or hurried as they should have been for longer than allowed.
    BalanceLost,
}

/// What a fault does to a moving robot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Severity {
    /// Finish the step, stand, refuse to walk.
    ControlledStop,
    /// Damping at once.
    Damping,
}

impl Fault {
    /// Every fault.
    pub const ALL: [Self; 18] = [
        Self::InvalidInput,
        Self::PositionOutOfRange,
        Self::VelocityOutOfRange,
        Self::EncoderJump,
        Self::Overspeed,
        Self::TrackingError,
        Self::JointStuck,
        Self::Tilt,
        Self::OverTemperature,
        Self::DriveHot,
        Self::DriveError,
        Self::BusDown,
        Self::Overrun,
        Self::ClockJump,
        Self::InternalError,
        Self::SecondController,
        Self::EstimateLost,
        Self::BalanceLost,
    ];

    /// The name by which it is shown and cleared.
    pub fn name(self) -> &'static str {
        match self {
            Self::InvalidInput => "invalid_input",
            Self::PositionOutOfRange => "position_out_of_range",
            Self::VelocityOutOfRange => "velocity_out_of_range",
            Self::EncoderJump => "encoder_jump",
            Self::Overspeed => "overspeed",
            Self::TrackingError => "tracking_error",
            Self::JointStuck => "joint_stuck",
            Self::Tilt => "tilt",
            Self::OverTemperature => "over_temperature",
            Self::DriveHot => "drive_hot",
            Self::DriveError => "drive_error",
            Self::BusDown => "bus_down",
            Self::SecondController => "second_controller",
            Self::Overrun => "overrun",
            Self::ClockJump => "clock_jump",
            Self::InternalError => "internal_error",
            Self::EstimateLost => "estimate_lost",
            Self::BalanceLost => "balance_lost",
        }
    }

    /// The fault of that name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|f| f.name() == name)
    }

    /// Where its meaning, cause and cure stand.
    pub fn page(self) -> String {
        format!("docs/faults.md#{}", self.name())
    }

    /// What it does to a moving robot.
    pub fn severity(self) -> Severity {
        match self {
            Self::DriveHot => Severity::ControlledStop,
            _ => Severity::Damping,
        }
    }

    fn bit(self) -> u32 {
        1 << self as u8
    }
}

/// The faults that are latched.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct FaultSet(u32);

impl FaultSet {
    /// None.
    pub const NONE: Self = Self(0);

    /// Latches a fault; true if it was not latched before.
    pub fn insert(&mut self, fault: Fault) -> bool {
        let new = !self.contains(fault);
        self.0 |= fault.bit();
        new
    }

    /// Clears a fault; false if it was not latched.
    pub fn remove(&mut self, fault: Fault) -> bool {
        let was = self.contains(fault);
        self.0 &= !fault.bit();
        was
    }

    /// Whether the fault is latched.
    pub fn contains(self, fault: Fault) -> bool {
        self.0 & fault.bit() != 0
    }

    /// One bit for each latched fault, the first of [`Fault::ALL`] lowest: what `ControllerState.fault_bits` holds.
    pub fn bits(self) -> u32 {
        self.0
    }

    /// Whether none is latched.
    pub fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// Whether a fault that sends the robot into damping is latched.
    pub fn any_damping(self) -> bool {
        self.iter().any(|f| f.severity() == Severity::Damping)
    }

    /// The latched faults, in the order of [`Fault::ALL`].
    pub fn iter(self) -> impl Iterator<Item = Fault> {
        Fault::ALL.into_iter().filter(move |f| self.contains(*f))
    }
}

/// Where a fault was seen first, for the message to the operator.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct FaultReport {
    /// Which fault.
    pub fault: Fault,
    /// Which joint, where it belongs to one.
    pub joint: Option<usize>,
    /// What was seen, in the unit of the limit.
    #[serde(with = "crate::bits")]
    pub value: f64,
    /// What was allowed.
    pub limit: f64,
}

impl FaultReport {
    /// The message to the operator: name, joint, what was seen, what was allowed, and what to do.
    pub fn message(&self, joint_names: &[String; crate::JOINTS]) -> String {
        let place = self.joint.map(|j| format!(" at {}", joint_names[j])).unwrap_or_default();
        let (unit, action) = match self.fault {
            Fault::InvalidInput => ("", "check the drive's encoder and the bus's wiring"),
            Fault::PositionOutOfRange => ("rad", "check the joint's zero point and encoder"),
            Fault::VelocityOutOfRange => ("rad/s", "check the joint's encoder"),
            Fault::EncoderJump => ("rad in one reading", "check the joint's encoder and its cable"),
            Fault::Overspeed => ("rad/s", "look for what drove the joint; was the robot falling?"),
            Fault::TrackingError => ("rad off its command", "look for a blocked joint or a drive without power"),
            Fault::JointStuck => (
                "rad commanded while it stood still",
                "look for a blocked joint, a failed encoder, or a drive without power",
            ),
            Fault::Tilt => ("rad", "put the robot level"),
            Fault::OverTemperature | Fault::DriveHot => ("°C", "let the drive cool down"),
            Fault::DriveError => ("as error code", "look the code up in the drive's manual"),
            Fault::BusDown => ("", "run `tandem doctor`"),
            Fault::SecondController if self.joint.is_none() => {
                ("other publishers of joint_command", "stop the other controller of this robot")
            }
            Fault::SecondController => ("commands of somebody else", "stop the other controller of this robot"),
            Fault::Overrun => ("s between two cycles", "give the controller real-time rights (docs/hardware.md)"),
            Fault::ClockJump => ("s", "restart the controller after the clock or the simulation"),
            Fault::EstimateLost => ("s without a good estimate", "look for an inertial unit that is silent or wrong"),
            Fault::BalanceLost => ("s at the balance's limits", "look for what pushed the robot, and put it level"),
            Fault::InternalError => ("", "please report this with the run's bag"),
        };
        format!(
            "fault {}{place}: saw {:.4} {unit}, allowed {:.4}; {action}, then clear it by its name ({})",
            self.fault.name(),
            self.value,
            self.limit,
            self.fault.page()
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_fault_is_found_by_its_name_and_has_a_bit_of_its_own() {
        let mut set = FaultSet::default();
        for f in Fault::ALL {
            assert_eq!(Fault::from_name(f.name()), Some(f));
            assert!(set.insert(f), "{f:?} shares a bit");
        }
        assert_eq!(set.iter().count(), Fault::ALL.len());
        for f in Fault::ALL {
            assert!(set.remove(f));
        }
        assert!(set.is_empty());
        assert_eq!(Fault::from_name("clock"), None);
    }

    #[test]
    fn every_fault_has_its_section_in_the_documents_and_its_message_names_it() {
        let page = include_str!("../../../docs/faults.md");
        let sections: Vec<&str> = page.split("\n## ").skip(1).collect();
        let found: Vec<&str> = sections.iter().filter_map(|text| text.lines().next()).collect();
        let mut names = Fault::ALL.map(Fault::name);
        names.sort_unstable();
        let mut sorted = found.clone();
        sorted.sort_unstable();
        assert_eq!(sorted, names, "a section for each fault, and for nothing else");
        for (name, text) in found.iter().zip(&sections) {
            for part in ["**Meaning.**", "**Cause.**", "**Cure.**"] {
                assert!(text.contains(part), "{name} lacks its {part}");
            }
        }
        let joint_names = core::array::from_fn(|j| format!("joint_{j}"));
        for fault in Fault::ALL {
            let report = FaultReport { fault, joint: None, value: 1.0, limit: 0.8 };
            assert!(report.message(&joint_names).ends_with(&format!("(docs/faults.md#{})", fault.name())));
        }
    }
}
