//! Inertial units on a bus or a serial line, which the control cycle reads itself.

use crate::{Frame, Incoming, Link, LinkError};
use joints::InertialState;
use std::time::Duration;

/// Frames taken from the unit's link in one cycle: what a unit at 1 kHz sends in 20 ms.
const FRAMES_PER_READ: usize = 64;
/// A link that is down is opened again after this time.
const RETRY: Duration = Duration::from_millis(100);
/// The parts of a measurement do not arrive further apart.
const LONGEST: Duration = Duration::from_millis(50);
/// What 16 bits span: rad/s, m/s², and the components of a unit quaternion.
const RANGES: [f64; 3] = [35.0, 160.0, 1.0];
/// A step of the unit's time.
const TICK: Duration = Duration::from_micros(100);

/// An inertial unit that is the robot's own, behind whatever it hangs on. Nothing here ever blocks or allocates.
///
/// A unit that falls silent, or whose link is down, gives nothing: the estimate goes stale, and what follows from that
/// is the controller's to say.
pub trait InertialUnit: Send {
    /// Takes over everything that came in by `now`: the newest measurement, if there is a new one. In the base's axes,
    /// with its time of arrival on the clock of `now`; not a number where the unit says that it cannot measure.
    fn read(&mut self, now: Duration) -> Option<InertialState>;
}

/// What the frames of an inertial unit say. A measurement is three classical frames with 29-bit identifiers: angular
/// velocity at `id`, acceleration at `id` + 1, attitude at `id` + 2 (x, y, z of the quaternion whose w is not
/// negative).
/// Each has three signed 16-bit numbers, of which the largest is the range's end and the smallest says that there is no
/// measurement, and an unsigned 16-bit time in steps of 0.1 ms, the same in all three; low bytes first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct InertialFrames {
    /// The first identifier, a multiple of four.
    pub id: u32,
}

/// One frame's content.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Part {
    /// 0 angular velocity, 1 acceleration, 2 attitude.
    of: usize,
    values: [f64; 3],
    time: u16,
}

impl InertialFrames {
    /// Whether a frame is one of the unit's.
    pub fn owns(&self, frame: &Frame) -> bool {
        frame.extended && !frame.fd && (self.id..self.id + 3).contains(&frame.id) && frame.data().len() == 8
    }

    /// The frames of a measurement that the unit takes at its own time `stamp`.
    pub fn encode(&self, state: &InertialState) -> [Frame; 3] {
        let time = (state.stamp.as_nanos() / TICK.as_nanos()) as u16;
        let nothing = [f64::NAN; 3];
        let attitude = state.attitude_xyzw.map(|[x, y, z, w]| [x, y, z].map(|c| if w < 0.0 { -c } else { c }));
        let parts = [state.angular_velocity_rad_s, state.acceleration_m_s2, attitude];
        std::array::from_fn(|of| {
            let mut data = [0; 8];
            for (bytes, value) in data.chunks_exact_mut(2).zip(parts[of].unwrap_or(nothing)) {
                bytes.copy_from_slice(&to_integer(value, RANGES[of]).to_le_bytes());
            }
            data[6..].copy_from_slice(&time.to_le_bytes());
            Frame::unchecked(self.id + of as u32, true, false, &data)
        })
    }

    fn decode(&self, frame: &Frame) -> Option<Part> {
        if !self.owns(frame) {
            return None;
        }
        let (d, of) = (frame.data(), (frame.id - self.id) as usize);
        let value = |n: usize| from_integer(i16::from_le_bytes([d[2 * n], d[2 * n + 1]]), RANGES[of]);
        Some(Part { of, values: [0, 1, 2].map(value), time: u16::from_le_bytes([d[6], d[7]]) })
    }
}

fn to_integer(value: f64, range: f64) -> i16 {
    if value.is_finite() { (value / range * f64::from(i16::MAX)).round().max(-32767.0) as i16 } else { i16::MIN }
}

fn from_integer(value: i16, range: f64) -> f64 {
    if value == i16::MIN { f64::NAN } else { f64::from(value) / f64::from(i16::MAX) * range }
}

/// The unit whose frames are [`InertialFrames`], on a link of its own.
pub struct CanInertialUnit<L> {
    frames: InertialFrames,
    link: L,
    down_until: Option<Duration>,
    /// What has come of the measurement under way, its time, and when its first part arrived.
    parts: [Option<[f64; 3]>; 3],
    time: u16,
    arrived: Duration,
    /// The time of the last whole measurement, and how far the unit's clock has come by then.
    last: Option<(u16, Duration)>,
}

impl<L: Link> CanInertialUnit<L> {
    /// The unit with these frames at the other end of `link`.
    pub fn new(frames: InertialFrames, link: L) -> Self {
        let (parts, time, arrived) = ([None; 3], 0, Duration::ZERO);
        Self { frames, link, down_until: None, parts, time, arrived, last: None }
    }

    fn take(&mut self, part: Part, at: Duration) -> Option<InertialState> {
        // Its time comes again after 6.5 s.
        if part.time != self.time || at.saturating_sub(self.arrived) > LONGEST {
            self.parts = [None; 3];
        }
        if self.parts == [None; 3] {
            (self.time, self.arrived) = (part.time, at);
        }
        self.parts[part.of] = Some(part.values);
        let [Some(turning), Some(acceleration), Some([x, y, z])] = self.parts else { return None };
        self.parts = [None; 3];
        let stamp =
            self.last.map_or(Duration::ZERO, |(time, stamp)| stamp + TICK * u32::from(part.time.wrapping_sub(time)));
        self.last = Some((part.time, stamp));
        Some(InertialState {
            stamp,
            arrived: self.arrived,
            attitude_xyzw: Some([x, y, z, (1.0 - x * x - y * y - z * z).max(0.0).sqrt()]),
            angular_velocity_rad_s: Some(turning),
            acceleration_m_s2: Some(acceleration),
        })
    }
}

impl<L: Link + Send> InertialUnit for CanInertialUnit<L> {
    fn read(&mut self, now: Duration) -> Option<InertialState> {
        if let Some(until) = self.down_until {
            if now < until {
                return None;
            }
            self.down_until = self.link.reopen().is_err().then_some(now + RETRY);
        }
        let mut newest = None;
        for _ in 0..FRAMES_PER_READ {
            match self.link.receive(now) {
                Ok(Some(Incoming::Frame(frame, at))) => {
                    if let Some(part) = self.frames.decode(&frame) {
                        newest = self.take(part, at.unwrap_or(now)).or(newest);
                    }
                }
                // What the bus itself suffers from is for the drives' bus to say.
                Ok(Some(_)) => {}
                Ok(None) | Err(LinkError::Full) => break,
                Err(_) => {
                    self.down_until = Some(now + RETRY);
                    break;
                }
            }
        }
        newest
    }
}

/// The unit's end of the link, for tests and for the simulator.
pub struct EmulatedInertialUnit {
    frames: InertialFrames,
    link: Box<dyn Link + Send>,
}

impl EmulatedInertialUnit {
    /// A unit with these frames on `link`.
    pub fn new(frames: InertialFrames, link: impl Link + Send + 'static) -> Self {
        Self { frames, link: Box::new(link) }
    }

    /// Sends a measurement, taken at its stamp. What a full or failed bus does not take is lost.
    pub fn send(&mut self, measured: &InertialState) {
        for frame in self.frames.encode(measured) {
            if let Err(LinkError::Down { .. }) = self.link.send(&frame, measured.stamp) {
                // It is tried again with the next measurement.
                let _ = self.link.reopen();
            }
        }
    }
}
