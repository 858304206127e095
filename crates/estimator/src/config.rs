//! How far each sensor is trusted.

/// Constants of the estimator. [`Config::problem`] names the first that cannot be.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Acceleration of free fall, m/s².
    pub gravity_m_s2: f64,
    /// Roll and pitch follow the accelerometer with this time constant, s.
    pub attitude_s: f64,
    /// An acceleration that differs from free fall's by this is not taken for the vertical, m/s².
    pub gravity_tolerance_m_s2: f64,
    /// The gyroscope's offset follows the attitude's corrections at this rate, 1/s.
    pub gyro_offset_rate_s: f64,
    /// And is never taken for more than this, rad/s.
    pub gyro_offset_limit_rad_s: f64,
    /// The velocity follows the standing legs with this time constant, s.
    pub velocity_s: f64,
    /// A standing leg whose velocity differs from the estimate by this counts half, m/s: it slips or its joints
    /// are wrong.
    pub slip_m_s: f64,
    /// Right after and before a switch the standing legs count this much: they touch down and lift off then.
    pub switch_share: f64,
    /// Until this phase of a step …
    pub switch_end: f64,
    /// … and from this phase on.
    pub switch_begin: f64,
    /// Radius of the toes, m: they roll.
    pub toe_radius_m: f64,
    /// Inertial data older than this are missing, s.
    pub timeout_s: f64,
    /// An angular velocity larger than this is no measurement, rad/s.
    pub angular_velocity_limit_rad_s: f64,
    /// A specific force larger than this is no measurement, m/s².
    pub specific_force_limit_m_s2: f64,
    /// An estimated speed larger than this is wrong, m/s.
    pub speed_limit_m_s: f64,
    /// Standard deviation of the estimated velocity while the legs hold, m/s: for the covariances.
    pub velocity_deviation_m_s: f64,
    /// Standard deviation of the estimated roll and pitch, rad.
    pub tilt_deviation_rad: f64,
    /// The yaw's variance grows by this each second, rad²/s.
    pub yaw_variance_rate: f64,
    /// The position's standard deviation grows by this share of the distance walked.
    pub odometry_share: f64,
}

impl Config {
    /// Constants that were measured with an accelerometer's offset of 0.05 m/s² and noise of 0.02 m/s²/√Hz, a
    /// gyroscope's noise of 0.002 rad/s/√Hz and encoders of 18 bits.
    pub fn new(toe_radius_m: f64) -> Self {
        Self {
            gravity_m_s2: 9.81,
            attitude_s: 3.0,
            gravity_tolerance_m_s2: 5.0,
            gyro_offset_rate_s: 0.02,
            gyro_offset_limit_rad_s: 0.05,
            velocity_s: 0.05,
            slip_m_s: 0.5,
            switch_share: 0.15,
            switch_end: 0.12,
            switch_begin: 0.95,
            toe_radius_m,
            timeout_s: 0.02,
            angular_velocity_limit_rad_s: 40.0,
            specific_force_limit_m_s2: 400.0,
            speed_limit_m_s: 5.0,
            velocity_deviation_m_s: 0.02,
            tilt_deviation_rad: 0.01,
            yaw_variance_rate: 1e-5,
            odometry_share: 0.01,
        }
    }

    /// The first value that cannot be, for the user.
    pub fn problem(&self) -> Option<String> {
        [
            ("gravity_m_s2", self.gravity_m_s2, 1.0, 30.0),
            ("attitude_s", self.attitude_s, 0.05, 1e3),
            ("gravity_tolerance_m_s2", self.gravity_tolerance_m_s2, 0.1, 1e3),
            ("gyro_offset_rate_s", self.gyro_offset_rate_s, 0.0, 10.0),
            ("gyro_offset_limit_rad_s", self.gyro_offset_limit_rad_s, 0.0, 1.0),
            ("velocity_s", self.velocity_s, 0.002, 10.0),
            ("slip_m_s", self.slip_m_s, 0.01, 100.0),
            ("switch_share", self.switch_share, 0.0, 1.0),
            ("switch_end", self.switch_end, 0.0, 0.5),
            ("switch_begin", self.switch_begin, 0.5, 1.0),
            ("toe_radius_m", self.toe_radius_m, 0.0, 0.2),
            ("timeout_s", self.timeout_s, 0.001, 1.0),
            ("angular_velocity_limit_rad_s", self.angular_velocity_limit_rad_s, 1.0, 1e3),
            ("specific_force_limit_m_s2", self.specific_force_limit_m_s2, 20.0, 1e4),
            ("speed_limit_m_s", self.speed_limit_m_s, 0.1, 100.0),
            ("velocity_deviation_m_s", self.velocity_deviation_m_s, 1e-6, 10.0),
            ("tilt_deviation_rad", self.tilt_deviation_rad, 1e-6, 1.0),
            ("yaw_variance_rate", self.yaw_variance_rate, 0.0, 1.0),
            ("odometry_share", self.odometry_share, 0.0, 1.0),
        ]
        .into_iter()
        // Written so that NaN is named too.
        .find(|(_, value, low, high)| !(low..=high).contains(&value))
        .map(|(name, value, low, high)| format!("{name} is {value}, expected {low} to {high}"))
    }
}
