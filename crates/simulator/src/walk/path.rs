//! How commands reach the simulated joints and states come back.

use super::{WalkError, WalkOptions};
use crate::Simulator;
use crate::drives::{DriveBench, DriveProtocol};
use control::{Config, InertialState, JointCommand, JointState, Output};
use joint_bus::{
    BusConfig, CanInertialUnit, DriveBus, EmulatedInertialUnit, InertialUnit, InertialWiring, JointBus, Link, Readings,
    memory, memory::MemoryLink,
};
use std::collections::VecDeque;
use std::time::Duration;

/// How commands reach the joints and states come back.
pub(super) enum Path {
    /// The simulator's own drives, and commands on their way to them.
    Own { on_the_way: VecDeque<JointCommand>, delay_cycles: usize },
    /// Emulated drives behind frames.
    Bus { bus: Box<DriveBus<DriveProtocol, MemoryLink>>, bench: Box<DriveBench>, readings: Box<Readings> },
}

/// Both ends of an inertial unit on a link of its own.
fn inertial_unit(wiring: &InertialWiring) -> (Box<dyn InertialUnit>, EmulatedInertialUnit) {
    let (near, far) = memory::pair();
    (Box::new(CanInertialUnit::new(wiring.frames, near)), EmulatedInertialUnit::new(wiring.frames, far))
}

impl Path {
    pub(super) fn new(options: &WalkOptions, config: &Config, delay_cycles: usize) -> Result<Self, WalkError> {
        let Some(drives) = &options.drives else {
            return Ok(Self::Own { on_the_way: VecDeque::with_capacity(delay_cycles + 1), delay_cycles });
        };
        if delay_cycles > 0 {
            return Err(WalkError::Option(
                "a command's delay belongs to the drives' model where drives are emulated".into(),
            ));
        }
        drives.bus.check_ranges(&config.command_range())?;
        let (near, far): (Vec<_>, Vec<Box<dyn Link + Send>>) = drives
            .bus
            .interfaces
            .iter()
            .map(|_| {
                let (near, far) = memory::pair();
                (near, Box::new(far) as Box<dyn Link + Send>)
            })
            .unzip();
        // Nobody else is on these links.
        let wiring = BusConfig { ask_before_arming: true, ..drives.bus.clone() };
        let (unit, emulated) = drives.bus.inertial.as_ref().map(inertial_unit).unzip();
        let bus = DriveBus::new(wiring, DriveProtocol::of(&drives.bus), near).with_inertial_unit(unit);
        let bench = DriveBench::new(drives.bus.clone(), drives.model, far).with_inertial_unit(emulated);
        let (bus, bench) = (Box::new(bus), Box::new(bench));
        let mut path = Self::Bus { bus, bench, readings: Box::default() };
        path.ask_first();
        Ok(path)
    }

    /// A drive reports its position only in reply to a frame: the first is sent before the first cycle.
    fn ask_first(&mut self) {
        if let Self::Bus { bus, .. } = self {
            bus.write(&JointCommand::LIMP, false, Duration::ZERO);
        }
    }

    /// The state that the controller sees.
    pub(super) fn read(&mut self, simulator: &Simulator, now: Duration) -> Option<JointState> {
        let (position_rad, velocity_rad_s) = simulator.joints();
        match self {
            Self::Own { .. } => Some(JointState::measured(now, position_rad, velocity_rad_s)),
            Self::Bus { bus, bench, readings } => {
                // What was written in the last cycle has been answered; only that first frame still waits.
                if now.is_zero() {
                    bench.answer(now, &position_rad, &velocity_rad_s);
                }
                bus.read(now, readings);
                readings.joint_state()
            }
        }
    }

    /// What the controller receives of a measurement of the inertial unit: through its frames, where it is wired.
    pub(super) fn inertial(&mut self, measured: InertialState, now: Duration) -> Option<InertialState> {
        match self {
            Self::Bus { bus, bench, .. } if bus.has_inertial_unit() => {
                bench.measure(&measured);
                bus.read_inertial(now)
            }
            _ => Some(measured),
        }
    }

    pub(super) fn fault(&self, now: Duration) -> Option<control::FaultReport> {
        match self {
            Self::Own { .. } => None,
            Self::Bus { bus, .. } => bus.fault(now),
        }
    }

    pub(super) fn write(&mut self, output: &Output, simulator: &mut Simulator, now: Duration) {
        match self {
            Self::Own { on_the_way, delay_cycles } => {
                on_the_way.push_back(output.command);
                if on_the_way.len() > *delay_cycles
                    && let Some(command) = on_the_way.pop_front()
                {
                    simulator.command(&command);
                }
            }
            Self::Bus { bus, bench, .. } => {
                bus.write(&output.command, output.drives_on, now);
                let (q, v) = simulator.joints();
                bench.answer(now, &q, &v);
            }
        }
    }

    pub(super) fn step(&mut self, simulator: &mut Simulator, now: Duration) {
        match self {
            Self::Own { .. } => simulator.step(),
            Self::Bus { bench, .. } => {
                let (q, v) = simulator.joints();
                simulator.step_with_torque(&bench.torques(now, &q, &v));
            }
        }
    }
}
