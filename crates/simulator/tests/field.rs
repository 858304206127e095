//! What the planner accepts the simulator walks: variations of the Vision 60 that people's URDFs show, made here.

use gait_design::{GaitRequest, PlanOptions};
use robot::Robot;
use simulator::walk::{End, Walk, WalkOptions, walk};
use std::ops::ControlFlow;
use std::path::Path;

const TOML: &str = include_str!("../../../config/robots/vision60/robot.toml");
const URDF: &str = include_str!("../../../config/robots/vision60/vision60.urdf");

/// Loads the two texts from a folder, plans stepping in place and walks it for 3 s.
fn walked(toml: &str, urdf: &str, files: &[(&str, &[u8])]) -> Walk {
    let folder =
        std::env::temp_dir().join(format!("tandem-field-{}-{:?}", std::process::id(), std::thread::current().id()));
    std::fs::create_dir_all(&folder).unwrap();
    std::fs::write(folder.join("robot.toml"), toml).unwrap();
    std::fs::write(folder.join("vision60.urdf"), urdf).unwrap();
    for (name, bytes) in files {
        let file = folder.join(name);
        std::fs::create_dir_all(file.parent().unwrap()).unwrap();
        std::fs::write(file, bytes).unwrap();
    }
    let robot = Robot::load(Path::new(&folder)).unwrap();
    let request = GaitRequest::named("gait1", &robot).unwrap();
    let plan = gait_design::plan(&robot, &request, &PlanOptions::default(), |_| ControlFlow::Continue(())).unwrap();
    let options = WalkOptions { seconds: 3.0, ..WalkOptions::default() };
    let done = walk(&robot, &plan.gait, &options, &mut |_, _, _| {});
    std::fs::remove_dir_all(&folder).unwrap();
    done.unwrap()
}

fn assert_walks(walk: &Walk, notes: &[&str]) {
    assert_eq!(walk.end, End::Upright, "{walk:?}");
    assert_eq!(walk.notes.len(), usize::from(!notes.is_empty()), "{:?}", walk.notes);
    for word in notes {
        assert!(walk.notes[0].contains(word), "{:?} do not say {word}", walk.notes);
    }
}

fn swap(text: &str, from: &str, to: &str) -> String {
    assert!(text.contains(from), "the test's text '{from}' is no longer in the file");
    text.replace(from, to)
}

/// The URDF with something before its end.
fn with_part(part: &str) -> String {
    swap(URDF, "</robot>", &format!("{part}</robot>"))
}

const MESH: &str =
    r#"<geometry><mesh filename="package://own_description/meshes/part.FORM" scale="1 1 1"/></geometry>"#;
const TETRAHEDRON_OBJ: &[u8] = b"v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nv 0 0 0.1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n";
const TETRAHEDRON_STL: &[u8] = b"solid t\n\
 facet normal 0 0 -1\n outer loop\n vertex 0 0 0\n vertex 0 0.1 0\n vertex 0.1 0 0\n endloop\n endfacet\n\
 facet normal 0 -1 0\n outer loop\n vertex 0 0 0\n vertex 0.1 0 0\n vertex 0 0 0.1\n endloop\n endfacet\n\
 facet normal 1 1 1\n outer loop\n vertex 0.1 0 0\n vertex 0 0.1 0\n vertex 0 0 0.1\n endloop\n endfacet\n\
 facet normal -1 0 0\n outer loop\n vertex 0 0 0\n vertex 0 0 0.1\n vertex 0 0.1 0\n endloop\n endfacet\n\
endsolid t\n";

