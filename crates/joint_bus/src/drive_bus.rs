//! What the control cycle sees: twelve joints.

use crate::link_state::LinkState;
use crate::{
    BusConfig, BusHealth, DriveCommand, DriveRequest, Frame, Incoming, InertialUnit, Link, LinkError, Protocol,
    Readings,
};
use joints::{Fault, FaultReport, InertialState, JOINTS, JointCommand};
use std::time::Duration;

/// Frames taken from one link in one cycle: more than it can bring at 1 Mbit/s in 20 ms.
const FRAMES_PER_READ: usize = 256;
/// A damped drive with an error is commanded to enter again once in so many cycles.
const REENTER_EVERY: u64 = 50;
/// A link that is down for longer than this is a fault; a shorter break is bridged by the drives holding their command.
const DOWN_FAULT: Duration = Duration::from_millis(5);
/// A command of somebody else is reported for so long: longer than one lost cycle, short enough that the fault can be
/// cleared once the other is gone.
const SECOND_MASTER_MEMORY: Duration = Duration::from_millis(500);
/// Someone wants to arm: so long the drives' first answers are waited for, and so long the drives are asked.
const FIRST_ANSWERS: Duration = Duration::from_millis(100);
const ASKED_TO_ARM: Duration = Duration::from_secs(1);
/// Behind the opening of a link its old socket's frames may still leave the queue, and the new socket receives them.
const OWN_ECHO: Duration = Duration::from_millis(100);

/// Twelve joints to read from and to write to. Nothing here ever blocks or allocates.
pub trait JointBus {
    /// The time of the cycle that begins at `wall` on the monotonic clock: that clock itself, unless the joints are
    /// simulated and their time is another.
    fn now(&mut self, wall: Duration) -> Duration {
        wall
    }
    /// Takes over everything that came in by `now`.
    fn read(&mut self, now: Duration, readings: &mut Readings);
    /// The newest measurement of an inertial unit that belongs to the bus, if there is a new one by `now`.
    fn read_inertial(&mut self, now: Duration) -> Option<InertialState> {
        let _ = now;
        None
    }
    /// Sends a command to every joint. With `drives_on` false the drives are commanded to rest (and asked for their
    /// state).
    fn write(&mut self, command: &JointCommand, drives_on: bool, now: Duration);
    /// Someone wants to arm. False while first answers of joints are awaited that nobody has asked where they are: ask
    /// again in the next cycle.
    fn prepare_to_arm(&mut self, readings: &Readings, now: Duration) -> bool {
        let _ = (readings, now);
        true
    }
    /// What the controller has to know of the bus: a link that has been down for too long.
    fn fault(&self, now: Duration) -> Option<FaultReport>;
    /// Counts.
    fn health(&self) -> BusHealth;
}

/// Joints on drives on links.
pub struct DriveBus<P, L> {
    protocol: P,
    links: Vec<LinkState<L>>,
    inertial: Option<Box<dyn InertialUnit>>,
    config: BusConfig,
    /// Whether each drive was commanded to enter.
    entered: [bool; JOINTS],
    /// What each drive reported last.
    errors: [u8; JOINTS],
    /// Whether the drives were ever on: who never was commands them nothing.
    was_on: bool,
    /// When someone wanted to arm, before the drives were ever on.
    asked_to_arm: Option<Duration>,
    writes: u64,
    /// Frames sent to each drive, and its replies.
    requests: [u64; JOINTS],
    replies: [u64; JOINTS],
}

impl<P: Protocol, L: Link> DriveBus<P, L> {
    /// Joints wired as in `config`, whose interfaces are `links` in that order.
    ///
    /// # Panics
    ///
    /// If there are not as many links as interfaces.
    pub fn new(config: BusConfig, protocol: P, links: Vec<L>) -> Self {
        assert_eq!(links.len(), config.interfaces.len(), "one link for each interface");
        let links = links
            .into_iter()
            .enumerate()
            .map(|(n, link)| {
                let mut joint_of = [None; 128];
                for (j, joint) in config.joints.iter().enumerate() {
                    if joint.interface == n {
                        joint_of[usize::from(joint.id)] = Some(j as u8);
                    }
                }
                LinkState::new(link, joint_of)
            })
            .collect();
        Self {
            protocol,
            links,
            inertial: None,
            config,
            entered: [false; JOINTS],
            errors: [0; JOINTS],
            was_on: false,
            asked_to_arm: None,
            writes: 0,
            requests: [0; JOINTS],
            replies: [0; JOINTS],
        }
    }

    /// With this inertial unit.
    #[must_use]
    pub fn with_inertial_unit(self, unit: Option<Box<dyn InertialUnit>>) -> Self {
        Self { inertial: unit, ..self }
    }

    /// Whether there is an inertial unit.
    pub fn has_inertial_unit(&self) -> bool {
        self.inertial.is_some()
    }

