//! Rear legs that are not the front ones' images: the Vision 60 with others.

use super::*;
use crate::tests::{as_steps, go_on, vision60};
use crate::tests_edges::keeps_its_limits;

const TOML: &str = include_str!("../../../config/robots/vision60/robot.toml");
const URDF: &str = include_str!("../../../config/robots/vision60/vision60.urdf");

fn swap(text: &str, from: &str, to: &str) -> String {
    assert!(text.contains(from), "the test's text '{from}' is no longer in the file");
    text.replace(from, to)
}

/// The Vision 60 with the rear legs' texts in robot.toml and the rear knees' joints in the URDF changed.
fn with_rear(in_toml: impl Fn(&str) -> String, knee: impl Fn(&str) -> String) -> Robot {
    let mut legs: Vec<String> = TOML.split("[[legs]]").map(str::to_owned).collect();
    for leg in [2, 4] {
        legs[leg] = in_toml(&legs[leg]);
    }
    let mut urdf = URDF.to_owned();
    for side in ["left", "right"] {
        let start = urdf.find(&format!("<joint name=\"rear_{side}_knee\"")).unwrap();
        let end = start + urdf[start..].find("</joint>").unwrap();
        let changed = knee(&urdf[start..end]);
        urdf.replace_range(start..end, &changed);
    }
    Robot::from_toml_str(&legs.join("[[legs]]"), &urdf).unwrap()
}

#[test]
fn rear_legs_whose_knees_have_another_zero_walk_as_the_front_ones_do() {
    let angle_rad = 0.6;
    let robot = with_rear(
        |leg| {
            let leg = swap(leg, "2.05802]", &format!("{}]", 2.05802 - angle_rad));
            swap(&swap(&leg, "0.25]", &format!("{}]", 0.25 - angle_rad)), "2.9]", &format!("{}]", 2.9 - angle_rad))
        },
        |knee| {
            let knee = swap(knee, "rpy=\"0 0 0\"", &format!("rpy=\"0 {angle_rad} 0\""));
            swap(&knee, "lower=\"0\"", "lower=\"-1\"")
        },
    );
    let plain = vision60();
    for name in ["gait1", "amble"] {
        let [a, b] = [&plain, &robot]
            .map(|robot| plan(robot, &as_steps(name, robot), &PlanOptions::default(), go_on).unwrap().gait);
        for j in 0..12 {
            let offset_rad = if [5, 11].contains(&j) { angle_rad } else { 0.0 };
            for (x, y) in a.coefficients_rad[j].into_iter().zip(b.coefficients_rad[j]) {
                assert!((x - y - offset_rad).abs() < 1e-4, "{name}, joint {j}: {x} and {y}");
            }
        }
    }
}

#[test]
fn knees_that_point_apart_are_planned_by_the_full_order_program() {
    let robot = with_rear(
        |leg| {
            let leg = swap(&swap(leg, "1.02839, 2.05802]", "2.11320, -2.05802]"), "-0.3, 0.25]", "0.9, -2.9]");
            swap(&leg, "2.2, 2.9]", "3.4, -0.25]")
        },
        |knee| swap(knee, "lower=\"0\" upper=\"3.14159265\"", "lower=\"-3.14159265\" upper=\"0\""),
    );
    let request = as_steps("amble", &robot);
    // Between 11 points the simulated step is 3 mrad off the planned joints.
    let mut options = PlanOptions::default();
    options.program.points = 21;
    let plan = plan(&robot, &request, &options, go_on).unwrap();
    keeps_its_limits(&robot, &request, &plan);
    let step = simulate_planned_step(&robot, &plan.gait, &plan.points, StepLaw::Linearising).unwrap();
    assert!(step.follows_plan(), "{step:?}");
    // No library of gaits can hold such: the decomposed program says why.
    let Err(error) = Planner::new(&robot).solve(&request, &PlanOptions::default(), go_on) else {
        panic!("the rear legs cannot do as the front ones do")
    };
    assert!(error.to_string().contains("rear_left"), "{error}");
}
