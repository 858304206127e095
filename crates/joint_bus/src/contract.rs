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
    let (position_tolerance, torque_tolerance) = bench.tolerance();
    let earlier = bench.earlier();
    let arrived_at = |arrived: Duration, now: Duration| arrived <= now && arrived + earlier >= now;
    let q: [f64; JOINTS] = std::array::from_fn(|j| 0.1 * (j as f64 + 1.0));
    let v: [f64; JOINTS] = std::array::from_fn(|j| 0.2 * (5.0 - j as f64));
    let mut now = Duration::from_secs(1);
    let mut readings = Readings::default();

    // Nothing is there before anyone has spoken, and reading returns at once.
    bench.bus().read(now, &mut readings);
    assert_eq!(readings.joint_state(), None, "readings out of nothing");

    // Drives at rest: they say where they are and give no torque, whatever the command.
    let push = JointCommand { torque_nm: [10.0; JOINTS], ..JointCommand::LIMP };
    for _ in 0..3 {
        now += MS;
        bench.bus().write(&push, false, now);
        assert_eq!(bench.act(now, &q, &v, None), [0.0; JOINTS], "torque with the drives off");
        bench.bus().read(now, &mut readings);
    }
    let state = readings.joint_state().expect("all joints reply at rest");
    for j in 0..JOINTS {
        assert!(
            (state.position_rad[j] - q[j]).abs() <= position_tolerance,
            "joint {j}: position {}",
            state.position_rad[j]
        );
        assert!((state.velocity_rad_s[j] - v[j]).abs() <= 0.03, "joint {j}: velocity {}", state.velocity_rad_s[j]);
        assert!(arrived_at(state.arrived[j], now), "joint {j} at {:?}, now {now:?}", state.arrived[j]);
    }

    // Drives on: they follow the law, each joint its own, sign and gear included.
    let command = JointCommand {
        position_rad: std::array::from_fn(|j| q[j] + 0.02 * (j as f64 - 6.0)),
        velocity_rad_s: std::array::from_fn(|j| v[j] - 0.1 * j as f64),
        kp: std::array::from_fn(|j| 100.0 + 15.0 * j as f64),
        kd: std::array::from_fn(|j| 1.0 + 0.3 * j as f64),
        torque_nm: std::array::from_fn(|j| 3.0 * (j as f64 - 5.0)),
    };
    let mut torque = [0.0; JOINTS];
    for _ in 0..5 {
        now += MS;
        bench.bus().write(&command, true, now);
        torque = bench.act(now, &q, &v, None);
        bench.bus().read(now, &mut readings);
    }
    for (j, law) in command.torque(&q, &v).into_iter().enumerate() {
        assert!((torque[j] - law).abs() <= torque_tolerance, "joint {j}: {} N m instead of {law}", torque[j]);
    }

    // A joint that falls silent is seen as silent, and the others are not.
    let since = now;
    for _ in 0..10 {
        now += MS;
        bench.bus().write(&command, true, now);
        bench.act(now, &q, &v, Some(4));
        bench.bus().read(now, &mut readings);
    }
    let state = readings.joint_state().expect("every joint was received once");
    assert!(arrived_at(state.arrived[4], since), "the silent joint: {:?}, since {since:?}", state.arrived[4]);
    let others = (0..JOINTS).filter(|j| *j != 4).all(|j| arrived_at(state.arrived[j], now));
    assert!(others, "the others: {:?}, now {now:?}", state.arrived);

    // Reading twice brings nothing new.
    let before = readings;
    bench.bus().read(now, &mut readings);
    assert_eq!(readings, before);
    assert_eq!(bench.bus().fault(now), None);

    // Off again.
    for _ in 0..3 {
        now += MS;
        bench.bus().write(&command, false, now);
        torque = bench.act(now, &q, &v, None);
    }
    assert_eq!(torque, [0.0; JOINTS], "torque after the drives were told to rest");
}
