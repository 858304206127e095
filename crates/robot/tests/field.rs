//! What people's robots' files stumble over, each test named for the symptom: variations of the Vision 60, made here.

use robot::{Robot, RobotError, propose};

const TOML: &str = include_str!("../../../config/robots/vision60/robot.toml");
const URDF: &str = include_str!("../../../config/robots/vision60/vision60.urdf");

fn swap(text: &str, from: &str, to: &str) -> String {
    assert!(text.contains(from), "the test's text '{from}' is no longer in the file");
    text.replace(from, to)
}

fn with(toml: &str, urdf: &str) -> Robot {
    Robot::from_toml_str(toml, urdf).unwrap_or_else(|error| panic!("{error}"))
}

fn assert_refused(toml: &str, urdf: &str, words: &[&str]) {
    let message = Robot::from_toml_str(toml, urdf).expect_err("the files are wrong").to_string();
    for word in words {
        assert!(message.contains(word), "'{message}' does not say '{word}'");
    }
}

fn assert_notes(robot: &Robot, words: &[&str]) {
    let names_it = |note: &String| words.iter().all(|word| note.contains(word));
    assert!(robot.notes.iter().any(names_it), "{:?} do not say {words:?}", robot.notes);
}

/// The URDF with something before its end.
fn with_part(part: &str) -> String {
    URDF.replace("</robot>", &format!("{part}</robot>"))
}

const LIDAR: &str = r#"<link name="lidar"><inertial><mass value="0.5"/><inertia ixx="0.001" ixy="0" ixz="0" iyy="0.001" iyz="0" izz="0.001"/></inertial></link>
  <joint name="lidar_spin" type="continuous"><parent link="torso"/><child link="lidar"/><origin xyz="0.2 0 0"/><axis xyz="0 0 1"/></joint>"#;

#[test]
fn the_vision60_itself_needs_no_word() {
    assert_eq!(with(TOML, URDF).notes, Vec::<String>::new());
}

#[test]
fn a_floating_joint_from_world_is_left_out_with_a_line() {
    for name in ["world", "map"] {
        let urdf = swap(
            URDF,
            "<link name=\"base_link\"/>",
            &format!(
                "<link name=\"base_link\"/><link name=\"{name}\"/><joint name=\"floating_base\" type=\"floating\"><parent link=\"{name}\"/><child link=\"base_link\"/></joint>"
            ),
        );
        assert_notes(&with(TOML, &urdf), &["floating_base", name]);
    }
    let heavy = with_part(
        r#"<link name="kite"/><joint name="string" type="floating"><parent link="torso"/><child link="kite"/></joint>"#,
    );
    assert_refused(TOML, &heavy, &["string", "floating"]);
}

#[test]
fn a_number_of_xacro_is_named_with_link_line_text_and_cure() {
    let urdf = swap(URDF, "<mass value=\"17.9\"/>", "<mass value=\"${torso_mass}\"/>");
    assert_refused(TOML, &urdf, &["link 'torso'", "mass value", "line 32", "${torso_mass}", "ros2 run xacro"]);
    let urdf = with_part("<xacro:leg name=\"fifth\"/>");
    assert_refused(TOML, &urdf, &["<xacro:leg>", "ros2 run xacro"]);
    let urdf = swap(URDF, "lower=\"-0.43\"", "lower=\"-0,43\"");
    assert_refused(TOML, &urdf, &["joint 'front_left_hip_roll'", "limit lower", "-0,43", "line"]);
    // Of a property alone nothing is missing.
    let declared = swap(URDF, "<robot ", "<robot xmlns:xacro=\"http://www.ros.org/wiki/xacro\" ");
    with(TOML, &declared.replace("</robot>", "<xacro:property name=\"m\" value=\"1\"/></robot>"));
}

#[test]
fn nothing_is_printed_twice() {
    let error = Robot::from_toml_str(TOML, "<robot/>").expect_err("no links");
    assert!(std::error::Error::source(&error).is_none(), "a chain of causes says it again");
}

