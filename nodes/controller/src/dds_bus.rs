//! The joints behind topics: `joint_states` in, `joint_command` out, as a [`JointBus`] for the control cycle. The
//! cycle's side takes no lock and allocates nothing; two wait-free buffers join it to the middleware's threads,
//! [`listen`] and [`CommandPublisher`].

use crate::inputs::{InputProblems, StateWatch, Topic};
use crate::messages::{CommandMessage, StateMessage};
use crate::others::{COMMANDS, OtherPublishers};
use crate::ports;
use control::{FaultReport, JOINTS, JointCommand};
use joint_bus::{BusHealth, JointBus, LinkHealth, Readings};
use realtime::monotonic_now;
use ros::{Node, PublishError, Publisher, Qos, RosError};
use rtrb::{Consumer, Producer};
use std::sync::Arc;
use std::thread::Thread;
use std::time::Duration;

/// Messages that wait, each way.
pub const DEPTH: usize = 256;
/// Serves subscriptions of either reliability; a slow one misses messages and holds up nobody.
pub const OFFERED: Qos = Qos::reliable(10);
/// A command for a state that was answered before is sent again only so often: its receiver has it, unless it was lost.
const REPEAT_EVERY: u64 = 10;

/// Which clock the gait follows in realtime.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CycleClock {
    /// The stamps of the joint states, and the monotonic clock in between: right for a simulation at any speed.
    JointStates,
    /// The monotonic clock.
    Monotonic,
}

/// The cycle's side.
pub struct DdsBus {
    states: Consumer<StateMessage>,
    commands: Producer<CommandMessage>,
    /// To be woken when there is a command.
    publisher: Option<Thread>,
    clock: CycleClock,
    patience: Duration,
    held: Readings,
    /// Stamp of each joint's last value: joints may come in several messages.
    stamps: [Option<Duration>; JOINTS],
    /// Stamp of the newest message and when it, or the last repetition of it, came in.
    newest: Option<(Duration, Duration)>,
    now: Duration,
    last: Option<CommandMessage>,
    health: LinkHealth,
    others: OtherPublishers,
}

impl DdsBus {
    /// Joints behind these buffers. Where the clock is the stamps', it runs on for `patience` after a state and then
    /// waits for the next: longer than the controller takes to call the states stale, or it never would, and no longer
    /// than that needs, because states that come again after a gap in which their own time stood still count as old
    /// until they have caught up.
    pub fn new(
        states: Consumer<StateMessage>,
        commands: Producer<CommandMessage>,
        publisher: Option<Thread>,
        clock: CycleClock,
        patience: Duration,
    ) -> Self {
        Self {
            states,
            commands,
            publisher,
            clock,
            patience,
            held: Readings::default(),
            stamps: [None; JOINTS],
            newest: None,
            now: Duration::ZERO,
            last: None,
            health: LinkHealth::default(),
            others: OtherPublishers::default(),
        }
    }

    /// Others' publishers of commands are a fault.
    #[must_use]
    pub fn beside(mut self, others: OtherPublishers) -> Self {
        self.others = others;
        self
    }

    /// Takes one message, for lockstep: its stamp.
    pub fn take_one(&mut self) -> Option<Duration> {
        let message = self.states.pop().ok()?;
        self.take(&message);
        Some(message.stamp)
    }

    /// Whether a message waits to be read.
    pub fn has_waiting(&self) -> bool {
        !self.states.is_empty()
    }

    /// Sends the last command once more: for a state that is repeated because the answer may have been lost.
    pub fn repeat(&mut self) {
        if let Some(last) = self.last {
            self.send(last);
        }
    }

    fn take(&mut self, message: &StateMessage) {
        self.health.received += 1;
        let mut named = (0..JOINTS).filter(|j| message.named[*j]);
        if named.clone().all(|j| self.stamps[j] == Some(message.stamp)) {
            // Time stands still where the states come from, and the source lives. On the machine's own clock it does
            // not stand still, and a source that repeats itself has failed.
            if let Some((stamp, wall)) = &mut self.newest
                && *stamp == message.stamp
                && self.clock == CycleClock::JointStates
            {
                *wall = message.wall;
            }
            return;
        }
        if named.any(|j| self.stamps[j].is_some_and(|stamp| message.stamp < stamp)) {
            // The simulation began anew; the controller has a fault for it if it is armed.
            self.now = Duration::ZERO;
            self.stamps = [None; JOINTS];
            self.newest = None;
        }
        if self.newest.is_none_or(|(stamp, _)| message.stamp > stamp) {
            self.newest = Some((message.stamp, message.wall));
        }
        let arrived = match self.clock {
            CycleClock::JointStates => message.stamp,
            CycleClock::Monotonic => message.wall,
        };
        self.held.torque_reported = message.torque_nm.is_some();
        for j in (0..JOINTS).filter(|j| message.named[*j]) {
            self.held.position_rad[j] = message.position_rad[j];
            self.held.velocity_rad_s[j] = message.velocity_rad_s[j];
            self.held.torque_nm[j] = message.torque_nm.map_or(0.0, |t| t[j]);
            self.held.arrived[j] = Some(arrived);
            self.stamps[j] = Some(message.stamp);
        }
        // A state is as old as its oldest part: with parts of one time, new once all of them are there.
        self.held.stamp = self.stamps.iter().flatten().min().copied();
    }

