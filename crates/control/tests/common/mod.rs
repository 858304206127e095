//! What the controller's tests share: a configuration with the Vision 60's numbers, a gait, and a robot that obeys.
#![allow(dead_code)]

pub mod balanced;

use control::{
    Config, Controller, DriveMode, Fault, InertialState, Input, JOINTS, JointState, Mode, Output, Posture,
    PreparedGait, Request, Tilt,
};
use gait::{Gains, Gait, InitialState, Mirror, StepSide};
use std::time::Duration;

pub const PERIOD: Duration = Duration::from_millis(1);

pub fn each_leg(joint: [f64; 3]) -> [f64; JOINTS] {
    std::array::from_fn(|j| joint[j % 3])
}

/// Left legs as given, right legs mirrored.
pub fn both_sides(left: [f64; 3]) -> [f64; JOINTS] {
    std::array::from_fn(|j| if j >= 6 && j % 3 == 0 { -left[0] } else { left[j % 3] })
}

pub fn joint_names() -> [String; JOINTS] {
    let legs = ["front_left", "rear_left", "front_right", "rear_right"];
    let joints = ["hip_roll", "hip_pitch", "knee"];
    std::array::from_fn(|j| format!("{}_{}", legs[j / 3], joints[j % 3]))
}

pub fn config() -> Config {
    Config {
        robot: "vision60".into(),
        joint_names: joint_names(),
        drive_mode: DriveMode::Impedance,
        simulation_start: false,
        position_min_rad: each_leg([-0.43, -0.3, 0.25]),
        position_max_rad: each_leg([0.43, 2.2, 2.9]),
        soft_stop_rad: 0.04,
        velocity_limit_rad_s: each_leg([8.6, 30.0, 30.0]),
        torque_limit_nm: [87.5; JOINTS],
        torque_rate_nm_s: 1e5,
        stand: Posture {
            position_rad: both_sides([0.107, 0.9755, 1.951]),
            support_torque_nm: both_sides([13.0, 0.0, 18.0]),
        },
        sit: Posture { position_rad: both_sides([0.0, 0.16, 0.30]), support_torque_nm: both_sides([9.0, 0.0, 28.0]) },
        posture_kp: each_leg([230.0, 230.0, 300.0]),
        posture_kd: [5.0; JOINTS],
        damping_kd: [8.0; JOINTS],
        damping_torque_nm: 40.0,
        gain_ramp_s: 0.25,
        posture_speed_rad_s: 0.8,
        posture_min_s: 0.5,
        start_blend_s: 0.6,
        start_share: 0.3,
        start_growth_s: 2.0,
        stop_blend_s: 0.4,
        gait_change_position_rad: 0.08,
        gait_change_velocity_rad_s: 1.5,
        control_period_s: 0.001,
        state_timeout_s: 0.02,
        overrun_s: 0.05,
        tracking_error_rad: 0.35,
        tracking_error_s: 0.04,
        stuck_rad: 0.2,
        overspeed_s: 0.03,
        position_fault_rad: 0.3,
        tilt_limit_rad: 0.8,
        hot_c: 80.0,
        over_temperature_c: 95.0,
        rest_velocity_rad_s: 1.0,
        legs: None,
        body_range: Default::default(),
        balance: None,
    }
}

