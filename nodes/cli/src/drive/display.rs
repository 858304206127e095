//! What the driver sees: one line that is written over.

use super::steer::Steer;
use anyhow::Result;
use ros::{Node, Qos};
use std::io::Write;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};
use tandem_msgs::ControllerState;
use tandem_msgs::nav_msgs::Odometry;
use tandem_msgs::text::{NAME_CHARS, printable};

/// What was not received again for so long is not known any more.
const MEMORY: Duration = Duration::from_secs(1);

/// What was learnt of the robot, and when.
#[derive(Default)]
struct Seen {
    state: Option<(String, String, Instant)>,
    velocity: Option<([f64; 3], Instant)>,
}

/// Subscriptions to the controller's topics, and the terminal's line.
pub struct Display(Arc<Mutex<Seen>>);

fn lock(seen: &Mutex<Seen>) -> std::sync::MutexGuard<'_, Seen> {
    // What is guarded is whole after a panic elsewhere.
    seen.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Display {
    /// Subscribes to `controller_state` and `odom`.
    pub fn new(node: &Node) -> Result<Self> {
        let seen = Arc::new(Mutex::new(Seen::default()));
        let of_state = Arc::clone(&seen);
        node.subscribe("controller_state", Qos::best_effort(10), move |message: ControllerState| {
            lock(&of_state).state = Some((message.mode, message.fault, Instant::now()));
        })?;
        let of_odometry = Arc::clone(&seen);
        node.subscribe("odom", Qos::best_effort(10), move |message: Odometry| {
            let twist = &message.twist.twist;
            lock(&of_odometry).velocity = Some(([twist.linear.x, twist.linear.y, twist.angular.z], Instant::now()));
        })?;
        Ok(Self(seen))
    }

    /// A line of its own.
    pub fn say(&self, words: &str) {
        // A terminal that is gone is no reason to fall silent on the topics.
        let _ = write!(std::io::stderr(), "\r\x1b[K{words}\r\n");
    }

    /// The line, written over the one before.
    pub fn show(&self, steer: &Steer, now: Instant) {
        let line = lock(&self.0).line(steer, now);
        let mut terminal = std::io::stdout();
        let _ = write!(terminal, "\r{line}\x1b[K").and_then(|()| terminal.flush());
    }
}

impl Seen {
    fn line(&self, steer: &Steer, now: Instant) -> String {
        let fresh = |at: &Instant| now.saturating_duration_since(*at) < MEMORY;
        let velocity = |[x, y, turning]: [f64; 3]| format!("{x:+.2} {y:+.2} m/s {turning:+.2} rad/s");
        let got = self.velocity.as_ref().filter(|(_, at)| fresh(at));
        let got = got.map_or("no odom".into(), |(got, _)| velocity(*got));
        let mode = match self.state.as_ref().filter(|(.., at)| fresh(at)) {
            None => "no controller".into(),
            Some((mode, fault, _)) if fault.is_empty() => printable(mode, NAME_CHARS).into_owned(),
            Some((mode, fault, _)) => format!("{}: {}", printable(mode, NAME_CHARS), printable(fault, NAME_CHARS)),
        };
        let pressed = if steer.pressed() { " | EMERGENCY STOP, r releases" } else { "" };
        let [speed, turn] = steer.speed();
        let asked = velocity(steer.velocity(now));
        format!("asked {asked} of {speed:.2}, {turn:.2} | got {got} | {mode}{pressed}")
    }
}

#[cfg(test)]
mod tests {
    use super::super::steer::Buttons;
    use super::*;
    use crate::operator_input::InputEvent;

    #[test]
    fn the_line_says_what_is_asked_and_got_the_mode_and_its_faults() {
        let now = Instant::now();
        let buttons = Buttons { press: 0, release: None, enable: 4 };
        let mut steer = Steer::new(0.3, 0.5, Duration::from_secs(1), buttons);
        steer.take(&InputEvent::Key(b'u'), now);
        let mut seen = Seen::default();
        assert!(seen.line(&steer, now).ends_with("| got no odom | no controller"));
        seen.velocity = Some(([0.28, -0.01, 0.47], now));
        seen.state = Some(("walking".into(), String::new(), now));
        let line = seen.line(&steer, now);
        assert_eq!(line, "asked +0.30 +0.00 m/s +0.50 rad/s of 0.30, 0.50 | got +0.28 -0.01 m/s +0.47 rad/s | walking");
        seen.state = Some(("fault".into(), "tilt\x1b[2J".into(), now));
        steer.take(&InputEvent::Key(b' '), now);
        let line = seen.line(&steer, now);
        assert!(line.contains("fault: tilt") && !line.contains('\x1b') && line.ends_with("releases"), "{line}");
        assert!(seen.line(&steer, now + 2 * MEMORY).contains("no controller"));
    }
}
