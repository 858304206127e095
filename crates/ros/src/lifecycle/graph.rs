//! States and transitions of a managed node: the table that every ROS 2 node has, numbers and labels included.
//! `tests/ros2/test_lifecycle.py` compares it with what rclpy's own lifecycle node answers.

use tandem_msgs::lifecycle_msgs as wire;

/// A state of a managed node.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum State {
    /// Nothing is read or opened yet.
    Unconfigured = 1,
    /// Ready, but does nothing.
    Inactive = 2,
    /// Does its work.
    Active = 3,
    /// Ended for good; the process stays until it is asked to end.
    Finalized = 4,
    /// On the way to inactive.
    Configuring = 10,
    /// On the way to unconfigured.
    CleaningUp = 11,
    /// On the way to finalized.
    ShuttingDown = 12,
    /// On the way to active.
    Activating = 13,
    /// On the way to inactive.
    Deactivating = 14,
    /// A callback panicked: what can be saved is cleaned up.
    ErrorProcessing = 15,
}

use State::{
    Activating, Active, CleaningUp, Configuring, Deactivating, ErrorProcessing, Finalized, Inactive, ShuttingDown,
    Unconfigured,
};

impl State {
    pub(super) const ALL: [State; 10] = [
        Unconfigured,
        Inactive,
        Active,
        Finalized,
        Configuring,
        CleaningUp,
        ShuttingDown,
        Activating,
        Deactivating,
        ErrorProcessing,
    ];

    /// ROS 2's label.
    #[must_use]
    pub fn label(self) -> &'static str {
        match self {
            Unconfigured => "unconfigured",
            Inactive => "inactive",
            Active => "active",
            Finalized => "finalized",
            Configuring => "configuring",
            CleaningUp => "cleaningup",
            ShuttingDown => "shuttingdown",
            Activating => "activating",
            Deactivating => "deactivating",
            ErrorProcessing => "errorprocessing",
        }
    }

    pub(super) fn from_id(id: u8) -> Option<State> {
        Self::ALL.into_iter().find(|state| *state as u8 == id)
    }

    pub(super) fn to_wire(self) -> wire::State {
        wire::State { id: self as u8, label: self.label().to_string() }
    }
}

/// What may be asked of a managed node.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Change {
    /// Read and open what is needed.
    Configure,
    /// Give it back.
    CleanUp,
    /// Begin to work.
    Activate,
    /// Rest.
    Deactivate,
    /// End for good.
    ShutDown,
}

impl Change {
    pub(super) fn label(self) -> &'static str {
        match self {
            Change::Configure => "configure",
            Change::CleanUp => "cleanup",
            Change::Activate => "activate",
            Change::Deactivate => "deactivate",
            Change::ShutDown => "shutdown",
        }
    }
}

/// How a callback ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Outcome {
    Success,
    Failure,
    Error,
}

/// One transition: ROS 2's number and label, from, to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Edge {
    pub(super) id: u8,
    pub(super) label: &'static str,
    pub(super) from: State,
    pub(super) to: State,
}

const fn edge(id: u8, label: &'static str, from: State, to: State) -> Edge {
    Edge { id, label, from, to }
}

const SUCCESS: &str = "transition_success";
const FAILURE: &str = "transition_failure";
const ERROR: &str = "transition_error";

/// Every transition, in ROS 2's order.
pub(super) const GRAPH: [Edge; 25] = [
    edge(1, "configure", Unconfigured, Configuring),
    edge(10, SUCCESS, Configuring, Inactive),
    edge(11, FAILURE, Configuring, Unconfigured),
    edge(12, ERROR, Configuring, ErrorProcessing),
    edge(2, "cleanup", Inactive, CleaningUp),
    edge(20, SUCCESS, CleaningUp, Unconfigured),
    edge(21, FAILURE, CleaningUp, Inactive),
    edge(22, ERROR, CleaningUp, ErrorProcessing),
    edge(3, "activate", Inactive, Activating),
    edge(30, SUCCESS, Activating, Active),
    edge(31, FAILURE, Activating, Inactive),
    edge(32, ERROR, Activating, ErrorProcessing),
    edge(4, "deactivate", Active, Deactivating),
    edge(40, SUCCESS, Deactivating, Inactive),
    edge(41, FAILURE, Deactivating, Active),
    edge(42, ERROR, Deactivating, ErrorProcessing),
    edge(5, "shutdown", Unconfigured, ShuttingDown),
    edge(6, "shutdown", Inactive, ShuttingDown),
    edge(7, "shutdown", Active, ShuttingDown),
    edge(50, SUCCESS, ShuttingDown, Finalized),
    edge(51, FAILURE, ShuttingDown, Finalized),
    edge(52, ERROR, ShuttingDown, ErrorProcessing),
    edge(60, SUCCESS, ErrorProcessing, Unconfigured),
    edge(61, FAILURE, ErrorProcessing, Finalized),
    edge(62, ERROR, ErrorProcessing, Finalized),
];

