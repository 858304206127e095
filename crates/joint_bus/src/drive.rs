//! What is sent to a drive and what it replies, in the drive's own terms (motor side), and the trait of the protocols.

use crate::Frame;

/// A command to one drive: τ = kp (position − q) + kd (velocity − q̇) + torque.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DriveCommand {
    /// rad.
    pub position_rad: f64,
    /// rad/s.
    pub velocity_rad_s: f64,
    /// N m / rad.
    pub kp: f64,
    /// N m s / rad.
    pub kd: f64,
    /// N m.
    pub torque_nm: f64,
    /// What the drive is to keep to by itself while it follows this.
    pub limits: DriveLimits,
}

/// Limits that travel with every command, where the protocol has room for them ([`crate::Registers`]): a drive that was
/// set up otherwise, or was exchanged, keeps to them all the same. None: as the drive is set up.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DriveLimits {
    /// Whatever the law asks for, N m.
    pub max_torque_nm: Option<f64>,
    /// Without a further command for so long the drive damps, s.
    pub watchdog_s: Option<f64>,
}

/// What a drive reports of itself.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DriveReply {
    /// rad.
    pub position_rad: f64,
    /// rad/s.
    pub velocity_rad_s: f64,
    /// N m.
    pub torque_nm: f64,
    /// °C, where the drive sends it.
    pub temperature_c: Option<f64>,
    /// The drive's error code, 0 for none, where it sends one.
    pub error: Option<u8>,
    /// V, the voltage that it is fed with, where it sends it.
    pub supply_v: Option<f64>,
    /// A, the current that makes its torque (q axis), where it sends it.
    pub current_a: Option<f64>,
}

/// Anything that a drive can be asked.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum DriveRequest {
    /// Close the loop: follow commands from now on.
    Enter,
    /// Open the loop: no torque. The drive still replies.
    Exit,
    /// Say where you are; nothing else changes. Some protocols have no such question: [`Protocol::has_query`].
    Query,
    /// The present position is zero from now on.
    SetZero,
    /// Follow this.
    Command(DriveCommand),
}

/// Ranges that a drive's numbers are quantised in, ± for position, velocity and torque, from 0 for the gains.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ranges {
    /// rad.
    pub position_rad: f64,
    /// rad/s.
    pub velocity_rad_s: f64,
    /// N m / rad.
    pub kp: f64,
    /// N m s / rad.
    pub kd: f64,
    /// N m.
    pub torque_nm: f64,
}

/// A number that cannot be sent.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("{field} is {value}, expected a finite number")]
pub struct EncodeError {
    /// Which.
    pub field: &'static str,
    /// What it is.
    pub value: f64,
}

impl DriveCommand {
    /// The first number that is not finite.
    pub(crate) fn check(&self) -> Result<(), EncodeError> {
        for (field, value) in [
            ("position", self.position_rad),
            ("velocity", self.velocity_rad_s),
            ("kp", self.kp),
            ("kd", self.kd),
            ("torque", self.torque_nm),
            ("max_torque", self.limits.max_torque_nm.unwrap_or(0.0)),
            ("watchdog", self.limits.watchdog_s.unwrap_or(0.0)),
        ] {
            if !value.is_finite() {
                return Err(EncodeError { field, value });
            }
        }
        Ok(())
    }
}

/// A protocol: frames to and from drives, seen from both ends. `id` is the drive's number on its bus.
///
/// Numbers out of a drive's range are sent as the range's end: limits are the controller's task, done before. Every
/// frame to a drive is answered by it, so that [`DriveRequest::Exit`] also serves to ask a drive at rest for its state.
pub trait Protocol {
    /// Whether a drive can be asked where it is without an order: whether [`DriveRequest::Query`] has a frame.
    fn has_query(&self) -> bool;
    /// The frame for a drive.
    fn encode_request(&self, id: u8, ranges: &Ranges, request: &DriveRequest) -> Result<Frame, EncodeError>;
    /// The drive that a reply comes from; `None` if the frame is no reply of this protocol.
    fn reply_id(&self, frame: &Frame) -> Option<u8>;
    /// What a reply reports; `None` if the frame is damaged.
    fn decode_reply(&self, ranges: &Ranges, frame: &Frame) -> Option<DriveReply>;
    /// The drive's end: what a frame asks of drive `id`; `None` if it is for another or damaged.
    fn decode_request(&self, id: u8, ranges: &Ranges, frame: &Frame) -> Option<DriveRequest>;
    /// The drive's end: the frame that replies.
    fn encode_reply(&self, id: u8, ranges: &Ranges, reply: &DriveReply) -> Frame;
}
