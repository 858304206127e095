//! The controller on real SocketCAN interfaces against emulated drives; what `tests/can/run` runs in a virtual machine, where
//! `can0` to `can3` are virtual interfaces. Two threads, each at its own pace on the monotonic clock, that share nothing but the
//! buses. The robot is twelve flywheels behind their drives: what is tested is everything from the bus file to the kernel and back,
//! in closed loop, not balance.
//!
//!     can_walk SECONDS
//!
//! It stands up and walks for SECONDS; then error frames, bus-off and an interface that goes down are injected, each with a bound
//! on the cycles until the robot is damped. Any failure ends it with exit status 1.

#[path = "../tests/common/mod.rs"]
mod common;
#[path = "../../control/tests/common/mod.rs"]
mod walk;

use control::{Config, Controller, Fault, Input, JOINTS, Mode, Output, Posture, PreparedGait, Request};
use joint_bus::can::CanLink;
use joint_bus::{
    BusConfig, ContractBench, DriveBus, DriveModel, EmulatedDrive, Incoming, JointBus, Link, Mit, Protocol, Readings,
    Registers, check_contract,
};
use realtime::{Histogram, Periodic, monotonic_now};
use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicI64, Ordering};
use std::time::Duration;

type Failure = Box<dyn std::error::Error>;

fn main() {
    if let Err(failure) = run() {
        println!("can_walk: FAILED: {failure}");
        std::process::exit(1);
    }
    println!("can_walk: passed");
}

/// Emulated drives at the far end of real interfaces, for the contract of every backend.
struct ContractOnCan<P> {
    protocol: P,
    bus: DriveBus<P, CanLink>,
    config: BusConfig,
    far: Vec<CanLink>,
    drives: [EmulatedDrive; JOINTS],
    tolerance: (f64, f64),
}

impl<P: Protocol + Copy> ContractOnCan<P> {
    fn new(protocol: P, config: BusConfig, tolerance: (f64, f64)) -> Result<Self, Failure> {
        let open = || config.interfaces.iter().map(|name| CanLink::open(name)).collect::<Result<Vec<_>, _>>();
        Ok(Self {
            protocol,
            bus: DriveBus::new(config.clone(), protocol, open()?),
            far: open()?,
            drives: config.joints.each_ref().map(|j| EmulatedDrive::new(j.id, j.ranges, DriveModel::default())),
            config,
            tolerance,
        })
    }
}

impl<P: Protocol + Copy> ContractBench for ContractOnCan<P> {
    fn bus(&mut self) -> &mut dyn JointBus {
        &mut self.bus
    }

    fn act(&mut self, now: Duration, q: &[f64; JOINTS], v: &[f64; JOINTS], silent: Option<usize>) -> [f64; JOINTS] {
        let motor = |w: &joint_bus::JointWiring, j: usize| {
            (w.sign * w.gear_ratio * (q[j] - w.zero_rad), w.sign * w.gear_ratio * v[j])
        };
        // What was sent goes through the kernel's queues.
        std::thread::sleep(Duration::from_micros(300));
        for (n, link) in self.far.iter_mut().enumerate() {
            while let Some(incoming) = link.receive(now).expect("the interface is up") {
                let Incoming::Frame(frame, _) = incoming else { continue };
                for j in (0..JOINTS).filter(|j| self.config.joints[*j].interface == n) {
                    let (q, v) = motor(&self.config.joints[j], j);
                    if let Some(reply) = self.drives[j].receive(&self.protocol, &frame, now, q, v)
                        && silent != Some(j)
                    {
                        link.send(&reply, now).expect("the interface is up");
                    }
                }
            }
        }
        std::thread::sleep(Duration::from_micros(300));
        std::array::from_fn(|j| {
            let w = &self.config.joints[j];
            let (q, v) = motor(w, j);
            w.sign * w.gear_ratio * self.drives[j].torque(q, v, now)
        })
    }

    fn tolerance(&self) -> (f64, f64) {
        self.tolerance
    }

