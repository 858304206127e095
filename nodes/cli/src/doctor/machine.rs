//! What the doctor looks at on the computer itself.

use super::{Finding, failure, good, warning};
use joint_bus::BusConfig;
use realtime::{Histogram, Wake, Warning, monotonic_now};
use robot::Robot;
use std::time::{Duration, SystemTime};

/// Lateness of the loop that is no matter of concern.
const PUNCTUAL: Duration = Duration::from_micros(300);

fn read(path: &str) -> Option<String> {
    std::fs::read_to_string(path).ok().map(|text| text.trim().to_owned())
}

/// Of what, in which version, the robot's software is made.
pub fn versions(robot: &Robot, bus: &BusConfig) -> Vec<Finding> {
    let mut found = vec![good(format!(
        "tandem {}; robot {}; wiring of {} with {:?} frames{}",
        env!("CARGO_PKG_VERSION"),
        robot.name,
        bus.robot,
        bus.protocol,
        if bus.protocol == joint_bus::ProtocolName::Mit {
            ", which carry no firmware version: compare the drives' by hand"
        } else {
            ""
        },
    ))];
    let release = read("/proc/sys/kernel/osrelease").unwrap_or_else(|| "of unknown release".into());
    found.push(kernel(&release, read("/sys/kernel/realtime").as_deref() == Some("1")));
    if let Some(governor) = read("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor") {
        found.push(if governor == "performance" {
            good("the processors keep their frequency")
        } else {
            warning(
                format!("the processors change their frequency (governor {governor}): cycles come late after rest"),
                "cpupower frequency-set -g performance",
            )
        });
    }
    found
}

fn kernel(release: &str, preemptible: bool) -> Finding {
    if preemptible {
        good(format!("Linux {release}, PREEMPT_RT"))
    } else {
        warning(
            format!("Linux {release} without PREEMPT_RT: a cycle may come some milliseconds late"),
            "on Debian: apt-get install linux-image-rt-amd64, and boot it",
        )
    }
}

/// What was read of the clocks.
pub struct ClockFacts {
    source: Option<String>,
    resolution: Duration,
    backwards: bool,
    wall: Duration,
}

/// No computer that runs this has an earlier clock: 2026-01-01, s since 1970.
const BEFORE_THIS_PROGRAM: u64 = 1_767_225_600;

impl ClockFacts {
    pub fn gather() -> Self {
        let mut last = monotonic_now();
        let (mut resolution, mut backwards) = (Duration::MAX, false);
        for _ in 0..100_000 {
            let now = monotonic_now();
            match now.checked_sub(last) {
                None => backwards = true,
                Some(step) if !step.is_zero() => resolution = resolution.min(step),
                Some(_) => {}
            }
            last = now;
        }
        Self {
            source: read("/sys/devices/system/clocksource/clocksource0/current_clocksource"),
            resolution,
            backwards,
            wall: SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default(),
        }
    }
}

/// The clocks: the loop lives on the monotonic one, bags and messages are stamped with the wall clock.
pub fn clocks(facts: &ClockFacts) -> Vec<Finding> {
    let source = facts.source.as_deref().unwrap_or("unknown");
    let mut found = Vec::new();
    if facts.backwards {
        found.push(failure(
            format!("the monotonic clock (source {source}) goes backwards"),
            "boot with clocksource=hpet; a machine with such a processor must not drive a robot",
        ));
    }
    if facts.resolution > Duration::from_micros(20) {
        found.push(failure(
            format!("the monotonic clock (source {source}) ticks only every {:?}", facts.resolution),
            "boot with clocksource=tsc, or in a virtual machine with the host's clock (kvm-clock)",
        ));
    }
    if facts.wall.as_secs() < BEFORE_THIS_PROGRAM {
        found.push(warning(
            "the wall clock stands before this program was written: records will have wrong dates",
            "timedatectl set-ntp true, or date -s",
        ));
    }
    if found.is_empty() {
        found.push(good(format!("clocks: source {source}, ticks of {:?} or less", facts.resolution)));
    }
    found
}

