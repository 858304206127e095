//! What is reported at the end of all walks.

use super::Walked;
use robot::Robot;
use tandem_msgs::text::{NAME_CHARS, SENTENCE_CHARS, printable};

/// The table at the end.
pub(super) fn summary(robot: &Robot, done: &[Walked]) -> String {
    let mut text = format!("\n{}\n", robot.name);
    let row3 = |name: &str, [roll, pitch, knee]: [f64; 3]| format!("  {name:28}{roll:10.2}{pitch:11.2}{knee:8.2}\n");
    for walked in done {
        let (gait, f) = (&walked.gait, &walked.figures);
        let solver = &gait.solver;
        text += &format!(
            "{}: {}\n  planned in {:.3} s and {} iterations ({}, cost {:.6}, largest violation {:.1e})\n",
            gait.name,
            printable(&walked.outcome.to_string(), SENTENCE_CHARS),
            solver.solve_time_s,
            solver.iterations,
            printable(&solver.status, NAME_CHARS),
            solver.objective,
            solver.max_violation
        );
        if let Some(c) = &gait.certificate {
            text += &format!(
                "  by itself: largest multiplier {:.3}, landing run {:.3} m: {}\n",
                c.largest_multiplier,
                c.landing_run_m,
                if c.stable { "stable" } else { "not called stable" }
            );
        }
        text += &format!(
            "  speed asked {:.3} m/s, got {:.3} m/s ahead and {:.3} m/s to the left, turned {:.1} deg\n",
            gait.speed_m_s(),
            f.speed_m_s,
            f.lateral_speed_m_s,
            f.turned_deg
        );
        text += "  mean |torque|, Nm             hip roll  hip pitch    knee\n";
        text += &row3("here", f.mean_abs_torque_nm.into());
        if let Some(paper) = report::table_two(&gait.robot, &gait.name) {
            text += &row3("the paper's MuJoCo", paper.mujoco_nm);
            text += &row3("the paper's experiment", paper.experiment_nm);
        }
        if let Some(state) = &walked.controller {
            text += &format!(
                "  {} control cycles, {} missed, {} with a stale state; ",
                state.cycles, state.missed_cycles, state.stale_inputs
            );
        }
        text += &format!("{} joint states lost on the way here\n", walked.lost_states);
        text += &format!(
            "  bag: {} messages, {:.1} MB, {} dropped\n",
            walked.bag.messages,
            walked.bag.bytes as f64 * 1e-6,
            walked.bag.dropped
        );
        for problem in &walked.problems {
            text += &format!("  {}\n", printable(problem, SENTENCE_CHARS));
        }
    }
    text
}
