//! Managed nodes (<https://design.ros2.org/articles/node_lifecycle.html>): their services, their topic, and what they
//! do at a transition. The transitions themselves are in `graph`.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicU8, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use tandem_msgs::lifecycle_msgs as wire;

use crate::{Node, Publisher, Qos, RosError};

mod graph;

pub use graph::{Change, State};

use State::{Activating, Active, CleaningUp, Configuring, Deactivating, ErrorProcessing, Finalized, Unconfigured};
use graph::{Edge, GRAPH, Outcome, available, outcome, requested};

/// What a managed node does at its transitions. An error leaves the node in the state in which it was (a failed
/// shut-down ends it all the same), and its sentence goes into the log.
pub trait Managed: Send + 'static {
    /// Read and open what is needed; on an error everything is as before. `goes_active`: activating follows at once,
    /// and clients that find the first endpoint need not be refused until then.
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
    /// Makes this a managed node, which begins unconfigured: serves `~/change_state`, `~/get_state`,
    /// `~/get_available_states`, `~/get_available_transitions` and `~/get_transition_graph`, publishes
    /// `~/transition_event`, and has a parameter `autostart`, which [`Lifecycle::start`] obeys.
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
