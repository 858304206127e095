//! Libraries of strides: the mirror, and what lies between their points.

use crate::library::{Axis, Entry, Field, Grid, Library};
use crate::tests::{as_steps, go_on, vision60};
use crate::tests_edges::solved;
use crate::{GaitRequest, PlanOptions, plan};
use gait::StepSide;
use robot::Robot;

fn grid(robot: &Robot) -> Grid {
    let base = GaitRequest { step_duration_s: 0.22, clearance_m: 0.08, ..as_steps("amble", robot) };
    let axes = vec![
        Axis { field: Field::SpeedMS, values: vec![0.2, 0.35] },
        Axis { field: Field::LateralSpeedMS, values: vec![-0.1, 0.0, 0.1] },
        Axis { field: Field::YawRateRadS, values: vec![-0.2, 0.0, 0.2] },
    ];
    Grid::new(robot, base, axes).unwrap()
}

#[test]
fn what_goes_to_the_right_is_the_mirror_image_of_what_goes_to_the_left() {
    let robot = vision60();
    let library = solved(&robot, Library::new(&robot, grid(&robot)));
    let images: Vec<usize> = (0..18).filter(|&i| matches!(library.entries()[i], Some(Entry::Mirror { .. }))).collect();
    assert_eq!(images, [0, 1, 2, 3, 9, 10, 11, 12]);
    for index in 0..18 {
        let request = library.grid().request(index);
        let found = library.find(&robot, &request).unwrap();
        assert!(found.violation.amount < 1e-5, "{}: {:?}", library.grid().describe(index), found.violation);
        let own = plan(&robot, &request, &PlanOptions::default(), go_on).unwrap().gait;
        if own.second_step.is_none() {
            // Straight on, a plan is a step and its mirror image, with a cost of its own.
            continue;
        }
        let costs = found.gait.solver.objective / own.solver.objective;
        assert!((costs - 1.0).abs() < 1e-5, "{costs}");
        for side in StepSide::BOTH {
            let [(own, _), (found, _)] = [&own, &found.gait].map(|gait| gait.planned(side, 0.5));
            let apart = own.iter().zip(&found).fold(0.0_f64, |most, (a, b)| most.max((a - b).abs()));
            assert!(apart < 3e-3, "{}: {apart} rad", library.grid().describe(index));
        }
    }
}

#[test]
fn between_strides_a_library_states_what_interpolation_breaks_and_gives_a_start() {
    let robot = vision60();
    let library = solved(&robot, Library::new(&robot, grid(&robot)));
    let corner = library.grid().request(0);
    let middle = GaitRequest { speed_m_s: 0.275, lateral_speed_m_s: -0.05, yaw_rate_rad_s: 0.1, ..corner };
    let between = library.find(&robot, &middle).unwrap();
    println!("{:?}", between.violation);
    assert_eq!((between.neighbours.len(), between.gait.solver.status.as_str()), (8, "interpolated"));
    assert!(between.violation.amount > 1e-5 && between.violation.amount < 0.5, "{:?}", between.violation);
    let options = PlanOptions { warm_start: Some(between.warm_start), ..PlanOptions::default() };
    let warm = plan(&robot, &middle, &options, go_on).unwrap().gait.solver;
    let cold = plan(&robot, &middle, &PlanOptions::default(), go_on).unwrap().gait.solver;
    assert!(warm.iterations < cold.iterations, "{} and {}", warm.iterations, cold.iterations);
    assert!((warm.objective - cold.objective).abs() < 1e-6, "{} and {}", warm.objective, cold.objective);
}

#[test]
fn a_library_of_strides_is_read_back_and_images_that_are_none_are_refused() {
    let robot = vision60();
    let library = solved(&robot, Library::new(&robot, grid(&robot)));
    let text = library.to_text();
    assert!(text.lines().next().unwrap().contains("\"version\":2"));
    assert_eq!(Library::from_text(&text, &robot).unwrap(), library);
    let spoiled = |index: usize, entry: Entry| {
        let mut library = library.clone();
        library.insert(index, entry);
        Library::from_text(&library.to_text(), &robot).unwrap_err().to_string()
    };
    let e = spoiled(0, Entry::Mirror { of: 7 });
    assert!(e.contains("gait number 0 is no mirror image of number 7"), "{e}");
    let e = spoiled(8, Entry::Mirror { of: 0 });
    assert!(e.contains("number 8 is no mirror image"), "{e}");
}

#[test]
fn a_grid_without_both_sides_has_no_mirror_images() {
    let robot = vision60();
    let base = as_steps("amble", &robot);
    let axis = |field, values: &[f64]| Axis { field, values: values.to_vec() };
    let yaw = axis(Field::YawRateRadS, &[-0.3, -0.1, 0.1]);
    let grid = Grid::new(&robot, base.clone(), vec![yaw.clone()]).unwrap();
    assert_eq!([0, 1, 2].map(|i| grid.mirror_of(i)), [None, Some(2), None]);
    // Aside by what no axis varies, and on a slope, the mirror image is another request.
    for (base, field) in [
        (GaitRequest { lateral_speed_m_s: 0.1, ..base.clone() }, Field::YawRateRadS),
        (GaitRequest { sideways_slope_rad: 0.1, ..base.clone() }, Field::LateralSpeedMS),
    ] {
        let grid = Grid::new(&robot, base, vec![axis(field, &[-0.1, 0.0, 0.1])]).unwrap();
        assert!((0..3).all(|i| grid.mirror_of(i).is_none()));
    }
}

#[test]
fn a_library_on_a_sideways_slope_is_of_strides() {
    let robot = vision60();
    let base = GaitRequest { sideways_slope_rad: 0.1, ..as_steps("amble", &robot) };
    let axis = Axis { field: Field::SpeedMS, values: vec![0.1, 0.3] };
    let library = solved(&robot, Library::new(&robot, Grid::new(&robot, base, vec![axis]).unwrap()));
    for index in [0, 1] {
        let request = library.grid().request(index);
        let found = library.find(&robot, &request).unwrap();
        assert!(found.violation.amount < 1e-5 && found.gait.second_step.is_some(), "{:?}", found.violation);
    }
}
