//! Managed nodes (<https://design.ros2.org/articles/node_lifecycle.html>): states, transitions, their services and their topic.
//!
//! The table below is the one that every ROS 2 node has, numbers and labels included; `tests/ros2/test_lifecycle.py` compares it
//! with what rclpy's own lifecycle node answers.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicU8, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use tandem_msgs::lifecycle_msgs as wire;

use crate::{Node, Publisher, Qos, RosError};

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
    const ALL: [State; 10] = [
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

    fn from_id(id: u8) -> Option<State> {
        Self::ALL.into_iter().find(|state| *state as u8 == id)
    }

    fn to_wire(self) -> wire::State {
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
    fn label(self) -> &'static str {
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
enum Outcome {
    Success,
    Failure,
    Error,
}

/// One transition: ROS 2's number and label, from, to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Edge {
    id: u8,
    label: &'static str,
    from: State,
    to: State,
}

const fn edge(id: u8, label: &'static str, from: State, to: State) -> Edge {
    Edge { id, label, from, to }
}

const SUCCESS: &str = "transition_success";
const FAILURE: &str = "transition_failure";
const ERROR: &str = "transition_error";

/// Every transition, in ROS 2's order.
const GRAPH: [Edge; 25] = [
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
fn available(state: State) -> impl Iterator<Item = &'static Edge> {
    GRAPH.iter().filter(move |edge| edge.from == state && edge.id < 10)
}

/// The transition that a request names in `state`: by its label where it has one, as ROS 2's own nodes do, else by its number.
fn requested(state: State, id: u8, label: &str) -> Option<&'static Edge> {
    available(state).find(|edge| if label.is_empty() { edge.id == id } else { edge.label == label })
}

/// Where a transition's callback leads.
fn outcome(passing: State, outcome: Outcome) -> Option<&'static Edge> {
    let label = match outcome {
        Outcome::Success => SUCCESS,
        Outcome::Failure => FAILURE,
        Outcome::Error => ERROR,
    };
    GRAPH.iter().find(|edge| edge.from == passing && edge.label == label)
}

impl Edge {
    fn transition(&self) -> wire::Transition {
        wire::Transition { id: self.id, label: self.label.to_string() }
    }

    fn describe(&self) -> wire::TransitionDescription {
        wire::TransitionDescription {
            transition: self.transition(),
            start_state: self.from.to_wire(),
            goal_state: self.to.to_wire(),
        }
    }
}

/// What a managed node does at its transitions. An error leaves the node in the state in which it was (a failed shut-down ends it
/// all the same), and its sentence goes into the log.
pub trait Managed: Send + 'static {
    /// Read and open what is needed; on an error everything is as before. `goes_active`: activating follows at once, and clients
    /// that find the first endpoint need not be refused until then.
    ///
    /// # Errors
    /// One sentence for people.
    fn configure(&mut self, goes_active: bool) -> Result<(), String>;
    /// Begin to work.
    ///
    /// # Errors
    /// One sentence for people.
    fn activate(&mut self) -> Result<(), String>;
    /// Rest, safely.
    ///
    /// # Errors
    /// One sentence for people; the node stays active.
    fn deactivate(&mut self) -> Result<(), String>;
    /// Give back what configuring took.
    ///
    /// # Errors
    /// One sentence for people.
    fn clean_up(&mut self) -> Result<(), String>;
}

/// A change that did not happen.
#[derive(Debug, thiserror::Error)]
pub enum ChangeError {
    /// It does not exist in this state.
    #[error("{change} is not possible while {}; possible: {possible}", state.label())]
    Impossible {
        /// What was asked, by its label.
        change: String,
        /// The present state.
        state: State,
        /// What can be asked, by labels.
        possible: String,
    },
    /// The node could not.
    #[error("{reason}")]
    Failed {
        /// Its sentence.
        reason: String,
    },
}

struct LifecycleInner {
    state: AtomicU8,
    autostart: bool,
    managed: Mutex<Box<dyn Managed>>,
    events: Publisher<wire::TransitionEvent>,
}

/// A managed node's state. Clones share it.
#[derive(Clone)]
pub struct Lifecycle {
    inner: Arc<LifecycleInner>,
}

impl Node {
    /// Makes this a managed node, which begins unconfigured: serves `~/change_state`, `~/get_state`, `~/get_available_states`,
    /// `~/get_available_transitions` and `~/get_transition_graph`, publishes `~/transition_event`, and has a parameter
    /// `autostart`, which [`Lifecycle::start`] obeys.
    ///
    /// # Errors
    /// What the middleware refuses.
    pub fn manage(&self, managed: impl Managed) -> Result<Lifecycle, RosError> {
        let autostart = self
            .parameter("autostart", true)
            .description("Become active by itself; false: stay unconfigured until change_state is called.")
            .read_only()
            .declare()?
            .get();
        let events = self.publisher("~/transition_event", Qos::reliable(10))?;
        let state = AtomicU8::new(Unconfigured as u8);
        let inner = LifecycleInner { state, autostart, managed: Mutex::new(Box::new(managed)), events };
        let lifecycle = Lifecycle { inner: Arc::new(inner) };
        let this = lifecycle.clone();
        self.serve::<wire::ChangeState>("~/change_state", move |request| {
            let asked = request.transition;
            let done = this.change_by(asked.id, &asked.label, false);
            if let Err(error) = &done {
                tracing::warn!("change_state: {error}");
            }
            wire::ChangeStateResponse { success: done.is_ok() }
        })?;
        let this = lifecycle.clone();
        self.serve::<wire::GetState>("~/get_state", move |_| wire::GetStateResponse {
            current_state: this.state().to_wire(),
        })?;
        self.serve::<wire::GetAvailableStates>("~/get_available_states", move |_| {
            // ROS 2 lists the state that is none as well.
            let unknown = wire::State { id: 0, label: "unknown".to_string() };
            let states = State::ALL.into_iter().map(State::to_wire);
            wire::GetAvailableStatesResponse { available_states: std::iter::once(unknown).chain(states).collect() }
        })?;
        let this = lifecycle.clone();
        self.serve::<wire::GetAvailableTransitions>("~/get_available_transitions", move |_| {
            wire::GetAvailableTransitionsResponse {
                available_transitions: available(this.state()).map(Edge::describe).collect(),
            }
        })?;
        self.serve::<wire::GetAvailableTransitions>("~/get_transition_graph", move |_| {
            wire::GetAvailableTransitionsResponse { available_transitions: GRAPH.iter().map(Edge::describe).collect() }
        })?;
        Ok(lifecycle)
    }
}

