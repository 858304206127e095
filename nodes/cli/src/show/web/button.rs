//! The page's stop button: silent until it is pressed, then a level that is repeated as `tandem stop-button` does.

use ros::{Node, Publisher, Qos};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use tandem_msgs::std_msgs::Bool;

/// Time between two messages: that of `tandem stop-button`.
pub const PERIOD: Duration = Duration::from_millis(50);

/// What the page shows of the button.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct State {
    /// It is pressed.
    pub pressed: bool,
    /// Subscriptions on `emergency_stop`.
    pub listeners: usize,
    /// Why the last message was not sent.
    pub failure: Option<String>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Level {
    Silent,
    Pressed,
    Released,
}

/// A page that is open is nobody's hand at a button: nothing is published before the first press. From then on somebody
/// relies on it, so its level is repeated until this program ends: where the controller asks for a heartbeat, its
/// silence is a press. It stands in for no other button: each one's own silence counts.
pub struct Button {
    publisher: Publisher<Bool>,
    inner: Mutex<Inner>,
}

struct Inner {
    level: Level,
    failure: Option<String>,
}

impl Button {
    /// Silent, its publisher ready.
    pub fn new(node: &Node) -> Result<Self, ros::RosError> {
        let publisher = node.publisher("emergency_stop", Qos::reliable(100))?;
        Ok(Button { publisher, inner: Mutex::new(Inner { level: Level::Silent, failure: None }) })
    }

    fn inner(&self) -> MutexGuard<'_, Inner> {
        // What is guarded is whole after a panic elsewhere.
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Presses: sent when this returns, and again until it is released. The error says why it is not sent yet.
    pub fn press(&self) -> Result<(), String> {
        let mut inner = self.inner();
        inner.level = Level::Pressed;
        self.send(true)
    }

    /// Releases what was pressed here.
    pub fn release(&self) -> Result<(), String> {
        let mut inner = self.inner();
        if inner.level != Level::Pressed {
            return Ok(());
        }
        inner.level = Level::Released;
        self.send(false)
    }

    /// To be called once a period.
    pub fn repeat(&self) {
        let mut inner = self.inner();
        if inner.level != Level::Silent {
            inner.failure = self.send(inner.level == Level::Pressed).err();
        }
    }

    /// What the page shows.
    pub fn state(&self, listeners: usize) -> State {
        let inner = self.inner();
        State { pressed: inner.level == Level::Pressed, listeners, failure: inner.failure.clone() }
    }

    fn send(&self, pressed: bool) -> Result<(), String> {
        self.publisher.publish(Bool { data: pressed }).map_err(|error| error.to_string())
    }
}
