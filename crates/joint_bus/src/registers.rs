//! Register frames over CAN FD, as moteus controllers speak them (their reference manual, "CAN protocol").
//!
//! A frame is a list of subframes, each a write, a read or a reply of consecutive registers of one type. A command
//! writes mode, position, velocity, torque and the scales of the drive's own gains, and reads back position, velocity,
//! torque, current, supply voltage, temperature and fault. Positions are in revolutions. The identifier holds the
//! sender in its upper and the receiver in its lower byte; its bit 15 asks for a reply.

use crate::{DriveCommand, DriveReply, DriveRequest, EncodeError, Frame, Protocol, Ranges};
use core::f64::consts::TAU;

/// The protocol. `Ranges::kp` and `Ranges::kd` are the gains that the drive is configured with: at most they can be
/// had.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Registers {
    /// The host's number on the bus, 0 to 127.
    pub host_id: u8,
}

mod register {
    pub const MODE: u32 = 0x000;
    pub const POSITION: u32 = 0x001;
    pub const VELOCITY: u32 = 0x002;
    pub const TORQUE: u32 = 0x003;
    pub const Q_CURRENT: u32 = 0x004;
    /// As a byte in steps of 0.5 V.
    pub const VOLTAGE: u32 = 0x00d;
    pub const TEMPERATURE: u32 = 0x00e;
    pub const FAULT: u32 = 0x00f;
    pub const COMMAND_POSITION: u32 = 0x020;
    pub const COMMAND_VELOCITY: u32 = 0x021;
    pub const COMMAND_TORQUE: u32 = 0x022;
    pub const COMMAND_KP_SCALE: u32 = 0x023;
    pub const COMMAND_KD_SCALE: u32 = 0x024;
    pub const COMMAND_MAX_TORQUE: u32 = 0x025;
    pub const COMMAND_WATCHDOG: u32 = 0x027;
    pub const SET_OUTPUT_EXACT: u32 = 0x131;
}

mod mode {
    pub const STOPPED: u8 = 0;
    pub const POSITION: u8 = 10;
    pub const ZERO_VELOCITY: u8 = 12;
}

/// Upper bits of a subframe's first byte: what it does; the next two: the type; the lowest two: how many registers, 0
/// meaning that the number follows.
mod subframe {
    pub const WRITE: u8 = 0x00;
    pub const READ: u8 = 0x10;
    pub const REPLY: u8 = 0x20;
    pub const INT8: u8 = 0x00;
    pub const FLOAT: u8 = 0x0c;
    pub const NO_OPERATION: u8 = 0x50;
}

const ASK_FOR_REPLY: u32 = 0x8000;
/// Read four floats from POSITION; read three bytes from VOLTAGE.
const QUERY: [u8; 5] = [subframe::READ | subframe::FLOAT, 4, 0x01, subframe::READ | subframe::INT8 | 3, 0x0d];
/// Volts of a byte's step.
const VOLTS_PER_STEP: f64 = 0.5;

/// Bytes of a frame under construction; 64 are enough for every frame made here.
struct Writer {
    data: [u8; 64],
    length: usize,
}

impl Writer {
    fn new() -> Self {
        Self { data: [0; 64], length: 0 }
    }

    fn bytes(&mut self, bytes: &[u8]) -> &mut Self {
        self.data[self.length..self.length + bytes.len()].copy_from_slice(bytes);
        self.length += bytes.len();
        self
    }

    fn float(&mut self, value: f64) -> &mut Self {
        self.bytes(&(value as f32).to_le_bytes())
    }

    fn frame(&self, id: u32) -> Frame {
        // Neither the identifier nor the data can be too long.
        Frame::new_fd(id, &self.data[..self.length], subframe::NO_OPERATION).unwrap_or(Frame::unchecked(
            id,
            true,
            true,
            &[],
        ))
    }
}

