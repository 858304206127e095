//! The balanced law by itself: no allocation, to the bit from its record, and the plan where nothing disturbs.
//! What it survives is tested in MuJoCo (nodes/sim_bridge/tests/trial.rs).

use control::balanced::{Balance, BalanceConfig, Cycle};
use control::{Config, InertialState, Instant, JOINTS, PreparedGait, Step, Velocity};
use estimator::{Estimator, Health};
use gait::Gait;
use robot::Robot;
use std::time::Duration;

#[global_allocator]
static ALLOCATOR: realtime::CountingAllocator = realtime::CountingAllocator;

struct Bench {
    config: Config,
    balance: BalanceConfig,
    gait: PreparedGait,
}

impl Bench {
    fn new() -> Self {
        let robot = Robot::from_toml_str(
            include_str!("../../../config/robots/vision60/robot.toml"),
            include_str!("../../../config/robots/vision60/vision60.urdf"),
        )
        .unwrap();
        let config = Config::for_robot(&robot);
        let gait = Gait::from_json(include_str!("../../../tests/gaits/amble.json")).unwrap();
        Self {
            balance: BalanceConfig::for_robot(&robot).unwrap(),
            gait: PreparedGait::new(&gait, &config).unwrap(),
            config,
        }
    }

    fn cycle<'a>(&'a self, position_rad: &'a [f64; JOINTS], estimate: &'a Estimator) -> Cycle<'a> {
        Cycle {
            config: &self.balance,
            gait: &self.gait,
            position_rad,
            velocity_limit_rad_s: &self.config.velocity_limit_rad_s,
            estimate,
            share: 1.0,
            dt_s: 1e-3,
        }
    }

    /// Runs `cycles` cycles of joints that follow perfectly on a base that is level but for `roll_rad`, and moves
    /// at `speed_m_s`.
    fn run(&self, memory: &mut Memory, cycles: u32, roll_rad: f64, speed_m_s: f64) -> Instant {
        self.accelerated(memory, cycles, roll_rad, speed_m_s, 0.0)
    }

    /// The same while the base speeds up by `ahead_m_s2`: `speed_m_s` is what its legs measure.
    fn accelerated(&self, memory: &mut Memory, cycles: u32, roll_rad: f64, speed_m_s: f64, ahead_m_s2: f64) -> Instant {
        let half = 0.5 * roll_rad;
        let mut last = None;
        for _ in 0..cycles {
            let unit = InertialState {
                stamp: Duration::ZERO,
                arrived: Duration::ZERO,
                attitude_xyzw: Some([half.sin(), 0.0, 0.0, half.cos()]),
                angular_velocity_rad_s: Some([0.0; 3]),
                acceleration_m_s2: Some([ahead_m_s2, 9.81 * roll_rad.sin(), 9.81 * roll_rad.cos()]),
            };
            // Velocities of joints that walk at the speed given.
            let at = self.gait.at_step(memory.step(&self.gait), memory.phase());
            let velocity = at.velocity_rad_s.map(|v| v * speed_m_s / 0.35);
            let (swings, phase) = (memory.swings(&self.gait), Some(memory.phase()));
            let joints = (&at.position_rad, &velocity);
            self.balance.estimate(
                &mut memory.estimate,
                joints,
                estimator::Inertial::of(&unit, Duration::ZERO),
                swings,
                phase,
                1e-3,
            );
            assert_eq!(memory.estimate.health(), Health::Good);
            let cycle = self.cycle(&at.position_rad, &memory.estimate);
            let balance = memory.balance.get_or_insert_with(|| Balance::start(&cycle, true));
            balance.advance(&cycle);
            let asked = Velocity { forward_m_s: 0.35, ..Velocity::default() };
            last = Some(balance.step(&cycle, &asked));
        }
        last.unwrap()
    }
}

#[derive(Clone, Copy, Default, PartialEq, Debug, serde::Serialize, serde::Deserialize)]
struct Memory {
    estimate: Estimator,
    balance: Option<Balance>,
}

impl Memory {
    fn step(&self, gait: &PreparedGait) -> Step {
        self.balance.as_ref().map_or(Step::Cycle(0), |balance| balance.present_step(gait))
    }

    fn phase(&self) -> f64 {
        self.balance.as_ref().map_or(0.0, Balance::phase)
    }

    fn swings(&self, gait: &PreparedGait) -> [bool; 4] {
        self.balance.as_ref().map_or([true, false, false, true], |balance| balance.swings(gait))
    }
}

