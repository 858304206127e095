//! What is reported and drawn of a walk.

use super::{watch::Outcome, write};
use anyhow::Result;
use gait::Gait;
use robot::Robot;
use simulator::SimulatorOptions;
use simulator::measure::WalkFigures;
use simulator::pictures::Studio;
use std::path::Path;
use tandem_msgs::StopRecordingResponse;

/// One gait walked.
pub struct Walked {
    /// What was walked.
    pub gait: Gait,
    /// How it ended.
    pub outcome: Outcome,
    /// What was measured.
    pub figures: WalkFigures,
    /// The controller's last word while it walked.
    pub controller: Option<tandem_msgs::ControllerState>,
    /// Joint states that did not come here.
    pub lost_states: u64,
    /// The recording's end.
    pub bag: StopRecordingResponse,
    /// Why there are no pictures, where there are none.
    pub problems: Vec<String>,
}

impl Walked {
    /// Draws it; what cannot be drawn is a problem that is reported.
    pub fn draw(
        &mut self,
        robot: &Robot,
        folder: &Path,
        samples: &[report::Sample],
        walking_from_s: f64,
    ) -> Result<()> {
        // A fall in the first steps, or a machine without OpenGL, leaves less to show. The walk itself is still
        // reported.
        let mut tiles = Vec::new();
        let options = SimulatorOptions::default();
        let filmed = Studio::new(robot, &options, &self.gait, samples, walking_from_s).and_then(|mut studio| {
            tiles = studio.tiles()?;
            studio.animation()
        });
        match filmed {
            Ok(animation) => write(&folder.join("walk.png"), &animation)?,
            Err(problem) => self.problems.push(problem.to_string()),
        }
        let run =
            report::Run { gait: &self.gait, origin: report::Origin::Simulated, samples, walking_from_s, tiles: &tiles };
        match report::render_run(folder, &run) {
            Ok(_) => {}
            Err(problem @ report::ReportError::TooLittle { .. }) => self.problems.push(problem.to_string()),
            Err(problem) => return Err(problem.into()),
        }
        Ok(())
    }

    /// For a program; what is not known is null.
    pub fn json(&self) -> serde_json::Value {
        let controller = self.controller.as_ref();
        serde_json::json!({
            "gait": self.gait.name,
            "plan": self.gait.solver, "certificate": self.gait.certificate,
            "upright": self.outcome.upright(),
            "outcome": self.outcome.to_string(),
            "speed_asked_m_s": self.gait.speed_m_s(),
            "figures": self.figures,
            "cycles": controller.map(|state| state.cycles),
            "missed_cycles": controller.map(|state| state.missed_cycles),
            "stale_inputs": controller.map(|state| state.stale_inputs),
            "lost_states": self.lost_states,
            "bag_messages": self.bag.success.then_some(self.bag.messages),
            "bag_dropped": self.bag.success.then_some(self.bag.dropped),
            "problems": self.problems,
        })
    }
}
