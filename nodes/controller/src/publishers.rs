//! The thread that publishes the cycle's output.

use crate::body_pose;
use crate::command_gait::CommandGaits;
use crate::cycle::CycleOutput;
use crate::dds_bus::{CommandPublisher, OFFERED};
use crate::drive_reports::DriveReports;
use crate::foot_contacts::FootContactsPublisher;
use crate::inputs::InputProblems;
use crate::odometry::{self, Odometer};
use crate::ports;
use crate::recording::{self, Recording};
use crate::services::Services;
use crate::timing::Timing;
use control::{DampingReason, Fault, FaultReport, JOINTS, Mode};
use realtime::monotonic_now;
use ros::{Clock, Node, PublishError, Publisher, Pulse, RosError, Stop};
use rtrb::Consumer;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use tandem_msgs::diagnostic_msgs::{DiagnosticArray, DiagnosticStatus, KeyValue};
use tandem_msgs::std_msgs::Header;
use tandem_msgs::{ControllerState, sensor_msgs};

/// How long it sleeps when nobody wakes it.
const PATIENCE: Duration = Duration::from_millis(20);

/// The node's publishers.
pub struct Publishers {
    /// Where the joints are behind topics.
    commands_out: Option<CommandPublisher>,
    controller_state: Publisher<ControllerState>,
    /// Where the cycle itself reads the drives.
    joint_states: Option<Publisher<sensor_msgs::JointState>>,
    /// Cycles between two messages of them.
    joint_states_every: u64,
    /// What the drives say of themselves, likewise.
    drive_reports: Option<DriveReports>,
    diagnostics: Publisher<DiagnosticArray>,
    joint_names: [String; JOINTS],
    node_name: String,
    clock: Clock,
    /// Cycles between two messages of state.
    state_every: u64,
    stop: Stop,
    last: Last,
    publish_failures: u64,
    recording: Arc<Recording>,
    problems: Arc<InputProblems>,
    odometer: Option<Odometer>,
    foot_contacts: Option<FootContactsPublisher>,
    command_gaits: Option<Arc<CommandGaits>>,
    /// Publishers that hang send no commands and no states.
    pulse: Pulse,
}

/// The output before, to see what is new.
#[derive(Default)]
struct Last {
    mode: Option<Mode>,
    report: Option<FaultReport>,
}

impl Publishers {
    /// Creates the publishers. Without one for commands the cycle reads the drives itself, and `joint_states` is
    /// published.
    pub fn new(
        node: &Node,
        joint_names: [String; JOINTS],
        (state_every, joint_states_every): (u64, u64),
        commands_out: Option<CommandPublisher>,
        recording: Arc<Recording>,
        problems: Arc<InputProblems>,
    ) -> Result<Self, RosError> {
        Ok(Self {
            drive_reports: commands_out.is_none().then(|| DriveReports::new(node, OFFERED)).transpose()?,
            joint_states: commands_out.is_none().then(|| node.publisher("joint_states", OFFERED)).transpose()?,
            commands_out,
            controller_state: node.publisher("controller_state", OFFERED)?,
            diagnostics: node.publisher("/diagnostics", OFFERED)?,
            joint_names,
            node_name: node.full_name(),
            clock: node.clock(),
            state_every,
            joint_states_every,
            stop: node.stop(),
            last: Last::default(),
            publish_failures: 0,
            recording,
            problems,
            odometer: None,
            foot_contacts: None,
            command_gaits: None,
            pulse: node.stop().health().watch(),
        })
    }

    /// Publishes the estimates of the base and of the feet too.
    #[must_use]
    pub fn with_estimates(self, odometer: Option<Odometer>, foot_contacts: Option<FootContactsPublisher>) -> Self {
        Self { odometer, foot_contacts, ..self }
    }

    /// Tells the gaits for the command what the cycle does.
    #[must_use]
    pub fn telling(self, command_gaits: Option<Arc<CommandGaits>>) -> Self {
        Self { command_gaits, ..self }
    }

    /// Publishes until `cycle_ended`, and every output until then.
    pub fn run(mut self, mut outputs: Consumer<CycleOutput>, services: &Services, cycle_ended: &AtomicBool) {
        loop {
            self.pulse.beat();
            let ended = cycle_ended.load(Ordering::Acquire);
            self.publish_commands();
            while let Ok(cycle) = outputs.pop() {
                self.print(&cycle, services);
                self.publish_commands();
            }
            if ended {
                return;
            }
            std::thread::park_timeout(PATIENCE);
        }
    }

