//! What the controller publishes of the base: its estimate as `odom` and `/tf`, by REP 105.

use control::balanced::BalanceConfig;
use control::{Config, Health, Output};
use ros::{Clock, Node, PublishError, Publisher, Qos, RosError};
use std::time::Duration;
use tandem_msgs::Covariance;
use tandem_msgs::builtin_interfaces::Time;
use tandem_msgs::diagnostic_msgs::KeyValue;
use tandem_msgs::geometry_msgs::{Point, Pose, Quaternion, Transform, TransformStamped, Twist, Vector3};
use tandem_msgs::nav_msgs::Odometry;
use tandem_msgs::std_msgs::Header;
use tandem_msgs::tf2_msgs::TFMessage;

/// Variance of the angular velocity: a sample of a gyroscope of 0.002 rad/s/√Hz at 1 kHz.
const TURNING_RAD2_S2: f64 = 0.004;

/// The publishers of the estimate; there where balance is on.
pub struct Odometer {
    odom: Publisher<Odometry>,
    tf: Publisher<TFMessage>,
    balance: BalanceConfig,
    frames: [String; 2],
    /// Cycles between two messages.
    every: u64,
    /// Where the joint states' stamps are the machine's own time since it was started: the node's clock stamps.
    clock: Option<Clock>,
}

impl Odometer {
    /// None where the configuration has no balance: what others publish on `odom` is theirs then.
    ///
    /// # Errors
    /// What the middleware refuses.
    pub fn new(
        node: &Node,
        config: &Config,
        frame_prefix: &str,
        every: u64,
        on_bus: bool,
    ) -> Result<Option<Self>, RosError> {
        let Some(balance) = config.balance else { return Ok(None) };
        Ok(Some(Self {
            odom: node.publisher("odom", Qos::reliable(10))?,
            tf: node.publisher("/tf", Qos::reliable(100))?,
            balance,
            frames: ["odom", "base_link"].map(|frame| format!("{frame_prefix}{frame}")),
            every,
            clock: on_bus.then(|| node.clock()),
        }))
    }

    /// Publishes a cycle's output, when it is time to. An estimate that is not good is published with variances that
    /// say so, and one that was never begun not at all.
    ///
    /// # Errors
    /// What the middleware refuses.
    pub fn print(&self, output: &Output) -> Result<(), PublishError> {
        let estimate = output.estimate.filter(|estimate| estimate.health() != Health::Waiting);
        let (Some(estimate), true) = (estimate, output.cycles.is_multiple_of(self.every)) else { return Ok(()) };
        let stamp = match (&self.clock, output.answered) {
            (Some(clock), _) => clock.now(),
            (None, Some(answered)) => time(answered),
            (None, None) => return Ok(()),
        };
        let good = estimate.health() == Health::Good;
        let variances = estimate.variances(&self.balance.estimator);
        let [odom, base] = &self.frames;
        let [x, y, z] = estimate.position_m();
        let [qx, qy, qz, qw] = estimate.attitude_xyzw();
        let orientation = Quaternion { x: qx, y: qy, z: qz, w: qw };
        let header = Header { stamp, frame_id: odom.clone() };
        let mut message = Odometry { header: header.clone(), child_frame_id: base.clone(), ..Odometry::default() };
        message.pose.pose = Pose { position: Point { x, y, z }, orientation };
        let (place, tilt, yaw) = (variances.position_m2, variances.tilt_rad2, variances.yaw_rad2);
        message.pose.covariance = diagonal([place, place, place, tilt, tilt, yaw], good);
        message.twist.twist = Twist {
            linear: vector(estimate.velocity_in_base_m_s()),
            angular: vector(estimate.angular_velocity_rad_s()),
        };
        let (speed, turning) = (variances.velocity_m2_s2, TURNING_RAD2_S2);
        message.twist.covariance = diagonal([speed, speed, speed, turning, turning, turning], good);
        self.odom.publish(message)?;
        self.tf.publish(TFMessage {
            transforms: vec![TransformStamped {
                header,
                child_frame_id: base.clone(),
                transform: Transform { translation: Vector3 { x, y, z }, rotation: orientation },
            }],
        })
    }
}

/// What the balance reports of itself, for diagnostics.
pub fn diagnostics(output: &Output) -> Vec<KeyValue> {
    let value = |key: &str, value: String| KeyValue { key: key.into(), value };
    let Some(estimate) = &output.estimate else { return vec![value("balance", "off".into())] };
    let balance = match &output.balance {
        None => "not walking in balance",
        Some(report) if report.placement_limited => "placement_limited",
        Some(report) if report.hurry_limited => "hurry_limited",
        Some(report) if report.pace > 1.0 => "hurried",
        Some(_) => "good",
    };
    vec![value("balance", balance.into()), value("estimate", estimate.health().name().into())]
}

/// Row by row; where the estimate is not good nothing is known.
fn diagonal(variances: [f64; 6], good: bool) -> Covariance {
    /// What REP 105's consumers take for unknown.
    const UNKNOWN: f64 = 1e6;
    let mut covariance = [0.0; 36];
    for (n, variance) in variances.into_iter().enumerate() {
        covariance[7 * n] = if good { variance } else { UNKNOWN };
    }
    Covariance(covariance)
}

fn vector([x, y, z]: [f64; 3]) -> Vector3 {
    Vector3 { x, y, z }
}

fn time(stamp: Duration) -> Time {
    Time::from_nanoseconds(i64::try_from(stamp.as_nanos()).unwrap_or(i64::MAX))
}
