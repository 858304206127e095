//! Linux SocketCAN.

use crate::{Frame, Incoming, Link, LinkError};
use socketcan::{
    CanAnyFrame, CanErrorFrame, CanFdFrame, CanFdSocket, CanFrame, EmbeddedFrame, ExtendedId, Frame as _, Id, Socket,
    SocketOptions, StandardId,
};
use std::io;
use std::time::{Duration, SystemTime};

/// One CAN interface, never blocking, with error frames switched on.
pub struct CanLink {
    interface: String,
    /// None while it could not be opened.
    socket: Option<CanFdSocket>,
    /// Whether frames carry the kernel's time of arrival.
    stamped: bool,
}

impl CanLink {
    /// Opens an interface, such as `can0`. Bit rates are the interface's own (`ip link set can0 type can bitrate 1000000`).
    pub fn open(interface: &str) -> Result<Self, LinkError> {
        let mut link = Self { interface: interface.into(), socket: None, stamped: false };
        link.open_socket()?;
        Ok(link)
    }

    fn open_socket(&mut self) -> Result<(), LinkError> {
        let down = |source| LinkError::Down { interface: self.interface.clone(), source };
        let socket = CanFdSocket::open(&self.interface).map_err(down)?;
        socket.set_nonblocking(true).map_err(down)?;
        socket.set_error_filter_accept_all().map_err(down)?;
        // Without the kernel's stamps the time of reading is taken: at most one control period later.
        self.stamped = socket.set_recv_timestamp(true).is_ok();
        self.socket = Some(socket);
        Ok(())
    }

    fn lost(&mut self, source: io::Error) -> LinkError {
        self.socket = None;
        LinkError::Down { interface: self.interface.clone(), source }
    }
}

/// What an error frame says.
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

/// The kernel stamps with the wall clock; the loop lives on the monotonic one.
fn on_the_clock_of(now: Duration, stamp: SystemTime) -> Duration {
    let age = SystemTime::now().duration_since(stamp).unwrap_or_default();
    // A step of the wall clock must not make a frame old or young.
    now.saturating_sub(age.min(Duration::from_millis(100)))
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
                LinkError::Unfit { interface: self.interface.clone(), source: error }
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
                socket.read_frame_with_timestamp().map(|(frame, stamp)| (frame, Some(on_the_clock_of(now, stamp))))
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

/// Puts an error frame on an interface, as its driver would: for tests of what happens then. `class` is the frame's class as in
/// linux/can/error.h, without the error flag.
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
    fn error_frames_are_told_apart() {
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
    fn a_stamp_of_the_wall_clock_becomes_one_of_the_loop() {
        let now = Duration::from_secs(50);
        let at = on_the_clock_of(now, SystemTime::now() - Duration::from_millis(3));
        assert!(at <= now - Duration::from_millis(3) && at > now - Duration::from_millis(100));
        assert_eq!(on_the_clock_of(now, SystemTime::now() + Duration::from_secs(60)), now);
        assert_eq!(on_the_clock_of(now, SystemTime::now() - Duration::from_secs(60)), now - Duration::from_millis(100));
    }
}