    /// Frames carry the kernel's stamps.
    fn earlier(&self) -> Duration {
        Duration::from_millis(1)
    }
}

/// What the robot's thread tells.
#[derive(Default)]
struct Seen {
    stop: AtomicBool,
    following: AtomicI64,
    /// The farthest that the front left knee has been folded and straightened, in units of 0.001 rad.
    knee_least: AtomicI64,
    knee_most: AtomicI64,
}

fn run() -> Result<(), Failure> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [seconds] = arguments.as_slice() else {
        return Err("usage: can_walk SECONDS".into());
    };
    let seconds: f64 = seconds.parse()?;
    check_contract(&mut ContractOnCan::new(Mit::default(), common::bus_config("mit", 1.0), (0.002, 0.35))?);
    check_contract(&mut ContractOnCan::new(Registers::default(), common::bus_config("registers", 1.0), (1e-5, 0.01))?);
    println!("can_walk: SocketCAN keeps the contract of every backend, with MIT frames and with register frames");

    let unloaded = |posture: Posture| Posture { support_torque_nm: [0.0; JOINTS], ..posture };
    let mut config = Config { state_timeout_s: 0.01, overrun_s: 0.01, posture_speed_rad_s: 2.0, ..walk::config() };
    // Flywheels carry nothing.
    config.stand = unloaded(config.stand);
    config.sit = unloaded(config.sit);
    let text = include_str!("../../../config/hardware/vision60_can.toml");
    let bus_config = BusConfig::from_toml_str(text, &config.robot, &config.joint_names)?;
    bus_config.check_ranges(&config)?;
    let mut gait = walk::gait();
    gait.reference_coefficients_rad = gait.coefficients_rad;
    let gait = PreparedGait::new(&gait, &config)?;

    let open = || -> Result<Vec<CanLink>, Failure> {
        Ok(bus_config.interfaces.iter().map(|name| CanLink::open(name)).collect::<Result<_, _>>()?)
    };
    let protocol = Mit { host_id: bus_config.host_id, ..Mit::default() };
    let seen = Arc::new(Seen { knee_least: AtomicI64::new(i64::MAX), ..Seen::default() });
    let watched = Arc::clone(&seen);
    let (far, wiring, sit) = (open()?, bus_config.clone(), config.sit.position_rad);
    let robot = std::thread::spawn(move || be_the_robot(far, &wiring, protocol, sit, &watched));

    let bus = DriveBus::new(bus_config.clone(), protocol, open()?);
    let mut rig = Rig {
        controller: Controller::new(config)?,
        bus,
        readings: Readings::default(),
        periodic: Periodic::new(Duration::from_millis(1)),
        gait,
        interfaces: bus_config.interfaces,
        latency: Histogram::default(),
        compute: Histogram::default(),
    };
    let result = rig.day(seconds, &seen);
    seen.stop.store(true, Ordering::Release);
    let robot = robot.join();
    rig.report();
    result?;
    robot.map_err(|_| "the robot's thread panicked")?;
    Ok(())
}

/// Twelve flywheels and their drives, at 2 kHz.
fn be_the_robot(mut links: Vec<CanLink>, wiring: &BusConfig, protocol: Mit, mut q: [f64; JOINTS], seen: &Seen) {
    const INERTIA_KG_M2: f64 = 0.3;
    const STEP_S: f64 = 5e-4;
    let mut v = [0.0; JOINTS];
    let mut drives = wiring.joints.each_ref().map(|j| EmulatedDrive::new(j.id, j.ranges, DriveModel::default()));
    let mut periodic = Periodic::new(Duration::from_micros(500));
    while !seen.stop.load(Ordering::Acquire) {
        let wake = periodic.wait();
        let now = monotonic_now();
        for (n, link) in links.iter_mut().enumerate() {
            loop {
                match link.receive(now) {
                    Ok(Some(Incoming::Frame(frame, _))) => {
                        for j in (0..JOINTS).filter(|j| wiring.joints[*j].interface == n) {
                            if let Some(reply) = drives[j].receive(&protocol, &frame, now, q[j], v[j]) {
                                // A bus that is down loses replies; the other end notices.
                                let _ = link.send(&reply, now);
                            }
                        }
                    }
                    Ok(Some(_)) => {}
                    Ok(None) => break,
                    Err(_) => {
                        // Down: a drive waits for its bus to come back.
                        let _ = link.reopen();
                        break;
                    }
                }
            }
        }
        // What was missed is made up for: the flywheels keep to the clock.
        for _ in 0..=wake.missed.min(20) {
            for j in 0..JOINTS {
                v[j] += drives[j].torque(q[j], v[j], now) / INERTIA_KG_M2 * STEP_S;
                q[j] += v[j] * STEP_S;
            }
        }
        let knee = (q[2] * 1e3) as i64;
        seen.knee_least.fetch_min(knee, Ordering::Relaxed);
        seen.knee_most.fetch_max(knee, Ordering::Relaxed);
        seen.following.store(drives.iter().filter(|d| d.is_following()).count() as i64, Ordering::Relaxed);
    }
}

