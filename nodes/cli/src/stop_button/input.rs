//! Keys of a terminal and buttons of a joystick, as events; and what is left when they are lost.

use anyhow::{Context, Result, bail};
use std::fs::File;
use std::io::{IsTerminal, Read};
use std::os::fd::AsRawFd;
use std::os::unix::fs::OpenOptionsExt;
use std::path::Path;
use std::time::{Duration, Instant};

/// A joystick's event: time in ms (4 bytes), value (2), kind (1), number (1).
const JOYSTICK_EVENT: usize = 8;
const KIND_BUTTON: u8 = 0x01;
/// The state at the beginning, sent as events: it counts, for a button that is held already.
const KIND_INITIAL: u8 = 0x80;

/// What a person wants, or what happened to the input.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Event {
    /// Nothing in this time.
    Nothing,
    /// Press the stop.
    Press,
    /// Release it.
    Release,
    /// Leave.
    Leave,
    /// The named input is gone.
    Lost(String),
}

/// The terminal and the joystick, as far as they are there.
pub struct Input {
    keys: Option<Terminal>,
    joystick: Option<Joystick>,
    lost: bool,
    help: String,
}

impl Input {
    /// Opens a joystick, if one is named, with its buttons, and the keys of standard input, if that is a terminal.
    pub fn open(joystick: Option<(&Path, u8, Option<u8>)>) -> Result<Self> {
        let joystick = joystick.map(|(path, press, release)| Joystick::open(path, press, release)).transpose()?;
        let keys = std::io::stdin().is_terminal().then(Terminal::open).transpose()?;
        let mut help = "publishes emergency_stop 20 times a second.".to_owned();
        match (&keys, &joystick) {
            (None, None) => bail!(
                "standard input is no terminal, so no key can be read; run it in a terminal, or name a joystick: --joystick /dev/input/js0"
            ),
            (None, Some(Joystick { release: None, .. })) => {
                bail!(
                    "standard input is no terminal, so nothing could release the stop: name a button with --release-button"
                )
            }
            _ => {}
        }
        if keys.is_some() {
            help += " Space or Enter: press. r: release. q: leave.";
        }
        if let Some(joystick) = &joystick {
            help += &format!(" Button {} of {}: press.", joystick.press, joystick.name);
            if let Some(release) = joystick.release {
                help += &format!(" Button {release}: release.");
            }
        }
        help += " Its silence stops the robot where the controller asks for a heartbeat.";
        Ok(Self { keys, joystick, lost: false, help })
    }

    /// What the operator can do, in words.
    pub fn help(&self) -> &str {
        &self.help
    }

    /// Whether an input was lost. Then nothing releases any more.
    pub fn is_lost(&self) -> bool {
        self.lost
    }

    /// Waits for the next event, at most so long.
    pub fn wait(&mut self, patience: Duration) -> Event {
        let deadline = Instant::now() + patience;
        loop {
            let left = deadline.saturating_duration_since(Instant::now());
            let fd = |fd: Option<i32>| libc::pollfd { fd: fd.unwrap_or(-1), events: libc::POLLIN, revents: 0 };
            let keys = self.keys.as_ref().map(|_| 0);
            let mut fds = [fd(keys), fd(self.joystick.as_ref().map(|joystick| joystick.file.as_raw_fd()))];
            // Rounded up: not a turn without waiting at the end.
            let timeout_ms = i32::try_from(left.as_micros().div_ceil(1000)).unwrap_or(i32::MAX);
            // SAFETY: the pointer and the count are the array's. A descriptor of -1 is passed over.
            let ready = unsafe { libc::poll(fds.as_mut_ptr(), 2, timeout_ms) };
            let event = match ready {
                1.. if fds[1].revents != 0 => self.read_joystick(),
                1.. => self.read_key(),
                // A signal: the caller looks whether it is to end.
                _ => return Event::Nothing,
            };
            if event != Event::Nothing || Instant::now() >= deadline {
                return event;
            }
        }
    }