/// A stepping gait about `posture` (left legs), like the planner's: legs 1 and 2 stand and carry, legs 0 and 3 lift.
pub fn gait_at(name: &str, posture: [f64; 3], step_duration_s: f64) -> Gait {
    let at = both_sides(posture);
    let lift = both_sides([0.25, 0.0, -0.45]);
    let load = both_sides([-0.09, -0.04, 0.13]);
    let shape = [0.0, 0.0, 1.0, 1.0, 0.0, 0.0];
    let swings = |j: usize| matches!(j / 3, 0 | 3);
    let rows =
        std::array::from_fn(|j| std::array::from_fn(|i| at[j] + if swings(j) { lift[j] * shape[i] } else { 0.0 }));
    let reference = std::array::from_fn(|j| {
        let row: [f64; 6] = rows[j];
        row.map(|c| if swings(j) { c + 0.01 } else { c + load[j] })
    });
    let gait = Gait {
        robot: "vision60".into(),
        name: name.into(),
        joint_names: joint_names(),
        step_duration_s,
        step_length_m: 0.0,
        coefficients_rad: rows,
        mirror: Mirror { leg: [2, 3, 0, 1], sign: [-1.0, 1.0, 1.0] },
        initial: InitialState {
            base_position_m: [0.0, 0.0, 0.58],
            base_quaternion_xyzw: [0.0, 0.0, 0.0, 1.0],
            base_linear_velocity_world: [0.0; 3],
            base_angular_velocity_body: [0.0; 3],
            joint_position_rad: at,
            joint_velocity_rad_s: [0.0; JOINTS],
        },
        reference_coefficients_rad: reference,
        gains: Gains { kp: each_leg([230.0, 230.0, 300.0]), kd: [5.0; JOINTS] },
        torque_limit_nm: [50.0; JOINTS],
        ..Gait::from_json(include_str!("../../../../tests/gaits/amble.json")).unwrap()
    };
    gait.validate().unwrap();
    gait
}

pub fn gait() -> Gait {
    gait_at("stepping", [0.0977, 0.985, 1.997], 0.404)
}

pub fn prepared() -> PreparedGait {
    PreparedGait::new(&gait(), &config()).unwrap()
}

/// A controller and a robot whose joints go exactly where they are commanded (where they are commanded anything).
pub struct Bench {
    pub controller: Controller,
    pub now: Duration,
    pub position_rad: [f64; JOINTS],
    pub velocity_rad_s: [f64; JOINTS],
    /// Added to what is measured.
    pub disturbance_rad: [f64; JOINTS],
    /// False: the joints do not move.
    pub obeys: bool,
    /// False: no new state is measured.
    pub measures: bool,
    pub emergency_stop: bool,
    /// The base's roll, where an inertial unit reports it, rad.
    pub roll_rad: Option<f64>,
    pub last: Option<Output>,
}

impl Bench {
    pub fn new(config: Config) -> Self {
        Self {
            position_rad: config.sit.position_rad,
            controller: Controller::new(config).unwrap(),
            now: Duration::from_secs(10),
            velocity_rad_s: [0.0; JOINTS],
            disturbance_rad: [0.0; JOINTS],
            obeys: true,
            measures: true,
            emergency_stop: false,
            roll_rad: None,
            last: None,
        }
    }

    pub fn state(&self) -> JointState {
        JointState {
            stamp: self.now,
            arrived: [self.now; JOINTS],
            position_rad: std::array::from_fn(|j| self.position_rad[j] + self.disturbance_rad[j]),
            velocity_rad_s: self.velocity_rad_s,
            temperature_c: None,
            drive_error: [0; JOINTS],
        }
    }

    /// One cycle with these requests.
    pub fn cycle(&mut self, requests: &[Request], gait: Option<&PreparedGait>) -> Output {
        self.now += PERIOD;
        let state = self.state();
        let tilted = |roll_rad| InertialState::tilted(Tilt { roll_rad, pitch_rad: 0.0 }, self.now);
        let output = self.controller.step(
            &Input {
                joints: self.measures.then_some(&state),
                requests,
                gait,
                emergency_stop: self.emergency_stop,
                inertial: self.roll_rad.map(tilted),
                ..Input::default()
            },
            self.now,
        );
        if self.obeys {
            for j in 0..JOINTS {
                if output.mode.is_moving() {
                    self.position_rad[j] = output.command.position_rad[j];
                    self.velocity_rad_s[j] = output.command.velocity_rad_s[j];
                } else {
                    self.velocity_rad_s[j] = 0.0;
                }
            }
        }
        self.last = Some(output);
        output
    }

    pub fn ask(&mut self, request: Request) -> Result<Mode, control::Refusal> {
        self.cycle(&[request], None).replies[0].unwrap()
    }

    pub fn load(&mut self, gait: &PreparedGait) {
        self.cycle(&[], Some(gait));
    }