#[test]
fn a_urdf_in_utf16_is_read_with_a_line() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let mut bytes = vec![0xFF, 0xFE];
    bytes.extend(
        swap(URDF, "<?xml version=\"1.0\"?>", "<?xml version=\"1.0\" encoding=\"UTF-16\"?>")
            .encode_utf16()
            .flat_map(u16::to_le_bytes),
    );
    std::fs::write(folder.path().join("vision60.urdf"), bytes).expect("writes");
    std::fs::write(folder.path().join("robot.toml"), TOML).expect("writes");
    assert_notes(&Robot::load(folder.path()).expect("UTF-16 is read"), &["vision60.urdf", "UTF-16"]);
}

#[test]
fn a_joint_that_is_no_leg_is_locked_by_name_and_its_mass_counts() {
    let urdf = with_part(LIDAR);
    assert_refused(TOML, &urdf, &["lidar_spin", "[locked]", "\"lidar_spin\" = 0.0"]);
    let locked = with(&swap(TOML, "[gains]", "[locked]\n\"lidar_spin\" = 0.3\n[gains]"), &urdf);
    assert_eq!(locked.model.dof(), 18);
    assert!((locked.model.total_mass() - with(TOML, URDF).model.total_mass() - 0.5).abs() < 1e-12);
    let unknown = swap(TOML, "[gains]", "[locked]\n\"lidar\" = 0.0\n[gains]");
    assert_refused(&unknown, &urdf, &["locked.\"lidar\"", "lidar_spin"]);
    let a_leg = swap(TOML, "[gains]", "[locked]\n\"front_left_knee\" = 0.0\n[gains]");
    assert_refused(&a_leg, URDF, &["front_left_knee", "front_left"]);
}

#[test]
fn a_locked_joint_stays_where_it_is_locked() {
    let arm = r#"<link name="arm"><inertial><origin xyz="0 0 0.5"/><mass value="2"/><inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial></link>
  <joint name="arm_pitch" type="revolute"><parent link="torso"/><child link="arm"/><axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="1" velocity="1"/></joint>"#;
    let toml = swap(TOML, "[gains]", "[locked]\n\"arm_pitch\" = 1.0\n[gains]");
    let robot = with(&toml, &with_part(arm));
    // Up turned about y by 1 rad. 2 kg at 0.5 m, of a torso of 17.9 kg at its origin.
    let center = robot.model.body_inertia(3).center_m;
    let (sine, cosine) = 1.0_f64.sin_cos();
    assert!((center.x - 2.0 * 0.5 * sine / 19.9).abs() < 1e-9, "{center}");
    assert!((center.z - 2.0 * 0.5 * cosine / 19.9).abs() < 1e-9, "{center}");
}

#[test]
fn degrees_are_refused() {
    let toml = swap(TOML, "stand_rad = [0.21036, 1.02839, 2.05802]", "stand_rad = [6.13, 55.86, 111.8]");
    assert_refused(&toml, URDF, &["stand_rad[1]", "55.86", "degrees"]);
    let toml = swap(TOML, "position_max_rad = [0.43, 2.2, 2.9]", "position_max_rad = [24.6, 126.0, 166.0]");
    assert_refused(&toml, URDF, &["position_max_rad[0]", "24.6", "degrees"]);
}

#[test]
fn limits_wider_than_the_urdfs_are_narrowed_with_a_line() {
    let toml = swap(TOML, "position_min_rad = [-0.43", "position_min_rad = [-1.2");
    let robot = with(&toml, URDF);
    assert_eq!(robot.legs[1].position_min_rad[0], -0.43);
    assert_notes(&robot, &["legs[1].position_min_rad[0]", "-1.2", "-0.43", "rear_left_hip_roll"]);
    let robot = with(&swap(TOML, "velocity_rad_s = [8.6", "velocity_rad_s = [20.0"), URDF);
    assert_eq!(robot.limits.velocity_rad_s[0], 8.6);
    assert_notes(&robot, &["velocity_rad_s[0]", "20", "8.6"]);
    let robot = with(&swap(TOML, "drive_torque_nm = [87.5, 87.5", "drive_torque_nm = [87.5, 120.0"), URDF);
    assert_eq!(robot.limits.drive_torque_nm[1], 87.5);
    assert_notes(&robot, &["drive_torque_nm[1]", "120", "87.5"]);
}