/// Calls `each` with every register of the subframes of one kind: its number, and its value. Numbers of 8 to 32 bits
/// are given as they stand. False if the frame is damaged.
fn registers(data: &[u8], kind: u8, mut each: impl FnMut(u32, f64)) -> bool {
    let mut rest = data.iter().copied();
    while let Some(first) = rest.next() {
        if first == subframe::NO_OPERATION {
            continue;
        }
        if first >= 0x30 {
            return false;
        }
        let count = match first & 0x03 {
            0 => match variable(&mut rest) {
                Some(count) => count,
                None => return false,
            },
            n => u32::from(n),
        };
        let Some(start) = variable(&mut rest) else { return false };
        if first & 0x30 == subframe::READ {
            continue;
        }
        for register in start..start.saturating_add(count) {
            let mut bytes = [0; 4];
            let size = [1, 2, 4, 4][usize::from((first >> 2) & 0x03)];
            for byte in &mut bytes[..size] {
                let Some(b) = rest.next() else { return false };
                *byte = b;
            }
            let value = match (first >> 2) & 0x03 {
                0 => f64::from(bytes[0] as i8),
                1 => f64::from(i16::from_le_bytes([bytes[0], bytes[1]])),
                2 => f64::from(i32::from_le_bytes(bytes)),
                _ => f64::from(f32::from_le_bytes(bytes)),
            };
            if first & 0x30 == kind {
                each(register, value);
            }
        }
    }
    true
}

/// A number of seven bits a byte, lowest first, the eighth bit saying that more follow.
fn variable(bytes: &mut impl Iterator<Item = u8>) -> Option<u32> {
    let mut value = 0;
    for shift in [0, 7, 14, 21] {
        let byte = bytes.next()?;
        value |= u32::from(byte & 0x7f) << shift;
        if byte & 0x80 == 0 {
            return Some(value);
        }
    }
    None
}

impl Protocol for Registers {
    fn has_query(&self) -> bool {
        true
    }

    fn encode_request(&self, id: u8, r: &Ranges, request: &DriveRequest) -> Result<Frame, EncodeError> {
        let mut w = Writer::new();
        let write_mode = [subframe::WRITE | subframe::INT8 | 1, register::MODE as u8];
        match request {
            DriveRequest::Enter => {
                w.bytes(&write_mode).bytes(&[mode::ZERO_VELOCITY]);
            }
            DriveRequest::Exit => {
                w.bytes(&write_mode).bytes(&[mode::STOPPED]);
            }
            DriveRequest::Query => {}
            DriveRequest::SetZero => {
                let [low, high] =
                    [(register::SET_OUTPUT_EXACT & 0x7f) as u8 | 0x80, (register::SET_OUTPUT_EXACT >> 7) as u8];
                w.bytes(&[subframe::WRITE | subframe::FLOAT | 1, low, high]).float(0.0);
            }
            DriveRequest::Command(c) => {
                c.check()?;
                w.bytes(&write_mode).bytes(&[mode::POSITION]);
                let count = 5 + u8::from(c.limits.max_torque_nm.is_some());
                w.bytes(&[subframe::WRITE | subframe::FLOAT, count, register::COMMAND_POSITION as u8])
                    .float(c.position_rad.clamp(-r.position_rad, r.position_rad) / TAU)
                    .float(c.velocity_rad_s.clamp(-r.velocity_rad_s, r.velocity_rad_s) / TAU)
                    .float(c.torque_nm.clamp(-r.torque_nm, r.torque_nm))
                    .float((c.kp / r.kp).clamp(0.0, 1.0))
                    .float((c.kd / r.kd).clamp(0.0, 1.0));
                // With both limits 41 of a frame's 64 bytes: it goes out as one of 48.
                if let Some(max_torque_nm) = c.limits.max_torque_nm {
                    w.float(max_torque_nm);
                }
                if let Some(watchdog_s) = c.limits.watchdog_s {
                    let one_float = subframe::WRITE | subframe::FLOAT | 1;
                    w.bytes(&[one_float, register::COMMAND_WATCHDOG as u8]).float(watchdog_s);
                }
            }
        }
        w.bytes(&QUERY);
        Ok(w.frame(ASK_FOR_REPLY | u32::from(self.host_id) << 8 | u32::from(id)))
    }

    fn reply_id(&self, frame: &Frame) -> Option<u8> {
        let ours = frame.fd && frame.id & 0x7f == u32::from(self.host_id) && frame.id & ASK_FOR_REPLY == 0;
        (ours && !frame.data().is_empty()).then_some((frame.id >> 8) as u8)
    }

