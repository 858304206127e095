//! Quality of service of a recorded topic, as rosbag2 writes it down so that playing offers the same.

use serde::{Deserialize, Serialize};

/// Whether every message must arrive.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Reliability {
    /// Lost messages are sent again.
    Reliable,
    /// Lost messages stay lost.
    BestEffort,
}

/// Whether a late subscriber gets the last messages.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Durability {
    /// It does ("latched").
    TransientLocal,
    /// It does not.
    Volatile,
}

/// Quality of service: reliability, durability, and a history that keeps the last `depth` messages.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Qos {
    /// Whether every message must arrive.
    pub reliability: Reliability,
    /// Whether a late subscriber gets the last messages.
    pub durability: Durability,
    /// How many messages are kept.
    pub depth: u32,
}

impl Qos {
    /// Best effort, volatile: state and command at a high rate, `/clock`.
    pub const fn sensor(depth: u32) -> Qos {
        Qos { reliability: Reliability::BestEffort, durability: Durability::Volatile, depth }
    }

    /// Reliable, volatile: ROS 2's default (depth 10).
    pub const fn reliable(depth: u32) -> Qos {
        Qos { reliability: Reliability::Reliable, durability: Durability::Volatile, depth }
    }

    /// Reliable, transient local, depth 1: `gait`, `robot_description`.
    pub const fn latched() -> Qos {
        Qos { reliability: Reliability::Reliable, durability: Durability::TransientLocal, depth: 1 }
    }

    /// The YAML text that rosbag2 keeps with an MCAP channel.
    pub fn to_yaml(self) -> String {
        serde_yaml_ng::to_string(&[QosYaml::from(self)]).expect("a plain structure is always YAML")
    }
}

/// One profile in rosbag2's own layout (metadata version 9).
#[derive(Clone, Debug, Serialize)]
pub(crate) struct QosYaml {
    history: &'static str,
    depth: u32,
    reliability: Reliability,
    durability: Durability,
    deadline: Span,
    lifespan: Span,
    liveliness: &'static str,
    liveliness_lease_duration: Span,
    avoid_ros_namespace_conventions: bool,
}

#[derive(Clone, Copy, Debug, Serialize)]
struct Span {
    sec: u64,
    nsec: u64,
}

/// rmw's "no limit": 2^63 - 1 nanoseconds.
const UNLIMITED: Span = Span { sec: 9_223_372_036, nsec: 854_775_807 };

impl From<Qos> for QosYaml {
    fn from(qos: Qos) -> QosYaml {
        QosYaml {
            history: "keep_last",
            depth: qos.depth,
            reliability: qos.reliability,
            durability: qos.durability,
            deadline: UNLIMITED,
            lifespan: UNLIMITED,
            liveliness: "automatic",
            liveliness_lease_duration: UNLIMITED,
            avoid_ros_namespace_conventions: false,
        }
    }
}