struct Rig {
    controller: Controller,
    bus: DriveBus<Mit, CanLink>,
    readings: Readings,
    periodic: Periodic,
    gait: PreparedGait,
    interfaces: Vec<String>,
    latency: Histogram,
    compute: Histogram,
}

impl Rig {
    fn cycle(&mut self, requests: &[Request], gait: bool) -> Output {
        let wake = self.periodic.wait();
        self.latency.record(wake.latency());
        let now = monotonic_now();
        self.bus.read(now, &mut self.readings);
        let state = self.readings.joint_state();
        let input = Input {
            joints: state.as_ref(),
            requests,
            gait: gait.then_some(&self.gait),
            fault: self.bus.fault(now),
            ..Input::default()
        };
        let output = self.controller.step(&input, now);
        self.bus.write(&output.command, output.drives_on, monotonic_now());
        self.compute.record(monotonic_now() - now);
        output
    }

    fn until(&mut self, mode: Mode, cycles: usize) -> Result<usize, Failure> {
        let mut last = None;
        for n in 1..=cycles {
            let output = self.cycle(&[], false);
            if output.mode == mode {
                return Ok(n);
            }
            last = Some(output);
        }
        Err(format!("{} not reached in {cycles} cycles: {last:?}", mode.name()).into())
    }

    fn ask(&mut self, request: Request) -> Result<Mode, Failure> {
        match self.cycle(&[request], false).replies[0] {
            Some(Ok(mode)) => Ok(mode),
            other => Err(format!("{request:?}: {other:?}").into()),
        }
    }

    /// Armed, stood up, walking.
    fn walk(&mut self) -> Result<(), Failure> {
        for _ in 0..1500 {
            self.cycle(&[], false);
        }
        if self.controller.mode() == Mode::Disarmed {
            self.ask(Request::Arm)?;
            // The drives enter motor mode one cycle later.
            for _ in 0..20 {
                self.cycle(&[], false);
            }
        }
        self.ask(Request::Stand)?;
        self.ask(Request::Walk)?;
        self.until(Mode::Walking, 12_000)?;
        Ok(())
    }