    fn decode_reply(&self, _: &Ranges, frame: &Frame) -> Option<DriveReply> {
        let mut found = [None; 7];
        let whole = registers(frame.data(), subframe::REPLY, |register, value| match register {
            register::POSITION => found[0] = Some(value * TAU),
            register::VELOCITY => found[1] = Some(value * TAU),
            register::TORQUE => found[2] = Some(value),
            register::TEMPERATURE => found[3] = Some(value),
            register::FAULT => found[4] = Some(value),
            // A drive that answers is fed: nothing, and the sign of an overflow, are no voltage.
            register::VOLTAGE => found[5] = (value > 0.0).then_some(value * VOLTS_PER_STEP),
            register::Q_CURRENT => found[6] = Some(value),
            _ => {}
        });
        let [Some(position_rad), Some(velocity_rad_s), Some(torque_nm), temperature_c, error, supply_v, current_a] =
            found
        else {
            return None;
        };
        whole.then_some(DriveReply {
            position_rad,
            velocity_rad_s,
            torque_nm,
            temperature_c,
            error: error.map(|e| e as i8 as u8),
            supply_v,
            current_a,
        })
    }

    fn decode_request(&self, id: u8, r: &Ranges, frame: &Frame) -> Option<DriveRequest> {
        if !frame.fd || frame.id & 0x7f != u32::from(id) || frame.id & ASK_FOR_REPLY == 0 {
            return None;
        }
        let mut mode = None;
        let mut zero = false;
        let mut c = DriveCommand { kp: r.kp, kd: r.kd, ..DriveCommand::default() };
        let whole = registers(frame.data(), subframe::WRITE, |register, value| match register {
            register::MODE => mode = Some(value as i8 as u8),
            register::COMMAND_POSITION => c.position_rad = value * TAU,
            register::COMMAND_VELOCITY => c.velocity_rad_s = value * TAU,
            register::COMMAND_TORQUE => c.torque_nm = value,
            register::COMMAND_KP_SCALE => c.kp = value * r.kp,
            register::COMMAND_KD_SCALE => c.kd = value * r.kd,
            register::COMMAND_MAX_TORQUE => c.limits.max_torque_nm = Some(value),
            register::COMMAND_WATCHDOG => c.limits.watchdog_s = Some(value),
            register::SET_OUTPUT_EXACT => zero = true,
            _ => {}
        });
        match (whole, mode) {
            (false, _) => None,
            (_, Some(mode::POSITION)) => Some(DriveRequest::Command(c)),
            (_, Some(mode::STOPPED)) => Some(DriveRequest::Exit),
            (_, Some(mode::ZERO_VELOCITY)) => Some(DriveRequest::Enter),
            (_, None) if zero => Some(DriveRequest::SetZero),
            (_, None) if frame.data().starts_with(&QUERY) => Some(DriveRequest::Query),
            _ => None,
        }
    }

