//! Whether gaits that are planned to turn and to step aside do so under the paper's law alone.

use super::cases::Bench;
use super::driving::mean;
use gait_design::{GaitRequest, PlanOptions, plan};
use std::ops::ControlFlow;
use tandem_sim_bridge::trial::{Noise, Trial};

/// Ahead and to the left, m/s, and yaw rates, rad/s: each with each.
const SPEEDS_M_S: [f64; 4] = [-0.2, 0.0, 0.35, 0.5];
const LATERAL_SPEEDS_M_S: [f64; 3] = [0.0, 0.1, 0.2];
const YAW_RATES_RAD_S: [f64; 4] = [0.0, 0.2, 0.4, 0.6];
const STEP_DURATION_S: f64 = 0.22;
const CLEARANCE_M: f64 = 0.08;
const SECONDS: f64 = 20.0;
/// Before this the robot settles into the gait, s.
const SETTLED_S: f64 = 5.0;

pub fn turning(bench: &Bench) {
    let own = GaitRequest::named("amble", &bench.robot).expect("the amble is one of Table I");
    let own = GaitRequest { step_duration_s: STEP_DURATION_S, clearance_m: CLEARANCE_M, ..own };
    let (mut walked, mut of, mut largest, mut iterations) = (0, 0, [0.0_f64; 3], 0);
    for speed_m_s in SPEEDS_M_S {
        for lateral_speed_m_s in LATERAL_SPEEDS_M_S {
            for yaw_rate_rad_s in YAW_RATES_RAD_S {
                of += 1;
                let name = format!("turning_{speed_m_s}_{lateral_speed_m_s}_{yaw_rate_rad_s}");
                let request = GaitRequest { speed_m_s, lateral_speed_m_s, yaw_rate_rad_s, ..own.clone() };
                match plan(&bench.robot, &request, &PlanOptions::default(), |_| ControlFlow::Continue(())) {
                    Ok(plan) => {
                        iterations += plan.gait.solver.iterations;
                        if let Some(errors) = walk(bench, &name, &request, &plan) {
                            walked += 1;
                            largest = std::array::from_fn(|axis| largest[axis].max(errors[axis]));
                        }
                    }
                    Err(error) => println!("{name} = {error}"),
                }
            }
        }
    }
    println!("turning = {walked}/{of}");
    println!("turning_mean_iterations = {:.1}", f64::from(iterations) / f64::from(of));
    println!("turning_largest_error = {:.3} {:.3} m/s {:.3} rad/s", largest[0], largest[1], largest[2]);
}

/// Walks a plan under the paper's law; by how much its mean velocity is off, where it stays up.
fn walk(bench: &Bench, name: &str, request: &GaitRequest, plan: &gait_design::Plan) -> Option<[f64; 3]> {
    let noise = Noise::default().times(0.0);
    let trial = Trial { seconds: SECONDS, noise, delay_cycles: 0, ..Trial::default() };
    let outcome = bench.run_with(&plan.gait, false, trial);
    let certificate = plan.gait.certificate.expect("a compensated plan has a certificate");
    let planned = format!(
        "{} iterations, {} points, multiplier {:.3}",
        plan.gait.solver.iterations, certificate.points, certificate.largest_multiplier
    );
    let asked = [request.speed_m_s, request.lateral_speed_m_s, request.yaw_rate_rad_s];
    match (outcome.ended, mean(&outcome.samples, SETTLED_S, SECONDS)) {
        (None, Some(got)) => {
            let error: [f64; 3] = std::array::from_fn(|axis| got[axis] - asked[axis]);
            println!("{name} = up, off by {:.3} {:.3} m/s {:.3} rad/s; {planned}", error[0], error[1], error[2]);
            Some(error.map(f64::abs))
        }
        (ended, _) => {
            let (at_s, why) = ended.unwrap_or((SECONDS, "no samples".into()));
            println!("{name} = {why} after {at_s:.1} s; {planned}");
            None
        }
    }
}