/// Transitions that can be asked for in `state`; the others happen by themselves.
pub(super) fn available(state: State) -> impl Iterator<Item = &'static Edge> {
    GRAPH.iter().filter(move |edge| edge.from == state && edge.id < 10)
}

/// The transition that a request names in `state`: by its label where it has one, as ROS 2's own nodes do, else by its
/// number.
pub(super) fn requested(state: State, id: u8, label: &str) -> Option<&'static Edge> {
    available(state).find(|edge| if label.is_empty() { edge.id == id } else { edge.label == label })
}

/// Where a transition's callback leads.
pub(super) fn outcome(passing: State, outcome: Outcome) -> Option<&'static Edge> {
    let label = match outcome {
        Outcome::Success => SUCCESS,
        Outcome::Failure => FAILURE,
        Outcome::Error => ERROR,
    };
    GRAPH.iter().find(|edge| edge.from == passing && edge.label == label)
}

impl Edge {
    pub(super) fn transition(&self) -> wire::Transition {
        wire::Transition { id: self.id, label: self.label.to_string() }
    }

    pub(super) fn describe(&self) -> wire::TransitionDescription {
        wire::TransitionDescription {
            transition: self.transition(),
            start_state: self.from.to_wire(),
            goal_state: self.to.to_wire(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PRIMARY: [State; 4] = [Unconfigured, Inactive, Active, Finalized];
    const CHANGES: [Change; 5] =
        [Change::Configure, Change::CleanUp, Change::Activate, Change::Deactivate, Change::ShutDown];

    /// Every state by every change by every outcome, written down.
    #[test]
    fn every_change_in_every_state_leads_where_the_design_says() {
        let ends = |from, change: Change| {
            let begin = requested(from, 0, change.label())?;
            Some([Outcome::Success, Outcome::Failure, Outcome::Error].map(|how| outcome(begin.to, how).unwrap().to))
        };
        for from in State::ALL {
            for change in CHANGES {
                let expected = match (from, change) {
                    (Unconfigured, Change::Configure) => Some([Inactive, Unconfigured, ErrorProcessing]),
                    (Inactive, Change::CleanUp) => Some([Unconfigured, Inactive, ErrorProcessing]),
                    (Inactive, Change::Activate) => Some([Active, Inactive, ErrorProcessing]),
                    (Active, Change::Deactivate) => Some([Inactive, Active, ErrorProcessing]),
                    (Unconfigured | Inactive | Active, Change::ShutDown) => {
                        Some([Finalized, Finalized, ErrorProcessing])
                    }
                    _ => None,
                };
                assert_eq!(ends(from, change), expected, "{from:?} {change:?}");
            }
        }
        let after_error =
            [Outcome::Success, Outcome::Failure, Outcome::Error].map(|how| outcome(ErrorProcessing, how).unwrap().to);
        assert_eq!(after_error, [Unconfigured, Finalized, Finalized]);
    }

    #[test]
    fn the_graph_is_whole() {
        for (index, edge) in GRAPH.iter().enumerate() {
            assert!(GRAPH[..index].iter().all(|other| other.id != edge.id), "{edge:?} has another's number");
            assert_eq!(edge.id < 10, PRIMARY.contains(&edge.from), "{edge:?}");
            assert_eq!(edge.id >= 10, PRIMARY.contains(&edge.to) || edge.to == ErrorProcessing, "{edge:?}");
        }
        for state in State::ALL {
            assert_eq!(State::from_id(state as u8), Some(state));
            for how in [Outcome::Success, Outcome::Failure, Outcome::Error] {
                assert_eq!(outcome(state, how).is_some(), !PRIMARY.contains(&state), "{state:?} {how:?}");
            }
        }
        assert_eq!(State::from_id(0), None);
    }

    #[test]
    fn a_label_counts_before_a_number_and_outcomes_cannot_be_asked_for() {
        assert_eq!(requested(Unconfigured, 1, "").unwrap().to, Configuring);
        assert_eq!(requested(Unconfigured, 1, "shutdown").unwrap().id, 5);
        for id in 0..=u8::MAX {
            for state in State::ALL {
                let expected = available(state).any(|edge| edge.id == id);
                assert_eq!(requested(state, id, "").is_some(), expected, "{state:?} {id}");
            }
        }
        assert!(requested(Configuring, 10, "").is_none());
        assert!(requested(Configuring, 0, SUCCESS).is_none());
        assert!(requested(Unconfigured, 1, "bogus").is_none());
    }
}
