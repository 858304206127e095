//! How the simulation fares: real-time factor and diagnostics.

use super::Bridge;
use ros::PublishError;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};
use tandem_msgs::builtin_interfaces::Time;
use tandem_msgs::diagnostic_msgs::{DiagnosticArray, DiagnosticStatus, KeyValue};
use tandem_msgs::std_msgs::{Float64, Header};

/// How often the real-time factor and diagnostics are published.
const REPORT_PERIOD: Duration = Duration::from_secs(1);

impl Bridge {
    pub(super) fn note_failure(&mut self, error: &PublishError) {
        self.counts.publish_failures += 1;
        if self.counts.publish_failures.is_power_of_two() && !self.inbox.is_closed() {
            tracing::warn!("{} messages not published; the last: {error}", self.counts.publish_failures);
        }
    }

    /// Once a second: real-time factor and diagnostics.
    pub(super) fn report(&mut self, now: Instant) {
        let simulated_s = self.stamp_ns() as f64 * 1e-9;
        let Some((since, from_s)) = self.report else {
            self.report = Some((now, simulated_s));
            return;
        };
        let wall = now - since;
        if wall < REPORT_PERIOD {
            return;
        }
        self.report = Some((now, simulated_s));
        let factor = (simulated_s - from_s) / wall.as_secs_f64();
        let status = self.status(factor, simulated_s);
        let header = Header { stamp: Time::from_nanoseconds(self.stamp_ns()), frame_id: String::new() };
        let sent = self
            .ports
            .real_time_factor
            .publish(Float64 { data: factor })
            .and_then(|()| self.ports.diagnostics.publish(DiagnosticArray { header, status: vec![status] }));
        if let Err(error) = sent {
            self.note_failure(&error);
        }
    }

    fn status(&self, factor: f64, simulated_s: f64) -> DiagnosticStatus {
        let fallen = self.simulator.fallen();
        let stale = match &self.bench {
            None => self.simulator.command_is_stale(),
            Some(bench) => bench.following() == 0,
        };
        let (level, message) = match (fallen, stale, self.paused) {
            (Some(fall), _, _) => (DiagnosticStatus::ERROR, fall.to_string()),
            (None, _, true) => (DiagnosticStatus::OK, "paused".into()),
            (None, true, false) => (DiagnosticStatus::WARN, "no fresh command: the drives damp".into()),
            (None, false, false) => (DiagnosticStatus::OK, "running".into()),
        };
        let value = |key: &str, value: String| KeyValue { key: key.into(), value };
        let mut status = DiagnosticStatus {
            level,
            name: format!("{}: simulation", self.node_name),
            message,
            hardware_id: "mujoco".into(),
            values: vec![
                value("real_time_factor", format!("{factor:.3}")),
                value("simulated_s", format!("{simulated_s:.3}")),
                value("cycles", self.counts.cycles.to_string()),
                value("commands_late_or_missing", self.counts.late_or_missing_commands.to_string()),
                value("commands_refused", self.refused_commands.load(Ordering::Relaxed).to_string()),
                value("lag_given_up_s", format!("{:.3}", self.counts.lag_given_up.as_secs_f64())),
                value("publish_failures", self.counts.publish_failures.to_string()),
            ],
        };
        if let Some(bench) = &self.bench {
            status.values.push(value("drives_following", bench.following().to_string()));
            status.values.push(value("replies_lost", bench.lost_replies().to_string()));
            status.values.push(value("hottest_drive_c", format!("{:.0}", bench.hottest_c())));
        }
        status
    }
}
