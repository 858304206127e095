//! The control thread: read, step, write. Between its start and its end it takes no lock, allocates nothing, and logs
//! nothing.

use crate::body_pose::BodyPoses;
use crate::dds_bus::DdsBus;
use crate::emergency_stop::EmergencyStop;
use crate::recording::CycleLog;
use crate::timing::{Durations, Timing};
use control::{
    Controller, FaultReport, GaitName, InertialState, Input, JOINTS, JointState, MAX_REQUESTS, Output, PreparedGait,
    Request, Velocity, VelocityCommand,
};
use joint_bus::{BusHealth, JointBus, Readings};
use realtime::{Periodic, RealtimeRequest, Warning, monotonic_now};
use ros::{Health, Pulse, Silence};
use rtrb::{Consumer, Producer};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::Thread;
use std::time::Duration;

/// An inertial measurement and when it came in, on the monotonic clock.
#[derive(Clone, Copy, Debug)]
pub struct TimedInertial {
    /// The measurement; the cycle says on its own clock when it came in.
    pub state: InertialState,
    /// When it came in.
    pub wall: Duration,
}

/// A velocity that is asked for and when it came in, on the monotonic clock.
#[derive(Clone, Copy, Debug)]
pub struct TimedVelocity {
    /// What is asked for.
    pub velocity: Velocity,
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

/// A cycle's output, to the publishers.
#[derive(Clone, Copy, Debug)]
pub struct CycleOutput {
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

/// An inertial state older than this says nothing about now.
const INERTIAL_MEMORY: Duration = Duration::from_millis(200);
/// Cycles between two reports on timing.
const TIMING_EVERY: u64 = 1000;
/// Lockstep looks at the end of the program this often.
const LOCKSTEP_PATIENCE: Duration = Duration::from_millis(20);

/// The cycle's watch over the threads through which the stop is received. It watches them itself, so that nothing else
/// has to run for the robot to be damped when they do not.
pub struct Middleware {
    /// The node's.
    pub health: Health,
    /// Longest silence of the middleware's threads; none in lockstep, where the node's own watch has to do.
    pub timeout: Option<Duration>,
    /// This thread's own sign of life.
    pub pulse: Pulse,
    silence: Silence<2>,
}

impl Middleware {
    /// Nothing has failed. `period` is the cycle's.
    pub fn new(health: Health, timeout: Option<Duration>, period: Duration) -> Self {
        let pulse = health.watch();
        // What the cycle itself came late by is not the others' silence.
        Self { health, timeout, pulse, silence: Silence::new(2 * period) }
    }

