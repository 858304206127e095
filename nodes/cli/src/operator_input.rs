//! An operator's input: keys of a terminal, buttons and axes of a joystick, and their loss.

use anyhow::{Context, Result};
use std::fs::File;
use std::io::{IsTerminal, Read};
use std::os::fd::AsRawFd;
use std::os::unix::fs::OpenOptionsExt;
use std::path::Path;
use std::time::{Duration, Instant};

/// A joystick's event: time in ms (4 bytes), value (2), kind (1), number (1).
const JOYSTICK_EVENT: usize = 8;
const KIND_BUTTON: u8 = 0x01;
const KIND_AXIS: u8 = 0x02;
/// The state at the beginning, sent as events.
const KIND_INITIAL: u8 = 0x80;

/// One input, or what happened to its device.
#[derive(Clone, Debug, PartialEq)]
pub enum InputEvent {
    /// Nothing in this time.
    Nothing,
    /// A key.
    Key(u8),
    /// A button went down, or up. `initial`: it was there already when the joystick was opened.
    Button { number: u8, down: bool, initial: bool },
    /// An axis went to a place from -1 to 1.
    Axis { number: u8, value: f64 },
    /// The named device is gone.
    Lost(String),
}

/// The terminal and the joystick, as far as they are there.
pub struct OperatorInput {
    keys: Option<Terminal>,
    joystick: Option<Joystick>,
    lost: bool,
}

impl OperatorInput {
    /// Opens a joystick, if one is named, and the keys of standard input, if that is a terminal.
    pub fn open(joystick: Option<&Path>) -> Result<Self> {
        let joystick = joystick.map(Joystick::open).transpose()?;
        let keys = std::io::stdin().is_terminal().then(Terminal::open).transpose()?;
        Ok(Self { keys, joystick, lost: false })
    }

    /// Only this joystick.
    #[cfg(test)]
    pub fn of_joystick(file: File) -> Self {
        Self { keys: None, joystick: Some(Joystick { file, name: "js".into() }), lost: false }
    }

    /// Whether there are keys.
    pub fn has_keys(&self) -> bool {
        self.keys.is_some()
    }

    /// The joystick's name, if there is one.
    pub fn joystick(&self) -> Option<&str> {
        self.joystick.as_ref().map(|joystick| joystick.name.as_str())
    }

    /// Whether a device was lost.
    pub fn is_lost(&self) -> bool {
        self.lost
    }

    /// Waits for the next movement, at most until then.
    pub fn wait(&mut self, deadline: Instant) -> InputEvent {
        loop {
            let left = deadline.saturating_duration_since(Instant::now());
            match self.poll(left) {
                // A signal, or the time is over: the caller looks which.
                None => return InputEvent::Nothing,
                Some(InputEvent::Nothing) if Instant::now() < deadline => {}
                Some(event) => return event,
            }
        }
    }

    fn poll(&mut self, left: Duration) -> Option<InputEvent> {
        let fd = |fd: Option<i32>| libc::pollfd { fd: fd.unwrap_or(-1), events: libc::POLLIN, revents: 0 };
        let keys = self.keys.as_ref().map(|_| 0);
        let mut fds = [fd(keys), fd(self.joystick.as_ref().map(|joystick| joystick.file.as_raw_fd()))];
        // Rounded up: not a turn without waiting at the end.
        let timeout_ms = i32::try_from(left.as_micros().div_ceil(1000)).unwrap_or(i32::MAX);
        // SAFETY: the pointer and the count are the array's. A descriptor of -1 is passed over.
        match unsafe { libc::poll(fds.as_mut_ptr(), 2, timeout_ms) } {
            1.. if fds[1].revents != 0 => Some(self.read_joystick()),
            1.. => Some(self.read_key()),
            _ => None,
        }
    }

    fn read_key(&mut self) -> InputEvent {
        let mut key = 0_u8;
        // Past the standard library's buffer: what waited there, poll would not report.
        // SAFETY: the pointer is to a local of that size.
        match unsafe { libc::read(0, (&raw mut key).cast(), 1) } {
            1 => InputEvent::Key(key),
            -1 if std::io::Error::last_os_error().kind() == std::io::ErrorKind::Interrupted => InputEvent::Nothing,
            _ => {
                self.keys = None;
                self.lost = true;
                InputEvent::Lost("the terminal".into())
            }
        }
    }

