//! A drive as it behaves behind its frames, for tests and for the simulator.

use crate::{DriveCommand, DriveReply, DriveRequest, Frame, Protocol, Ranges};
use core::time::Duration;

/// Commands under way to the drive's loop: 16 at 1 kHz are 16 ms of latency.
const PIPELINE: usize = 16;

/// How a drive behaves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DriveModel {
    /// Largest torque, N m.
    pub torque_limit_nm: f64,
    /// Without a frame for so long it damps until it is entered anew.
    pub watchdog: Duration,
    /// Velocity gain of that damping, N m s / rad.
    pub damping_kd: f64,
    /// From a frame's arrival to its effect.
    pub latency: Duration,
    /// Temperature of the surroundings, °C.
    pub ambient_c: f64,
    /// How fast torque heats, °C / s per (N m)².
    pub heating_c_per_s_nm2: f64,
    /// Time in which the difference to the surroundings falls to 1/e, s.
    pub cooling_s: f64,
    /// Above this it gives no torque, °C.
    pub shutdown_c: f64,
    /// What it is fed with, V.
    pub supply_v: f64,
    /// Torque of a current, N m / A.
    pub torque_per_ampere_nm: f64,
}

impl Default for DriveModel {
    /// The Vision 60's 87.5 N m; the other numbers are plausible, not measured.
    fn default() -> Self {
        Self {
            torque_limit_nm: 87.5,
            watchdog: Duration::from_millis(20),
            damping_kd: 8.0,
            latency: Duration::ZERO,
            ambient_c: 25.0,
            heating_c_per_s_nm2: 2e-4,
            cooling_s: 300.0,
            shutdown_c: 100.0,
            supply_v: 48.0,
            torque_per_ampere_nm: 2.0,
        }
    }
}

/// A drive. Positions, velocities and torques are the motor side's.
#[derive(Clone, Debug)]
pub struct EmulatedDrive {
    id: u8,
    ranges: Ranges,
    model: DriveModel,
    following: bool,
    tripped: bool,
    command: DriveCommand,
    pending: [Option<(Duration, DriveCommand)>; PIPELINE],
    received: Duration,
    zero_rad: f64,
    torque_nm: f64,
    temperature_c: f64,
    last: Option<Duration>,
}

impl EmulatedDrive {
    /// Error code: its watchdog has tripped.
    pub const ERROR_WATCHDOG: u8 = 1;
    /// Error code: it is too hot.
    pub const ERROR_TEMPERATURE: u8 = 2;

    /// A drive at rest.
    pub fn new(id: u8, ranges: Ranges, model: DriveModel) -> Self {
        Self {
            id,
            ranges,
            model,
            following: false,
            tripped: false,
            command: DriveCommand::default(),
            pending: [None; PIPELINE],
            received: Duration::ZERO,
            zero_rad: 0.0,
            torque_nm: 0.0,
            temperature_c: model.ambient_c,
            last: None,
        }
    }

    /// Whether it follows commands.
    pub fn is_following(&self) -> bool {
        self.following
    }

    /// The torque of the last [`EmulatedDrive::torque`], N m.
    pub fn last_torque_nm(&self) -> f64 {
        self.torque_nm
    }

    /// Its temperature, °C.
    pub fn temperature_c(&self) -> f64 {
        self.temperature_c
    }

    /// Sets its temperature, °C: for tests of what happens then.
    pub fn set_temperature_c(&mut self, temperature_c: f64) {
        self.temperature_c = temperature_c;
    }

