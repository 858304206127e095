//! The contract of every backend, kept by SocketCAN on real interfaces, with MIT frames and with register frames: part
//! of what `tests/can/run` runs in a virtual machine, where `can0` to `can3` are virtual interfaces. Any failure ends
//! it with an exit status other than 0.

#[path = "../tests/common/mod.rs"]
mod common;

use control::JOINTS;
use joint_bus::can::CanLink;
use joint_bus::{
    BusConfig, ContractBench, DriveBus, DriveModel, EmulatedDrive, Incoming, JointBus, Link, Mit, Protocol, Registers,
    check_contract,
};
use std::time::Duration;

type Failure = Box<dyn std::error::Error>;

fn main() -> Result<(), Failure> {
    check_contract(&mut ContractOnCan::new(Mit::default(), common::bus_config("mit", 1.0), (0.002, 0.35))?);
    check_contract(&mut ContractOnCan::new(Registers::default(), common::bus_config("registers", 1.0), (1e-5, 0.01))?);
    println!("can_contract: SocketCAN keeps the contract of every backend, with MIT frames and with register frames");
    Ok(())
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
