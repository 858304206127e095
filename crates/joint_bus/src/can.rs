//! Linux SocketCAN.

use crate::{Frame, Incoming, InertialFrames, Link, LinkError};
use socketcan::{
    CanAnyFrame, CanErrorFrame, CanFdFrame, CanFdSocket, CanFilter, CanFrame, EmbeddedFrame, ExtendedId, Frame as _,
    Id, Socket, SocketOptions, StandardId,
};
use std::io;
use std::sync::Arc;
use std::time::{Duration, SystemTime};

/// One CAN interface, never blocking, with error frames switched on.
pub struct CanLink {
    interface: Arc<str>,
    /// Frames that it takes; none: all.
    filter: Option<CanFilter>,
    /// None while it could not be opened.
    socket: Option<CanFdSocket>,
    /// Whether frames carry the kernel's time of arrival.
    stamped: bool,
    clock: StampClock,
}

/// The kernel stamps frames with the wall clock; the loop lives on the monotonic one. A step of the wall clock must
/// make no frame old or young.
#[derive(Clone, Copy, Debug, Default)]
struct StampClock {
    /// Wall minus monotonic clock when it was looked at last, ns.
    offset_ns: Option<i128>,
    /// Stamps before this were given by a clock that has been set since; since the epoch.
    set_at: Duration,
}

/// The two clocks are read one after the other, maybe with a pause between; a step smaller than this is believed, and
/// makes a frame older by no more than this.
const CLOCK_STEP: i128 = 5_000_000;

impl StampClock {
    /// When a frame with that stamp came, on the monotonic clock; all times since the clocks' beginnings.
    fn arrival(&mut self, now: Duration, wall: Duration, stamp: Duration) -> Duration {
        let offset_ns = wall.as_nanos() as i128 - now.as_nanos() as i128;
        if self.offset_ns.replace(offset_ns).is_some_and(|last| (offset_ns - last).abs() > CLOCK_STEP) {
            self.set_at = wall;
        }
        // A frame from before the step, or one that the wall clock says is yet to come: as old as its reading.
        if stamp <= self.set_at { now } else { now.saturating_sub(wall.saturating_sub(stamp)) }
    }
}

fn since_epoch(time: SystemTime) -> Duration {
    time.duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default()
}

impl CanLink {
    /// Opens an interface, such as `can0`. Bit rates are the interface's own (`ip link set can0 type can bitrate
    /// 1000000`).
    pub fn open(interface: &str) -> Result<Self, LinkError> {
        Self::open_with(interface, None)
    }

    /// Opens an interface for the frames of an inertial unit alone.
    pub fn open_for(interface: &str, frames: InertialFrames) -> Result<Self, LinkError> {
        // Its identifiers differ in the last two bits.
        let mask = (libc::CAN_EFF_MASK & !3) | libc::CAN_EFF_FLAG | libc::CAN_RTR_FLAG;
        Self::open_with(interface, Some(CanFilter::new(frames.id | libc::CAN_EFF_FLAG, mask)))
    }

    fn open_with(interface: &str, filter: Option<CanFilter>) -> Result<Self, LinkError> {
        let (interface, clock) = (interface.into(), StampClock::default());
        let mut link = Self { interface, filter, socket: None, stamped: false, clock };
        link.open_socket()?;
        Ok(link)
    }

    fn open_socket(&mut self) -> Result<(), LinkError> {
        let down = |source| LinkError::Down { interface: Arc::clone(&self.interface), source };
        let socket = CanFdSocket::open(&self.interface).map_err(down)?;
        socket.set_nonblocking(true).map_err(down)?;
        socket.set_error_filter_accept_all().map_err(down)?;
        if let Some(filter) = self.filter {
            socket.set_filters(&[filter]).map_err(down)?;
        }
        // Without the kernel's stamps the time of reading is taken: at most one control period later.
        self.stamped = socket.set_recv_timestamp(true).is_ok();
        self.socket = Some(socket);
        Ok(())
    }

    fn lost(&mut self, source: io::Error) -> LinkError {
        self.socket = None;
        LinkError::Down { interface: Arc::clone(&self.interface), source }
    }
}

/// What an error frame reports.
fn decode_error(frame: &CanErrorFrame) -> Incoming {
    // linux/can/error.h
    const BUS_OFF: u32 = 0x40;
    const RESTARTED: u32 = 0x100;
    const CONTROLLER: u32 = 0x04;
    const CONTROLLER_PASSIVE: u8 = 0x10 | 0x20;
    let class = frame.raw_id();
    if class & BUS_OFF != 0 {
        Incoming::BusOff
    } else if class & RESTARTED != 0 {
        Incoming::Restarted
    } else if class & CONTROLLER != 0 && frame.data().get(1).is_some_and(|d| d & CONTROLLER_PASSIVE != 0) {
        Incoming::ErrorPassive
    } else {
        Incoming::BusError
    }
}

fn take(frame: &CanAnyFrame) -> Option<Incoming> {
    let data = |f: &dyn Fn() -> (u32, bool, bool), bytes: &[u8]| {
        let (id, extended, fd) = f();
        Incoming::Frame(Frame::unchecked(id, extended, fd, bytes), None)
    };
    match frame {
        CanAnyFrame::Normal(f) => Some(data(&|| (f.raw_id(), f.is_extended(), false), f.data())),
        CanAnyFrame::Fd(f) => Some(data(&|| (f.raw_id(), f.is_extended(), true), f.data())),
        CanAnyFrame::Error(f) => Some(decode_error(f)),
        // Nothing here asks for or answers remote frames.
        CanAnyFrame::Remote(_) => None,
    }
}

