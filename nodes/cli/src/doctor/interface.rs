//! What the kernel reports of a CAN interface.

use super::{Finding, Verdict, failure, good, warning};
use joint_bus::ProtocolName;
use std::process::Command;

/// How an interface ought to be.
pub struct Expected {
    pub protocol: ProtocolName,
    /// bit/s.
    pub bit_rate: u32,
    /// bit/s, of CAN FD's data phase.
    pub data_bit_rate: u32,
}

/// How it is. None: its driver does not say; a virtual interface has no bit rate and no state.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Facts {
    up: bool,
    carries_fd: bool,
    /// Made of nothing but software (`vcan`).
    is_virtual: bool,
    bit_rate: Option<u64>,
    data_bit_rate: Option<u64>,
    /// `ERROR-ACTIVE`, `BUS-OFF` and so on.
    state: Option<String>,
    restart_ms: Option<u64>,
    queue_length: Option<u64>,
}

/// What came of asking.
#[derive(Clone, Debug, PartialEq)]
pub enum Asked {
    /// There is no such interface.
    NotThere,
    /// There is one of another kind.
    NotCan,
    /// Bit rate and state could not be asked for: why.
    Half(Facts, String),
    /// Everything.
    Whole(Facts),
}

/// Asks the kernel, for bit rate and state by way of iproute2's `ip`. Needs no rights.
pub fn ask(name: &str) -> Asked {
    let attribute = |what: &str| {
        std::fs::read_to_string(format!("/sys/class/net/{name}/{what}")).map(|text| text.trim().to_owned()).ok()
    };
    let Some(kind) = attribute("type") else { return Asked::NotThere };
    // ARPHRD_CAN in linux/if_arp.h
    if kind != "280" {
        return Asked::NotCan;
    }
    let flags = attribute("flags").and_then(|text| u32::from_str_radix(text.trim_start_matches("0x"), 16).ok());
    let facts = Facts {
        // IFF_UP
        up: flags.is_some_and(|flags| flags & 1 != 0),
        // CANFD_MTU
        carries_fd: attribute("mtu").as_deref() == Some("72"),
        queue_length: attribute("tx_queue_len").and_then(|text| text.parse().ok()),
        ..Facts::default()
    };
    let output = Command::new("ip").args(["-json", "-details", "link", "show", "dev", name]).output();
    match output {
        Err(error) => Asked::Half(facts, format!("`ip` does not run: {error}")),
        Ok(output) => match details(&facts, &String::from_utf8_lossy(&output.stdout)) {
            Some(whole) => Asked::Whole(whole),
            None => Asked::Half(facts, format!("`ip -json` fails: {}", output.status)),
        },
    }
}

/// What `ip -json -details link show` adds to the facts.
fn details(facts: &Facts, json: &str) -> Option<Facts> {
    let links: serde_json::Value = serde_json::from_str(json).ok()?;
    let info = links.get(0)?.get("linkinfo")?;
    let data = &info["info_data"];
    Some(Facts {
        is_virtual: info["info_kind"] == "vcan",
        bit_rate: data["bittiming"]["bitrate"].as_u64(),
        data_bit_rate: data["data_bittiming"]["bitrate"].as_u64(),
        state: data["state"].as_str().map(str::to_owned),
        // `ip` says nothing of a chip that is never restarted.
        restart_ms: Some(data["restart_ms"].as_u64().unwrap_or(0)),
        ..facts.clone()
    })
}

/// What follows from it.
pub fn findings(name: &str, asked: &Asked, expected: &Expected) -> Vec<Finding> {
    let bring_up = format!(
        "ip link set {name} down; ip link set {name} type can bitrate {} restart-ms 100; ip link set {name} txqueuelen 64 up \
         (docs/hardware.md)",
        expected.bit_rate
    );
    match asked {
        Asked::NotThere => vec![failure(
            format!("{name} is not there"),
            format!("plug it in, load its driver (modprobe), and bring it up: {bring_up}"),
        )],
        Asked::NotCan => {
            vec![failure(format!("{name} is no CAN interface"), "name the CAN interfaces in the wiring file")]
        }
        Asked::Half(facts, why) => {
            let mut found =
                vec![warning(format!("bit rate and state of {name} are not known: {why}"), "apt-get install iproute2")];
            if !facts.up {
                found.push(failure(format!("{name} is down"), bring_up));
            }
            found
        }
        Asked::Whole(facts) => whole(name, facts, expected, &bring_up),
    }
}

