//! The control thread: read, step, write. Between its start and its end it takes no lock, allocates nothing, and logs nothing.

use crate::dds_bus::DdsBus;
use crate::tape::Tape;
use control::{
    Controller, Fault, FaultReport, GaitName, Input, JOINTS, JointState, MAX_REQUESTS, Output, PreparedGait, Request,
    Tilt,
};
use joint_bus::{BusHealth, JointBus, Readings};
use realtime::{Histogram, Periodic, RealtimeRequest, Warning, monotonic_now};
use rtrb::{Consumer, Producer};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::Thread;
use std::time::Duration;

/// An attitude and when it came in, on the monotonic clock.
#[derive(Clone, Copy, Debug)]
pub struct TimedTilt {
    /// The attitude.
    pub tilt: Tilt,
    /// When it came in.
    pub wall: Duration,
}

/// A request and the number under which its reply is waited for.
#[derive(Clone, Copy, Debug)]
pub struct Asked {
    /// The number.
    pub id: u64,
    /// The request.
    pub request: Request,
}

/// What the cycle says to the press.
#[derive(Clone, Copy, Debug)]
pub struct Said {
    /// The controller's output.
    pub output: Output,
    /// Numbers of the requests that the output's replies answer.
    pub ids: [u64; MAX_REQUESTS],
    /// The loaded gait.
    pub gait: Option<GaitName>,
    /// Cycles that were missed so far.
    pub missed_cycles: u64,
    /// Once a second: how the loop keeps its time.
    pub timing: Option<Timing>,
    /// What was read from the drives, where the cycle itself reads them.
    pub readings: Option<Readings>,
    /// Once a second, where the cycle itself reads the drives: how the buses are.
    pub bus: Option<BusHealth>,
}

/// How the loop kept its time: median, 99th percentile and maximum.
#[derive(Clone, Copy, Debug, Default)]
pub struct Timing {
    /// Lateness of wakes since it began.
    pub latency: [Duration; 3],
    /// Lateness of wakes since the report before.
    pub recent_latency: [Duration; 3],
    /// Computing time of a cycle since it began.
    pub compute: [Duration; 3],
    /// Computing time of a cycle since the report before.
    pub recent_compute: [Duration; 3],
}

/// The emergency stop's level. Pressed by the service, by the topic, by the topic's silence, or because the node is not active.
#[derive(Debug, Default)]
pub struct EmergencyStop {
    inactive: AtomicBool,
    service: AtomicBool,
    topic: AtomicBool,
    /// Monotonic time of the last message on the topic, ns.
    heard_ns: AtomicU64,
    /// Longest silence, ns; 0: silence means nothing.
    heartbeat_ns: u64,
}

impl EmergencyStop {
    /// Released. With a heartbeat, pressed until the topic is heard.
    pub fn new(heartbeat: Option<Duration>) -> Self {
        Self { heartbeat_ns: heartbeat.map_or(0, |d| d.as_nanos() as u64), ..Self::default() }
    }

    /// The node became active, or is no longer.
    pub fn set_active(&self, active: bool) {
        self.inactive.store(!active, Ordering::Release);
    }

    /// Whether the node is active.
    pub fn is_active(&self) -> bool {
        !self.inactive.load(Ordering::Acquire)
    }

    /// The service was called.
    pub fn set_by_service(&self, pressed: bool) {
        self.service.store(pressed, Ordering::Release);
    }

    /// The topic was heard.
    pub fn set_by_topic(&self, pressed: bool, wall: Duration) {
        self.topic.store(pressed, Ordering::Release);
        self.heard_ns.store(wall.as_nanos() as u64, Ordering::Release);
    }

    fn is_pressed(&self, wall: Duration) -> bool {
        let silent = self.heartbeat_ns > 0 && {
            let heard = self.heard_ns.load(Ordering::Acquire);
            heard == 0 || (wall.as_nanos() as u64).saturating_sub(heard) > self.heartbeat_ns
        };
        !self.is_active() || self.service.load(Ordering::Acquire) || self.topic.load(Ordering::Acquire) || silent
    }
}

/// An attitude older than this says nothing about now.
const TILT_MEMORY: Duration = Duration::from_millis(200);
/// Cycles between two reports on timing.
const TIMING_EVERY: u64 = 1000;
/// Lockstep looks at the end of the program this often.
const LOCKSTEP_PATIENCE: Duration = Duration::from_millis(20);

