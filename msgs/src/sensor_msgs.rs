//! Measured joints and inertial data.

use crate::geometry_msgs::{Quaternion, Vector3};
use crate::std_msgs::Header;

messages! { "sensor_msgs";
    /// A picture in a file's format.
    CompressedImage {
        /// When and where it was taken.
        header: Header,
        /// `jpeg`, `png`, …
        format: String,
        /// The file.
        data: Vec<u8>,
    }
    /// The state of joints. Arrays are as long as `name` or empty.
    JointState {
        /// When it was measured.
        header: Header,
        /// Joint names.
        name: Vec<String>,
        /// rad.
        position: Vec<f64>,
        /// rad/s.
        velocity: Vec<f64>,
        /// Nm.
        effort: Vec<f64>,
    }
    /// A battery. What is not measured is NaN, or 0 (unknown).
    BatteryState {
        /// When it was measured.
        header: Header,
        /// V.
        voltage: f32,
        /// Degrees Celsius.
        temperature: f32,
        /// A; negative when discharging.
        current: f32,
        /// A h.
        charge: f32,
        /// A h, of the last full charge.
        capacity: f32,
        /// A h, as built.
        design_capacity: f32,
        /// 0 to 1.
        percentage: f32,
        /// 0: unknown.
        power_supply_status: u8,
        /// 0: unknown.
        power_supply_health: u8,
        /// 0: unknown.
        power_supply_technology: u8,
        /// Whether there is one.
        present: bool,
        /// V.
        cell_voltage: Vec<f32>,
        /// Degrees Celsius.
        cell_temperature: Vec<f32>,
        /// Where it sits.
        location: String,
        /// As the maker counts.
        serial_number: String,
    }
    /// An inertial measurement.
    Imu {
        /// When it was measured, and the frame of the sensor.
        header: Header,
        /// Orientation of the sensor in the world.
        orientation: Quaternion,
        /// Row-major 3 x 3, rad²; first element -1: no orientation.
        orientation_covariance: [f64; 9],
        /// rad/s, sensor axes.
        angular_velocity: Vector3,
        /// Row-major 3 x 3.
        angular_velocity_covariance: [f64; 9],
        /// m/s², sensor axes, gravity included (at rest: +g upwards).
        linear_acceleration: Vector3,
        /// Row-major 3 x 3.
        linear_acceleration_covariance: [f64; 9],
    }
}