impl Link for CanLink {
    fn send(&mut self, frame: &Frame, _: Duration) -> Result<(), LinkError> {
        let Some(socket) = &self.socket else { return Err(self.lost(io::Error::from_raw_os_error(libc::ENETDOWN))) };
        let id: Option<Id> = if frame.extended {
            ExtendedId::new(frame.id).map(Id::from)
        } else {
            StandardId::new(frame.id as u16).map(Id::from)
        };
        let invalid = || io::Error::from_raw_os_error(libc::EINVAL);
        let result = match id {
            None => Err(invalid()),
            Some(id) if frame.fd => match CanFdFrame::new(id, frame.data()) {
                Some(f) => socket.write_frame(&f),
                None => Err(invalid()),
            },
            Some(id) => match CanFrame::new(id, frame.data()) {
                Some(f) => socket.write_frame(&f),
                None => Err(invalid()),
            },
        };
        result.map_err(|error| match error.raw_os_error() {
            Some(libc::ENOBUFS | libc::EAGAIN) => LinkError::Full,
            Some(libc::EINVAL | libc::EMSGSIZE) => {
                LinkError::Unfit { interface: Arc::clone(&self.interface), source: error }
            }
            _ => self.lost(error),
        })
    }

    fn receive(&mut self, now: Duration) -> Result<Option<Incoming>, LinkError> {
        loop {
            let Some(socket) = &self.socket else {
                return Err(self.lost(io::Error::from_raw_os_error(libc::ENETDOWN)));
            };
            let result = if self.stamped {
                socket.read_frame_with_timestamp().map(|(frame, stamp)| {
                    (frame, Some(self.clock.arrival(now, since_epoch(SystemTime::now()), since_epoch(stamp))))
                })
            } else {
                socket.read_frame().map(|frame| (frame, None))
            };
            match result {
                Ok((frame, at)) => match take(&frame) {
                    Some(Incoming::Frame(frame, _)) => return Ok(Some(Incoming::Frame(frame, at))),
                    Some(other) => return Ok(Some(other)),
                    None => {}
                },
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => return Ok(None),
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return Err(self.lost(error)),
            }
        }
    }

    fn reopen(&mut self) -> Result<(), LinkError> {
        self.open_socket()
    }
}

/// Puts an error frame on an interface, as its driver would: for tests of what happens then. `class` is the frame's
/// class as in linux/can/error.h, without the error flag.
pub fn send_error_frame(interface: &str, class: u32, data: &[u8; 8]) -> Result<(), LinkError> {
    let unfit = |source| LinkError::Unfit { interface: interface.into(), source };
    let frame =
        CanErrorFrame::new_error(class, data).map_err(|e| unfit(io::Error::new(io::ErrorKind::InvalidInput, e)))?;
    let socket =
        CanFdSocket::open(interface).map_err(|source| LinkError::Down { interface: interface.into(), source })?;
    socket.write_frame(&frame).map_err(unfit)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn error_frames_are_distinguished() {
        let error = |class: u32, data: [u8; 8]| decode_error(&CanErrorFrame::new_error(class, &data).unwrap());
        assert_eq!(error(0x40, [0; 8]), Incoming::BusOff);
        assert_eq!(error(0x100, [0; 8]), Incoming::Restarted);
        assert_eq!(error(0x04, [0, 0x20, 0, 0, 0, 0, 0, 0]), Incoming::ErrorPassive);
        assert_eq!(error(0x08, [0; 8]), Incoming::BusError);
    }

    #[test]
    fn an_interface_that_is_not_there_is_named() {
        let Err(error) = CanLink::open("nocan7") else { panic!("there is no such interface") };
        assert!(error.to_string().contains("nocan7 is down") && error.to_string().contains("ip link set"), "{error}");
    }

    #[test]
    fn a_stamp_of_the_wall_clock_becomes_one_of_the_loop_whatever_is_done_to_the_wall_clock() {
        let ms = Duration::from_millis;
        let (now, wall) = (Duration::from_secs(50), Duration::from_secs(1_000_000));
        let mut clock = StampClock::default();
        assert_eq!(clock.arrival(now, wall, wall - ms(3)), now - ms(3));
        // Old frames are old: after a pause of this process they must not look fresh.
        assert_eq!(clock.arrival(now + ms(500), wall + ms(500), wall), now);
        // An hour forward, an hour back: frames from before are as old as their reading, those behind it are stamped
        // well.
        for (wall, step) in [(wall + ms(3_600_000), 600), (wall - ms(3_600_000), 700)] {
            let (now, wall) = (now + ms(step), wall + ms(step));
            assert_eq!(clock.arrival(now, wall, Duration::from_secs(1_000_000)), now, "the first frame");
            assert_eq!(clock.arrival(now, wall, wall - ms(2)), now, "the second");
            assert_eq!(clock.arrival(now + ms(10), wall + ms(10), wall + ms(6)), now + ms(6));
        }
    }
}
