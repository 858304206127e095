//! Register frames against the crate of the drives' makers, both ways: what we write they read as it was meant, and
//! what they write we do.

use core::f64::consts::TAU;
use joint_bus::{DriveCommand, DriveLimits, DriveReply, DriveRequest, Frame, Protocol, Ranges, Registers};
use moteus_protocol::command::{OutputExactCommand, PositionCommand, PositionFormat, StopCommand, ZeroVelocityCommand};
use moteus_protocol::query::QueryResult;
use moteus_protocol::{CanFdFrame, Resolution, Subframe, SubframeType, Value, calculate_arbitration_id, parse_frame};
use proptest::prelude::*;
use std::collections::BTreeMap;

const CASES: u32 = 20_000;
const RANGES: Ranges = Ranges { position_rad: 12.5, velocity_rad_s: 45.0, kp: 500.0, kd: 10.0, torque_nm: 90.0 };
/// No-operation, which fills a frame up to a length of CAN FD.
const PAD: u8 = 0x50;

fn commands() -> impl Strategy<Value = DriveCommand> {
    let limits = (prop::option::of(0.01..200.0), prop::option::of(0.001..1.0));
    let numbers = (-15.0..15.0, -50.0..50.0, -10.0..600.0, -1.0..12.0, -100.0..100.0, limits);
    numbers.prop_map(|(position_rad, velocity_rad_s, kp, kd, torque_nm, (max_torque_nm, watchdog_s))| DriveCommand {
        position_rad,
        velocity_rad_s,
        kp,
        kd,
        torque_nm,
        limits: DriveLimits { max_torque_nm, watchdog_s },
    })
}

/// What a frame writes, by register, and what it asks for.
fn read(frame: &Frame) -> (BTreeMap<u16, Value>, Vec<(u16, Resolution)>) {
    let (mut written, mut asked) = (BTreeMap::new(), Vec::new());
    for subframe in parse_frame(frame.data()) {
        match subframe {
            Subframe::Register { subframe_type: SubframeType::Write, register, value: Some(value), .. } => {
                assert!(written.insert(register, value).is_none(), "register {register:#x} is written twice");
            }
            Subframe::Register { subframe_type: SubframeType::Read, register, resolution, .. } => {
                asked.push((register, resolution));
            }
            other => panic!("a request holds {other:?}"),
        }
    }
    (written, asked)
}

fn float(value: Option<&Value>) -> Option<f32> {
    value.map(|value| match value {
        Value::Float(value) => *value,
        other => panic!("{other:?} is no float"),
    })
}

/// What a command is on the wire, in their units: registers 0x20 to 0x25 and 0x27.
fn expected(c: &DriveCommand) -> [Option<f32>; 7] {
    let within = |value: f64, limit: f64| value.clamp(-limit, limit);
    [
        Some((within(c.position_rad, RANGES.position_rad) / TAU) as f32),
        Some((within(c.velocity_rad_s, RANGES.velocity_rad_s) / TAU) as f32),
        Some(within(c.torque_nm, RANGES.torque_nm) as f32),
        Some((c.kp / RANGES.kp).clamp(0.0, 1.0) as f32),
        Some((c.kd / RANGES.kd).clamp(0.0, 1.0) as f32),
        c.limits.max_torque_nm.map(|torque_nm| torque_nm as f32),
        c.limits.watchdog_s.map(|seconds| seconds as f32),
    ]
}

fn of_theirs(theirs: &CanFdFrame) -> Frame {
    Frame::new_fd(theirs.arbitration_id, theirs.payload(), PAD).unwrap()
}

/// A drive's answer in their writer's words: four floats from position on, three bytes from the voltage on.
fn their_reply([position, velocity, torque, current]: [f32; 4], [voltage, temperature, fault]: [i8; 3]) -> CanFdFrame {
    let mut frame = CanFdFrame::new();
    let mut writer = moteus_protocol::WriteCanData::new(&mut frame);
    writer.write_bytes(&[0x2c, 0x04, 0x01]);
    for value in [position, velocity, torque, current] {
        writer.write_f32(value);
    }
    writer.write_bytes(&[0x23, 0x0d]);
    writer.write_i8(voltage);
    writer.write_i8(temperature);
    writer.write_i8(fault);
    frame
}