    fn day(&mut self, seconds: f64, seen: &Seen) -> Result<(), Failure> {
        self.cycle(&[], true);
        self.walk()?;
        seen.knee_least.store(i64::MAX, Ordering::Relaxed);
        seen.knee_most.store(0, Ordering::Relaxed);
        for _ in 0..(seconds * 1e3) as usize {
            let output = self.cycle(&[], false);
            if output.mode != Mode::Walking {
                return Err(format!("it no longer walks: {:?} {:?}", output.damping_reason, output.report).into());
            }
        }
        let (least, most) = (seen.knee_least.load(Ordering::Relaxed), seen.knee_most.load(Ordering::Relaxed));
        println!("can_walk: walked {seconds} s on four buses; the front left knee went from {least} to {most} mrad");
        // The gait lifts it from 1997 to 1716.
        if !(1650..1800).contains(&least) || !(1950..2060).contains(&most) {
            return Err("the joints did not follow the gait".into());
        }

        // An error frame that means no more than that: it walks on.
        send_error_frame(&self.interfaces[0], 0x08, [0; 8])?;
        for _ in 0..100 {
            self.cycle(&[], false);
        }
        if self.controller.mode() != Mode::Walking || self.bus.health().links[0].bus_errors == 0 {
            return Err(
                format!("an error frame: {:?}, {:?}", self.controller.mode(), self.bus.health().links[0]).into()
            );
        }
        println!("can_walk: an error frame is counted and walked on");

        send_error_frame(&self.interfaces[1], 0x40, [0; 8])?;
        self.fault_within(10, "bus-off")?;
        for _ in 0..100 {
            self.cycle(&[], false);
        }
        let health = self.bus.health().links[1];
        if health.down_since.is_some() || health.reopened == 0 {
            return Err(format!("bus-off was not recovered: {health:?}").into());
        }
        self.recover("bus-off")?;

        let interface = self.interfaces[2].clone();
        ip_link(&interface, "down")?;
        self.fault_within(12, "interface down")?;
        for _ in 0..300 {
            self.cycle(&[], false);
        }
        ip_link(&interface, "up")?;
        for _ in 0..1500 {
            self.cycle(&[], false);
        }
        if self.bus.health().links[2].down_since.is_some() {
            return Err("the interface is up again, the bus is not".into());
        }
        self.recover("interface down")?;

        for _ in 0..1000 {
            let output = self.cycle(&[], false);
            if output.mode != Mode::Walking {
                return Err(format!("after all this it no longer walks: {:?}", output.report).into());
            }
        }
        println!("can_walk: walks again; {} drives follow", seen.following.load(Ordering::Relaxed));
        Ok(())
    }

    fn fault_within(&mut self, cycles: usize, what: &str) -> Result<(), Failure> {
        let taken = self.until(Mode::Fault, cycles)?;
        println!("can_walk: {what}: damped after {taken} cycles");
        Ok(())
    }

    /// Clears what is latched, stands up and walks.
    fn recover(&mut self, what: &str) -> Result<(), Failure> {
        for attempt in 0..5 {
            for _ in 0..300 {
                self.cycle(&[], false);
            }
            let latched: Vec<Fault> = self.cycle(&[], false).faults.iter().collect();
            println!("can_walk: {what}: clearing {:?}", latched.iter().map(|f| f.name()).collect::<Vec<_>>());
            for fault in latched {
                self.ask(Request::ClearFault(fault))?;
            }
            for _ in 0..20 {
                self.cycle(&[], false);
            }
            if self.controller.mode() == Mode::Damping {
                break;
            }
            if attempt == 4 {
                return Err(format!("{what}: faults come back: {:?}", self.controller.mode()).into());
            }
        }
        self.walk()
    }

    fn report(&self) {
        let us = |d: Duration| d.as_secs_f64() * 1e6;
        for (name, h) in [("lateness", &self.latency), ("computing", &self.compute)] {
            println!(
                "can_walk: {name} of {} cycles, us of virtual time: median {:.0}, p99 {:.0}, max {:.0}",
                h.count(),
                us(h.quantile(0.5)),
                us(h.quantile(0.99)),
                us(h.max())
            );
        }
        for (n, link) in self.bus.health().links[..self.interfaces.len()].iter().enumerate() {
            println!("can_walk: {}: {link:?}", self.interfaces[n]);
        }
    }
}

fn ip_link(interface: &str, state: &str) -> Result<(), Failure> {
    let status = Command::new("ip").args(["link", "set", interface, state]).status()?;
    if status.success() { Ok(()) } else { Err(format!("ip link set {interface} {state}: {status}").into()) }
}

/// A virtual interface carries error frames from one socket to the others, as a chip's driver would make them.
fn send_error_frame(interface: &str, class: u32, data: [u8; 8]) -> Result<(), Failure> {
    joint_bus::can::send_error_frame(interface, class, &data)?;
    Ok(())
}
