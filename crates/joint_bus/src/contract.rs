//! What every backend must do, as one suite of checks that each backend's test runs.

use crate::{JointBus, Readings};
use joints::{JOINTS, JointCommand};
use std::time::Duration;

/// A backend with something at its far end.
pub trait ContractBench {
    /// The backend under test.
    fn bus(&mut self) -> &mut dyn JointBus;
    /// Lets the far end act by `now`: take what was sent and reply. Joint j is at `position_rad[j]`, moving at
    /// `velocity_rad_s[j]`; joint `silent` sends nothing. Returns the torque of each joint.
    fn act(
        &mut self,
        now: Duration,
        position_rad: &[f64; JOINTS],
        velocity_rad_s: &[f64; JOINTS],
        silent: Option<usize>,
    ) -> [f64; JOINTS];
    /// How exact the backend is: positions rad, torques N m.
    fn tolerance(&self) -> (f64, f64);
    /// How much earlier than its reading a reply may be stamped.
    fn earlier(&self) -> Duration {
        Duration::ZERO
    }
}

const MS: Duration = Duration::from_millis(1);

/// Runs the whole suite; panics with what failed.
///
/// # Panics
///
/// If the backend breaks the contract.
pub fn check_contract(bench: &mut impl ContractBench) {
    let mut suite = Suite {
        position_rad: std::array::from_fn(|j| 0.1 * (j as f64 + 1.0)),
        velocity_rad_s: std::array::from_fn(|j| 0.2 * (5.0 - j as f64)),
        now: Duration::from_secs(1),
        readings: Readings::default(),
        bench,
    };
    // Nothing is there before anyone has sent, and reading returns at once.
    suite.bench.bus().read(suite.now, &mut suite.readings);
    assert_eq!(suite.readings.joint_state(), None, "readings out of nothing");
    suite.drives_at_rest();
    let command = suite.drives_on();
    suite.a_silent_joint(&command);
    // Reading twice brings nothing new.
    let before = suite.readings;
    suite.bench.bus().read(suite.now, &mut suite.readings);
    assert_eq!(suite.readings, before);
    assert_eq!(suite.bench.bus().fault(suite.now), None);
    suite.drives_off_again(&command);
}

struct Suite<'a, B> {
    bench: &'a mut B,
    position_rad: [f64; JOINTS],
    velocity_rad_s: [f64; JOINTS],
    now: Duration,
    readings: Readings,
}

impl<B: ContractBench> Suite<'_, B> {
    /// So many cycles of `command`; the torques of the last one.
    fn run(&mut self, cycles: usize, command: &JointCommand, drives_on: bool, silent: Option<usize>) -> [f64; JOINTS] {
        let mut torque = [0.0; JOINTS];
        for _ in 0..cycles {
            self.now += MS;
            self.bench.bus().write(command, drives_on, self.now);
            torque = self.bench.act(self.now, &self.position_rad, &self.velocity_rad_s, silent);
            self.bench.bus().read(self.now, &mut self.readings);
        }
        torque
    }

    fn arrived_at(&self, arrived: Duration, now: Duration) -> bool {
        arrived <= now && arrived + self.bench.earlier() >= now
    }

    /// Drives at rest report where they are and give no torque, whatever the command.
    fn drives_at_rest(&mut self) {
        let (position_tolerance, _) = self.bench.tolerance();
        let push = JointCommand { torque_nm: [10.0; JOINTS], ..JointCommand::LIMP };
        for _ in 0..3 {
            assert_eq!(self.run(1, &push, false, None), [0.0; JOINTS], "torque with the drives off");
        }
        let state = self.readings.joint_state().expect("all joints reply at rest");
        for j in 0..JOINTS {
            let (q, v) = (state.position_rad[j], state.velocity_rad_s[j]);
            assert!((q - self.position_rad[j]).abs() <= position_tolerance, "joint {j}: position {q}");
            assert!((v - self.velocity_rad_s[j]).abs() <= 0.03, "joint {j}: velocity {v}");
            let arrived = state.arrived[j];
            assert!(self.arrived_at(arrived, self.now), "joint {j} at {arrived:?}, now {:?}", self.now);
        }
    }

    /// Drives that are on follow the law, each joint its own, sign and gear included.
    fn drives_on(&mut self) -> JointCommand {
        let (_, torque_tolerance) = self.bench.tolerance();
        let (q, v) = (self.position_rad, self.velocity_rad_s);
        let command = JointCommand {
            position_rad: std::array::from_fn(|j| q[j] + 0.02 * (j as f64 - 6.0)),
            velocity_rad_s: std::array::from_fn(|j| v[j] - 0.1 * j as f64),
            kp: std::array::from_fn(|j| 100.0 + 15.0 * j as f64),
            kd: std::array::from_fn(|j| 1.0 + 0.3 * j as f64),
            torque_nm: std::array::from_fn(|j| 3.0 * (j as f64 - 5.0)),
        };
        let torque = self.run(5, &command, true, None);
        for (j, law) in command.torque(&q, &v).into_iter().enumerate() {
            assert!((torque[j] - law).abs() <= torque_tolerance, "joint {j}: {} N m instead of {law}", torque[j]);
        }
        command
    }

    /// A joint that falls silent is seen as silent, and the others are not.
    fn a_silent_joint(&mut self, command: &JointCommand) {
        let since = self.now;
        self.run(10, command, true, Some(4));
        let state = self.readings.joint_state().expect("every joint was received once");
        let silent = state.arrived[4];
        assert!(self.arrived_at(silent, since), "the silent joint: {silent:?}, since {since:?}");
        let others = (0..JOINTS).filter(|j| *j != 4).all(|j| self.arrived_at(state.arrived[j], self.now));
        assert!(others, "the others: {:?}, now {:?}", state.arrived, self.now);
    }

    fn drives_off_again(&mut self, command: &JointCommand) {
        let torque = self.run(3, command, false, None);
        assert_eq!(torque, [0.0; JOINTS], "torque after the drives were commanded to rest");
    }
}
