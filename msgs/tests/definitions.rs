//! The Rust types of `tandem_msgs` against the definition files, field by field.

use std::path::Path;

use tandem_msgs::{
    Action, Claim, ClearFault, ControlCycle, ControllerState, FootContacts, Gait, GaitDomain, GenerateGait,
    GenerateGaitAction, JointCommand, JointDiagnostics, LoadGait, Message, Service, SolverReport, StartRecording,
    StopRecording, definition,
};

/// The fields of a definition file's sections (one for a message, two for a service, three for an action).
fn sections(path: &str) -> Vec<Vec<(String, String)>> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(path);
    let text = std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    text.split("\n---\n")
        .map(|section| {
            section
                .lines()
                .map(|line| line.split('#').next().unwrap_or_default().trim())
                // A constant, NAME=VALUE, is no field; a bound, type[<=N], stands before the name.
                .filter(|line| !line.is_empty() && !line.split_once(' ').is_some_and(|(_, name)| name.contains('=')))
                .map(|line| {
                    let (type_name, name) =
                        line.split_once(' ').unwrap_or_else(|| panic!("{line}: expected 'type name'"));
                    (name.trim().to_string(), type_name.to_string())
                })
                .collect()
        })
        .collect()
}

/// The same from the Rust type; types of the own package stand without its name, as a definition file may write them.
fn rust_fields<M: Message>() -> Vec<(String, String)> {
    M::fields()
        .into_iter()
        // ROS 2's own, for a structure without members.
        .filter(|field| field.name != "structure_needs_at_least_one_member")
        .map(|field| (field.name.to_string(), field.type_name.replace("tandem_msgs/", "")))
        .collect()
}

#[track_caller]
fn assert_message<M: Message>() {
    assert_eq!(sections(&format!("msg/{}.msg", M::NAME)), [rust_fields::<M>()], "{}", M::NAME);
}

#[track_caller]
fn assert_service<S: Service>() {
    let file = sections(&format!("srv/{}.srv", S::NAME));
    assert_eq!(file, [rust_fields::<S::Request>(), rust_fields::<S::Response>()], "{}", S::NAME);
}

#[test]
fn messages_match_their_files() {
    assert_message::<ControlCycle>();
    assert_message::<ControllerState>();
    assert_message::<FootContacts>();
    assert_message::<Gait>();
    assert_message::<JointCommand>();
    assert_message::<GaitDomain>();
    assert_message::<JointDiagnostics>();
    assert_message::<SolverReport>();
}

#[test]
fn services_match_their_files() {
    assert_service::<Claim>();
    assert_service::<ClearFault>();
    assert_service::<GenerateGait>();
    assert_service::<LoadGait>();
    assert_service::<StartRecording>();
    assert_service::<StopRecording>();
}

#[test]
fn actions_match_their_files() {
    type A = GenerateGaitAction;
    assert_eq!(
        sections("action/GenerateGait.action"),
        [
            rust_fields::<<A as Action>::Goal>(),
            rust_fields::<<A as Action>::Result>(),
            rust_fields::<<A as Action>::Feedback>()
        ]
    );
}

#[test]
fn every_file_has_a_rust_type_and_is_built() {
    let cmake = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("CMakeLists.txt")).unwrap();
    let mut found = Vec::new();
    for folder in ["msg", "srv", "action"] {
        for entry in std::fs::read_dir(Path::new(env!("CARGO_MANIFEST_DIR")).join(folder)).unwrap() {
            found.push(format!("{folder}/{}", entry.unwrap().file_name().to_string_lossy()));
        }
    }
    found.sort();
    assert_eq!(
        found,
        [
            "action/GenerateGait.action",
            "msg/ControlCycle.msg",
            "msg/ControllerState.msg",
            "msg/FootContacts.msg",
            "msg/Gait.msg",
            "msg/GaitDomain.msg",
            "msg/JointCommand.msg",
            "msg/JointDiagnostics.msg",
            "msg/SolverReport.msg",
            "srv/Claim.srv",
            "srv/ClearFault.srv",
            "srv/GenerateGait.srv",
            "srv/LoadGait.srv",
            "srv/StartRecording.srv",
            "srv/StopRecording.srv",
        ],
        "a new definition file needs its Rust type and a test above"
    );
    for file in found {
        assert!(cmake.contains(&format!("\"{file}\"")), "CMakeLists.txt does not build {file}");
    }
}

#[test]
fn a_definition_carries_each_nested_message_once() {
    let text = definition::<Gait>();
    let rule = "=".repeat(80);
    for nested in ["std_msgs/Header", "builtin_interfaces/Time", "geometry_msgs/Pose", "geometry_msgs/Vector3"] {
        assert_eq!(text.matches(&format!("{rule}\nMSG: {nested}\n")).count(), 1, "{nested}");
    }
    assert!(text.starts_with("std_msgs/Header header\nuint32 version\n"));
    assert!(text.contains("float64[] coefficients_rad\n"));
    let trigger = definition::<tandem_msgs::std_srvs::TriggerRequest>();
    assert_eq!(trigger, "", "the byte that ROS 2 adds is no field of the definition");
}