#[test]
fn a_cycle_allocates_nothing_not_even_at_switches() {
    let bench = Bench::new();
    let mut memory = Memory::default();
    bench.run(&mut memory, 1, 0.0, 0.35);
    let before = realtime::allocations_of_this_thread();
    bench.run(&mut memory, 3000, 0.05, 0.35);
    assert_eq!(realtime::allocations_of_this_thread(), before);
    assert!(memory.balance.unwrap().steps() > 5);
}

/// Written down in the middle of a step and read again, it goes on to the bit.
#[test]
fn it_goes_on_from_its_record_to_the_bit() {
    let bench = Bench::new();
    let mut first = Memory::default();
    bench.run(&mut first, 500, 0.03, 0.3);
    let mut second: Memory = serde_json::from_str(&serde_json::to_string(&first).unwrap()).unwrap();
    assert_eq!(bench.run(&mut first, 1500, 0.03, 0.3), bench.run(&mut second, 1500, 0.03, 0.3));
    assert_eq!(first, second);
}

/// On the plan, level and at the plan's pace, it asks for nearly what the plan asks for.
#[test]
fn where_nothing_disturbs_the_plan_is_walked() {
    let bench = Bench::new();
    let mut memory = Memory::default();
    let asked = bench.run(&mut memory, 150, 0.0, 0.35);
    let plan = bench.gait.at_step(memory.step(&bench.gait), memory.phase());
    for j in 0..JOINTS {
        let away = asked.position_rad[j] - plan.position_rad[j];
        assert!(away.abs() < 0.06, "joint {j}: {away} rad");
    }
    let report = *memory.balance.unwrap().report();
    assert!(report.pace == 1.0 && !report.placement_limited && !report.hurry_limited, "{report:?}");
}

/// A base that is pushed far from its toes' line is caught: the step is hurried and its toes placed at the range's
/// end, never further, and no hurried joint is asked to move faster than its limit. Legs and accelerometer tell of
/// the push alike: where they contradict each other the estimator does not believe the legs, and nothing is far.
#[test]
fn what_is_too_far_is_hurried_and_placed_within_bounds() {
    const PUSH_M_S2: f64 = 20.0;
    const PUSH_CYCLES: u32 = 100;
    let bench = Bench::new();
    let mut memory = Memory::default();
    bench.run(&mut memory, 60, 0.0, 0.35);
    let mut seen = (false, false);
    for n in 1..=300 {
        let speed_m_s = 0.35 + PUSH_M_S2 * 1e-3 * f64::from(n.min(PUSH_CYCLES));
        let pushed_m_s2 = if n <= PUSH_CYCLES { PUSH_M_S2 } else { 0.0 };
        let asked = bench.accelerated(&mut memory, 1, 0.0, speed_m_s, pushed_m_s2);
        let balance = memory.balance.as_ref().unwrap();
        let report = balance.report();
        let [x, y] = report.placement_m;
        assert!(x.hypot(y) <= 0.36 * balance.height_m() + 1e-12, "{report:?}");
        assert!((1.0..=4.0 + 1e-9).contains(&report.pace), "{report:?}");
        let at_end = x.hypot(y) > 0.36 * balance.height_m() - 1e-9;
        seen = (seen.0 || (report.placement_limited && at_end), seen.1 || report.pace > 1.0);
        for j in 0..JOINTS {
            let velocity = asked.velocity_rad_s[j];
            assert!(asked.position_rad[j].is_finite() && velocity.is_finite() && asked.torque_nm[j].is_finite());
            let limit = bench.config.velocity_limit_rad_s[j];
            assert!(
                report.pace <= 1.0 + 1e-9 || velocity.abs() <= limit,
                "cycle {n} joint {j}: {velocity} of {limit} rad/s, {report:?}"
            );
        }
    }
    assert_eq!(seen, (true, true), "{:?}", memory.balance.unwrap().report());
}

#[test]
fn constants_that_cannot_be_are_named() {
    let bench = Bench::new();
    assert_eq!(bench.balance.problem(), None);
    let mut bad = bench.balance;
    bad.placement_gain = f64::NAN;
    assert_eq!(bad.problem().unwrap().0, "balance.placement_gain");
    bad = bench.balance;
    bad.estimator.velocity_s = 0.0;
    assert!(bad.problem().unwrap().1.starts_with("velocity_s is 0"));
}
