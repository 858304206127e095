//! What a node reports at its start: who and where it is, and which settings of other middlewares it does not follow.

use std::collections::BTreeSet;
use std::sync::mpsc::Receiver;
use std::time::Duration;

use tandem_msgs::rcl_interfaces::Log;

use crate::arguments::{Arguments, DiscoveryRange};
use crate::logging;

/// What other middlewares read, and what it means that this one does not.
const NOT_FOLLOWED: [(&str, &str); 15] = [
    ("ROS_STATIC_PEERS", "others are found by multicast only"),
    ("ROS_DISCOVERY_SERVER", "nodes that only a discovery server knows are not met"),
    ("ROS_SUPER_CLIENT", "there is no discovery server for it"),
    ("FASTDDS_DEFAULT_PROFILES_FILE", PROFILES),
    ("FASTRTPS_DEFAULT_PROFILES_FILE", PROFILES),
    ("FASTDDS_BUILTIN_TRANSPORTS", "it speaks UDP over IPv4"),
    ("RMW_FASTRTPS_USE_QOS_FROM_XML", PROFILES),
    ("RMW_FASTRTPS_PUBLICATION_MODE", "publishing never waits"),
    ("CYCLONEDDS_URI", PROFILES),
    ("NDDS_QOS_PROFILES", PROFILES),
    ("RMW_CONNEXT_INITIAL_PEERS", "others are found by multicast only"),
    ("ZENOH_ROUTER_CONFIG_URI", ZENOH),
    ("ZENOH_SESSION_CONFIG_URI", ZENOH),
    ("ZENOH_CONFIG_OVERRIDE", ZENOH),
    ("ZENOH_ROUTER_CHECK_ATTEMPTS", ZENOH),
];

const PROFILES: &str =
    "it is for another middleware: qualities of service, networks and buffers are as they are without it";
const ZENOH: &str = "this node speaks DDS, not Zenoh";

/// Starts the log, and says in it what a person asks for first.
pub(crate) fn start(arguments: &Arguments, namespace: &str, name: &str) -> Option<Receiver<Log>> {
    let logger = [namespace.trim_matches('/').split('/').collect::<Vec<_>>().join("."), name.to_string()];
    let lines = logging::start(arguments, name, logger.join(".").trim_start_matches('.'));
    let reach = match arguments.range {
        DiscoveryRange::Subnet => "every network interface",
        DiscoveryRange::Localhost => "this machine only",
    };
    let space = if namespace == "/" { "" } else { namespace };
    let version = env!("CARGO_PKG_VERSION");
    tracing::info!("{space}/{name} starts: Tandem {version}, domain {}, {reach}", arguments.domain_id);
    // What is not Unicode is set all the same.
    for line in not_followed(|variable| Some(std::env::var_os(variable)?.to_string_lossy().into_owned())) {
        tracing::warn!("{line}");
    }
    if lines.is_some() && arguments.range == DiscoveryRange::Subnet {
        watch_interfaces();
    }
    lines
}

/// How often it is looked for new network interfaces.
const INTERFACES_PERIOD: Duration = Duration::from_secs(2);

/// The middleware uses an interface that comes up later too, from its next announcement on; the log names it,
/// until the process ends. Without the list, or a thread, nobody is.
fn watch_interfaces() {
    let routes = || std::fs::read_to_string("/proc/net/route").map(|table| interfaces(&table));
    let Ok(mut known) = routes() else { return };
    let watch = move || {
        loop {
            std::thread::sleep(INTERFACES_PERIOD);
            for name in routes().unwrap_or_default() {
                if known.insert(name.clone()) {
                    tracing::info!("the network interface {name} came up after the start, and is used from now on");
                }
            }
        }
    };
    if let Err(error) = std::thread::Builder::new().name("interfaces".into()).spawn(watch) {
        tracing::warn!("nobody watches for new network interfaces: {error}");
    }
}

/// Those with an IPv4 address: the first column of the kernel's table of routes, below its head.
fn interfaces(table: &str) -> BTreeSet<String> {
    table.lines().skip(1).filter_map(|line| line.split_whitespace().next()).map(String::from).collect()
}

/// A line for each setting that is made and not followed.
fn not_followed(environment: impl Fn(&str) -> Option<String>) -> Vec<String> {
    let set = |variable: &str| environment(variable).filter(|value| !value.is_empty());
    let mut lines = Vec::new();
    if let Some(value) = set("RMW_IMPLEMENTATION") {
        // Theirs is the wire protocol that is spoken here.
        let dds = ["rmw_fastrtps_cpp", "rmw_fastrtps_dynamic_cpp", "rmw_cyclonedds_cpp", "rmw_connextdds"];
        let meaning = if dds.contains(&value.as_str()) {
            "this node has a DDS of its own and meets nodes with that one"
        } else {
            "this node has a DDS of its own, and nodes with another protocol are not met"
        };
        lines.push(format!("RMW_IMPLEMENTATION={value} is not followed: {meaning}"));
    }
    for (variable, meaning) in NOT_FOLLOWED {
        if let Some(value) = set(variable) {
            lines.push(format!("{variable}={value} is not followed: {meaning}"));
        }
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn interfaces_are_those_with_a_route() {
        let table =
            "Iface\tDestination\tGateway\neth0\t00000000\t0101A8C0\neth0\t0001A8C0\t00000000\nwlan0\t0002A8C0\t0\n";
        assert_eq!(interfaces(table), BTreeSet::from(["eth0".to_owned(), "wlan0".to_owned()]));
        assert!(interfaces("").is_empty());
    }

    #[test]
    fn settings_that_are_not_followed_are_named_one_line_each() {
        let given = |name: &str, value: &str| {
            let (name, value) = (name.to_owned(), value.to_owned());
            not_followed(move |asked| (asked == name).then(|| value.clone()))
        };
        let zenoh = given("RMW_IMPLEMENTATION", "rmw_zenoh_cpp");
        assert!(zenoh.len() == 1 && zenoh[0].contains("rmw_zenoh_cpp") && zenoh[0].contains("not met"), "{zenoh:?}");
        let fast = given("RMW_IMPLEMENTATION", "rmw_fastrtps_cpp");
        assert!(fast.len() == 1 && fast[0].contains("meets nodes"), "{fast:?}");
        for (variable, _) in NOT_FOLLOWED {
            let lines = given(variable, "some");
            assert!(lines.len() == 1 && lines[0].starts_with(&format!("{variable}=some is not followed")), "{lines:?}");
            assert!(given(variable, "").is_empty(), "{variable}");
        }
        assert!(given("ROS_DOMAIN_ID", "3").is_empty());
    }
}