#[test]
fn limits_that_cannot_be_meant_are_refused_with_both_values() {
    let toml = swap(TOML, "plan_torque_nm = [50.0, 50.0, 50.0]", "plan_torque_nm = [50.0, 50.0, 500.0]");
    assert_refused(&toml, URDF, &["plan_torque_nm[2]", "500", "87.5", "effort"]);
    let urdf = swap(URDF, "lower=\"-0.43\" upper=\"0.43\"", "lower=\"0.43\" upper=\"-0.43\"");
    assert_refused(TOML, &urdf, &["front_left_hip_roll", "0.43", "-0.43", "swapped"]);
    for gain in ["kp_nm_per_rad = [230.0", "kd_nm_s_per_rad = [5.0"] {
        let toml = swap(TOML, gain, &format!("{}[0.0", gain.split('[').next().expect("a list")));
        assert_refused(&toml, URDF, &["[0]", "positive"]);
    }
}

#[test]
fn legs_in_the_wrong_order_are_refused_by_place() {
    let sides =
        swap(TOML, "front_left", "front_x").replace("front_right", "front_left").replace("front_x", "front_right");
    assert_refused(&sides, URDF, &["front_left stands on the right", "front_right", "legs[0]"]);
    let ends = swap(TOML, "front_", "@_").replace("rear_", "front_").replace("@_", "rear_");
    assert_refused(&ends, URDF, &["front_left stands behind the rear leg", "rear_left"]);
}

#[test]
fn a_posture_that_is_not_the_nominal_one_is_refused_with_both_values() {
    assert_refused(&swap(TOML, "height_m = 0.55", "height_m = 0.45"), URDF, &["height_m", "0.45", "0.55"]);
    assert_refused(&swap(TOML, "half_width_m = 0.31", "half_width_m = 0.15"), URDF, &["half_width_m", "0.15", "0.31"]);
}

#[test]
fn a_careless_inertia_on_a_fixed_link_is_the_merged_bodys() {
    let camera = r#"<link name="camera"><inertial><mass value="0.1"/><inertia ixx="1e-4" ixy="0" ixz="0" iyy="1e-4" iyz="0" izz="1e-3"/></inertial></link>
  <joint name="camera_fixed" type="fixed"><parent link="torso"/><child link="camera"/></joint>"#;
    with(TOML, &with_part(camera));
}

#[test]
fn joints_may_bear_the_names_of_the_bases() {
    let urdf = swap(URDF, "\"front_left_hip_roll\"", "\"base_roll\"");
    let robot = with(&swap(TOML, "\"front_left_hip_roll\"", "\"base_roll\""), &urdf);
    assert_eq!(robot.model.joint_index("base_roll"), Some(6));
}

#[test]
fn a_folder_is_proposed_from_the_urdf_alone() {
    let proposal = propose("own", "own.urdf", None, &with_part(LIDAR)).expect("four legs");
    let (robot, by_hand) = (&proposal.robot, with(TOML, URDF));
    for (ours, theirs) in robot.legs.iter().zip(&by_hand.legs) {
        assert_eq!(ours.joints, theirs.joints);
        assert_eq!(robot.model.frame_name(ours.toe), by_hand.model.frame_name(theirs.toe));
        assert_eq!(ours.stand_rad[2] > 1.0, theirs.stand_rad[2] > 1.0);
    }
    assert_eq!(robot.mirror, by_hand.mirror);
    assert_eq!(robot.toe_radius_m, by_hand.toe_radius_m);
    assert!((robot.nominal.height_m - 0.76 * 0.6807).abs() < 1e-3, "{:?}", robot.nominal);
    assert!(proposal.look_at.iter().any(|line| line.contains("lidar_spin")), "{:?}", proposal.look_at);
    assert!(proposal.toml.contains("[locked]\n\"lidar_spin\" = 0.0"), "{}", proposal.toml);
}

#[test]
fn no_folder_is_proposed_for_what_has_not_four_legs() {
    let urdf = swap(URDF, "name=\"rear_left_knee\" type=\"revolute\"", "name=\"rear_left_knee\" type=\"fixed\"");
    let error = propose("own", "own.urdf", None, &urdf).expect_err("three legs");
    assert!(matches!(error, RobotError::NotFourLegs { .. }), "{error}");
    assert!(error.to_string().contains("3 begin a chain of three"), "{error}");
}