    /// Commands first: the robot waits for them.
    fn publish_commands(&mut self) {
        while let Some(sent) = self.commands_out.as_mut().and_then(CommandPublisher::publish_next) {
            self.note(sent);
        }
    }

    fn print(&mut self, cycle: &CycleOutput, services: &Services) {
        let output = &cycle.output;
        services.set_mode(output.mode, output.holds_posture);
        self.command_gaits.iter().for_each(|gaits| gaits.follow(output.cycles, output.mode));
        for (id, reply) in cycle.ids.iter().zip(&output.replies) {
            if *id != 0
                && let Some(reply) = reply
            {
                services.reply(*id, *reply);
            }
        }
        if let (Some(port), Some(readings)) = (&self.joint_states, &cycle.readings)
            && let Some(answered) = output.answered
            && output.cycles.is_multiple_of(self.joint_states_every)
        {
            let sent = port.publish(ports::joint_states(readings, &self.joint_names, answered));
            self.note(sent);
        }
        let odometry = self.odometer.as_ref().map(|odometer| odometer.print(output));
        let contacts = self.foot_contacts.as_mut().map(|contacts| contacts.follow(cycle));
        [odometry, contacts].into_iter().flatten().for_each(|sent| self.note(sent));
        body_pose::note_answer(output, &self.problems);
        let changed = self.last.mode != Some(output.mode) || self.last.report != output.report;
        self.log(cycle);
        self.last.mode = Some(output.mode);
        self.last.report = output.report;
        if changed || output.cycles.is_multiple_of(self.state_every) {
            let gait = cycle.gait.as_ref().map(|name| name.as_str());
            let sent = self.controller_state.publish(ports::controller_state(output, gait, cycle.missed_cycles));
            self.note(sent);
        }
        if let (Some(reports), Some(readings), Some(bus)) = (&self.drive_reports, &cycle.readings, &cycle.bus)
            && let Some(answered) = output.answered
        {
            let sent = reports.publish(readings, bus, &self.joint_names, answered);
            sent.into_iter().for_each(|sent| self.note(sent));
        }
        if let Some(timing) = &cycle.timing {
            let message = self.diagnostics(cycle, timing, services.holder());
            self.recording.other(recording::DIAGNOSTICS, None, &message);
            let sent = self.diagnostics.publish(message);
            self.note(sent);
        }
    }

    fn log(&self, cycle: &CycleOutput) {
        let output = &cycle.output;
        if self.last.mode != Some(output.mode) {
            match (output.mode, output.damping_reason) {
                (Mode::Damping, Some(DampingReason::EmergencyStop)) => tracing::error!("emergency stop: damping"),
                (Mode::Damping, Some(DampingReason::StaleJointState)) => {
                    tracing::error!("the joint states have stopped coming: damping");
                }
                (Mode::Walking, _) if output.estimate.is_some() && output.balance.is_none() => {
                    tracing::warn!("walking without balance: no inertial data was received");
                }
                (mode, _) => tracing::info!("{}", mode.name()),
            }
        }
        if let Some(report) = &output.report
            && self.last.report != output.report
        {
            tracing::error!("{}", report.message(&self.joint_names));
        }
    }

    fn note(&mut self, sent: Result<(), PublishError>) {
        let Err(error) = sent else { return };
        if self.stop.is_requested() {
            return;
        }
        self.publish_failures += 1;
        if self.publish_failures.is_power_of_two() {
            tracing::warn!("{} messages not published; the last: {error}", self.publish_failures);
        }
    }

    fn recording_status(&self) -> DiagnosticStatus {
        let status = self.recording.status();
        let (level, message) = match (&status.fault, &status.folder) {
            (Some(fault), _) => (DiagnosticStatus::ERROR, fault.clone()),
            (None, Some(_)) if status.dropped > 0 => {
                (DiagnosticStatus::WARN, format!("the disk is too slow: {} dropped", status.dropped))
            }
            (None, Some(_)) => (DiagnosticStatus::OK, "recording".to_owned()),
            (None, None) => (DiagnosticStatus::OK, "not recording".to_owned()),
        };
        let value = |key: &str, value: String| KeyValue { key: key.into(), value };
        DiagnosticStatus {
            level,
            name: format!("{}: recording", self.node_name),
            message,
            hardware_id: String::new(),
            values: vec![
                value("folder", status.folder.map_or_else(String::new, |folder| folder.display().to_string())),
                value("messages_written", status.written.to_string()),
                value("dropped", status.dropped.to_string()),
                value("missing_cycles", status.missing_cycles.to_string()),
                value("longest_hole_s", format!("{:.3}", status.longest_hole.as_secs_f64())),
            ],
        }
    }