impl Node {
    /// As [`Node::run`]; before the node leaves, what it manages is shut down.
    ///
    /// # Errors
    /// What went wrong while it was shut down. The node has left all the same.
    pub fn run_managed(self, lifecycle: &Lifecycle) -> Result<(), ChangeError> {
        self.wait_for_stop();
        let ended = if lifecycle.state() == Finalized { Ok(()) } else { lifecycle.change(Change::ShutDown) };
        self.shutdown();
        ended
    }
}

impl Lifecycle {
    /// The present state.
    #[must_use]
    pub fn state(&self) -> State {
        // Only numbers of states are stored.
        State::from_id(self.inner.state.load(Ordering::Acquire)).unwrap_or(Finalized)
    }

    /// Becomes active, unless the parameter `autostart` is false.
    ///
    /// # Errors
    /// The node could not; it stays unconfigured or inactive.
    pub fn start(&self) -> Result<(), ChangeError> {
        if !self.inner.autostart {
            tracing::info!("unconfigured: waits for change_state, because autostart is false");
            return Ok(());
        }
        self.change_by(0, Change::Configure.label(), true)?;
        self.change(Change::Activate)
    }

    /// Asks for a change and waits until it is done.
    ///
    /// # Errors
    /// It does not exist in the present state, or the node could not.
    pub fn change(&self, change: Change) -> Result<(), ChangeError> {
        self.change_by(0, change.label(), false)
    }

    fn change_by(&self, id: u8, label: &str, goes_active: bool) -> Result<(), ChangeError> {
        // One change at a time: whoever asks meanwhile waits, and is answered for the state that is then.
        let mut managed = self.inner.managed.lock().unwrap_or_else(PoisonError::into_inner);
        let before = self.state();
        let begin = requested(before, id, label).ok_or_else(|| ChangeError::Impossible {
            change: if label.is_empty() { format!("transition {id}") } else { format!("\"{label}\"") },
            state: before,
            possible: match available(before).map(|edge| edge.label).collect::<Vec<_>>() {
                none if none.is_empty() => "nothing".to_string(),
                some => some.join(", "),
            },
        })?;
        self.pass(begin);
        let mut call = |step: &mut dyn FnMut(&mut dyn Managed) -> Result<(), String>| {
            match catch_unwind(AssertUnwindSafe(|| step(managed.as_mut()))) {
                Ok(Ok(())) => (Outcome::Success, None),
                Ok(Err(reason)) => (Outcome::Failure, Some(reason)),
                // The panic's own message went to standard error.
                Err(_) => (Outcome::Error, Some("it panicked; the lines above say where".to_string())),
            }
        };
        let (how, reason) = call(&mut |node| match begin.to {
            Configuring => node.configure(goes_active),
            Activating => node.activate(),
            Deactivating => node.deactivate(),
            CleaningUp => node.clean_up(),
            _ => {
                let rested = if before == Active { node.deactivate() } else { Ok(()) };
                let cleaned = if before == Unconfigured { Ok(()) } else { node.clean_up() };
                rested.and(cleaned)
            }
        });
        self.arrive(begin.to, how);
        if how == Outcome::Error {
            tracing::error!("{} failed: a thread of it panicked; the node is cleaned up", begin.label);
            let (how, _) = call(&mut |node| node.clean_up());
            self.arrive(ErrorProcessing, how);
        }
        reason.map_or(Ok(()), |reason| Err(ChangeError::Failed { reason: format!("{}: {reason}", begin.label) }))
    }

    fn arrive(&self, passing: State, how: Outcome) {
        // Every passing state has an edge for every outcome: a test goes through them.
        if let Some(edge) = outcome(passing, how) {
            self.pass(edge);
        }
    }

    fn pass(&self, edge: &'static Edge) {
        self.inner.state.store(edge.to as u8, Ordering::Release);
        let now = crate::wall_time().nanoseconds();
        let event = wire::TransitionEvent {
            timestamp: u64::try_from(now).unwrap_or_default(),
            transition: edge.transition(),
            start_state: edge.from.to_wire(),
            goal_state: edge.to.to_wire(),
        };
        if let Err(error) = self.inner.events.publish(event) {
            tracing::debug!("{error}"); // after the node's end nobody listens
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