/// The URDF with the text of each rear leg changed.
fn with_rear(change: impl Fn(&str) -> String) -> String {
    let mut urdf = URDF.to_owned();
    for side in ["left", "right"] {
        let start = urdf.find(&format!("<!-- rear {side} leg -->")).expect("a comment in the URDF");
        let length = urdf[start + 1..].find("<!--").map_or(urdf[start..].len(), |length| length + 1);
        let leg = change(&urdf[start..start + length]);
        urdf.replace_range(start..start + length, &leg);
    }
    urdf
}

/// Rear knees whose zero is 0.6 rad from the front ones', as where the shank is bent: the origin of the knee's joint is
/// turned.
fn rear_knees_turned_by(angle_rad: f64) -> (String, String) {
    let urdf = with_rear(|leg| {
        let at = leg.find("_knee\" type=").expect("the knee");
        let origin = at + leg[at..].find("<origin").expect("its origin");
        let end = origin + leg[origin..].find("/>").expect("its end");
        let turned = leg[origin..end].replace("rpy=\"0 0 0\"", &format!("rpy=\"0 {angle_rad} 0\""));
        assert_ne!(turned, leg[origin..end], "the knee's origin has another form");
        format!("{}{turned}{}", &leg[..origin], &leg[end..])
    });
    let mut toml = TOML.to_owned();
    for leg in ["rear_left", "rear_right"] {
        let at = toml.find(&format!("name = \"{leg}\"")).expect("the leg");
        let (head, tail) = toml.split_at(at);
        toml = format!("{head}{}", tail.replacen("2.05802]", &format!("{}]", 2.05802 - angle_rad), 1));
    }
    (toml, urdf)
}

#[test]
fn rear_legs_with_another_zero_are_paired_by_the_standing_posture() {
    assert_eq!(with(TOML, URDF).rear_offset_rad(), Ok([0.0; 6]));
    let (toml, urdf) = rear_knees_turned_by(0.6);
    let offset = with(&toml, &urdf).rear_offset_rad().expect("the same legs, another zero");
    for (found, wanted) in offset.into_iter().zip([0.0, 0.0, -0.6, 0.0, 0.0, -0.6]) {
        assert!((found - wanted).abs() < 1e-9, "{offset:?}");
    }
}

#[test]
fn knees_that_point_apart_cannot_be_paired_and_the_reason_is_given() {
    let mut legs: Vec<String> = TOML.split("[[legs]]").map(str::to_owned).collect();
    for leg in [2, 4] {
        legs[leg] = swap(&legs[leg], "1.02839, 2.05802]", "2.11320, -2.05802]")
            .replace("-0.3, 0.25]", "0.9, -2.9]")
            .replace("2.2, 2.9]", "3.4, -0.25]");
    }
    let urdf = with_rear(|leg| swap(leg, "lower=\"0\" upper=\"3.14159265\"", "lower=\"-3.14159265\" upper=\"0\""));
    let error = with(&legs.join("[[legs]]"), &urdf).rear_offset_rad().expect_err("knees point apart").to_string();
    for word in ["rear_left", "front_right", "moves their toes by"] {
        assert!(error.contains(word), "{error}");
    }
}

#[test]
fn a_toe_is_where_its_ball_is_not_where_its_link_begins() {
    // All four toes, or the two sides were no mirror images. Their collisions' shapes alone, which have no origin.
    let ball = "<collision>\n      <geometry><sphere radius=\"0.0325\"/>";
    let urdf = swap(URDF, ball, &ball.replace("<geometry>", "<origin xyz=\"0 0 0.02\" rpy=\"0 0 0\"/><geometry>"));
    let (plain, moved) = (with(TOML, URDF), with(TOML, &urdf));
    let joints = plain.legs[0].stand_rad;
    let way = moved.toe_from_hip(0, &joints) - plain.toe_from_hip(0, &joints);
    assert!((way.norm() - 0.02).abs() < 1e-12, "{way}");
    let smaller = with(&swap(TOML, "toe_radius_m = 0.0325", "toe_radius_m = 0.02"), URDF);
    assert_notes(&smaller, &["toe_radius_m", "0.02", "0.0325", "front_left_toe"]);
}