    fn read_key(&mut self) -> Event {
        let mut key = 0_u8;
        // Past the standard library's buffer: what waited there, poll would not tell of.
        // SAFETY: the pointer is to a local of that size.
        match unsafe { libc::read(0, (&raw mut key).cast(), 1) } {
            1 => match key {
                b' ' | b'\r' | b'\n' => Event::Press,
                b'r' | b'R' => Event::Release,
                b'q' | b'Q' => Event::Leave,
                _ => Event::Nothing,
            },
            -1 if std::io::Error::last_os_error().kind() == std::io::ErrorKind::Interrupted => Event::Nothing,
            _ => {
                self.keys = None;
                self.lost = true;
                Event::Lost("the terminal".into())
            }
        }
    }

    fn read_joystick(&mut self) -> Event {
        let Some(joystick) = &mut self.joystick else { return Event::Nothing };
        let mut event = [0; JOYSTICK_EVENT];
        match joystick.file.read(&mut event) {
            Ok(JOYSTICK_EVENT) => joystick.decode(event),
            Err(error) if matches!(error.kind(), std::io::ErrorKind::Interrupted | std::io::ErrorKind::WouldBlock) => {
                Event::Nothing
            }
            _ => {
                let name = joystick.name.clone();
                self.joystick = None;
                self.lost = true;
                Event::Lost(name)
            }
        }
    }
}

struct Joystick {
    file: File,
    name: String,
    press: u8,
    release: Option<u8>,
}

impl Joystick {
    fn open(path: &Path, press: u8, release: Option<u8>) -> Result<Self> {
        let mut options = File::options();
        options.read(true).custom_flags(libc::O_NONBLOCK);
        let file = options.open(path).with_context(|| format!("cannot open the joystick {}", path.display()))?;
        Ok(Self { file, name: path.display().to_string(), press, release })
    }

    fn decode(&self, event: [u8; JOYSTICK_EVENT]) -> Event {
        let [.., value_low, value_high, kind, number] = event;
        let down = i16::from_ne_bytes([value_low, value_high]) != 0;
        if kind & !KIND_INITIAL != KIND_BUTTON || !down {
            Event::Nothing
        } else if number == self.press {
            Event::Press
        } else if self.release == Some(number) && kind & KIND_INITIAL == 0 {
            Event::Release
        } else {
            Event::Nothing
        }
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
mod tests {
    use super::*;

    fn event(value: i16, kind: u8, number: u8) -> [u8; JOYSTICK_EVENT] {
        let value = value.to_ne_bytes();
        [1, 2, 3, 4, value[0], value[1], kind, number]
    }

    #[test]
    fn a_joystick_presses_when_its_button_goes_down_or_is_down_already() {
        let file = tempfile::tempfile().unwrap();
        let joystick = Joystick { file, name: "js".into(), press: 3, release: Some(7) };
        assert_eq!(joystick.decode(event(1, KIND_BUTTON, 3)), Event::Press);
        assert_eq!(joystick.decode(event(1, KIND_BUTTON | KIND_INITIAL, 3)), Event::Press);
        assert_eq!(joystick.decode(event(0, KIND_BUTTON, 3)), Event::Nothing, "letting go releases nothing");
        assert_eq!(joystick.decode(event(1, KIND_BUTTON, 7)), Event::Release);
        assert_eq!(joystick.decode(event(1, KIND_BUTTON | KIND_INITIAL, 7)), Event::Nothing);
        assert_eq!(joystick.decode(event(32767, 0x02, 3)), Event::Nothing, "an axis");
    }

    #[test]
    fn a_joystick_that_is_unplugged_is_lost() {
        let file = tempfile::tempfile().unwrap();
        let joystick = Some(Joystick { file, name: "js".into(), press: 0, release: None });
        let mut input = Input { keys: None, joystick, lost: false, help: String::new() };
        // An empty file ends at once, as a device does that is gone.
        assert_eq!(input.wait(Duration::from_millis(10)), Event::Lost("js".into()));
        assert!(input.is_lost());
        assert_eq!(input.wait(Duration::from_millis(1)), Event::Nothing);
    }
}