    /// A link, for tests that make it fail.
    pub fn link_mut(&mut self, n: usize) -> &mut L {
        &mut self.links[n].link
    }

    fn take(&mut self, n: usize, incoming: &Incoming, now: Duration, readings: &mut Readings) {
        let state = &mut self.links[n];
        let (frame, at) = match incoming {
            Incoming::Frame(frame, at) => (frame, at.unwrap_or(now)),
            Incoming::BusOff => return state.broke(now),
            Incoming::Restarted => return state.mended(),
            Incoming::ErrorPassive | Incoming::BusError => {
                state.health.bus_errors += 1;
                return;
            }
        };
        let reply = self.protocol.reply_id(frame).and_then(|id| {
            let j = usize::from((*state.joint_of.get(usize::from(id))?)?);
            Some((j, self.protocol.decode_reply(&self.config.joints[j].ranges, frame)?))
        });
        let Some((j, reply)) = reply else {
            if self.config.inertial.is_some_and(|unit| unit.interface == n && unit.frames.owns(frame)) {
                return;
            }
            state.health.foreign += 1;
            self.take_foreign(n, frame, now);
            return;
        };
        state.health.received += 1;
        state.balance.replied += 1;
        let w = &self.config.joints[j];
        readings.position_rad[j] = w.sign * reply.position_rad / w.gear_ratio + w.zero_rad;
        readings.velocity_rad_s[j] = w.sign * reply.velocity_rad_s / w.gear_ratio;
        readings.torque_reported = true;
        readings.torque_nm[j] = w.sign * reply.torque_nm * w.gear_ratio;
        if let Some(temperature) = reply.temperature_c {
            readings.temperature_c.get_or_insert([temperature; JOINTS])[j] = temperature;
        }
        // A drive that has not sent it yet is none, and no other one's.
        for (reported, all) in [(reply.supply_v, &mut readings.supply_v), (reply.current_a, &mut readings.current_a)] {
            if let Some(value) = reported {
                all.get_or_insert([f64::NAN; JOINTS])[j] = value;
            }
        }
        self.replies[j] += 1;
        readings.drive_error[j] = reply.error.unwrap_or(0);
        self.errors[j] = readings.drive_error[j];
        readings.arrived[j] = Some(at);
    }

    /// A link does not receive its own frames, so a command to a drive here is somebody else's.
    fn take_foreign(&mut self, n: usize, frame: &Frame, now: Duration) {
        let Some(j) = commanded(&self.protocol, &self.config, n, frame) else { return };
        let state = &mut self.links[n];
        state.health.commands_of_others += 1;
        let echo = state.health.reopened > 0 && now.saturating_sub(state.opened_at) < OWN_ECHO;
        if !echo {
            state.second_master = Some((now, j));
        }
    }

    /// What a link brings before this has sent anything: the joint that somebody else commands.
    pub fn listen_for_second_master(&mut self, now: Duration) -> Option<(&str, &str)> {
        self.read(now, &mut Readings::default());
        let (n, j) = self.links.iter().enumerate().find_map(|(n, state)| Some((n, state.second_master?.1)))?;
        Some((&self.config.interfaces[n], &self.config.joints[j].name))
    }

    fn second_master_fault(&self, now: Duration) -> Option<FaultReport> {
        self.links.iter().find_map(|state| {
            let (_, j) = state.second_master.filter(|(at, _)| now.saturating_sub(*at) < SECOND_MASTER_MEMORY)?;
            Some(FaultReport {
                fault: Fault::SecondController,
                joint: Some(j),
                value: state.health.commands_of_others as f64,
                limit: 0.0,
            })
        })
    }

    /// Whether a drive may be commanded to rest only to learn where it is.
    fn may_command_rest(&self, now: Duration) -> bool {
        let wanted = self.asked_to_arm.is_some_and(|asked| now.saturating_sub(asked) < ASKED_TO_ARM);
        self.was_on || self.config.ask_before_arming || wanted
    }

    /// What joint j's drive is sent; nothing, where even a question is an order and nobody has armed.
    fn request(&self, j: usize, command: &JointCommand, drives_on: bool, now: Duration) -> Option<DriveRequest> {
        if drives_on {
            return Some(self.order(j, command));
        }
        if !self.was_on && self.protocol.has_query() {
            return Some(DriveRequest::Query);
        }
        self.may_command_rest(now).then_some(DriveRequest::Exit)
    }