    /// Cycles until `mode`, at most `seconds`; the cycles that it took.
    pub fn until(&mut self, mode: Mode, seconds: f64) -> usize {
        let cycles = (seconds * 1000.0) as usize;
        for n in 0..cycles {
            if self.cycle(&[], None).mode == mode {
                return n + 1;
            }
        }
        panic!(
            "{mode:?} not reached in {seconds} s, is {:?}, faults {:?}",
            self.controller.mode(),
            self.last.map(|o| o.report)
        );
    }

    pub fn run(&mut self, cycles: usize) -> Output {
        for _ in 0..cycles {
            self.cycle(&[], None);
        }
        self.last.unwrap()
    }

    /// Armed, stood up, walking `gait` out of standing, in its first cycle.
    pub fn begun(gait: &PreparedGait) -> Self {
        let mut bench = Self::new(config());
        bench.load(gait);
        for request in [Request::Arm, Request::Stand, Request::Walk] {
            bench.ask(request).unwrap();
        }
        bench.until(Mode::Walking, 6.0);
        bench
    }

    /// Cycles of the present step until `step` begins.
    pub fn until_step(&mut self, step: u64) -> usize {
        let mut cycles = 0;
        while self.last.unwrap().step_index < step {
            self.cycle(&[], None);
            cycles += 1;
        }
        cycles
    }

    /// Another robot in this one's state, whose controller goes on from this one's snapshot.
    pub fn resumed(&self) -> Self {
        let text = serde_json::to_string(&self.controller.snapshot()).unwrap();
        let (now, position_rad, velocity_rad_s) = (self.now, self.position_rad, self.velocity_rad_s);
        let controller = Controller::resume(config(), &serde_json::from_str(&text).unwrap()).unwrap();
        Self { controller, now, position_rad, velocity_rad_s, ..Self::new(config()) }
    }

    /// Armed, stood up, walking.
    pub fn walking(config: Config) -> Self {
        let mut bench = Self::new(config);
        bench.load(&prepared());
        bench.ask(Request::Arm).unwrap();
        bench.ask(Request::Stand).unwrap();
        bench.ask(Request::Walk).unwrap();
        bench.until(Mode::Walking, 6.0);
        // Until the whole gait is walked: the first cycle of an even step.
        let grown = 2 * (bench.controller.config().start_growth_s / (2.0 * 0.404)).ceil() as u64;
        while bench.run(1).step_index < grown {}
        bench
    }
}

/// From standing into a walk of `gait`, until `step` begins, no joint's command jumps.
pub fn assert_begins_without_a_jump(gait: &PreparedGait, step: u64) {
    let mut b = Bench::new(config());
    b.load(gait);
    b.ask(Request::Arm).unwrap();
    b.ask(Request::Stand).unwrap();
    b.until(Mode::Standing, 6.0);
    b.ask(Request::Walk).unwrap();
    let mut last = b.last.unwrap();
    while b.controller.mode() != Mode::Walking || last.step_index < step {
        let output = b.cycle(&[], None);
        for j in 0..JOINTS {
            let jump = output.command.position_rad[j] - last.command.position_rad[j];
            assert!(jump.abs() < 0.006, "step {} joint {j} jumped {jump}", output.step_index);
            let jump = output.command.velocity_rad_s[j] - last.command.velocity_rad_s[j];
            assert!(jump.abs() < 0.3, "step {} joint {j}: velocity jumped {jump}", output.step_index);
        }
        last = output;
    }
}

/// The compensated law itself, as the paper writes it: kp (B̃ − q) + kd (dB̃/dt − q̇).
pub fn law(gait: &Gait, side: StepSide, s: f64, q: &[f64; JOINTS], v: &[f64; JOINTS]) -> [f64; JOINTS] {
    let (position, velocity) = gait.reference(side, s);
    std::array::from_fn(|j| gait.gains.kp[j] * (position[j] - q[j]) + gait.gains.kd[j] * (velocity[j] - v[j]))
}

