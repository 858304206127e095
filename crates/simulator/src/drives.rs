//! Twelve emulated drives at the far end of the robot's buses, moved by the simulator: what the controller's hardware
//! side talks to where there is no robot. They take the frames and the wiring file that are meant for the robot.

use control::{InertialState, JOINTS};
pub use joint_bus::DriveProtocol;
use joint_bus::{BusConfig, DriveModel, EmulatedDrive, EmulatedInertialUnit, Incoming, Link, LinkError};
use std::time::Duration;

/// A link that is down is tried again after this time.
const RETRY: Duration = Duration::from_millis(100);

struct BusEnd {
    link: Box<dyn Link + Send>,
    /// When to try again, if it is down.
    down_until: Option<Duration>,
}

/// The drives and their ends of the buses.
pub struct DriveBench {
    protocol: DriveProtocol,
    config: BusConfig,
    drives: [EmulatedDrive; JOINTS],
    ends: Vec<BusEnd>,
    inertial: Option<EmulatedInertialUnit>,
    /// Replies lost to full queues.
    lost_replies: u64,
}

impl DriveBench {
    /// Drives wired as in `config`, behaving as `model` (whose torque limit is the joint's; the gear is reckoned with),
    /// on `links` in the order of the file's interfaces.
    ///
    /// # Panics
    /// If there are not as many links as interfaces.
    pub fn new(config: BusConfig, model: DriveModel, links: Vec<Box<dyn Link + Send>>) -> Self {
        assert_eq!(links.len(), config.interfaces.len(), "one link for each interface");
        let drives = config.joints.each_ref().map(|joint| {
            let model = DriveModel { torque_limit_nm: model.torque_limit_nm / joint.gear_ratio, ..model };
            EmulatedDrive::new(joint.id, joint.ranges, model)
        });
        let ends = links.into_iter().map(|link| BusEnd { link, down_until: None }).collect();
        Self { protocol: DriveProtocol::of(&config), config, drives, ends, inertial: None, lost_replies: 0 }
    }

    /// With this inertial unit.
    #[must_use]
    pub fn with_inertial_unit(self, unit: Option<EmulatedInertialUnit>) -> Self {
        Self { inertial: unit, ..self }
    }

    /// The inertial unit has measured this.
    pub fn measure(&mut self, measured: &InertialState) {
        if let Some(unit) = &mut self.inertial {
            unit.send(measured);
        }
    }

    /// Motor side of joint `j`.
    fn motor(&self, j: usize, q: f64, v: f64) -> (f64, f64) {
        let wiring = &self.config.joints[j];
        let turns = wiring.sign * wiring.gear_ratio;
        (turns * (q - wiring.zero_rad), turns * v)
    }

    /// Takes every frame that has come in by `now` and answers it, the joints being at `q` rad and moving with `v`
    /// rad/s.
    pub fn answer(&mut self, now: Duration, q: &[f64; JOINTS], v: &[f64; JOINTS]) {
        for n in 0..self.ends.len() {
            if let Some(until) = self.ends[n].down_until {
                if now < until {
                    continue;
                }
                self.ends[n].down_until = self.ends[n].link.reopen().is_err().then_some(now + RETRY);
            }
            loop {
                let frame = match self.ends[n].link.receive(now) {
                    Ok(Some(Incoming::Frame(frame, _))) => frame,
                    // Errors on the bus are for its controllers, not for its drives.
                    Ok(Some(_)) => continue,
                    Ok(None) | Err(LinkError::Full) => break,
                    Err(_) => {
                        self.ends[n].down_until = Some(now + RETRY);
                        break;
                    }
                };
                for j in (0..JOINTS).filter(|j| self.config.joints[*j].interface == n) {
                    let (motor_q, motor_v) = self.motor(j, q[j], v[j]);
                    let Some(reply) = self.drives[j].receive(&self.protocol, &frame, now, motor_q, motor_v) else {
                        continue;
                    };
                    if self.ends[n].link.send(&reply, now).is_err() {
                        self.lost_replies += 1;
                    }
                }
            }
        }
    }

    /// The drives' torques on the joints, Nm: once every physics step.
    pub fn torques(&mut self, now: Duration, q: &[f64; JOINTS], v: &[f64; JOINTS]) -> [f64; JOINTS] {
        std::array::from_fn(|j| {
            let (motor_q, motor_v) = self.motor(j, q[j], v[j]);
            let wiring = &self.config.joints[j];
            wiring.sign * wiring.gear_ratio * self.drives[j].torque(motor_q, motor_v, now)
        })
    }

    /// Replies that a full or failed bus did not take.
    pub fn lost_replies(&self) -> u64 {
        self.lost_replies
    }

    /// How many drives follow commands.
    pub fn following(&self) -> usize {
        self.drives.iter().filter(|drive| drive.is_following()).count()
    }

    /// The hottest drive, °C.
    pub fn hottest_c(&self) -> f64 {
        self.drives.iter().map(EmulatedDrive::temperature_c).fold(f64::MIN, f64::max)
    }
}