fn whole(name: &str, facts: &Facts, expected: &Expected, bring_up: &str) -> Vec<Finding> {
    let mut found = Vec::new();
    if !facts.up {
        found.push(failure(format!("{name} is down"), bring_up));
    }
    if expected.protocol.uses_can_fd() {
        let cure = format!("add to its bit rate: dbitrate {} fd on", expected.data_bit_rate);
        if !facts.carries_fd {
            found.push(failure(format!("{name} carries no CAN FD frames, which these drives speak"), &cure));
        } else if let Some(rate) = facts.data_bit_rate.filter(|rate| *rate != u64::from(expected.data_bit_rate)) {
            found.push(failure(
                format!("{name} sends data at {rate} bit/s, expected {}", expected.data_bit_rate),
                &cure,
            ));
        }
    }
    if facts.is_virtual {
        found.push(warning(format!("{name} is a virtual interface"), "fine for emulated drives; no robot hangs on it"));
        return found;
    }
    match facts.bit_rate {
        Some(rate) if rate == u64::from(expected.bit_rate) => {}
        Some(rate) => {
            found.push(failure(format!("{name} runs at {rate} bit/s, expected {}", expected.bit_rate), bring_up))
        }
        None => found.push(failure(format!("{name} has no bit rate"), bring_up)),
    }
    match facts.state.as_deref() {
        None | Some("ERROR-ACTIVE") => {}
        Some(state @ ("ERROR-WARNING" | "ERROR-PASSIVE")) => found.push(failure(
            format!("{name} is {state}: errors pile up on the bus"),
            "look at the wiring, at 120 ohms at both ends, and that all drives are powered and have this bit rate",
        )),
        // A stopped one is down, and has been reported.
        Some("STOPPED") if !facts.up => {}
        Some(state) => found.push(failure(format!("{name} is {state}"), bring_up)),
    }
    if facts.restart_ms == Some(0) {
        found.push(failure(
            format!("{name} stays off the bus after bus-off"),
            format!("ip link set {name} down; ip link set {name} type can restart-ms 100; ip link set {name} up"),
        ));
    }
    if let Some(length) = facts.queue_length.filter(|length| !(10..=256).contains(length)) {
        found.push(warning(
            format!("{name} queues {length} frames, expected 10 to 256: some cycles' worth, but not old commands"),
            format!("ip link set {name} txqueuelen 64"),
        ));
    }
    if found.iter().all(|finding| finding.verdict == Verdict::Good) {
        found.push(good(format!("{name} is up, {} bit/s, no errors", expected.bit_rate)));
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    fn expected(protocol: ProtocolName) -> Expected {
        Expected { protocol, bit_rate: 1_000_000, data_bit_rate: 5_000_000 }
    }

    /// As iproute2 6.1 prints it, shortened.
    const SAID: &str = r#"[{"ifindex":3,"ifname":"can0","flags":["NOARP","UP","LOWER_UP","ECHO"],"mtu":16,"txqlen":64,
        "linkinfo":{"info_kind":"can","info_data":{"state":"ERROR-ACTIVE","restart_ms":100,
        "bittiming":{"bitrate":1000000,"sample_point":"0.750","tq":25},
        "data_bittiming":{"bitrate":5000000,"sample_point":"0.750"},"clock":80000000}}}]"#;

    fn half() -> Facts {
        Facts { up: true, carries_fd: true, queue_length: Some(64), ..Facts::default() }
    }

    fn healthy() -> Facts {
        details(&half(), SAID).unwrap()
    }

    #[test]
    fn what_ip_says_is_understood() {
        let facts = healthy();
        assert_eq!((facts.bit_rate, facts.data_bit_rate), (Some(1_000_000), Some(5_000_000)));
        assert_eq!(
            (facts.state.as_deref(), facts.restart_ms, facts.is_virtual),
            (Some("ERROR-ACTIVE"), Some(100), false)
        );
        let silent = details(&half(), &SAID.replace("\"restart_ms\":100,", "")).unwrap();
        assert_eq!(silent.restart_ms, Some(0));
        let software = r#"[{"ifname":"can0","linkinfo":{"info_kind":"vcan"}}]"#;
        assert!(details(&half(), software).unwrap().is_virtual);
        for nonsense in ["", "[]", "{}", "[{}]", "BusyBox v1.35"] {
            assert_eq!(details(&half(), nonsense), None, "{nonsense}");
        }
    }

    #[test]
    fn an_interface_in_order_is_good_for_both_protocols() {
        for protocol in [ProtocolName::Mit, ProtocolName::Registers] {
            let found = findings("can0", &Asked::Whole(healthy()), &expected(protocol));
            assert_eq!(found, [good("can0 is up, 1000000 bit/s, no errors")]);
        }
    }

    #[test]
    fn each_thing_wrong_with_an_interface_is_named_with_its_cure() {
        use ProtocolName::{Mit, Registers};
        use Verdict::{Failure, Warning};
        let whole = |change: &dyn Fn(&mut Facts)| {
            let mut facts = healthy();
            change(&mut facts);
            Asked::Whole(facts)
        };
        let state = |name: &'static str| whole(&|f| f.state = Some(name.into()));
        for (protocol, asked, what, cure, verdict) in [
            (Mit, ask("nocan7"), "can0 is not there", "modprobe", Failure),
            (Mit, ask("lo"), "no CAN interface", "wiring file", Failure),
            (Mit, Asked::Half(half(), "no ip".into()), "not known: no ip", "iproute2", Warning),
            (Mit, whole(&|f| f.up = false), "can0 is down", "txqueuelen 64 up", Failure),
            (Mit, whole(&|f| f.bit_rate = Some(500_000)), "500000 bit/s, expected 1000000", "bitrate 1000000", Failure),
            (Mit, whole(&|f| f.bit_rate = None), "has no bit rate", "bitrate 1000000", Failure),
            (Mit, state("BUS-OFF"), "BUS-OFF", "ip link set can0 down", Failure),
            (Mit, state("ERROR-PASSIVE"), "errors pile up", "120 ohms", Failure),
            (Mit, whole(&|f| f.restart_ms = Some(0)), "stays off", "restart-ms 100", Failure),
            (Mit, whole(&|f| f.queue_length = Some(1000)), "queues 1000", "txqueuelen 64", Warning),
            (Mit, whole(&|f| f.is_virtual = true), "virtual", "emulated", Warning),
            (Registers, whole(&|f| f.carries_fd = false), "no CAN FD", "fd on", Failure),
            (Registers, whole(&|f| f.data_bit_rate = Some(2_000_000)), "2000000 bit/s", "dbitrate 5000000", Failure),
        ] {
            let found = findings("can0", &asked, &expected(protocol));
            assert_eq!(found.len(), 1, "{found:?}");
            assert!(found[0].what.contains(what) && found[0].cure.contains(cure), "{found:?}");
            assert_eq!(found[0].verdict, verdict, "{found:?}");
        }
    }
}
