//! Doing what clients asked.

use super::{Bridge, put_down};
use crate::inbox::Ask;
use simulator::Push;

/// What [`Bridge::serve_requests`] did.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Served {
    pub activated: bool,
    pub reset: bool,
    pub single_steps: u32,
}

impl Bridge {
    /// Does what clients asked. True if the state has a new stamp by it (reset) or a single step is asked for.
    pub(super) fn serve_requests(&mut self) -> Served {
        let mut served = Served::default();
        while let Some(request) = self.inbox.take_request() {
            let answer = match request.ask {
                Ask::Activate(active) => {
                    served.activated |= active && !self.active;
                    self.active = active;
                    Ok(if active { "active" } else { "inactive" }.to_owned())
                }
                _ if !self.active => Err("the simulation is not active: activate it (its service change_state)".into()),
                Ask::Pause(paused) => {
                    self.paused = paused;
                    Ok(if paused { "paused" } else { "running" }.to_owned())
                }
                Ask::Reset => {
                    put_down(&mut self.simulator, &self.config);
                    served.reset = true;
                    Ok(format!("the robot is put down: {}", self.config.initial_posture.get()))
                }
                Ask::Step if self.paused => {
                    served.single_steps += 1;
                    Ok(format!("one control period of {:?}", self.config.period))
                }
                Ask::Step => Err("the simulation is running: pause it first".into()),
                Ask::Push(force_n) => {
                    let push = Push {
                        start_s: self.simulator.time_s(),
                        duration_s: self.config.push_duration_s.get(),
                        force_n,
                    };
                    self.simulator.push(push).map(|()| "pushing".to_owned()).map_err(|e| e.to_string())
                }
            };
            if let Some(reply) = request.reply {
                // A client that has given up does not want the answer.
                let _ = reply.send(answer);
            }
        }
        if served.reset {
            self.period += 1;
        }
        served
    }
}
