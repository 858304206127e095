//! The topics of a run, without their namespace, and the words for requests.

use control::{Fault, Request};

/// What the joints measured.
pub const JOINT_STATES: &str = "joint_states";
/// What was asked of the joints.
pub const JOINT_COMMAND: &str = "joint_command";
/// What a step saw besides.
pub const CONTROL_CYCLE: &str = "control_cycle";
/// Mode, fault, gait and place in it.
pub const CONTROLLER_STATE: &str = "controller_state";
/// A gait as its file says it.
pub const GAIT_FILE: &str = "gait_file";
/// The controller's configuration.
pub const CONTROLLER_CONFIG: &str = "controller_config";
/// The controller's memory, where a recording begins later than it.
pub const CONTROLLER_SNAPSHOT: &str = "controller_snapshot";
/// The URDF.
pub const ROBOT_DESCRIPTION: &str = "robot_description";
/// Where the base is.
pub const ODOM: &str = "odom";
/// Where the base truly is, where a simulation says so beside an estimate.
pub const GROUND_TRUTH: &str = "ground_truth/odom";
/// Forces on the toes, each below with its leg's name.
pub const GROUND_FORCE: &str = "ground_force";

/// The topic's own name, without the namespace that it was recorded under.
pub fn is(topic: &str, name: &str) -> bool {
    topic == name || topic.strip_suffix(name).is_some_and(|front| front.ends_with('/'))
}

const CLEAR_FAULT: &str = "clear_fault";

/// What a request is called in a recorded cycle.
pub fn request_word(request: &Request) -> String {
    match request {
        Request::ClearFault(fault) => format!("{CLEAR_FAULT} {}", fault.name()),
        other => {
            Request::NAMED.iter().find(|(_, plain)| plain == other).map_or(String::new(), |(word, _)| (*word).into())
        }
    }
}

/// The request of a word; none if there is none of that name.
pub fn request_of(word: &str) -> Option<Request> {
    if let Some(fault) = word.strip_prefix(CLEAR_FAULT) {
        return Fault::from_name(fault.trim_start()).map(Request::ClearFault);
    }
    Request::NAMED.iter().find(|(plain, _)| *plain == word).map(|(_, request)| *request)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_request_has_a_word_of_its_own() {
        let faults = Fault::ALL.into_iter().map(Request::ClearFault);
        for request in Request::NAMED.into_iter().map(|(_, request)| request).chain(faults) {
            assert_eq!(request_of(&request_word(&request)), Some(request));
        }
        assert_eq!(request_of("dance"), None);
        assert_eq!(request_of("clear_fault dance"), None);
    }

    #[test]
    fn a_topic_is_known_in_any_namespace() {
        assert!(is("joint_states", JOINT_STATES) && is("/spot/joint_states", JOINT_STATES));
        assert!(!is("/other_joint_states", JOINT_STATES));
    }
}
