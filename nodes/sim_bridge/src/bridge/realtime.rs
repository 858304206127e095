//! Stepping on the wall clock.

use super::{Bridge, BridgeError, REPUBLISH};
use std::time::{Duration, Instant};

/// Behind CAN: how often frames are looked for between two control periods.
const FRAME_POLL: Duration = Duration::from_micros(200);
/// In realtime, what is more than this behind the wall clock is given up instead of being made up for.
const MAX_LAG: Duration = Duration::from_millis(50);

impl Bridge {
    pub(super) fn run_realtime(&mut self) -> Result<(), BridgeError> {
        let wall_period = self.config.period.div_f64(self.config.real_time_factor);
        let mut next = Instant::now();
        let mut used_stamp_ns = None;
        while !self.inbox.is_closed() {
            let served = self.serve_requests();
            if !self.active {
                self.rest();
                next = Instant::now();
                continue;
            }
            if self.paused && served.single_steps == 0 {
                if let Err(error) = self.publish_standing_time() {
                    self.note_failure(&error);
                }
                self.report(Instant::now());
                self.rest();
                next = Instant::now();
                continue;
            }
            for _ in 0..served.single_steps.max(1) {
                match self.inbox.newest() {
                    Some(answer) if Some(answer.stamp_ns) != used_stamp_ns => {
                        self.simulator.command(&answer.command);
                        used_stamp_ns = Some(answer.stamp_ns);
                    }
                    // The drives hold the last command, and damp when it grows too old.
                    Some(_) => self.counts.late_or_missing_commands += 1,
                    None => {}
                }
                self.advance();
                if let Err(error) = self.publish_all() {
                    self.note_failure(&error);
                }
            }
            self.report(Instant::now());
            next += wall_period;
            self.answer_until(next);
            let now = Instant::now();
            match next.checked_duration_since(now) {
                Some(early) => std::thread::sleep(early),
                None if now - next > MAX_LAG => {
                    self.counts.lag_given_up += now - next;
                    next = now;
                }
                None => {}
            }
        }
        Ok(())
    }

    /// While time stands still: waits for a request. Behind CAN frames are answered all the same.
    fn rest(&mut self) {
        self.inbox.wait_for_request(if self.bench.is_some() { self.config.period } else { REPUBLISH });
        self.answer_until(Instant::now() + self.config.period);
    }

    /// Behind CAN: goes on answering frames until just before `next`.
    fn answer_until(&mut self, next: Instant) {
        let Some(bench) = &mut self.bench else { return };
        let (q, v) = self.simulator.joints();
        while Instant::now() + FRAME_POLL < next {
            bench.answer(self.started.elapsed(), &q, &v);
            std::thread::sleep(FRAME_POLL);
        }
    }
}