    fn order(&self, j: usize, command: &JointCommand) -> DriveRequest {
        // The command to enter may have been lost, and the drive's watchdog may have tripped. While it is only to be
        // damped the command can be sent again without a surprise; not every time, because entering forgets the
        // damping.
        let damped = command.kp[j] == 0.0 && command.torque_nm[j] == 0.0;
        let again = self.errors[j] != 0 && damped && self.writes.is_multiple_of(REENTER_EVERY);
        if !self.entered[j] || again {
            return DriveRequest::Enter;
        }
        let (w, gear) = (&self.config.joints[j], self.config.joints[j].gear_ratio);
        DriveRequest::Command(DriveCommand {
            position_rad: w.sign * gear * (command.position_rad[j] - w.zero_rad),
            velocity_rad_s: w.sign * gear * command.velocity_rad_s[j],
            kp: command.kp[j] / (gear * gear),
            kd: command.kd[j] / (gear * gear),
            torque_nm: w.sign * command.torque_nm[j] / gear,
            limits: w.limits,
        })
    }
}

/// The joint whose drive a frame commands.
fn commanded(protocol: &impl Protocol, config: &BusConfig, n: usize, frame: &Frame) -> Option<usize> {
    let orders = |request| request != DriveRequest::Query;
    config.joints.iter().position(|joint| {
        joint.interface == n && protocol.decode_request(joint.id, &joint.ranges, frame).is_some_and(orders)
    })
}

impl<P: Protocol, L: Link> JointBus for DriveBus<P, L> {
    fn read(&mut self, now: Duration, readings: &mut Readings) {
        for n in 0..self.links.len() {
            let state = &mut self.links[n];
            state.reopen(now);
            for _ in 0..FRAMES_PER_READ {
                match self.links[n].link.receive(now) {
                    Ok(Some(incoming)) => self.take(n, &incoming, now, readings),
                    Ok(None) | Err(LinkError::Full) => break,
                    Err(_) => {
                        self.links[n].broke(now);
                        break;
                    }
                }
            }
            let first_joint = self.config.joints.iter().position(|joint| joint.interface == n).unwrap_or_default();
            let state = &mut self.links[n];
            let steady = state.health.reopened == 0 || !state.was_opened_lately(now);
            if state.balance.weigh(now, steady) {
                state.second_master = Some((now, first_joint));
            }
        }
    }

    fn read_inertial(&mut self, now: Duration) -> Option<InertialState> {
        self.inertial.as_mut()?.read(now)
    }

    fn write(&mut self, command: &JointCommand, drives_on: bool, now: Duration) {
        self.writes += 1;
        self.was_on |= drives_on;
        if !self.was_on && self.second_master_fault(now).is_some() {
            // Even a question is a command to some drives: the other's robot may be walking.
            return;
        }
        for j in 0..JOINTS {
            let w = &self.config.joints[j];
            let (n, id, ranges) = (w.interface, w.id, w.ranges);
            if self.links[n].health.down_since.is_some() {
                // Its drives damp by their watchdogs, and are entered anew when it is back.
                self.entered[j] = false;
                continue;
            }
            let Some(request) = self.request(j, command, drives_on, now) else { continue };
            // A command that is not finite never leaves the controller; if one did, the drive's watchdog would take
            // over.
            let Ok(frame) = self.protocol.encode_request(id, &ranges, &request) else { continue };
            let state = &mut self.links[n];
            match state.link.send(&frame, now) {
                Ok(()) => {
                    state.health.sent += 1;
                    state.balance.requested += 1;
                    self.requests[j] += 1;
                    match request {
                        DriveRequest::Enter => self.entered[j] = true,
                        DriveRequest::Exit => self.entered[j] = false,
                        _ => {}
                    }
                }
                Err(LinkError::Full) => state.health.full += 1,
                Err(_) => state.broke(now),
            }
        }
    }

    fn prepare_to_arm(&mut self, readings: &Readings, now: Duration) -> bool {
        if self.protocol.has_query() || self.was_on || self.config.ask_before_arming {
            return true;
        }
        let asked = *self.asked_to_arm.get_or_insert(now);
        if now.saturating_sub(asked) >= ASKED_TO_ARM {
            self.asked_to_arm = Some(now);
            return false;
        }
        let answered = readings.arrived.iter().all(|at| at.is_some_and(|at| at >= asked));
        answered || now.saturating_sub(asked) >= FIRST_ANSWERS
    }

    fn fault(&self, now: Duration) -> Option<FaultReport> {
        if let Some(report) = self.second_master_fault(now) {
            return Some(report);
        }
        let (n, down) = self.links.iter().enumerate().find_map(|(n, state)| {
            let down = now.saturating_sub(state.health.down_since?);
            (down > DOWN_FAULT).then_some((n, down))
        })?;
        Some(FaultReport {
            fault: Fault::BusDown,
            joint: self.config.joints.iter().position(|joint| joint.interface == n),
            value: down.as_secs_f64(),
            limit: DOWN_FAULT.as_secs_f64(),
        })
    }

    fn health(&self) -> BusHealth {
        let (requests, replies) = (self.requests, self.replies);
        let mut health = BusHealth { count: self.links.len(), requests, replies, ..BusHealth::default() };
        for (to, state) in health.links.iter_mut().zip(&self.links) {
            *to = state.health;
        }
        health
    }
}
