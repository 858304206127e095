//! Every output of the controller over random days, as one number: a change of its code that is to change nothing
//! is held to that. Where behaviour changes on purpose the number changes with it, and the commit says why.

mod common;
use common::*;
use control::*;
use std::time::Duration;

/// What the programs reported before `controller.rs` was split by state.
const DIGEST: u64 = 0x2d46_f6ee_310d_f9b6;

const ROBOTS: u64 = 50;
const CYCLES: usize = 10_000;

/// FNV-1a, and what was seen.
struct Digest {
    hash: u64,
    modes: [u64; Mode::ALL.len()],
    faults: FaultSet,
}

impl Digest {
    fn bytes(&mut self, bytes: &[u8]) {
        for byte in bytes {
            self.hash = (self.hash ^ u64::from(*byte)).wrapping_mul(0x0000_0100_0000_01b3);
        }
    }

    fn numbers(&mut self, numbers: &[f64]) {
        for number in numbers {
            // Of what is not a number only that it is none.
            let bits = if number.is_nan() { u64::MAX } else { number.to_bits() };
            self.bytes(&bits.to_le_bytes());
        }
    }

    fn output(&mut self, output: &Output) {
        let c = &output.command;
        for values in [&c.position_rad, &c.velocity_rad_s, &c.kp, &c.kd, &c.torque_nm] {
            self.numbers(values);
        }
        self.numbers(&output.tracking_error_rad);
        self.numbers(&output.torque_nm);
        self.numbers(&[output.step_phase]);
        let report = output.report.map(|report| (report.fault, report.joint));
        let words = format!(
            "{:?}",
            (output.drives_on, output.mode, output.damping_reason, output.faults, report, output.replies)
        );
        self.bytes(words.as_bytes());
        let counts = (output.answered, output.step_index, output.cycles, output.stale_inputs);
        self.bytes(format!("{counts:?}").as_bytes());
        self.modes[Mode::ALL.iter().position(|mode| *mode == output.mode).unwrap()] += 1;
        output.faults.iter().for_each(|fault| _ = self.faults.insert(fault));
    }
}

/// What one cycle of a random day brings, besides the robot's own motion.
struct Day {
    random: Random,
    gaits: [PreparedGait; 3],
    requests: Vec<Request>,
    gait: Option<usize>,
    roll_rad: Option<f64>,
    fault: Option<FaultReport>,
    missing: bool,
}

impl Day {
    /// Half of the days are calm, so that they get far.
    fn turn(&mut self, b: &mut Bench, state: &mut JointState, calm: bool) {
        self.requests.clear();
        (self.gait, self.roll_rad, self.fault, self.missing) = (None, None, None, false);
        if b.emergency_stop && self.random.one_in(20) {
            b.emergency_stop = false;
        }
        if !self.random.one_in(if calm { 600 } else { 40 }) {
            return;
        }
        let joint = (self.random.next() % 12) as usize;
        match self.random.next() % if calm { 12 } else { 24 } {
            0 | 1 => self.requests.push(Request::Arm),
            2 | 3 => self.requests.push(Request::Stand),
            4 | 5 => self.requests.push(Request::Walk),
            6 => self.requests.extend([Request::Stop, Request::Walk]),
            7 => self.requests.push(Request::Sit),
            8 => self.gait = Some((self.random.next() % 3) as usize),
            9 => self.requests.extend([Request::Arm, Request::Stand, Request::Walk, Request::Stop]),
            10 => self.requests.extend(Fault::ALL.map(Request::ClearFault).into_iter().take(8)),
            11 => self.requests.extend(Fault::ALL.map(Request::ClearFault).into_iter().skip(8)),
            12 => self.requests.push(Request::Disarm),
            13 => state.position_rad[joint] = f64::NAN,
            14 => state.velocity_rad_s[joint] = 200.0 * (self.random.share() - 0.5),
            15 => state.position_rad[joint] += 3.0 * (self.random.share() - 0.5),
            16 => self.roll_rad = Some(2.0 * self.random.share()),
            17 => b.now += Duration::from_millis(self.random.next() % 100),
            18 => state.temperature_c = Some([60.0 + 40.0 * self.random.share(); JOINTS]),
            19 => b.emergency_stop = true,
            20 => {
                self.fault = Some(FaultReport { fault: Fault::BusDown, joint: Some(joint), value: 0.01, limit: 0.005 });
            }
            21 => state.drive_error[joint] = 3,
            22 => b.now -= Duration::from_millis(2),
            _ => self.missing = true,
        }
    }
}