/// The cycle's ends of the buffers, and what it runs.
pub struct Cycle {
    /// The controller.
    pub controller: Controller,
    /// Attitudes in.
    pub tilts: Consumer<TimedTilt>,
    /// Requests in.
    pub asked: Consumer<Asked>,
    /// Gaits in, numbered from 1.
    pub gaits: Consumer<(u64, PreparedGait)>,
    /// The emergency stop.
    pub emergency_stop: Arc<EmergencyStop>,
    /// Whether another program commands the robot over topics.
    pub second_controller: Arc<AtomicBool>,
    /// The end of the program.
    pub stop: Arc<AtomicBool>,
    /// Outputs out.
    pub said: Producer<Said>,
    /// What is recorded.
    pub tape: Tape,
    /// To be woken when there is an output.
    pub press: Thread,
    /// In a simulation that puts the robot on the gait: start there as soon as there is a gait and a state.
    pub start_on_gait: bool,
}

impl Cycle {
    /// One step on `state` at time `now`, with everything that was asked meanwhile.
    fn step(&mut self, memory: &mut Memory, measured: &Measured, now: Duration, wall: Duration, stop: bool) -> Output {
        let state = measured.state;
        let mut requests = [Request::Stop; MAX_REQUESTS];
        let mut ids = [0; MAX_REQUESTS];
        let mut count = 0;
        let (mut gait, mut gait_number) = (None, 0);
        while let Ok((number, newer)) = self.gaits.pop() {
            (gait, gait_number) = (Some(newer), number);
        }
        if self.start_on_gait && state.is_some() && (gait.is_some() || self.controller.gait().is_some()) {
            self.start_on_gait = false;
            requests[0] = Request::StartOnGait;
            count = 1;
        }
        while count < MAX_REQUESTS {
            let Ok(asked) = self.asked.pop() else { break };
            (requests[count], ids[count]) = (asked.request, asked.id);
            count += 1;
        }
        while let Ok(newer) = self.tilts.pop() {
            memory.tilt = Some(newer);
        }
        let tilt = memory.tilt.filter(|t| wall.saturating_sub(t.wall) < TILT_MEMORY).map(|t| t.tilt.to_resolution());
        let state = state.map(|state| state.to_resolution());
        let input = Input {
            joints: state.as_ref(),
            tilt,
            requests: &requests[..count],
            gait: gait.as_ref(),
            emergency_stop: stop || self.emergency_stop.is_pressed(wall),
            fault: measured.fault.or_else(|| self.second_controller()),
        };
        self.tape.begin_cycle(&self.controller);
        let output = self.controller.step(&input, now);
        self.tape.end_cycle(now, &input, gait_number, measured.effort_nm, &output);
        memory.compute.record(monotonic_now().saturating_sub(wall));
        let timing = output.cycles.is_multiple_of(TIMING_EVERY).then(|| memory.timing());
        self.say(Said {
            output,
            ids,
            gait: self.controller.gait().map(PreparedGait::name),
            missed_cycles: memory.missed_cycles,
            timing,
            readings: measured.readings,
            bus: timing.and(measured.bus),
        });
        output
    }

    fn second_controller(&self) -> Option<FaultReport> {
        self.second_controller.load(Ordering::Acquire).then_some(FaultReport {
            fault: Fault::SecondController,
            joint: None,
            value: 1.0,
            limit: 0.0,
        })
    }

    /// A full buffer means that the press has stalled; what it misses are outputs that are too old already.
    fn say(&mut self, said: Said) {
        if self.said.push(said).is_ok() {
            self.press.unpark();
        }
    }

    /// Runs on the wall clock until the end of the program: read, step, write. The last command is damping; after it the drives'
    /// own watchdogs damp.
    pub fn run_realtime(
        mut self,
        mut bus: impl JointBus,
        period: Duration,
        request: RealtimeRequest,
        warn: impl FnOnce(Vec<Warning>),
    ) {
        warn(request.apply());
        let mut memory = Memory::default();
        let mut readings = Readings::default();
        let mut periodic = Periodic::new(period);
        loop {
            let wake = periodic.wait();
            memory.latency.record(wake.latency());
            memory.missed_cycles += wake.missed;
            let wall = monotonic_now();
            let now = bus.now(wall);
            bus.read(now, &mut readings);
            let state = readings.joint_state();
            let stop = self.stop.load(Ordering::Acquire);
            let measured = Measured {
                state: state.as_ref(),
                effort_nm: readings.torque_told.then_some(readings.torque_nm),
                fault: bus.fault(now),
                readings: Some(readings),
                bus: Some(bus.health()),
            };
            let output = self.step(&mut memory, &measured, now, wall, stop);
            bus.write(&output.command, output.drives_on, now + monotonic_now().saturating_sub(wall));
            if stop {
                return;
            }
        }
    }

