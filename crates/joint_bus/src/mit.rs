//! The layout of the MIT mini-cheetah's actuators, as its firmware and several vendors' drives speak it.
//!
//! Command, 8 bytes to the drive's identifier: position 16 bits, velocity 12, kp 12, kd 12, torque 12, each the share
//! of its range, most significant bits first. Reply, 6 bytes from the host's identifier: drive, position 16, velocity
//! 12, torque 12; or 8 bytes with temperature (signed, °C) and error code. Special commands are seven bytes FF and FC
//! (enter), FD (exit) or FE (zero): a command whose numbers would spell one is sent one step of torque lower.

use crate::{DriveCommand, DriveLimits, DriveReply, DriveRequest, EncodeError, Frame, Protocol, Ranges};

/// The protocol. Drives reply to identifier `host_id`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Mit {
    /// Identifier of replies; the mini-cheetah's is 0.
    pub host_id: u32,
    /// Whether drives append temperature and error to their replies.
    pub long_replies: bool,
}

impl Default for Mit {
    fn default() -> Self {
        Self { host_id: 0, long_replies: true }
    }
}

const ENTER: u8 = 0xfc;
const EXIT: u8 = 0xfd;
const ZERO: u8 = 0xfe;

/// The nearest of 2^bits values that share [low, high] evenly, both ends among them.
fn quantise(value: f64, low: f64, high: f64, bits: u32) -> u32 {
    let steps = f64::from((1_u32 << bits) - 1);
    let share = (value.clamp(low, high) - low) / (high - low);
    // `round` needs the standard library; the number is not negative, so adding a half and cutting is the same.
    (share * steps + 0.5) as u32
}

fn restore(code: u32, low: f64, high: f64, bits: u32) -> f64 {
    let steps = f64::from((1_u32 << bits) - 1);
    low + f64::from(code) / steps * (high - low)
}

fn special(last: u8) -> [u8; 8] {
    [0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, last]
}

fn pack(r: &Ranges, c: &DriveCommand) -> [u8; 8] {
    let position = quantise(c.position_rad, -r.position_rad, r.position_rad, 16);
    let velocity = quantise(c.velocity_rad_s, -r.velocity_rad_s, r.velocity_rad_s, 12);
    let kp = quantise(c.kp, 0.0, r.kp, 12);
    let kd = quantise(c.kd, 0.0, r.kd, 12);
    let torque = quantise(c.torque_nm, -r.torque_nm, r.torque_nm, 12);
    let word = (u64::from(position) << 48)
        | (u64::from(velocity) << 36)
        | (u64::from(kp) << 24)
        | (u64::from(kd) << 12)
        | u64::from(torque);
    let mut data = word.to_be_bytes();
    if data[..7] == special(0)[..7] && data[7] >= ENTER {
        // Every number at its end: it would be taken for a special command.
        data[7] = ENTER - 1;
    }
    data
}

impl Protocol for Mit {
    /// Each of its frames is an order.
    fn has_query(&self) -> bool {
        false
    }

    fn encode_request(&self, id: u8, ranges: &Ranges, request: &DriveRequest) -> Result<Frame, EncodeError> {
        let data = match request {
            DriveRequest::Enter => special(ENTER),
            DriveRequest::Exit => special(EXIT),
            DriveRequest::SetZero => special(ZERO),
            DriveRequest::Query => return Err(EncodeError { field: "a query in MIT frames", value: f64::NAN }),
            DriveRequest::Command(command) => {
                command.check()?;
                pack(ranges, command)
            }
        };
        Ok(Frame::unchecked(id.into(), false, false, &data))
    }

    fn reply_id(&self, frame: &Frame) -> Option<u8> {
        let ours = !frame.fd && !frame.extended && frame.id == self.host_id;
        (ours && matches!(frame.data().len(), 6 | 8)).then(|| frame.data()[0])
    }

    fn decode_reply(&self, r: &Ranges, frame: &Frame) -> Option<DriveReply> {
        let d = frame.data();
        if !matches!(d.len(), 6 | 8) {
            return None;
        }
        let position = u32::from(d[1]) << 8 | u32::from(d[2]);
        let velocity = u32::from(d[3]) << 4 | u32::from(d[4]) >> 4;
        let torque = u32::from(d[4] & 0xf) << 8 | u32::from(d[5]);
        Some(DriveReply {
            position_rad: restore(position, -r.position_rad, r.position_rad, 16),
            velocity_rad_s: restore(velocity, -r.velocity_rad_s, r.velocity_rad_s, 12),
            torque_nm: restore(torque, -r.torque_nm, r.torque_nm, 12),
            temperature_c: d.get(6).map(|t| f64::from(*t as i8)),
            error: d.get(7).copied(),
            supply_v: None,
            current_a: None,
        })
    }

