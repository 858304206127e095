//! The Vision 60 against numbers that Pinocchio computed. `tests/pinocchio/run` makes them anew, for other robots too.

#[path = "common/golden.rs"]
mod golden;

#[test]
fn the_vision_60_agrees_with_pinocchio() {
    let robot = robot::Robot::from_toml_str(
        include_str!("../../../config/robots/vision60/robot.toml"),
        include_str!("../../../config/robots/vision60/vision60.urdf"),
    )
    .expect("the project's own robot loads");
    let numbers = include_str!("../../../tests/pinocchio/vision60.json");
    let golden: golden::Golden = serde_json::from_str(numbers).expect("the golden file is whole");
    assert_eq!(golden.robot, robot.name);
    for (what, error) in golden::compare(&robot, &golden) {
        assert!(error < 1e-9, "{what}: {error:e}");
    }
}
