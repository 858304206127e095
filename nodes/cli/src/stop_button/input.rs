//! An operator's input, as the stop button understands it.

use crate::operator_input::{InputEvent, OperatorInput};
use anyhow::{Result, bail};
use std::path::Path;
use std::time::{Duration, Instant};

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

/// The operator's input, and which of its buttons mean what.
pub struct Input {
    devices: OperatorInput,
    press: u8,
    release: Option<u8>,
    help: String,
}

impl Input {
    /// Opens a joystick, if one is named, with its buttons, and the keys of standard input, if that is a terminal.
    pub fn open(joystick: Option<(&Path, u8, Option<u8>)>) -> Result<Self> {
        let devices = OperatorInput::open(joystick.map(|(path, ..)| path))?;
        let (press, release) = joystick.map_or((0, None), |(_, press, release)| (press, release));
        let mut help = "publishes emergency_stop 20 times a second.".to_owned();
        match (devices.has_keys(), devices.joystick()) {
            (false, None) => bail!(
                "standard input is no terminal, so no key can be read; run it in a terminal, or name a joystick: --joystick /dev/input/js0"
            ),
            (false, Some(_)) if release.is_none() => {
                bail!(
                    "standard input is no terminal, so nothing could release the stop: name a button with --release-button"
                )
            }
            _ => {}
        }
        if devices.has_keys() {
            help += " Space or Enter: press. r: release. q: leave.";
        }
        if let Some(name) = devices.joystick() {
            help += &format!(" Button {press} of {name}: press.");
            if let Some(release) = release {
                help += &format!(" Button {release}: release.");
            }
        }
        help += " Its silence stops the robot where the controller asks for a heartbeat.";
        Ok(Self { devices, press, release, help })
    }

    /// What the operator can do, in words.
    pub fn help(&self) -> &str {
        &self.help
    }

    /// Whether an input was lost. Then nothing releases any more.
    pub fn is_lost(&self) -> bool {
        self.devices.is_lost()
    }

    /// Waits for the next event, at most so long.
    pub fn wait(&mut self, patience: Duration) -> Event {
        let deadline = Instant::now() + patience;
        loop {
            let event = match self.devices.wait(deadline) {
                InputEvent::Nothing => return Event::Nothing,
                moved => self.meant(moved),
            };
            if event != Event::Nothing || Instant::now() >= deadline {
                return event;
            }
        }
    }

    fn meant(&self, moved: InputEvent) -> Event {
        match moved {
            InputEvent::Key(b' ' | b'\r' | b'\n') => Event::Press,
            InputEvent::Key(b'r' | b'R') => Event::Release,
            InputEvent::Key(b'q' | b'Q') => Event::Leave,
            // Held already when the program began: it counts.
            InputEvent::Button { number, down: true, .. } if number == self.press => Event::Press,
            InputEvent::Button { number, down: true, initial: false } if self.release == Some(number) => Event::Release,
            InputEvent::Lost(what) => Event::Lost(what),
            _ => Event::Nothing,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::operator_input::tests::joystick;

    const BUTTON: u8 = 1;
    const INITIAL: u8 = 0x80;

    fn events(of: &[(i16, u8, u8)], count: usize) -> Vec<Event> {
        let mut input = Input { devices: joystick(of), press: 3, release: Some(7), help: String::new() };
        (0..count).map(|_| input.wait(Duration::from_millis(10))).collect()
    }

    #[test]
    fn a_joystick_presses_when_its_button_goes_down_or_is_down_already() {
        let lost = || Event::Lost("js".into());
        assert_eq!(events(&[(1, BUTTON, 3)], 2), [Event::Press, lost()]);
        assert_eq!(events(&[(1, BUTTON | INITIAL, 3)], 1), [Event::Press]);
        assert_eq!(events(&[(0, BUTTON, 3)], 1), [lost()], "letting go releases nothing");
        assert_eq!(events(&[(1, BUTTON, 7)], 1), [Event::Release]);
        assert_eq!(events(&[(1, BUTTON | INITIAL, 7)], 1), [lost()]);
        assert_eq!(events(&[(32767, 2, 3)], 1), [lost()], "an axis");
    }

    #[test]
    fn a_joystick_that_is_unplugged_is_lost() {
        assert_eq!(events(&[], 2), [Event::Lost("js".into()), Event::Nothing]);
    }
}