    fn inputs_status(&self) -> DiagnosticStatus {
        let problem = self.problems.recent(monotonic_now());
        let (level, message) = match problem.is_empty() {
            true => (DiagnosticStatus::OK, "nothing wrong with what comes in".to_owned()),
            false => (DiagnosticStatus::ERROR, problem),
        };
        DiagnosticStatus {
            level,
            name: format!("{}: inputs", self.node_name),
            message,
            hardware_id: String::new(),
            values: Vec::new(),
        }
    }

    fn diagnostics(&self, cycle: &CycleOutput, timing: &Timing, claimed_by: String) -> DiagnosticArray {
        let output = &cycle.output;
        let value = |key: &str, value: String| KeyValue { key: key.into(), value };
        let us = |d: Duration| format!("{:.1}", d.as_secs_f64() * 1e6);
        let mut values = vec![
            value("mode", output.mode.name().into()),
            value("cycles", output.cycles.to_string()),
            value("missed_cycles", cycle.missed_cycles.to_string()),
            value("cycles_without_new_state", output.stale_inputs.to_string()),
            value("publish_failures", self.publish_failures.to_string()),
            value("claimed_by", claimed_by),
            value("body_pose", body_pose::shown(output)),
        ];
        for (what, quantiles) in [
            ("latency", timing.latency),
            ("recent_latency", timing.recent_latency),
            ("compute", timing.compute),
            ("recent_compute", timing.recent_compute),
        ] {
            for (name, duration) in ["median", "p99", "max"].into_iter().zip(quantiles) {
                values.push(value(&format!("{what}_{name}_us"), us(duration)));
            }
        }
        values.extend(odometry::diagnostics(output));
        values.extend(self.command_gaits.iter().map(|gaits| value("plan_for_cmd_vel", gaits.status())));
        if let Some(bus) = &cycle.bus {
            for (n, link) in bus.links[..bus.count].iter().enumerate() {
                values.push(value(
                    &format!("interface_{n}"),
                    format!(
                        "sent {}, received {}, queue full {}, foreign {}, commands of others {}, bus errors {}, breaks {}, reopened {}{}",
                        link.sent,
                        link.received,
                        link.full,
                        link.foreign,
                        link.commands_of_others,
                        link.bus_errors,
                        link.breaks,
                        link.reopened,
                        if link.down_since.is_some() { ", DOWN" } else { "" }
                    ),
                ));
            }
        }
        let (level, message) = if output.faults.is_empty() {
            match (output.mode, output.damping_reason) {
                (Mode::Damping, Some(DampingReason::EmergencyStop | DampingReason::StaleJointState)) => {
                    (DiagnosticStatus::WARN, output.damping_reason.map_or("", DampingReason::name).to_owned())
                }
                (mode, _) => (DiagnosticStatus::OK, mode.name().to_owned()),
            }
        } else {
            (DiagnosticStatus::ERROR, output.faults.iter().map(Fault::name).collect::<Vec<_>>().join(","))
        };
        DiagnosticArray {
            header: Header { stamp: self.clock.now(), frame_id: String::new() },
            status: vec![
                self.recording_status(),
                self.inputs_status(),
                DiagnosticStatus {
                    level,
                    name: format!("{}: control loop", self.node_name),
                    message,
                    hardware_id: String::new(),
                    values,
                },
            ],
        }
    }
}

/// What the publishers' thread is given.
pub struct PublisherThread {
    /// The publishers.
    pub publishers: Publishers,
    /// What the cycle reports.
    pub outputs: Consumer<CycleOutput>,
    /// Whom requests' replies go to.
    pub services: Arc<Services>,
    /// Set once the cycle says no more.
    pub cycle_ended: Arc<AtomicBool>,
}

impl PublisherThread {
    /// Publishes until the cycle has ended.
    pub fn run(self) {
        self.publishers.run(self.outputs, &self.services, &self.cycle_ended);
    }
}
