//! What the handler of an action sees of a goal.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::Sender;

use tandem_msgs::Action;

/// How a goal ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GoalEnd {
    /// Done.
    Succeeded,
    /// Failed.
    Aborted,
    /// Stopped on request.
    Cancelled,
}

/// A goal that runs: what its handler may ask and say.
pub struct Goal<A: Action> {
    pub(super) cancelled: Arc<AtomicBool>,
    pub(super) feedback: Sender<A::Feedback>,
}

impl<A: Action> Goal<A> {
    /// Whether a client has asked to stop.
    #[must_use]
    pub fn is_cancelled(&self) -> bool {
        self.cancelled.load(Ordering::Relaxed)
    }

    /// Reports progress.
    pub fn feedback(&self, feedback: A::Feedback) {
        // After the node's end nobody listens.
        let _ = self.feedback.send(feedback);
    }
}
