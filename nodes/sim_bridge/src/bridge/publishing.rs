//! What the simulation publishes.

use super::{Bridge, REPUBLISH};
use crate::ports;
use ros::PublishError;
use std::time::{Duration, Instant};
use tandem_msgs::builtin_interfaces::Time;
use tandem_msgs::rosgraph_msgs::Clock;

/// Behind CAN nobody waits for the topics: joint states and clock are published every so many control periods.
const PUBLISH_EVERY: u64 = 4;

impl Bridge {
    pub(super) fn publish_joint_states(&self) -> Result<(), PublishError> {
        let message =
            ports::joint_state(&self.simulator.state(), &self.joint_names, Time::from_nanoseconds(self.stamp_ns()));
        self.ports.joint_states.publish(message)
    }

    /// While paused: the joint states for a controller that comes now, and the time for nodes that follow `/clock`.
    pub(super) fn publish_standing_time(&mut self) -> Result<(), PublishError> {
        if self.standing_time_published.is_none_or(|at| at.elapsed() >= REPUBLISH) {
            self.standing_time_published = Some(Instant::now());
            self.ports.clock.publish(Clock { clock: Time::from_nanoseconds(self.stamp_ns()) })?;
        }
        self.publish_joint_states()
    }

    /// Everything that belongs to a new stamp; joint states last, because they are what others wait for.
    pub(super) fn publish_all(&mut self) -> Result<(), PublishError> {
        let stamp = Time::from_nanoseconds(self.stamp_ns());
        let state = self.simulator.state();
        // Behind topics every period is published, because the controller answers it.
        let publishes = self.bench.is_none() || self.period.is_multiple_of(PUBLISH_EVERY);
        if publishes {
            self.ports.clock.publish(Clock { clock: stamp })?;
        }
        if self.period.is_multiple_of(self.config.imu_every) {
            let measured = self.simulator.inertial_state(Duration::from_nanos(self.stamp_ns().unsigned_abs()));
            if let Some(bench) = &mut self.bench {
                bench.measure(&measured);
            }
            self.ports.imu.publish(ports::imu(&measured, &self.frames, stamp))?;
        }
        if self.period.is_multiple_of(self.config.odometry_every) {
            self.ports.odom.publish(ports::odometry(&state, &self.frames, stamp))?;
            self.ports.tf.as_ref().map_or(Ok(()), |tf| tf.publish(ports::transform(&state, &self.frames, stamp)))?;
            for (port, force) in self.ports.ground_forces.iter().zip(state.toe_force_n) {
                port.publish(ports::ground_force(force, &self.frames, stamp))?;
            }
        }
        if publishes {
            self.ports.joint_states.publish(ports::joint_state(&state, &self.joint_names, stamp))?;
        }
        Ok(())
    }
}