    fn encode_reply(&self, id: u8, _: &Ranges, reply: &DriveReply) -> Frame {
        let mut w = Writer::new();
        let byte = |value: f64| value.round().clamp(-128.0, 127.0) as i8 as u8;
        w.bytes(&[subframe::REPLY | subframe::FLOAT, 4, register::POSITION as u8])
            .float(reply.position_rad / TAU)
            .float(reply.velocity_rad_s / TAU)
            .float(reply.torque_nm)
            .float(reply.current_a.unwrap_or(f64::NAN))
            .bytes(&[subframe::REPLY | subframe::INT8 | 3, register::VOLTAGE as u8])
            .bytes(&[byte(reply.supply_v.unwrap_or(0.0) / VOLTS_PER_STEP)])
            .bytes(&[reply.temperature_c.unwrap_or(0.0).clamp(-128.0, 127.0) as i8 as u8, reply.error.unwrap_or(0)]);
        w.frame(u32::from(id) << 8 | u32::from(self.host_id))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::DriveLimits;
    use proptest::prelude::*;

    const RANGES: Ranges = Ranges { position_rad: 12.5, velocity_rad_s: 45.0, kp: 500.0, kd: 10.0, torque_nm: 90.0 };
    const P: Registers = Registers { host_id: 0 };

    /// Worked by hand from the manual: stop drive 1 and ask for its state.
    #[test]
    fn known_bytes() {
        let frame = P.encode_request(1, &RANGES, &DriveRequest::Exit).unwrap();
        assert_eq!(frame.id, 0x8001);
        assert_eq!(frame.data(), [0x01, 0x00, 0x00, 0x1c, 0x04, 0x01, 0x13, 0x0d]);
        let quarter = DriveCommand { position_rad: TAU / 4.0, kp: 250.0, kd: 10.0, ..DriveCommand::default() };
        let frame = P.encode_request(1, &RANGES, &DriveRequest::Command(quarter)).unwrap();
        assert_eq!(frame.data().len(), 32);
        assert_eq!(frame.data()[..6], [0x01, 0x00, 0x0a, 0x0c, 0x05, 0x20]);
        assert_eq!(frame.data()[6..10], 0.25_f32.to_le_bytes());
        assert_eq!(frame.data()[18..22], 0.5_f32.to_le_bytes());
        assert_eq!(frame.data()[31..], [0x50]);
    }

    #[test]
    fn every_request_and_reply_goes_there_and_back() {
        for request in [DriveRequest::Enter, DriveRequest::Exit, DriveRequest::SetZero] {
            let frame = P.encode_request(5, &RANGES, &request).unwrap();
            assert_eq!(P.decode_request(5, &RANGES, &frame), Some(request));
            assert_eq!(P.decode_request(4, &RANGES, &frame), None);
            assert_eq!(P.reply_id(&frame), None, "a request is no reply");
        }
        let reply = P.encode_reply(5, &RANGES, &DriveReply::default());
        assert_eq!(P.decode_request(0, &RANGES, &reply), None, "a reply is no request");
        let mut cut = Frame::new_fd(5 << 8, &reply.data()[..10], 0x50).unwrap();
        assert_eq!(P.decode_reply(&RANGES, &cut), None);
        cut.data_mut()[0] = 0x2c;
        assert_eq!(P.decode_reply(&RANGES, &cut), None);
    }

    proptest! {
        #[test]
        fn commands_survive_to_single_precision(
            p in -12.0..12.0f64, v in -40.0..40.0f64, kp in 0.0..500.0f64, kd in 0.0..10.0f64, t in -90.0..90.0f64,
            max in prop::option::of(0.1..90.0f64), watchdog in prop::option::of(0.001..1.0f64),
        ) {
            let limits = DriveLimits { max_torque_nm: max, watchdog_s: watchdog };
            let sent = DriveCommand { position_rad: p, velocity_rad_s: v, kp, kd, torque_nm: t, limits };
            let frame = P.encode_request(7, &RANGES, &DriveRequest::Command(sent)).unwrap();
            let Some(DriveRequest::Command(got)) = P.decode_request(7, &RANGES, &frame) else { panic!() };
            for (a, b) in [(got.position_rad, p), (got.velocity_rad_s, v), (got.kp, kp), (got.kd, kd), (got.torque_nm, t)] {
                prop_assert!((a - b).abs() < 1e-4, "{} for {}", a, b);
            }
            for (a, b) in [(got.limits.max_torque_nm, max), (got.limits.watchdog_s, watchdog)] {
                prop_assert_eq!(a.is_some(), b.is_some());
                prop_assert!((a.unwrap_or(0.0) - b.unwrap_or(0.0)).abs() < 1e-4, "{:?} for {:?}", a, b);
            }
            let reply = DriveReply {
                position_rad: p, velocity_rad_s: v, torque_nm: t, temperature_c: Some(35.0), error: Some(33),
                supply_v: Some(47.5), current_a: Some(-2.5),
            };
            let frame = P.encode_reply(7, &RANGES, &reply);
            prop_assert_eq!(P.reply_id(&frame), Some(7));
            let got = P.decode_reply(&RANGES, &frame).unwrap();
            prop_assert!((got.position_rad - p).abs() < 1e-5 && (got.velocity_rad_s - v).abs() < 1e-5);
            prop_assert_eq!((got.temperature_c, got.error), (Some(35.0), Some(33)));
            prop_assert_eq!((got.supply_v, got.current_a), (Some(47.5), Some(-2.5)));
        }

        #[test]
        fn no_frame_makes_it_panic(id in 0u32..0x1000_0000, data in prop::collection::vec(any::<u8>(), 0..=64)) {
            let frame = Frame::new_fd(id, &data, 0x50).unwrap();
            P.reply_id(&frame);
            P.decode_reply(&RANGES, &frame);
            P.decode_request((id & 0x7f) as u8, &RANGES, &frame);
        }
    }
}