/// Prints what a test of the fault matrix measured, and holds docs/safety.md to it: the row that names the test says
/// the number in its last column.
pub fn measured(test: &str, cycles: usize) {
    println!("{test}: {cycles} cycles");
    let page = include_str!("../../../../docs/safety.md");
    let name = format!("`{test}`");
    let row = page.lines().find(|line| line.starts_with('|') && line.contains(&name));
    let row = row.unwrap_or_else(|| panic!("docs/safety.md has no row for {name}, which measured {cycles}"));
    let cell = row.trim_end_matches('|').rsplit('|').next().unwrap_or_default();
    let stated = cell.split(|c: char| !c.is_ascii_digit()).any(|number| number == cycles.to_string());
    assert!(stated, "{name} measured {cycles} cycles, docs/safety.md says {cell:?}");
}

/// What an inertial unit without gyroscope and accelerometer says of a base that rolled so far.
pub fn rolled(roll_rad: f64) -> InertialState {
    InertialState::tilted(Tilt { roll_rad, pitch_rad: 0.0 }, Duration::ZERO)
}

/// A reproducible source of random numbers (xorshift).
pub struct Random(pub u64);

impl Random {
    pub fn next(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }
    pub fn share(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1_u64 << 53) as f64
    }
    pub fn one_in(&mut self, n: u64) -> bool {
        self.next().is_multiple_of(n)
    }
}

/// Whether the command is damping.
pub fn is_damping(output: &Output) -> bool {
    let c = &output.command;
    output.drives_on
        && c.kp == [0.0; JOINTS]
        && c.torque_nm == [0.0; JOINTS]
        && c.kd.iter().all(|kd| *kd > 0.0)
        && c.velocity_rad_s == [0.0; JOINTS]
}

/// Runs a walking robot with something spoiled each cycle, and returns the cycles until it is safe and the last output.
/// On the way no command breaks a limit.
pub fn cycles_to_safe(
    bench: &mut Bench,
    at_most: usize,
    mut spoil: impl FnMut(usize, &mut JointState, &mut Input<'_>, &mut Duration),
) -> (usize, Output) {
    let config = config();
    let mut last = bench.last.unwrap();
    for n in 0..at_most {
        bench.now += PERIOD;
        let mut state = bench.state();
        let mut input = Input::default();
        let mut now = bench.now;
        spoil(n, &mut state, &mut input, &mut now);
        let measures = bench.measures;
        input.joints = measures.then_some(&state);
        let output = bench.controller.step(&input, now);
        assert!(output.command.is_finite(), "cycle {n}");
        for j in 0..JOINTS {
            assert!(output.torque_nm[j].abs() <= config.torque_limit_nm[j] + 1e-9, "cycle {n} joint {j}");
            if output.mode.is_moving() && last.mode.is_moving() {
                let step = (output.command.position_rad[j] - last.command.position_rad[j]).abs();
                let limit = config.velocity_limit_rad_s[j] * config.control_period_s;
                assert!(step <= limit + 1e-12, "cycle {n} joint {j}: {step}");
            }
        }
        if output.mode.is_moving() && bench.obeys {
            bench.position_rad = output.command.position_rad;
            bench.velocity_rad_s = output.command.velocity_rad_s;
        }
        last = output;
        bench.last = Some(output);
        if !output.mode.is_moving() {
            assert!(is_damping(&output), "{:?}", output.command);
            return (n + 1, output);
        }
    }
    panic!("not safe after {at_most} cycles: {:?}", last.mode);
}

/// The robot is damped by this fault, and the message says so.
pub fn assert_fault(output: &Output, fault: Fault, joint: Option<usize>) {
    assert_eq!(output.mode, Mode::Fault);
    assert!(output.faults.contains(fault), "{:?}", output.faults);
    let report = output.report.unwrap();
    assert_eq!((report.fault, report.joint), (fault, joint));
    let text = report.message(&joint_names());
    assert!(text.contains(fault.name()), "{text}");
    if let Some(j) = joint {
        assert!(text.contains(&joint_names()[j]), "{text}");
    }
}
