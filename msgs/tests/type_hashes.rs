//! Hashes of types against those that ROS 2's own generator wrote for the same definitions (rosidl, Kilted). All types
//! are compared in `tests/ros2/test_serialization.py`, what our nodes announce in `test_interfaces.py`.

use tandem_msgs::{
    GenerateGaitAction, TypeHash, diagnostic_msgs, nav_msgs, rcl_interfaces, sensor_msgs, std_msgs, std_srvs,
};

#[test]
fn messages_have_the_hashes_that_ros_gives_them() {
    // Nested types, bytes, arrays of numbers and of structures.
    for (computed, name, hash) in [
        (
            TypeHash::of_message::<std_msgs::Header>(),
            "std_msgs/msg/Header",
            "RIHS01_f49fb3ae2cf070f793645ff749683ac6b06203e41c891e17701b1cb597ce6a01",
        ),
        (
            TypeHash::of_message::<sensor_msgs::Imu>(),
            "sensor_msgs/msg/Imu",
            "RIHS01_7d9a00ff131080897a5ec7e26e315954b8eae3353c3f995c55faf71574000b5b",
        ),
        (
            TypeHash::of_message::<sensor_msgs::BatteryState>(),
            "sensor_msgs/msg/BatteryState",
            "RIHS01_4bee5dfce981c98faa6828b868307a0a73f992ed0789f374ee96c8f840e69741",
        ),
        (
            TypeHash::of_message::<nav_msgs::Odometry>(),
            "nav_msgs/msg/Odometry",
            "RIHS01_3cc97dc7fb7502f8714462c526d369e35b603cfc34d946e3f2eda2766dfec6e0",
        ),
        (
            TypeHash::of_message::<diagnostic_msgs::DiagnosticArray>(),
            "diagnostic_msgs/msg/DiagnosticArray",
            "RIHS01_5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e",
        ),
        (
            TypeHash::of_message::<rcl_interfaces::ParameterEvent>(),
            "rcl_interfaces/msg/ParameterEvent",
            "RIHS01_043e627780fcad87a22d225bc2a037361dba713fca6a6b9f4b869a5aa0393204",
        ),
    ] {
        assert_eq!((computed.name.as_str(), computed.hash.as_str()), (name, hash));
    }
}

#[test]
fn requests_and_responses_have_hashes_of_their_own_and_an_empty_request_its_byte() {
    let [request, response] = TypeHash::of_service::<std_srvs::Trigger>();
    assert_eq!(request.name, "std_srvs/srv/Trigger_Request");
    assert_eq!(request.dds_name(), "std_srvs::srv::dds_::Trigger_Request_");
    assert_eq!(request.hash, "RIHS01_d010825374ce8918e72bfd826c82603e60f45419e932ea976f807b74a863a199");
    assert_eq!(response.hash, "RIHS01_2d946c21e2fc3f1e9ca6986a8191d85fcc70097a8bb7771a053564bc47009cdf");
}

#[test]
fn all_that_an_action_sends_has_a_hash() {
    let all = TypeHash::of_action::<GenerateGaitAction>();
    let names: Vec<_> = all.iter().map(|described| described.name.rsplit('/').next().unwrap()).collect();
    assert_eq!(
        names,
        [
            "GenerateGait_SendGoal_Request",
            "GenerateGait_SendGoal_Response",
            "GenerateGait_GetResult_Request",
            "GenerateGait_GetResult_Response",
            "GenerateGait_FeedbackMessage",
            "CancelGoal_Request",
            "CancelGoal_Response",
            "GoalStatusArray",
        ]
    );
    // The identifier's sixteen bytes and a nested message, without what may change of ours.
    assert_eq!(all[2].hash, "RIHS01_0ba6c70dca827023aad8ded799b36204654dbabe528714bab1eaaaf19d6a3255");
    assert_eq!(all[5].hash, "RIHS01_3d3c84653c1f96918086887e1dcb236faec88b81a5b14fd4cf4840065bcdf8af");
    assert_eq!(all[6].hash, "RIHS01_35e682cf3f510e83c70a82a4aac888496dedee56773bf9d8e5e0aa81f9e1c960");
    assert_eq!(all[7].hash, "RIHS01_6c1684b00f177d37438febe6e709fc4e2b0d4248dca4854946f9ed8b30cda83e");
}

#[test]
fn a_definition_s_text_has_the_hash_of_its_type_whatever_else_stands_in_it() {
    fn check<M: tandem_msgs::Message>() {
        let computed = TypeHash::of_definition(&M::full_name(), &tandem_msgs::definition::<M>());
        assert_eq!(computed, TypeHash::of_message::<M>());
    }
    check::<std_msgs::Header>();
    check::<diagnostic_msgs::DiagnosticArray>();
    check::<tandem_msgs::Gait>();
    check::<tandem_msgs::ControllerState>();
    check::<tandem_msgs::ControlCycle>();
    // As its authors wrote it: constants, comments, a type of its own package without the package.
    let text = "byte OK=0\nbyte WARN = 1 # not well\n# of one part\n\n  byte level\nstring name 'a = b' # what\nstring message\n\
                string hardware_id\nKeyValue[] values\n\
                ================================================================================\n\
                MSG: diagnostic_msgs/KeyValue\nstring key# short\nstring value\n";
    let status = TypeHash::of_definition("diagnostic_msgs/msg/DiagnosticStatus", text);
    assert_eq!(status, TypeHash::of_message::<diagnostic_msgs::DiagnosticStatus>());
    // No fields; bounded strings count (both by rosbags 0.11.9).
    let empty = TypeHash::of_definition("std_msgs/msg/Empty", "");
    assert_eq!(empty.hash, "RIHS01_20b625256f32d5dbc0d04fee44f43c41e51c70d3502f84b4a08e7a9c26a96312");
    let bounded = TypeHash::of_definition("p/msg/T", "string<=8 a\nstring[<=3] b\nstring<=4[2] c\nint32[<=4] d\n");
    assert_eq!(bounded.hash, "RIHS01_1d14a360d4566080754169138a909b2676becf815eb9e4a34fa1cbea98ed0ba9");
}