fn live(seed: u64, digest: &mut Digest) {
    let c = config();
    let calm = seed.is_multiple_of(2);
    let drive_mode = if seed % 3 == 2 { DriveMode::Torque } else { DriveMode::Impedance };
    let mut b =
        Bench::new(Config { posture_speed_rad_s: 3.0, drive_mode, simulation_start: seed % 8 == 7, ..c.clone() });
    let mut day = Day {
        random: Random(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1),
        gaits: [
            prepared(),
            PreparedGait::new(&gait_at("other", [0.12, 1.0, 2.03], 0.37), &c).unwrap(),
            PreparedGait::new(&gait_at("far", [0.15, 1.1, 2.2], 0.31), &c).unwrap(),
        ],
        requests: Vec::new(),
        gait: None,
        roll_rad: None,
        fault: None,
        missing: false,
    };
    for n in 0..CYCLES {
        b.now += PERIOD;
        let mut state = b.state();
        day.turn(&mut b, &mut state, calm);
        if n == 3 && seed % 8 == 7 {
            day.gait = Some(0);
            day.requests.push(Request::StartOnGait);
        }
        // Late in a day a joint blocks, or turns too fast.
        let last = b.last.map(|last| (last.mode, last.step_index));
        let blocked = match seed % 10 {
            4 => matches!(last, Some((Mode::Walking, 6..))),
            6 => matches!(last, Some((Mode::StandingUp, _))) && n > 600,
            _ => false,
        };
        if n > CYCLES - 1000 && seed % 5 == 3 {
            state.velocity_rad_s[6] = 20.0;
        }
        // Every calm day begins with a walk.
        if calm && n == 20 {
            day.gait = Some(0);
            day.requests = vec![Request::Arm, Request::Stand, Request::Walk];
        }
        let input = Input {
            joints: (!day.missing).then_some(&state),
            inertial: day.roll_rad.map(rolled),
            requests: &day.requests,
            gait: day.gait.map(|n| &day.gaits[n]),
            emergency_stop: b.emergency_stop,
            fault: day.fault,
            ..Input::default()
        };
        let output = b.controller.step(&input, b.now);
        digest.output(&output);
        b.last = Some(output);
        // A robot that follows with some noise.
        for j in 0..JOINTS {
            b.velocity_rad_s[j] = 0.0;
            if output.mode.is_moving() && !(blocked && j == 2) {
                b.position_rad[j] = output.command.position_rad[j] + 0.01 * (day.random.share() - 0.5);
                b.velocity_rad_s[j] = output.command.velocity_rad_s[j].clamp(-0.9, 0.9);
            }
        }
    }
}

#[test]
fn random_days_give_to_the_bit_what_they_gave_before() {
    let mut digest = Digest { hash: 0xcbf2_9ce4_8422_2325, modes: [0; _], faults: FaultSet::default() };
    for seed in 1..=ROBOTS {
        live(seed, &mut digest);
    }
    println!("{:?} {:?}", digest.modes, digest.faults.iter().collect::<Vec<_>>());
    assert!(digest.modes.iter().all(|cycles| *cycles > 1000), "{:?}: the days do not go far", digest.modes);
    assert!(digest.faults.iter().count() == 14, "{:?}", digest.faults.iter().collect::<Vec<_>>());
    assert_eq!(digest.hash, DIGEST, "the digest is {:#018x}", digest.hash);
}