#[test]
fn an_element_that_cannot_be_read_names_its_link_and_line() {
    let twice = swap(URDF, "<mass value=\"17.9\"/>", "<mass value=\"17.9\"/><mass value=\"17.9\"/>");
    assert_refused(TOML, &twice, &["link 'torso'", "line", "mass"]);
    let at = URDF.find("name=\"front_left_knee\"").expect("the joint");
    let parent = at + URDF[at..].find("<parent").expect("its parent");
    let end = parent + URDF[parent..].find("/>").expect("its end") + 2;
    let none = format!("{}{}", &URDF[..parent], &URDF[end..]);
    assert_refused(TOML, &none, &["joint 'front_left_knee'", "line", "parent"]);
}

#[test]
fn a_leg_whose_inertia_is_a_little_out_is_corrected_with_a_line() {
    // xx + yy of the hips is 0.01897 kg m².
    let urdf = URDF.replace("izz=\"0.01533698\"", "izz=\"0.0195\"");
    let robot = with(TOML, &urdf);
    assert_notes(&robot, &["front_left_hip", "moments of inertia", "added"]);
    let hip = robot.model.body_inertia(6).rotational_kg_m2;
    assert!(hip[(0, 0)] + hip[(1, 1)] >= hip[(2, 2)] * (1.0 - 1e-9), "{hip}");
    assert_refused(TOML, &URDF.replace("izz=\"0.01533698\"", "izz=\"0.03\""), &["hip", "moments of inertia"]);
}

#[test]
fn a_plan_may_not_use_more_torque_than_the_drives_give() {
    let urdf = URDF.replace("effort=\"87.5\"", "effort=\"0\"");
    let toml = swap(TOML, "plan_torque_nm = [50.0, 50.0, 50.0]", "plan_torque_nm = [50.0, 50.0, 90.0]");
    assert_refused(&toml, &urdf, &["plan_torque_nm[2]", "90", "drive_torque_nm[2]", "87.5"]);
}

#[test]
fn degrees_in_the_urdf_are_named() {
    let limits = swap(URDF, "lower=\"-0.43\" upper=\"0.43\"", "lower=\"-24.6\" upper=\"24.6\"");
    assert_notes(&with(TOML, &limits), &["front_left_hip_roll", "24.6", "degrees"]);
    let urdf = with_part(
        r#"<link name="camera"/><joint name="camera_fixed" type="fixed"><parent link="torso"/><child link="camera"/><origin xyz="0 0 0" rpy="0 90 0"/></joint>"#,
    );
    assert_notes(&with(TOML, &urdf), &["camera_fixed", "90", "degrees"]);
}

#[test]
fn a_base_of_a_millionth_of_a_kilogram_is_part_of_the_torso() {
    let urdf = swap(
        URDF,
        "<link name=\"base_link\"/>",
        "<link name=\"base_link\"><inertial><mass value=\"1e-6\"/><inertia ixx=\"1e-6\" ixy=\"0\" ixz=\"0\" iyy=\"1e-12\" iyz=\"0\" izz=\"1e-12\"/></inertial></link>",
    );
    assert!((with(TOML, &urdf).model.total_mass() - with(TOML, URDF).model.total_mass() - 1e-6).abs() < 1e-12);
}

#[test]
fn meshes_are_looked_for_from_robot_tomls_folder() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    std::fs::write(folder.path().join("vision60.urdf"), URDF).expect("writes");
    std::fs::write(folder.path().join("robot.toml"), TOML).expect("writes");
    assert_eq!(Robot::load(folder.path()).expect("loads").folder.as_deref(), Some(folder.path()));
    let toml = swap(TOML, "toe_radius_m = ", "meshes = \"/opt/own_description\"\ntoe_radius_m = ");
    std::fs::write(folder.path().join("robot.toml"), toml).expect("writes");
    let robot = Robot::load(folder.path()).expect("loads");
    assert_eq!(robot.folder.as_deref(), Some(std::path::Path::new("/opt/own_description")));
}