/// Real-time rights, as the system granted or refused them.
pub fn rights(refused: &[Warning], priority: u8) -> Vec<Finding> {
    if refused.is_empty() {
        return vec![good(format!("real-time rights: SCHED_FIFO {priority}, locked memory"))];
    }
    refused
        .iter()
        .map(|refusal| {
            let text = refusal.to_string();
            // A refusal says what, why, what comes of it, and what to grant, in this order.
            match text.find(". Grant ") {
                Some(at) => failure(&text[..at], &text[at + 2..]),
                None => failure(text, "docs/hardware.md, real-time rights"),
            }
        })
        .collect()
}

/// How punctual the loop is while the drives are asked.
#[derive(Default)]
pub struct LoopTiming {
    lateness: Histogram,
    missed: u64,
}

impl LoopTiming {
    pub fn record(&mut self, wake: &Wake) {
        self.lateness.record(wake.latency());
        self.missed += wake.missed;
    }

    pub fn finding(&self) -> Finding {
        let us = |d: Duration| d.as_secs_f64() * 1e6;
        let (p99, max) = (self.lateness.quantile(0.99), self.lateness.max());
        let what = format!(
            "1 kHz loop: {} cycles, {} missed, late by {:.0} us (99 of 100), {:.0} us at most",
            self.lateness.count(),
            self.missed,
            us(p99),
            us(max)
        );
        let cure = "leave a processor to the control thread (isolcpus, core:=N), stop other work, use PREEMPT_RT: docs/hardware.md";
        if self.missed * 100 > self.lateness.count() || max > Duration::from_millis(8) {
            failure(what, cure)
        } else if self.missed > 0 || p99 > PUNCTUAL {
            warning(what, cure)
        } else {
            good(what)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::Verdict;
    use super::*;
    use std::io;

    #[test]
    fn a_kernel_without_preempt_rt_is_a_warning() {
        assert_eq!(kernel("6.1.0-rt", true).verdict, Verdict::Good);
        let found = kernel("6.1.0", false);
        assert_eq!(found.verdict, Verdict::Warning);
        assert!(found.cure.contains("linux-image-rt"));
    }

    #[test]
    fn this_machine_has_a_clock() {
        assert!(ClockFacts::gather().resolution < Duration::from_millis(1));
    }

    #[test]
    fn bad_clocks_are_distinguished() {
        let well = || ClockFacts {
            source: Some("tsc".into()),
            resolution: Duration::from_nanos(30),
            backwards: false,
            wall: Duration::from_secs(2_000_000_000),
        };
        assert_eq!(clocks(&well())[0].verdict, Verdict::Good);
        for (facts, verdict, what) in [
            (ClockFacts { backwards: true, ..well() }, Verdict::Failure, "backwards"),
            (ClockFacts { resolution: Duration::from_millis(4), ..well() }, Verdict::Failure, "4ms"),
            (ClockFacts { wall: Duration::ZERO, ..well() }, Verdict::Warning, "wall clock"),
        ] {
            let found = clocks(&facts);
            assert_eq!((found.len(), found[0].verdict), (1, verdict));
            assert!(found[0].what.contains(what) && !found[0].cure.is_empty(), "{found:?}");
        }
    }

    #[test]
    fn refused_rights_come_with_what_to_grant() {
        assert_eq!(rights(&[], 80)[0].verdict, Verdict::Good);
        let refusal = |source| Warning::Scheduling { priority: 80, source };
        let found = rights(&[refusal(io::Error::from_raw_os_error(1))], 80);
        assert_eq!(found[0].verdict, Verdict::Failure);
        assert!(found[0].what.contains("SCHED_FIFO 80") && found[0].cure.contains("rtprio 80"), "{found:?}");
    }

    #[test]
    fn lateness_is_a_warning_and_missed_cycles_a_failure() {
        let pace = |late: Duration, missed| {
            let mut pace = LoopTiming::default();
            for n in 0..1000 {
                let due = Duration::from_millis(n);
                pace.record(&Wake { due, at: due + late, missed: if n == 500 { missed } else { 0 } });
            }
            pace.finding().verdict
        };
        assert_eq!(pace(Duration::from_micros(50), 0), Verdict::Good);
        assert_eq!(pace(Duration::from_micros(600), 0), Verdict::Warning);
        assert_eq!(pace(Duration::from_micros(50), 1), Verdict::Warning);
        assert_eq!(pace(Duration::from_micros(50), 20), Verdict::Failure);
    }
}