    /// Takes a frame at time `now` with the motor at `q` rad and `v` rad/s; the reply, if the frame was for this drive.
    pub fn receive(&mut self, protocol: &impl Protocol, frame: &Frame, now: Duration, q: f64, v: f64) -> Option<Frame> {
        let request = protocol.decode_request(self.id, &self.ranges, frame)?;
        if request != DriveRequest::Query {
            self.received = now;
        }
        match request {
            DriveRequest::Query => {}
            DriveRequest::Enter => {
                self.following = true;
                self.tripped = false;
                self.command = DriveCommand::default();
                self.pending = [None; PIPELINE];
            }
            DriveRequest::Exit => {
                self.following = false;
                self.tripped = false;
                self.pending = [None; PIPELINE];
            }
            DriveRequest::SetZero => self.zero_rad = q,
            DriveRequest::Command(command) => {
                let due = now + self.model.latency;
                // A full pipeline loses its oldest.
                let slot = match self.pending.iter().position(Option::is_none) {
                    Some(free) => free,
                    None => {
                        self.pending.rotate_left(1);
                        PIPELINE - 1
                    }
                };
                self.pending[slot] = Some((due, command));
            }
        }
        let reply = DriveReply {
            position_rad: q - self.zero_rad,
            velocity_rad_s: v,
            torque_nm: self.torque_nm,
            temperature_c: Some(self.temperature_c),
            error: Some(self.error()),
            supply_v: Some(self.model.supply_v),
            current_a: Some(self.torque_nm / self.model.torque_per_ampere_nm),
        };
        Some(protocol.encode_reply(self.id, &self.ranges, &reply))
    }

    fn error(&self) -> u8 {
        if self.temperature_c > self.model.shutdown_c {
            Self::ERROR_TEMPERATURE
        } else if self.tripped {
            Self::ERROR_WATCHDOG
        } else {
            0
        }
    }

