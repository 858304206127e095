//! Stepping when the command for the last state has come.

use super::{Bridge, BridgeError, REPUBLISH};
use std::time::{Duration, Instant};

impl Bridge {
    pub(super) fn run_lockstep(&mut self) -> Result<(), BridgeError> {
        if self.active {
            self.publish_all()?;
        }
        let mut single_steps = 0;
        let mut waiting_since = Instant::now();
        while !self.inbox.is_closed() {
            let served = self.serve_requests();
            single_steps += served.single_steps;
            if !self.active {
                self.inbox.wait_for_request(REPUBLISH);
                continue;
            }
            if served.reset || served.activated {
                self.publish_all()?;
                waiting_since = Instant::now();
            }
            self.report(Instant::now());
            if self.paused && single_steps == 0 {
                self.inbox.wait_for_request(REPUBLISH);
                self.publish_standing_time()?;
                waiting_since = Instant::now();
                continue;
            }
            let Some(answer) = self.inbox.wait_for_answer(self.stamp_ns(), REPUBLISH) else {
                let waited = waiting_since.elapsed();
                if waited > self.config.lockstep_timeout && !self.inbox.is_closed() {
                    return Err(self.no_answer(waited));
                }
                if waited >= REPUBLISH {
                    self.publish_joint_states()?;
                }
                continue;
            };
            self.simulator.command(&answer.command);
            self.advance();
            single_steps = u32::saturating_sub(single_steps, 1);
            self.publish_all()?;
            waiting_since = Instant::now();
        }
        Ok(())
    }

    fn no_answer(&self, waited: Duration) -> BridgeError {
        let detail = match (self.inbox.newest(), self.inbox.last_refusal()) {
            (_, Some(refusal)) => format!(" (the last command was refused: {refusal})"),
            (Some(answer), None) => format!(" (the newest command has stamp {:.6} s)", answer.stamp_ns as f64 * 1e-9),
            (None, None) => " (no command came at all)".into(),
        };
        BridgeError::NoAnswer {
            stamp_s: self.stamp_ns() as f64 * 1e-9,
            topic: "joint_command".into(),
            waited_s: waited.as_secs_f64().round(),
            detail,
        }
    }
}