    /// Whether the stop may not be received any more. Wait-free.
    fn has_failed(&mut self, wall: Duration) -> bool {
        self.pulse.beat();
        if let Some(timeout) = self.timeout {
            let [event_loop, workers] = self.silence.look(self.health.turns(), wall);
            if event_loop > timeout {
                self.health.fail(ros::Thread::EventLoop);
            } else if workers > timeout {
                self.health.fail(ros::Thread::Workers);
            }
        }
        self.health.has_failed()
    }
}

/// The cycle's ends of the buffers, and what it runs.
pub struct Cycle {
    /// The controller.
    pub controller: Controller,
    /// What the inertial unit reports, in.
    pub inertial: Consumer<TimedInertial>,
    /// Velocities that are asked for, in.
    pub velocities: Consumer<TimedVelocity>,
    /// Poses of the body in.
    pub body_poses: BodyPoses,
    /// Requests in.
    pub asked: Consumer<Asked>,
    /// Gaits in, numbered from 1.
    pub gaits: Consumer<(u64, PreparedGait)>,
    /// The emergency stop.
    pub emergency_stop: Arc<EmergencyStop>,
    /// Whether the middleware lives.
    pub middleware: Middleware,
    /// The end of the program.
    pub stop: Arc<AtomicBool>,
    /// Outputs out.
    pub outputs: Producer<CycleOutput>,
    /// What is recorded.
    pub cycle_log: CycleLog,
    /// To be woken when there is an output.
    pub publishers: Thread,
    /// In a simulation that puts the robot on the gait: start there as soon as there is a gait and a state.
    pub start_on_gait: bool,
}

impl Cycle {
    /// One step on `state` at time `now`, with everything that was asked meanwhile.
    ///
    /// An arm request, and what was asked after it, waits while `measured` says that joints are yet to answer.
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
        while count < MAX_REQUESTS && !(measured.awaits_answers && self.arm_is_next()) {
            let Ok(asked) = self.asked.pop() else { break };
            (requests[count], ids[count]) = (asked.request, asked.id);
            count += 1;
        }
        while let Ok(newer) = self.inertial.pop() {
            if memory.reads_unit {
                continue;
            }
            // The cycle that takes it is when it came in: on the cycle's own clock, whichever that is.
            let state = InertialState { arrived: now, ..newer.state };
            memory.inertial = Some(TimedInertial { state, ..newer });
        }
        if let Some(state) = measured.inertial {
            (memory.inertial, memory.reads_unit) = (Some(TimedInertial { state, wall }), true);
        }
        while let Ok(newer) = self.velocities.pop() {
            memory.velocity = Some(memory.command(newer, now, wall));
        }
        let inertial = memory
            .inertial
            // In lockstep time may stand still.
            .filter(|unit| memory.age(unit, now, wall) < INERTIAL_MEMORY)
            .map(|unit| unit.state.to_resolution());
        let state = state.map(|state| state.to_resolution());
        let input = Input {
            joints: state.as_ref(),
            inertial,
            velocity: memory.velocity,
            body_pose: self.body_poses.newest(wall, memory.lockstep),
            requests: &requests[..count],
            gait: gait.as_ref(),
            // Each is asked: a press that one cycle has seen is not kept for the next.
            emergency_stop: self.emergency_stop.is_pressed(wall) | self.middleware.has_failed(wall) | stop,
            fault: measured.fault,
        };
        self.cycle_log.begin_cycle(&self.controller);
        let output = self.controller.step(&input, now);
        self.cycle_log.end_cycle(now, &input, gait_number, measured.effort_nm, &output);
        memory.compute.record(monotonic_now().saturating_sub(wall));
        let timing = output.cycles.is_multiple_of(TIMING_EVERY).then(|| memory.timing());
        self.send(CycleOutput {
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

    fn arm_is_next(&mut self) -> bool {
        self.asked.peek().is_ok_and(|asked| asked.request == Request::Arm)
    }

    /// A full buffer means that the publishers have stalled; what they miss are outputs that are too old already.
    fn send(&mut self, output: CycleOutput) {
        if self.outputs.push(output).is_ok() {
            self.publishers.unpark();
        }
    }

    /// Runs on the wall clock until the end of the program: read, step, write. The last command is damping; after it
    /// the drives' own watchdogs damp.
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
            let awaits_answers = self.arm_is_next() && !bus.prepare_to_arm(&readings, now);
            let measured = Measured {
                awaits_answers,
                state: state.as_ref(),
                effort_nm: readings.torque_reported.then_some(readings.torque_nm),
                inertial: bus.read_inertial(now),
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

    /// Runs on the stamps of the joint states until the end of the program: one step for each new stamp, none for a
    /// stamp that was answered before, which gets the same answer again. What is asked between two stamps is applied at
    /// the second, so that a run is the same to the bit however its processes are scheduled.
    pub fn run_lockstep(mut self, mut bus: DdsBus) {
        let mut memory = Memory { lockstep: true, ..Memory::default() };
        let mut readings = Readings::default();
        let mut last: Option<Duration> = None;
        loop {
            let mut idle = true;
            while let Some(stamp) = bus.take_one() {
                idle = false;
                if last == Some(stamp) {
                    bus.repeat();
                    self.publishers.unpark();
                    continue;
                }
                last = Some(stamp);
                bus.read(stamp, &mut readings);
                let state = readings.joint_state();
                let effort_nm = readings.torque_reported.then_some(readings.torque_nm);
                let fault = bus.fault(stamp);
                let (state, readings) = (state.as_ref(), Some(readings));
                let measured = Measured { state, effort_nm, fault, readings, ..Measured::default() };
                let output = self.step(&mut memory, &measured, stamp, monotonic_now(), false);
                bus.write(&output.command, output.drives_on, stamp);
                self.publishers.unpark();
            }
            if self.stop.load(Ordering::Acquire) {
                if let Some(now) = last {
                    let output = self.step(&mut memory, &Measured::default(), now, monotonic_now(), true);
                    bus.write(&output.command, output.drives_on, now);
                }
                return;
            }
            if idle {
                self.middleware.pulse.beat();
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
    /// A new measurement of the unit that the cycle reads itself.
    inertial: Option<InertialState>,
    fault: Option<FaultReport>,
    readings: Option<Readings>,
    bus: Option<BusHealth>,
    awaits_answers: bool,
}

/// What the loop remembers besides the controller.
#[derive(Default)]
struct Memory {
    inertial: Option<TimedInertial>,
    /// It came from a unit that the cycle reads itself: no topic takes that one's place when it falls silent.
    reads_unit: bool,
    /// The newest velocity that was asked for.
    velocity: Option<VelocityCommand>,
    lockstep: bool,
    latency: Durations,
    compute: Durations,
    missed_cycles: u64,
}

impl Memory {
    /// A velocity that waited for its cycle is as old as that: none from before the cycle ran is new to it.
    fn command(&self, received: TimedVelocity, now: Duration, wall: Duration) -> VelocityCommand {
        // In lockstep time may stand still.
        let age = if self.lockstep { Duration::ZERO } else { wall.saturating_sub(received.wall) };
        VelocityCommand { velocity: received.velocity, arrived: now.saturating_sub(age) }
    }

    fn age(&self, unit: &TimedInertial, now: Duration, wall: Duration) -> Duration {
        if self.lockstep { now.saturating_sub(unit.state.arrived) } else { wall.saturating_sub(unit.wall) }
    }

    fn timing(&mut self) -> Timing {
        let (latency, recent_latency) = self.latency.report();
        let (compute, recent_compute) = self.compute.report();
        Timing { latency, recent_latency, compute, recent_compute }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_velocity_that_waited_while_no_cycle_ran_is_not_walked() {
        let velocity = Velocity { forward_m_s: 0.3, ..Velocity::default() };
        let received = TimedVelocity { velocity, wall: Duration::from_secs(100) };
        // The cycle's clock is another than the machine's.
        let at = |waited: Duration, lockstep: bool| {
            let memory = Memory { lockstep, ..Memory::default() };
            memory.command(received, Duration::from_secs(7), received.wall + waited).at(Duration::from_secs(7), 0.5)
        };
        assert_eq!(at(Duration::from_millis(400), false), velocity);
        assert_eq!(at(Duration::from_millis(600), false), Velocity::default());
        assert_eq!(at(Duration::from_secs(60), false), Velocity::default());
        assert_eq!(at(Duration::from_secs(60), true), velocity);
    }
}
