//! Five strides that turn and step aside, as JSON: what was asked, where the solve starts, what was found. The
//! independent program `tests/strides/program.py` solves the same.

use gait_design::{GaitRequest, PlanOptions, PlanPoint, plan, stride_start};
use robot::Robot;
use serde_json::{Value, json};
use std::ops::ControlFlow;
use std::path::Path;

/// Behaviour, step duration s, clearance m; speed ahead and to the left m/s, yaw rate rad/s.
const REQUESTS: [(&str, f64, f64, [f64; 3]); 5] = [
    ("amble", 0.22, 0.08, [0.0, 0.0, 0.4]),
    ("amble", 0.22, 0.08, [0.0, 0.2, 0.0]),
    ("amble", 0.22, 0.08, [0.35, 0.1, 0.4]),
    ("amble", 0.22, 0.08, [-0.2, 0.1, -0.2]),
    ("gait3", 0.22, 0.1, [0.1, -0.05, 0.2]),
];

fn points(points: &[PlanPoint]) -> Value {
    points
        .iter()
        .map(|p| {
            json!({
                "q": p.q, "v": p.v, "a": p.a, "torque_nm": p.torque_nm, "ground_force_n": p.ground_force_n,
            })
        })
        .collect()
}

fn main() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/robots/vision60");
    let robot = Robot::load(&folder).expect("the robot's folder belongs to the project");
    let options = PlanOptions::default();
    let strides: Vec<Value> = REQUESTS
        .into_iter()
        .map(|(behaviour, step_duration_s, clearance_m, [speed_m_s, lateral_speed_m_s, yaw_rate_rad_s])| {
            let own = GaitRequest::named(behaviour, &robot).expect("a behaviour of Table I");
            let steps = GaitRequest { step_duration_s, clearance_m, ..own };
            let request = GaitRequest { speed_m_s, lateral_speed_m_s, yaw_rate_rad_s, ..steps };
            let start = stride_start(&robot, &request, &options).expect("legs that reach");
            let plan = plan(&robot, &request, &options, |_| ControlFlow::Continue(())).expect("a gait");
            assert_eq!(plan.points.len(), options.program.points, "{request:?}: planned with more points");
            json!({
                "request": request,
                "start": start.map(|step| points(&step)),
                "planned": [points(&plan.points), points(&plan.second_points)],
                "cost": plan.gait.solver.objective,
            })
        })
        .collect();
    println!("{}", Value::from(strides));
}