    fn read_joystick(&mut self) -> InputEvent {
        let Some(joystick) = &mut self.joystick else { return InputEvent::Nothing };
        let mut event = [0; JOYSTICK_EVENT];
        match joystick.file.read(&mut event) {
            Ok(JOYSTICK_EVENT) => decode(event),
            Err(error) if matches!(error.kind(), std::io::ErrorKind::Interrupted | std::io::ErrorKind::WouldBlock) => {
                InputEvent::Nothing
            }
            _ => {
                let name = joystick.name.clone();
                self.joystick = None;
                self.lost = true;
                InputEvent::Lost(name)
            }
        }
    }
}

struct Joystick {
    file: File,
    name: String,
}

impl Joystick {
    fn open(path: &Path) -> Result<Self> {
        let mut options = File::options();
        options.read(true).custom_flags(libc::O_NONBLOCK);
        let file = options.open(path).with_context(|| format!("cannot open the joystick {}", path.display()))?;
        Ok(Self { file, name: path.display().to_string() })
    }
}

fn decode(event: [u8; JOYSTICK_EVENT]) -> InputEvent {
    let [.., low, high, kind, number] = event;
    let value = i16::from_ne_bytes([low, high]);
    match kind & !KIND_INITIAL {
        KIND_BUTTON => InputEvent::Button { number, down: value != 0, initial: kind & KIND_INITIAL != 0 },
        KIND_AXIS => InputEvent::Axis { number, value: (f64::from(value) / f64::from(i16::MAX)).max(-1.0) },
        _ => InputEvent::Nothing,
    }
}

/// Standard input, each key at once and unseen, until it is dropped. Ctrl-C stays a signal.
struct Terminal {
    before: libc::termios,
}

impl Terminal {
    fn open() -> Result<Self> {
        // SAFETY: all zero is a valid structure, which the call fills; the pointers are to locals.
        let set = unsafe {
            let mut before: libc::termios = std::mem::zeroed();
            if libc::tcgetattr(0, &mut before) == 0 {
                let mut keys = before;
                keys.c_lflag &= !(libc::ICANON | libc::ECHO);
                keys.c_cc[libc::VMIN] = 1;
                keys.c_cc[libc::VTIME] = 0;
                (libc::tcsetattr(0, libc::TCSANOW, &keys) == 0).then_some(before)
            } else {
                None
            }
        };
        let before = set.ok_or_else(std::io::Error::last_os_error).context("the terminal's keys cannot be read")?;
        Ok(Self { before })
    }
}

impl Drop for Terminal {
    fn drop(&mut self) {
        // SAFETY: the pointer is to what tcgetattr filled.
        unsafe { libc::tcsetattr(0, libc::TCSANOW, &self.before) };
    }
}

#[cfg(test)]
pub mod tests {
    use super::*;
    use std::io::{Seek, Write};

    /// A joystick that says these events, then is gone.
    pub fn joystick(events: &[(i16, u8, u8)]) -> OperatorInput {
        let mut file = tempfile::tempfile().unwrap();
        for (value, kind, number) in events {
            let [low, high] = value.to_ne_bytes();
            file.write_all(&[1, 2, 3, 4, low, high, *kind, *number]).unwrap();
        }
        file.rewind().unwrap();
        OperatorInput::of_joystick(file)
    }

    #[test]
    fn a_joysticks_events_are_read_until_it_is_gone() {
        let mut input = joystick(&[(1, 0x81, 3), (0, 1, 3), (-32767, 2, 1), (i16::MIN, 2, 1), (16384, 2, 0)]);
        let event: Vec<_> = (0..7).map(|_| input.wait(Instant::now() + Duration::from_millis(2))).collect();
        assert_eq!(event[0], InputEvent::Button { number: 3, down: true, initial: true });
        assert_eq!(event[1], InputEvent::Button { number: 3, down: false, initial: false });
        assert_eq!(
            event[2..4],
            [InputEvent::Axis { number: 1, value: -1.0 }, InputEvent::Axis { number: 1, value: -1.0 }]
        );
        assert!(matches!(event[4], InputEvent::Axis { number: 0, value } if (value - 0.5).abs() < 1e-4));
        assert_eq!(event[5..], [InputEvent::Lost("js".into()), InputEvent::Nothing]);
        assert!(input.is_lost());
    }
}