    fn decode_request(&self, id: u8, r: &Ranges, frame: &Frame) -> Option<DriveRequest> {
        let data: [u8; 8] = frame.data().try_into().ok()?;
        if frame.fd || frame.extended || frame.id != u32::from(id) {
            return None;
        }
        if data[..7] == special(0)[..7] {
            match data[7] {
                ENTER => return Some(DriveRequest::Enter),
                EXIT => return Some(DriveRequest::Exit),
                ZERO => return Some(DriveRequest::SetZero),
                _ => {}
            }
        }
        let word = u64::from_be_bytes(data);
        let bits = |shift: u32, count: u32| ((word >> shift) & ((1 << count) - 1)) as u32;
        Some(DriveRequest::Command(DriveCommand {
            position_rad: restore(bits(48, 16), -r.position_rad, r.position_rad, 16),
            velocity_rad_s: restore(bits(36, 12), -r.velocity_rad_s, r.velocity_rad_s, 12),
            kp: restore(bits(24, 12), 0.0, r.kp, 12),
            kd: restore(bits(12, 12), 0.0, r.kd, 12),
            torque_nm: restore(bits(0, 12), -r.torque_nm, r.torque_nm, 12),
            limits: DriveLimits::default(),
        }))
    }

    fn encode_reply(&self, id: u8, r: &Ranges, reply: &DriveReply) -> Frame {
        let position = quantise(reply.position_rad, -r.position_rad, r.position_rad, 16);
        let velocity = quantise(reply.velocity_rad_s, -r.velocity_rad_s, r.velocity_rad_s, 12);
        let torque = quantise(reply.torque_nm, -r.torque_nm, r.torque_nm, 12);
        let temperature = reply.temperature_c.unwrap_or(0.0).clamp(-128.0, 127.0) as i8;
        let data = [
            id,
            (position >> 8) as u8,
            position as u8,
            (velocity >> 4) as u8,
            ((velocity & 0xf) << 4 | torque >> 8) as u8,
            torque as u8,
            temperature as u8,
            reply.error.unwrap_or(0),
        ];
        let length = if self.long_replies { 8 } else { 6 };
        Frame::unchecked(self.host_id, false, false, &data[..length])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const RANGES: Ranges = Ranges { position_rad: 12.5, velocity_rad_s: 45.0, kp: 500.0, kd: 10.0, torque_nm: 90.0 };
    const MIT: Mit = Mit { host_id: 0, long_replies: true };

    /// Worked by hand from the layout: half of each range.
    #[test]
    fn known_bytes() {
        let command = DriveCommand {
            position_rad: 12.5,
            velocity_rad_s: -45.0,
            kp: 250.0,
            kd: 0.0,
            torque_nm: 90.0,
            ..DriveCommand::default()
        };
        let frame = MIT.encode_request(3, &RANGES, &DriveRequest::Command(command)).unwrap();
        assert_eq!(frame.id, 3);
        // position ffff, velocity 000, kp 800 (2047.5 rounded up), kd 000, torque fff
        assert_eq!(frame.data(), [0xff, 0xff, 0x00, 0x08, 0x00, 0x00, 0x0f, 0xff]);
        for (request, last) in [(DriveRequest::Enter, 0xfc), (DriveRequest::Exit, 0xfd), (DriveRequest::SetZero, 0xfe)]
        {
            let frame = MIT.encode_request(3, &RANGES, &request).unwrap();
            assert_eq!(frame.data(), special(last));
            assert_eq!(MIT.decode_request(3, &RANGES, &frame), Some(request));
        }
        let reply = Frame::new(0, &[3, 0x80, 0x00, 0x7f, 0xf8, 0x00, 41, 2]).unwrap();
        let decoded = MIT.decode_reply(&RANGES, &reply).unwrap();
        assert!(decoded.position_rad.abs() < 4e-4 && decoded.torque_nm.abs() < 0.05);
        assert_eq!((decoded.temperature_c, decoded.error), (Some(41.0), Some(2)));
        let short = Frame::new(0, &reply.data()[..6]).unwrap();
        let decoded = MIT.decode_reply(&RANGES, &short).unwrap();
        assert_eq!((decoded.temperature_c, decoded.error), (None, None));
    }

    #[test]
    fn a_command_is_never_taken_for_a_special_one() {
        let all = DriveCommand {
            position_rad: 99.0,
            velocity_rad_s: 99.0,
            kp: 999.0,
            kd: 99.0,
            torque_nm: 999.0,
            ..DriveCommand::default()
        };
        let frame = MIT.encode_request(1, &RANGES, &DriveRequest::Command(all)).unwrap();
        assert!(matches!(MIT.decode_request(1, &RANGES, &frame), Some(DriveRequest::Command(_))));
    }

    #[test]
    fn numbers_that_are_not_finite_are_refused_by_name() {
        let bad = DriveCommand { kd: f64::NAN, ..DriveCommand::default() };
        let e = MIT.encode_request(1, &RANGES, &DriveRequest::Command(bad)).unwrap_err();
        assert_eq!(e.field, "kd");
    }

    #[test]
    fn frames_of_others_are_left_alone() {
        assert_eq!(MIT.reply_id(&Frame::new(5, &[1; 8]).unwrap()), None);
        assert_eq!(MIT.reply_id(&Frame::new(0, &[1; 7]).unwrap()), None);
        assert_eq!(MIT.reply_id(&Frame::new_fd(0, &[1; 8], 0).unwrap()), None);
        assert_eq!(MIT.decode_request(2, &RANGES, &Frame::new(3, &[0; 8]).unwrap()), None);
    }

    proptest! {
        #[test]
        fn commands_survive_to_half_a_step(
            p in -15.0..15.0f64, v in -50.0..50.0f64, kp in -10.0..600.0f64, kd in -1.0..12.0f64, t in -100.0..100.0f64,
        ) {
            let sent = DriveCommand { position_rad: p, velocity_rad_s: v, kp, kd, torque_nm: t, ..DriveCommand::default() };
            let frame = MIT.encode_request(7, &RANGES, &DriveRequest::Command(sent)).unwrap();
            let Some(DriveRequest::Command(got)) = MIT.decode_request(7, &RANGES, &frame) else { panic!() };
            prop_assert!((got.position_rad - p.clamp(-12.5, 12.5)).abs() <= 12.5 / 65535.0 + 1e-12);
            prop_assert!((got.velocity_rad_s - v.clamp(-45.0, 45.0)).abs() <= 45.0 / 4095.0 + 1e-12);
            prop_assert!((got.kp - kp.clamp(0.0, 500.0)).abs() <= 250.0 / 4095.0 + 1e-12);
            prop_assert!((got.kd - kd.clamp(0.0, 10.0)).abs() <= 5.0 / 4095.0 + 1e-12);
            // One more step: the way out of a special command.
            prop_assert!((got.torque_nm - t.clamp(-90.0, 90.0)).abs() <= 3.0 * 90.0 / 4095.0 + 1e-12);
        }

        #[test]
        fn replies_survive_to_half_a_step(
            p in -12.5..12.5f64, v in -45.0..45.0f64, t in -90.0..90.0f64, c in -40i8..120, e in any::<u8>(),
        ) {
            let sent = DriveReply {
                position_rad: p, velocity_rad_s: v, torque_nm: t, temperature_c: Some(c.into()), error: Some(e),
                ..DriveReply::default()
            };
            let frame = MIT.encode_reply(9, &RANGES, &sent);
            prop_assert_eq!(MIT.reply_id(&frame), Some(9));
            let got = MIT.decode_reply(&RANGES, &frame).unwrap();
            prop_assert!((got.position_rad - p).abs() <= 12.5 / 65535.0 + 1e-12);
            prop_assert!((got.velocity_rad_s - v).abs() <= 45.0 / 4095.0 + 1e-12);
            prop_assert!((got.torque_nm - t).abs() <= 90.0 / 4095.0 + 1e-12);
            prop_assert_eq!((got.temperature_c, got.error), (Some(f64::from(c)), Some(e)));
        }

        #[test]
        fn no_frame_makes_it_panic(id in 0u32..0x800, data in prop::collection::vec(any::<u8>(), 0..=8)) {
            let frame = Frame::new(id, &data).unwrap();
            if MIT.reply_id(&frame).is_some() {
                let reply = MIT.decode_reply(&RANGES, &frame).unwrap();
                prop_assert!(reply.position_rad.is_finite() && reply.torque_nm.abs() <= 90.0 + 1e-9);
            }
            MIT.decode_request(data.first().copied().unwrap_or(0), &RANGES, &frame);
        }
    }
}