fn near(a: f64, b: f64) -> bool {
    (a - b).abs() <= 1e-6 * (1.0 + b.abs())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(CASES))]

    #[test]
    fn they_read_our_commands_and_we_read_theirs(c in commands(), host_id in 0_u8..128, id in 1_u8..128) {
        let protocol = Registers { host_id };
        let frame = protocol.encode_request(id, &RANGES, &DriveRequest::Command(c)).unwrap();
        prop_assert!(frame.data().len() <= 48);
        prop_assert_eq!(frame.id, calculate_arbitration_id(host_id as i8, id as i8, 0, true));
        let (written, asked) = read(&frame);
        prop_assert_eq!(written[&0].to_i32(), 10, "mode position");
        let got = [0x20, 0x21, 0x22, 0x23, 0x24, 0x25, 0x27].map(|register| float(written.get(&register)));
        prop_assert_eq!(got, expected(&c));
        prop_assert_eq!(written.len(), 1 + got.iter().flatten().count(), "nothing else is written");
        let (float, byte) = (Resolution::Float, Resolution::Int8);
        let floats = [1, 2, 3, 4].map(|register| (register, float));
        prop_assert_eq!(asked, [&floats[..], &[0x0d, 0x0e, 0x0f].map(|register| (register, byte))].concat());

        // The same command by their writer: our drive follows it as ours.
        let [position, velocity, torque, kp, kd, max_torque, watchdog] = expected(&c);
        let mut theirs = PositionCommand::new();
        (theirs.position, theirs.velocity, theirs.feedforward_torque) = (position, velocity, torque);
        (theirs.kp_scale, theirs.kd_scale) = (kp, kd);
        (theirs.maximum_torque, theirs.watchdog_timeout) = (max_torque, watchdog);
        let mut sent = CanFdFrame::new();
        sent.arbitration_id = frame.id;
        theirs.serialize(&mut sent, &PositionFormat::default());
        prop_assert_eq!(
            protocol.decode_request(id, &RANGES, &of_theirs(&sent)),
            protocol.decode_request(id, &RANGES, &frame)
        );
    }

    #[test]
    fn they_read_our_replies_and_we_read_theirs(
        p in -2.0..2.0_f32, v in -8.0..8.0_f32, t in -100.0..100.0_f32, c in -40_i8..120, e in 0_i8..100, id in 1_u8..128,
        volts in 1_i8..=127, amperes in -60.0..60.0_f32,
    ) {
        let protocol = Registers { host_id: 0 };
        let reply = DriveReply {
            position_rad: f64::from(p) * TAU,
            velocity_rad_s: f64::from(v) * TAU,
            torque_nm: f64::from(t),
            temperature_c: Some(c.into()),
            error: Some(e as u8),
            supply_v: Some(0.5 * f64::from(volts)),
            current_a: Some(amperes.into()),
        };
        let frame = protocol.encode_reply(id, &RANGES, &reply);
        prop_assert_eq!(frame.id, calculate_arbitration_id(id as i8, 0, 0, false));
        let got = QueryResult::parse_data(frame.data());
        prop_assert_eq!((got.torque, got.fault, got.temperature), (t, e, f32::from(c)));
        prop_assert_eq!((got.q_current, got.voltage), (amperes, 0.5 * f32::from(volts)));
        prop_assert!(near(got.position.into(), p.into()) && near(got.velocity.into(), v.into()), "{:?}", got);

        let mut theirs = their_reply([p, v, t, amperes], [volts, c, e]);
        theirs.arbitration_id = calculate_arbitration_id(id as i8, 0, 0, false);
        let theirs = of_theirs(&theirs);
        prop_assert_eq!(protocol.reply_id(&theirs), Some(id));
        prop_assert_eq!(protocol.decode_reply(&RANGES, &theirs), Some(reply));
    }
}

#[test]
fn rest_enter_and_zero_are_theirs() {
    let protocol = Registers::default();
    let id = calculate_arbitration_id(0, 3, 0, true);
    let of = |write: &dyn Fn(&mut CanFdFrame)| {
        let mut frame = CanFdFrame::new();
        frame.arbitration_id = id;
        write(&mut frame);
        protocol.decode_request(3, &RANGES, &of_theirs(&frame))
    };
    assert_eq!(of(&|frame| StopCommand::serialize(frame)), Some(DriveRequest::Exit));
    let enter = of(&|frame| ZeroVelocityCommand::new().serialize(frame, &Default::default()));
    assert_eq!(enter, Some(DriveRequest::Enter));
    assert_eq!(of(&|frame| OutputExactCommand::new(0.0).serialize(frame)), Some(DriveRequest::SetZero));
    for (request, mode) in [(DriveRequest::Exit, 0), (DriveRequest::Enter, 12)] {
        let (written, _) = read(&protocol.encode_request(3, &RANGES, &request).unwrap());
        assert_eq!((written.len(), written[&0].to_i32()), (1, mode));
    }
    let (written, _) = read(&protocol.encode_request(3, &RANGES, &DriveRequest::SetZero).unwrap());
    assert_eq!((written.len(), float(written.get(&0x131))), (1, Some(0.0)));
}