    /// Runs on the stamps of the joint states until the end of the program: one step for each new stamp, none for a stamp
    /// that was answered before, which gets the same answer again. What is asked between two stamps is applied at the
    /// second, so that a run is the same to the bit however its processes are scheduled.
    pub fn run_lockstep(mut self, mut bus: DdsBus) {
        let mut memory = Memory::default();
        let mut readings = Readings::default();
        let mut last: Option<Duration> = None;
        loop {
            let mut idle = true;
            while let Some(stamp) = bus.take_one() {
                idle = false;
                if last == Some(stamp) {
                    bus.repeat();
                    self.press.unpark();
                    continue;
                }
                last = Some(stamp);
                bus.read(stamp, &mut readings);
                let state = readings.joint_state();
                let effort_nm = readings.torque_told.then_some(readings.torque_nm);
                let measured = Measured { state: state.as_ref(), effort_nm, ..Measured::default() };
                let output = self.step(&mut memory, &measured, stamp, monotonic_now(), false);
                bus.write(&output.command, output.drives_on, stamp);
                self.press.unpark();
            }
            if self.stop.load(Ordering::Acquire) {
                if let Some(now) = last {
                    let output = self.step(&mut memory, &Measured::default(), now, monotonic_now(), true);
                    bus.write(&output.command, output.drives_on, now);
                }
                return;
            }
            if idle {
                std::thread::park_timeout(LOCKSTEP_PATIENCE);
            }
        }
    }
}

/// What one cycle has to go on.
#[derive(Clone, Copy, Default)]
struct Measured<'a> {
    state: Option<&'a JointState>,
    effort_nm: Option<[f64; JOINTS]>,
    fault: Option<FaultReport>,
    readings: Option<Readings>,
    bus: Option<BusHealth>,
}

/// What the loop remembers besides the controller.
#[derive(Default)]
struct Memory {
    tilt: Option<TimedTilt>,
    latency: Durations,
    compute: Durations,
    missed_cycles: u64,
}

impl Memory {
    fn timing(&mut self) -> Timing {
        let (latency, recent_latency) = self.latency.report();
        let (compute, recent_compute) = self.compute.report();
        Timing { latency, recent_latency, compute, recent_compute }
    }
}

/// Durations since the beginning, and since the last report.
#[derive(Default)]
struct Durations {
    all: Histogram,
    recent: Histogram,
}

impl Durations {
    fn record(&mut self, duration: Duration) {
        self.all.record(duration);
        self.recent.record(duration);
    }

    fn report(&mut self) -> ([Duration; 3], [Duration; 3]) {
        let of = |h: &Histogram| [h.quantile(0.5), h.quantile(0.99), h.max()];
        let report = (of(&self.all), of(&self.recent));
        self.recent.clear();
        report
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_recent_begins_anew_with_every_report() {
        let mut durations = Durations::default();
        durations.record(Duration::from_millis(3));
        let slow = [Duration::from_millis(3); 3];
        assert_eq!(durations.report(), (slow, slow));
        durations.record(Duration::from_millis(1));
        let (all, recent) = durations.report();
        assert_eq!((all[2], recent), (slow[0], [Duration::from_millis(1); 3]));
    }

    #[test]
    fn the_emergency_stop_is_pressed_by_any_of_its_ways() {
        let wall = Duration::from_secs(100);
        let stop = EmergencyStop::new(None);
        assert!(!stop.is_pressed(wall));
        stop.set_by_service(true);
        assert!(stop.is_pressed(wall));
        stop.set_by_service(false);
        stop.set_by_topic(true, wall);
        assert!(stop.is_pressed(wall));
        stop.set_by_topic(false, wall);
        assert!(!stop.is_pressed(wall + Duration::from_secs(1000)));
        stop.set_active(false);
        assert!(stop.is_pressed(wall));
        stop.set_active(true);
        assert!(!stop.is_pressed(wall));

        let stop = EmergencyStop::new(Some(Duration::from_millis(500)));
        assert!(stop.is_pressed(wall), "not heard yet");
        stop.set_by_topic(false, wall);
        assert!(!stop.is_pressed(wall + Duration::from_millis(400)));
        assert!(stop.is_pressed(wall + Duration::from_millis(600)), "silent");
    }
}