    /// Its torque at time `now` with the motor at `q` rad and `v` rad/s, N m. Call it every physics step.
    pub fn torque(&mut self, q: f64, v: f64, now: Duration) -> f64 {
        while let Some((due, command)) = self.pending[0]
            && due <= now
        {
            self.command = command;
            self.pending.rotate_left(1);
            self.pending[PIPELINE - 1] = None;
        }
        let limits = self.command.limits;
        // What cannot be a time or a torque is none.
        let watchdog = limits.watchdog_s.and_then(|seconds| Duration::try_from_secs_f64(seconds).ok());
        if self.following && now.saturating_sub(self.received) > watchdog.unwrap_or(self.model.watchdog) {
            self.tripped = true;
        }
        let c = &self.command;
        let q = q - self.zero_rad;
        let law = if !self.following || self.temperature_c > self.model.shutdown_c {
            0.0
        } else if self.tripped {
            -self.model.damping_kd * v
        } else {
            c.kp * (c.position_rad - q) + c.kd * (c.velocity_rad_s - v) + c.torque_nm
        };
        let largest = limits.max_torque_nm.filter(|torque_nm| *torque_nm >= 0.0).unwrap_or(f64::INFINITY);
        let most = self.model.torque_limit_nm.min(largest);
        self.torque_nm = law.clamp(-most, most);
        let dt_s = self.last.replace(now).map_or(0.0, |last| now.saturating_sub(last).as_secs_f64());
        self.temperature_c += dt_s
            * (self.model.heating_c_per_s_nm2 * self.torque_nm * self.torque_nm
                - (self.temperature_c - self.model.ambient_c) / self.model.cooling_s);
        self.torque_nm
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Mit;

    const RANGES: Ranges = Ranges { position_rad: 12.5, velocity_rad_s: 45.0, kp: 500.0, kd: 10.0, torque_nm: 90.0 };
    const MS: Duration = Duration::from_millis(1);

    fn send(drive: &mut EmulatedDrive, request: DriveRequest, now: Duration) -> DriveReply {
        let mit = Mit::default();
        let frame = mit.encode_request(1, &RANGES, &request).unwrap();
        let reply = drive.receive(&mit, &frame, now, 0.5, 1.0).unwrap();
        mit.decode_reply(&RANGES, &reply).unwrap()
    }

    #[test]
    fn it_follows_only_when_entered_and_damps_when_left_alone() {
        let mut d = EmulatedDrive::new(1, RANGES, DriveModel::default());
        let push = DriveRequest::Command(DriveCommand { torque_nm: 10.0, ..DriveCommand::default() });
        send(&mut d, push, MS);
        assert_eq!(d.torque(0.5, 1.0, MS), 0.0, "at rest");
        send(&mut d, DriveRequest::Enter, 2 * MS);
        assert_eq!(send(&mut d, push, 3 * MS).error, Some(0));
        assert!((d.torque(0.5, 0.0, 3 * MS) - 10.0).abs() < 0.1);
        assert!((d.torque(0.5, 1.0, 23 * MS) - 10.0).abs() < 0.1, "20 ms are allowed");
        assert_eq!(d.torque(0.5, 1.0, 24 * MS), -8.0, "then it damps");
        assert_eq!(send(&mut d, push, 25 * MS).error, Some(EmulatedDrive::ERROR_WATCHDOG));
        assert_eq!(d.torque(0.5, 1.0, 25 * MS), -8.0, "until it is entered anew");
        send(&mut d, DriveRequest::Enter, 26 * MS);
        assert_eq!(d.torque(0.5, 1.0, 26 * MS), 0.0);
        send(&mut d, push, 27 * MS);
        assert!((d.torque(0.5, 1.0, 27 * MS) - 10.0).abs() < 0.1);
    }

    #[test]
    fn torque_is_limited_late_and_warm() {
        let model = DriveModel { latency: 3 * MS, heating_c_per_s_nm2: 1.0, ..DriveModel::default() };
        let mut d = EmulatedDrive::new(1, RANGES, model);
        send(&mut d, DriveRequest::Enter, Duration::ZERO);
        send(
            &mut d,
            DriveRequest::Command(DriveCommand { position_rad: 9.0, kp: 500.0, ..DriveCommand::default() }),
            MS,
        );
        assert_eq!(d.torque(0.5, 0.0, 3 * MS), 0.0, "not yet");
        assert_eq!(d.torque(0.5, 0.0, 4 * MS), 87.5);
        d.torque(0.5, 0.0, 14 * MS);
        assert!(d.temperature_c() > 90.0);
        let reply = send(&mut d, DriveRequest::Enter, 14 * MS);
        assert_eq!(reply.temperature_c, Some(d.temperature_c().trunc()));
        d.set_temperature_c(120.0);
        assert_eq!(d.torque(0.5, 0.0, 15 * MS), 0.0);
        assert_eq!(send(&mut d, DriveRequest::Enter, 15 * MS).error, Some(EmulatedDrive::ERROR_TEMPERATURE));
    }

    #[test]
    fn zero_is_where_it_was_set() {
        let mut d = EmulatedDrive::new(1, RANGES, DriveModel::default());
        assert!((send(&mut d, DriveRequest::Exit, MS).position_rad - 0.5).abs() < 1e-3);
        assert!(send(&mut d, DriveRequest::SetZero, MS).position_rad.abs() < 1e-3);
    }

    #[test]
    fn limits_that_come_with_a_command_are_kept() {
        let protocol = crate::Registers::default();
        let mut d = EmulatedDrive::new(1, RANGES, DriveModel::default());
        let limits = crate::DriveLimits { max_torque_nm: Some(5.0), watchdog_s: Some(0.003) };
        for (request, at) in [
            (DriveRequest::Enter, MS),
            (DriveRequest::Command(DriveCommand { torque_nm: 30.0, limits, ..DriveCommand::default() }), 2 * MS),
        ] {
            let frame = protocol.encode_request(1, &RANGES, &request).unwrap();
            d.receive(&protocol, &frame, at, 0.0, 0.0).unwrap();
        }
        assert_eq!(d.torque(0.0, 0.0, 2 * MS), 5.0, "30 N m were asked for");
        assert_eq!(d.torque(0.0, 0.1, 5 * MS), 5.0, "3 ms are allowed");
        assert_eq!(d.torque(0.0, 0.1, 6 * MS), -0.8, "then it damps, long before its own 20 ms");
    }
}
