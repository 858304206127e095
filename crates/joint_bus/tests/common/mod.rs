//! Twelve emulated drives behind memory links, with faults on request.
#![allow(dead_code)]

use control::{JOINTS, JointCommand};
use joint_bus::memory::{MemoryLink, pair};
use joint_bus::*;
use std::time::Duration;

pub fn joint_names() -> [String; JOINTS] {
    let legs = ["front_left", "rear_left", "front_right", "rear_right"];
    let joints = ["hip_roll", "hip_pitch", "knee"];
    std::array::from_fn(|j| format!("{}_{}", legs[j / 3], joints[j % 3]))
}

/// A bus file with signs and zeros that differ from joint to joint.
pub fn bus_text(protocol: &str, gear_ratio: f64) -> String {
    let mut text = format!(
        "format = \"tandem-bus\"\nversion = 1\nrobot = \"vision60\"\nprotocol = \"{protocol}\"\nhost_id = 0\nask_before_arming = true\n\
         interfaces = [\"can0\", \"can1\", \"can2\", \"can3\"]\n\
         [ranges]\nposition_rad = 12.5\nvelocity_rad_s = 65.0\nkp_nm_per_rad = 500.0\nkd_nm_s_per_rad = 10.0\ntorque_nm = 90.0\n"
    );
    for (j, name) in joint_names().iter().enumerate() {
        let sign = if j % 2 == 0 { 1.0 } else { -1.0 };
        text += &format!(
            "[[joints]]\nname = \"{name}\"\ninterface = {}\nid = {}\nsign = {sign:?}\ngear_ratio = {gear_ratio:?}\nzero_rad = {:?}\n",
            j / 3,
            j % 3 + 1,
            0.05 * j as f64 - 0.3,
        );
    }
    text
}

pub fn bus_config(protocol: &str, gear_ratio: f64) -> BusConfig {
    BusConfig::from_toml_str(&bus_text(protocol, gear_ratio), "vision60", &joint_names()).unwrap()
}

/// Drives, links and bus.
pub struct Bench<P> {
    pub protocol: P,
    pub bus: DriveBus<P, Faulty<MemoryLink>>,
    pub config: BusConfig,
    pub far: Vec<MemoryLink>,
    pub drives: [EmulatedDrive; JOINTS],
    tolerance: (f64, f64),
}

impl<P: Protocol + Copy> Bench<P> {
    pub fn new(protocol: P, config: BusConfig, position_tolerance: f64, torque_tolerance: f64) -> Self {
        let (near, far): (Vec<_>, Vec<_>) = (0..config.interfaces.len())
            .map(|n| {
                let (near, far) = pair();
                (Faulty::new(near, n as u64 + 1), far)
            })
            .unzip();
        let drives = config.joints.each_ref().map(|j| EmulatedDrive::new(j.id, j.ranges, DriveModel::default()));
        Self {
            protocol,
            bus: DriveBus::new(config.clone(), protocol, near),
            config,
            far,
            drives,
            tolerance: (position_tolerance, torque_tolerance),
        }
    }

    pub fn faults(&mut self, n: usize) -> &mut Faults {
        &mut self.bus.link_mut(n).faults
    }

    pub fn all_faults(&mut self, faults: Faults) {
        for n in 0..self.far.len() {
            *self.faults(n) = faults;
        }
    }
}

impl<P: Protocol + Copy> ContractBench for Bench<P> {
    fn bus(&mut self) -> &mut dyn JointBus {
        &mut self.bus
    }

    fn act(&mut self, now: Duration, q: &[f64; JOINTS], v: &[f64; JOINTS], silent: Option<usize>) -> [f64; JOINTS] {
        let motor = |j: usize| {
            let w = &self.config.joints[j];
            (w.sign * w.gear_ratio * (q[j] - w.zero_rad), w.sign * w.gear_ratio * v[j])
        };
        for (n, link) in self.far.iter_mut().enumerate() {
            while let Some(incoming) = link.receive(now).unwrap() {
                let Incoming::Frame(frame, _) = incoming else { continue };
                for j in (0..JOINTS).filter(|j| self.config.joints[*j].interface == n) {
                    let (q, v) = motor(j);
                    if let Some(reply) = self.drives[j].receive(&self.protocol, &frame, now, q, v)
                        && silent != Some(j)
                    {
                        // A full queue loses replies, as a bus does.
                        let _ = link.send(&reply, now);
                    }
                }
            }
        }
        std::array::from_fn(|j| {
            let (q, v) = motor(j);
            let w = &self.config.joints[j];
            w.sign * w.gear_ratio * self.drives[j].torque(q, v, now)
        })
    }

    fn tolerance(&self) -> (f64, f64) {
        self.tolerance
    }
}

/// For tests that only need something to send.
pub const HOLD: JointCommand = JointCommand {
    position_rad: [0.0; JOINTS],
    velocity_rad_s: [0.0; JOINTS],
    kp: [100.0; JOINTS],
    kd: [2.0; JOINTS],
    torque_nm: [0.0; JOINTS],
};
