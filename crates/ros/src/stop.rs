//! The wish that a node ends.

use std::sync::Arc;

use tokio::sync::watch;

use crate::health::Health;

/// Asked to stop: by SIGINT, SIGTERM or the program itself. Clones share one state.
#[derive(Clone, Debug)]
pub struct Stop {
    sender: Arc<watch::Sender<bool>>,
    health: Health,
}

impl Stop {
    pub(crate) fn new(health: Health) -> Self {
        Stop { sender: Arc::new(watch::Sender::new(false)), health }
    }

    /// Asks everyone to stop.
    pub fn request(&self) {
        self.sender.send_replace(true);
    }

    /// Whether it has been asked. Wait-free enough for a loop, not for a control thread (a lock is taken).
    #[must_use]
    pub fn is_requested(&self) -> bool {
        *self.sender.borrow()
    }

    /// Why the node ends against its will, if it does: a thread panicked or stands still, or the process itself was
    /// stopped (SIGSTOP, Ctrl-Z) and went on, which its connections do not outlive. A program ends with an error then,
    /// for a supervisor to start it anew.
    #[must_use]
    pub fn failure(&self) -> Option<String> {
        self.health.failure()
    }

    /// Whether the node's threads live.
    #[must_use]
    pub fn health(&self) -> Health {
        self.health.clone()
    }

    /// Waits until it is asked.
    pub async fn requested(&self) {
        // The sender lives as long as self, so waiting cannot fail.
        let _ = self.sender.subscribe().wait_for(|asked| *asked).await;
    }
}