    /// A full buffer means that the publisher has stalled; the receiver's own patience then ends in damping.
    fn send(&mut self, message: CommandMessage) {
        if self.commands.push(message).is_err() {
            self.health.full += 1;
            return;
        }
        self.health.sent += 1;
        if let Some(publisher) = &self.publisher {
            publisher.unpark();
        }
    }
}

impl JointBus for DdsBus {
    fn now(&mut self, wall: Duration) -> Duration {
        while self.take_one().is_some() {}
        let now = match (self.clock, self.newest) {
            (CycleClock::Monotonic, _) => wall,
            (CycleClock::JointStates, Some((stamp, since))) => {
                self.now.max(stamp + wall.saturating_sub(since).min(self.patience))
            }
            (CycleClock::JointStates, None) => self.now,
        };
        self.now = now;
        now
    }

    fn read(&mut self, now: Duration, readings: &mut Readings) {
        while let Ok(message) = self.states.peek() {
            let at = match self.clock {
                CycleClock::JointStates => message.stamp,
                CycleClock::Monotonic => message.wall,
            };
            if at > now || self.take_one().is_none() {
                break;
            }
        }
        *readings = self.held;
    }

    fn write(&mut self, command: &JointCommand, drives_on: bool, _: Duration) {
        // Without any state there is nothing to answer.
        let Some((stamp, _)) = self.newest else { return };
        let command = if drives_on { *command } else { JointCommand::LIMP };
        let message = CommandMessage { stamp, command, drives_on };
        self.last = Some(message);
        self.send(message);
    }

    /// A silent topic is seen by the joints' own staleness.
    fn fault(&self, _: Duration) -> Option<FaultReport> {
        self.others.fault()
    }

    fn health(&self) -> BusHealth {
        let mut health = BusHealth { count: 1, ..BusHealth::default() };
        health.links[0] = self.health;
        health
    }
}

/// Fills the bus's buffer from the topic `joint_states`, and wakes `cycle` where it waits for states (in lockstep,
/// where a stamp that stands still is a simulation that waits for an answer).
///
/// # Errors
/// What the middleware refuses.
pub fn listen(
    node: &Node,
    names: [String; JOINTS],
    mut states: Producer<StateMessage>,
    cycle: Option<Thread>,
    qos: Qos,
    problems: Arc<InputProblems>,
) -> Result<(), RosError> {
    let mut watch = StateWatch::new(cycle.is_some());
    node.subscribe("joint_states", qos, move |message: tandem_msgs::sensor_msgs::JointState| {
        let wall = monotonic_now();
        let state = match ports::joint_state(&message, &names, wall) {
            Ok(state) => state,
            Err(problem) => return problems.note(Topic::JointStates, problem, wall),
        };
        match watch.look(&state, &names, &message.name) {
            Some(problem) => problems.note(Topic::JointStates, problem, wall),
            None => problems.is_fine(Topic::JointStates),
        }
        // A full buffer: the cycle takes the newest of what is there, or has ended.
        let _ = states.push(state);
        if let Some(cycle) = &cycle {
            cycle.unpark();
        }
    })
}

/// The side of the topic `joint_command`.
pub struct CommandPublisher {
    commands: Consumer<CommandMessage>,
    publisher: Publisher<tandem_msgs::JointCommand>,
    names: [String; JOINTS],
    /// Every command is published, answers that were given before included.
    all: bool,
    last: Option<CommandMessage>,
    repeats: u64,
}

impl CommandPublisher {
    /// Publishes what comes through `commands`; all of it, or not every repeated answer.
    ///
    /// # Errors
    /// What the middleware refuses.
    pub fn new(
        node: &Node,
        names: [String; JOINTS],
        commands: Consumer<CommandMessage>,
        all: bool,
    ) -> Result<Self, RosError> {
        let publisher = node.publisher(COMMANDS, OFFERED)?;
        Ok(Self { commands, publisher, names, all, last: None, repeats: 0 })
    }

    /// Publishes the next command that is worth it; `None`: there is no more.
    pub fn publish_next(&mut self) -> Option<Result<(), PublishError>> {
        loop {
            let message = self.commands.pop().ok()?;
            let repeated = self.last.is_some_and(|last| last.stamp == message.stamp);
            self.repeats = if repeated { self.repeats + 1 } else { 0 };
            // Gains that come or go, damping above all, do not wait.
            let changed = self.last.is_none_or(|last| {
                last.drives_on != message.drives_on
                    || last.command.kp.map(|k| k > 0.0) != message.command.kp.map(|k| k > 0.0)
            });
            self.last = Some(message);
            if self.all || changed || self.repeats.is_multiple_of(REPEAT_EVERY) {
                return Some(self.publisher.publish(ports::joint_command(&message, &self.names)));
            }
        }
    }
}
