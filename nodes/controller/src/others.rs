//! Who else publishes this robot's commands: a robot has one controller.

use control::{Fault, FaultReport};
use ros::{Node, RosError};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

/// The topic of the commands.
pub const COMMANDS: &str = "joint_command";

/// How long other nodes get to be discovered before this one's commands have a topic.
const LISTENING: Duration = Duration::from_secs(1);

/// Other participants' publishers of commands, counted as they come and go. Wait-free to read.
#[derive(Clone, Debug, Default)]
pub struct OtherPublishers(Arc<AtomicUsize>);

impl OtherPublishers {
    /// Counts them from now on. One that announces another type is none: nobody takes its messages for commands.
    ///
    /// # Errors
    /// What the middleware refuses.
    pub fn watch(node: &Node) -> Result<Self, RosError> {
        let others = Self::default();
        let counted = others.clone();
        node.watch_publishers_of_others::<tandem_msgs::JointCommand>(COMMANDS, move |count| {
            let before = counted.0.swap(count, Ordering::Relaxed);
            if count > before {
                tracing::error!("{count} other publishers of {COMMANDS}: a robot has one controller");
            }
        })?;
        Ok(others)
    }

    /// Watches, and refuses where another program commands the same robot. It must be asked before this one's publisher
    /// exists: two that see each other's are a fault in both.
    ///
    /// # Errors
    /// Where another one is there within a second, or what the middleware refuses.
    pub fn listen_first(node: &Node) -> anyhow::Result<Self> {
        let others = Self::watch(node)?;
        let deadline = Instant::now() + LISTENING;
        while Instant::now() < deadline {
            others.refuse_any()?;
            std::thread::sleep(LISTENING / 50);
        }
        others.refuse_any()?;
        Ok(others)
    }

    /// # Errors
    /// Says why this one does not command the robot while another one is there.
    pub fn refuse_any(&self) -> anyhow::Result<()> {
        if self.count() == 0 {
            return Ok(());
        }
        anyhow::bail!(
            "another program publishes {COMMANDS}: a robot has one controller. Stop the other one (one that was killed \
             is known for 50 s), or give this one another namespace (--ros-args -r __ns:=/NAME)"
        )
    }

    /// How many there are.
    pub fn count(&self) -> usize {
        self.0.load(Ordering::Relaxed)
    }

    /// For tests: as if so many were there.
    pub fn set(&self, count: usize) {
        self.0.store(count, Ordering::Relaxed);
    }

    /// What the controller has to know: their commands go between this one's.
    pub fn fault(&self) -> Option<FaultReport> {
        let count = self.count();
        (count > 0).then_some(FaultReport {
            fault: Fault::SecondController,
            joint: None,
            value: count as f64,
            limit: 0.0,
        })
    }
}
