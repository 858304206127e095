//! `tandem plan --table`: the paper's Table I beside this planner's.

use super::{Arguments, multiplier, timed};
use crate::output;
use anyhow::Result;
use gait_design::Plan;

/// Plans the five gaits and prints Table I of the paper beside what came of them. Each is planned a few times, and the
/// fastest counts: the first finds the processor idle.
pub fn print(arguments: &Arguments, robot: &robot::Robot) -> Result<()> {
    const TIMES: usize = 5;
    if !arguments.json {
        say!("          Table I of the paper                                  here, {}", robot.name)?;
        say!(
            "gait      strides/s  clearance m  speed m/s  iterations  time s  iterations  time ms      cost  violation  multiplier"
        )?;
    }
    let (mut paper_s, mut ours_s) = (0.0, 0.0);
    for row in gait_design::table_one() {
        let request = arguments.request(row.behaviour, robot)?;
        let mut best: Option<Plan> = None;
        for _ in 0..TIMES {
            let plan = timed(robot, &request, arguments, false)?;
            if best.as_ref().is_none_or(|b| plan.gait.solver.solve_time_s < b.gait.solver.solve_time_s) {
                best = Some(plan);
            }
        }
        let gait = best.expect("planned at least once").gait;
        let solver = &gait.solver;
        if arguments.json {
            output::json(&serde_json::json!({
                "gait": row.behaviour, "strides_per_s": row.frequency_hz, "clearance_m": row.clearance_m,
                "speed_m_s": row.speed_m_s, "paper_iterations": row.iterations, "paper_time_s": row.time_s,
                "iterations": solver.iterations, "time_s": solver.solve_time_s, "cost": solver.objective,
                "violation": solver.max_violation, "certificate": gait.certificate,
            }))?;
            continue;
        }
        say!(
            "{:8} {:>8} {:>12} {:>10} {:>11} {:>7} {:>11} {:>8.2} {:>9.6} {:>10.1e} {:>11}",
            row.behaviour,
            row.frequency_hz,
            row.clearance_m,
            row.speed_m_s,
            row.iterations,
            row.time_s,
            solver.iterations,
            1e3 * solver.solve_time_s,
            solver.objective,
            solver.max_violation,
            multiplier(&gait)
        )?;
        paper_s += row.time_s / 5.0;
        ours_s += solver.solve_time_s / 5.0;
    }
    if arguments.json {
        return Ok(());
    }
    say!(
        "mean {:>57.2} {:>20.2}     {:.0} times as fast (the paper on an i7-6820HQ)",
        paper_s,
        1e3 * ours_s,
        paper_s / ours_s
    )?;
    Ok(())
}
