//! `foot_contacts`: which feet carry weight, by the torques of the joint states.

use crate::cycle::CycleOutput;
use crate::dds_bus::OFFERED;
use control::{ContactEstimator, Contacts, Health};
use robot::Robot;
use ros::{Node, PublishError, Publisher, RosError};
use std::time::Duration;
use tandem_msgs::FootContacts;
use tandem_msgs::builtin_interfaces::Time;
use tandem_msgs::std_msgs::Header;

/// The publisher; there where the legs' kinematics are known.
pub struct FootContactsPublisher {
    port: Publisher<FootContacts>,
    estimator: ContactEstimator,
    leg_names: Vec<String>,
    /// Cycles between two messages, where no foot lands or lifts off.
    every: u64,
    last: Option<Duration>,
    published: [bool; gait::LEGS],
}

impl FootContactsPublisher {
    /// None for legs whose kinematics are not known.
    ///
    /// # Errors
    /// What the middleware refuses.
    pub fn new(node: &Node, robot: &Robot, every: u64) -> Result<Option<Self>, RosError> {
        let Ok(estimator) = ContactEstimator::new(robot) else { return Ok(None) };
        Ok(Some(Self {
            port: node.publisher("foot_contacts", OFFERED)?,
            estimator,
            leg_names: robot.legs.iter().map(|leg| leg.name.clone()).collect(),
            every,
            last: None,
            published: Default::default(),
        }))
    }

    /// Follows a cycle whose joint state is new and has torques; publishes when it is time to.
    ///
    /// # Errors
    /// The middleware's.
    pub fn follow(&mut self, cycle: &CycleOutput) -> Result<(), PublishError> {
        let output = &cycle.output;
        let Some((readings, stamp)) = cycle.readings.as_ref().zip(output.answered) else { return Ok(()) };
        if !readings.torque_reported || self.last == Some(stamp) {
            return Ok(());
        }
        let dt_s = self.last.map_or(0.0, |last| stamp.saturating_sub(last).as_secs_f64());
        self.last = Some(stamp);
        let good = output.estimate.filter(|estimate| estimate.health() == Health::Good);
        let tilt_rad = good.map_or([0.0; 2], |estimate| estimate.roll_pitch_rad());
        let contacts = *self.estimator.step(&readings.position_rad, &readings.torque_nm, tilt_rad, dt_s);
        if contacts.touches == self.published && !output.cycles.is_multiple_of(self.every) {
            return Ok(());
        }
        self.published = contacts.touches;
        self.port.publish(self.message(&contacts, stamp))
    }

    fn message(&self, contacts: &Contacts, stamp: Duration) -> FootContacts {
        let stamp = Time::from_nanoseconds(i64::try_from(stamp.as_nanos()).unwrap_or(i64::MAX));
        FootContacts {
            header: Header { stamp, frame_id: String::new() },
            name: self.leg_names.clone(),
            contact: contacts.touches.into(),
            force_n: contacts.force_n.into(),
        }
    }
}