#[test]
fn meshes_that_are_not_found_are_left_out_with_one_line_and_it_walks_the_same() {
    let plain = walked(TOML, URDF, &[]);
    assert_walks(&plain, &[]);
    let urdf = swap(URDF, "<geometry><box size=\"0.1 0.16 0.08\"/></geometry>", &MESH.replace("FORM", "dae"));
    let bare = walked(TOML, &urdf, &[]);
    assert_walks(&bare, &["package://own_description/meshes/part.dae", "not found", "left out"]);
    assert_eq!(bare.state, plain.state);
    // Found, it is drawn and touches nothing.
    for (form, bytes) in [("obj", TETRAHEDRON_OBJ), ("stl", TETRAHEDRON_STL)] {
        let urdf = swap(URDF, "<geometry><box size=\"0.1 0.16 0.08\"/></geometry>", &MESH.replace("FORM", form));
        let file = format!("own_description/meshes/part.{form}");
        let drawn = walked(TOML, &urdf, &[(&file, bytes)]);
        assert_walks(&drawn, &[]);
        assert_eq!(drawn.state, plain.state);
    }
}

#[test]
fn a_link_named_as_the_tool_names_its_own_walks() {
    let urdf = swap(&swap(URDF, "\"torso\"", "\"base\""), "\"front_left_hip\"", "\"world\"");
    assert_walks(&walked(TOML, &urdf, &[]), &[]);
    let toe = swap(URDF, "\"front_left_toe\"", "\"floor\"");
    assert_walks(&walked(&swap(TOML, "\"front_left_toe\"", "\"floor\""), &toe, &[]), &[]);
}

#[test]
fn a_camera_with_an_inertia_that_no_body_has_walks() {
    for inertia in [
        "ixx=\"1e-4\" ixy=\"0\" ixz=\"0\" iyy=\"1e-4\" iyz=\"0\" izz=\"1e-3\"",
        "ixx=\"0\" ixy=\"0\" ixz=\"0\" iyy=\"0\" iyz=\"0\" izz=\"0\"",
    ] {
        let urdf = with_part(&format!(
            r#"<link name="camera"><inertial><mass value="0.1"/><inertia {inertia}/></inertial></link>
            <joint name="camera_fixed" type="fixed"><parent link="torso"/><child link="camera"/><origin xyz="0.4 0 0.1"/></joint>"#
        ));
        assert_walks(&walked(TOML, &urdf, &[]), &[]);
    }
}

#[test]
fn a_floating_joint_from_world_and_a_locked_lidar_walk() {
    let urdf = with_part(
        r#"<link name="lidar"><inertial><mass value="0.5"/><inertia ixx="0.001" ixy="0" ixz="0" iyy="0.001" iyz="0" izz="0.001"/></inertial></link>
        <joint name="lidar_spin" type="continuous"><parent link="torso"/><child link="lidar"/><axis xyz="0 0 1"/></joint>
        <link name="world"/><joint name="floating_base" type="floating"><parent link="world"/><child link="base_link"/></joint>"#,
    );
    assert_walks(&walked(&swap(TOML, "[gains]", "[locked]\n\"lidar_spin\" = 0.0\n[gains]"), &urdf, &[]), &[]);
}

#[test]
fn a_toe_without_a_ball_stands_on_robot_tomls() {
    let toe = URDF.split("<link name=\"front_left_toe\">").nth(1).unwrap().split("</link>").next().unwrap();
    let without = toe.split("<collision>").next().unwrap();
    let cylinder =
        format!("{without}<collision><geometry><cylinder radius=\"0.0325\" length=\"0.03\"/></geometry></collision>");
    for shape in [without, &cylinder] {
        let walk = walked(TOML, &URDF.replacen(toe, shape, 1), &[]);
        assert_walks(&walk, &["front_left_toe", "0.0325"]);
    }
}

#[test]
fn damping_of_the_urdf_and_rotors_of_robot_toml_act() {
    let plain = walked(TOML, URDF, &[]);
    let damped = walked(
        TOML,
        &swap(URDF, "<axis xyz=\"0 1 0\"/>", "<axis xyz=\"0 1 0\"/><dynamics damping=\"0.5\" friction=\"0.2\"/>"),
        &[],
    );
    assert_walks(&damped, &[]);
    assert_ne!(damped.state, plain.state);
    let rotors = swap(TOML, "[gains]", "[drives]\nrotor_inertia_kg_m2 = [0.01, 0.01, 0.01]\n[gains]");
    let heavy = walked(&rotors, URDF, &[]);
    assert_walks(&heavy, &[]);
    assert_ne!(heavy.state, plain.state);
}
