//! From an operator's input to what the robot is asked for: a velocity, and whether the emergency stop is pressed.

use crate::operator_input::InputEvent;
use std::time::{Duration, Instant};

/// Directions of the keys, ahead, to the left and turning left, as teleop_twist_keyboard has them.
const DIRECTIONS: [(u8, [f64; 3]); 16] = [
    (b'i', [1.0, 0.0, 0.0]),
    (b'o', [1.0, 0.0, -1.0]),
    (b'u', [1.0, 0.0, 1.0]),
    (b'j', [0.0, 0.0, 1.0]),
    (b'l', [0.0, 0.0, -1.0]),
    (b',', [-1.0, 0.0, 0.0]),
    (b'.', [-1.0, 0.0, 1.0]),
    (b'm', [-1.0, 0.0, -1.0]),
    // With the shift key it goes sideways where it would have turned.
    (b'I', [1.0, 0.0, 0.0]),
    (b'O', [1.0, -1.0, 0.0]),
    (b'U', [1.0, 1.0, 0.0]),
    (b'J', [0.0, 1.0, 0.0]),
    (b'L', [0.0, -1.0, 0.0]),
    (b'<', [-1.0, 0.0, 0.0]),
    (b'>', [-1.0, -1.0, 0.0]),
    (b'M', [-1.0, 1.0, 0.0]),
];
/// Factors of the speed and of the turning by the keys that change them, likewise.
const FACTORS: [(u8, [f64; 2]); 6] = [
    (b'q', [1.1, 1.1]),
    (b'z', [0.9, 0.9]),
    (b'w', [1.1, 1.0]),
    (b'x', [0.9, 1.0]),
    (b'e', [1.0, 1.1]),
    (b'c', [1.0, 0.9]),
];
/// A stick that is let go of rests within this of its middle.
const DEAD_ZONE: f64 = 0.08;

/// Which of a joystick's buttons mean what; its axes are 1 and 0 of the left stick, and 3 of the right one.
#[derive(Clone, Copy, Debug)]
pub struct Buttons {
    /// Presses the emergency stop.
    pub press: u8,
    /// Releases it.
    pub release: Option<u8>,
    /// The sticks move the robot while this one is held.
    pub enable: u8,
}

/// What is asked for.
#[derive(Clone, Debug)]
pub struct Steer {
    /// Largest speed, m/s, and turning, rad/s.
    speed: [f64; 2],
    /// A key counts for so long.
    hold: Duration,
    buttons: Buttons,
    key: Option<([f64; 3], Instant)>,
    stick: [f64; 3],
    enabled: bool,
    pressed: bool,
    lost: bool,
}

impl Steer {
    /// Nothing is asked for.
    pub fn new(speed_m_s: f64, turn_rad_s: f64, hold: Duration, buttons: Buttons) -> Self {
        Self {
            speed: [speed_m_s, turn_rad_s],
            hold,
            buttons,
            key: None,
            stick: [0.0; 3],
            enabled: false,
            pressed: false,
            lost: false,
        }
    }

    /// Whether the emergency stop is pressed.
    pub fn pressed(&self) -> bool {
        self.pressed
    }

    /// The greatest speed, m/s, and turning, rad/s.
    pub fn speed(&self) -> [f64; 2] {
        self.speed
    }

    /// The velocity that is asked for: ahead and to the left, m/s, and turning, rad/s.
    pub fn velocity(&self, now: Instant) -> [f64; 3] {
        let of_key = self.key.filter(|(_, at)| now.saturating_duration_since(*at) < self.hold);
        let direction = match of_key {
            _ if self.pressed || self.lost => [0.0; 3],
            _ if self.enabled => self.stick,
            Some((direction, _)) => direction,
            None => [0.0; 3],
        };
        let [speed, turn] = self.speed;
        [direction[0] * speed, direction[1] * speed, direction[2] * turn]
    }

    /// Takes an input. What is lost is pressed, and nothing releases it any more.
    pub fn take(&mut self, event: &InputEvent, now: Instant) {
        match event {
            InputEvent::Nothing => {}
            InputEvent::Key(key) => self.key(*key, now),
            InputEvent::Button { number, down, initial } => self.button(*number, *down, *initial),
            InputEvent::Axis { number, value } => {
                let value = if value.abs() < DEAD_ZONE { 0.0 } else { *value };
                // Forward and left are negative.
                match number {
                    1 => self.stick[0] = -value,
                    0 => self.stick[1] = -value,
                    3 => self.stick[2] = -value,
                    _ => {}
                }
            }
            InputEvent::Lost(_) => (self.pressed, self.lost) = (true, true),
        }
    }

    fn key(&mut self, key: u8, now: Instant) {
        let factors = FACTORS.iter().find(|(of, _)| *of == key);
        let direction = DIRECTIONS.iter().find(|(of, _)| *of == key);
        match (key, direction, factors) {
            (b' ', ..) => self.press(),
            (b'r' | b'R', ..) => self.pressed = self.lost,
            (_, Some((_, direction)), _) => self.key = Some((*direction, now)),
            (_, _, Some((_, factors))) => self.speed = [self.speed[0] * factors[0], self.speed[1] * factors[1]],
            // k, and every other key.
            _ => self.key = None,
        }
    }

    fn button(&mut self, number: u8, down: bool, initial: bool) {
        if number == self.buttons.enable {
            // Held since before the program began, it lay somewhere.
            self.enabled = down && !initial;
        } else if down && number == self.buttons.press {
            self.press();
        } else if down && !initial && self.buttons.release == Some(number) {
            self.pressed = self.lost;
        }
    }

    /// Nothing that was asked for before it holds after it.
    fn press(&mut self) {
        (self.pressed, self.key, self.enabled) = (true, None, false);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HOLD: Duration = Duration::from_millis(700);

    fn steer() -> Steer {
        Steer::new(0.5, 1.0, HOLD, Buttons { press: 0, release: Some(7), enable: 4 })
    }

    fn type_all(steer: &mut Steer, keys: &[u8], now: Instant) {
        keys.iter().for_each(|key| steer.take(&InputEvent::Key(*key), now));
    }

    #[test]
    fn keys_mean_what_teleop_twist_keyboards_mean() {
        let (mut steer, now) = (steer(), Instant::now());
        for (key, expected) in [
            (b'i', [0.5, 0.0, 0.0]),
            (b'u', [0.5, 0.0, 1.0]),
            (b'l', [0.0, 0.0, -1.0]),
            (b',', [-0.5, 0.0, 0.0]),
            (b'J', [0.0, 0.5, 0.0]),
            (b'>', [-0.5, -0.5, 0.0]),
            (b'k', [0.0; 3]),
        ] {
            type_all(&mut steer, &[key], now);
            assert_eq!(steer.velocity(now), expected, "{}", char::from(key));
        }
        type_all(&mut steer, b"wwci", now);
        let [ahead, _, _] = steer.velocity(now);
        assert!((ahead - 0.605).abs() < 1e-12 && (steer.speed()[1] - 0.9).abs() < 1e-12);
    }

    #[test]
    fn a_key_that_is_let_go_of_counts_no_longer() {
        let (mut steer, now) = (steer(), Instant::now());
        type_all(&mut steer, b"i", now);
        assert_eq!(steer.velocity(now + HOLD / 2)[0], 0.5);
        assert_eq!(steer.velocity(now + HOLD), [0.0; 3]);
    }

    #[test]
    fn the_space_bar_stops_until_it_is_released_and_what_was_asked_before_is_forgotten() {
        let (mut steer, now) = (steer(), Instant::now());
        type_all(&mut steer, b"i ", now);
        assert!(steer.pressed() && steer.velocity(now) == [0.0; 3]);
        type_all(&mut steer, b"i", now);
        assert_eq!(steer.velocity(now), [0.0; 3], "pressed, no key moves it");
        type_all(&mut steer, b" r", now);
        assert!(!steer.pressed() && steer.velocity(now) == [0.0; 3]);
    }

    #[test]
    fn sticks_move_it_only_while_their_button_is_held() {
        let (mut steer, now) = (steer(), Instant::now());
        let button = |number, down| InputEvent::Button { number, down, initial: false };
        steer.take(&InputEvent::Axis { number: 1, value: -1.0 }, now);
        steer.take(&InputEvent::Axis { number: 3, value: 0.05 }, now);
        assert_eq!(steer.velocity(now), [0.0; 3]);
        steer.take(&InputEvent::Button { number: 4, down: true, initial: true }, now);
        assert_eq!(steer.velocity(now), [0.0; 3], "held before it began");
        steer.take(&button(4, true), now);
        assert_eq!(steer.velocity(now), [0.5, 0.0, 0.0]);
        steer.take(&button(0, true), now);
        steer.take(&button(7, true), now);
        assert!(!steer.pressed() && steer.velocity(now) == [0.0; 3], "to be held anew after a stop");
    }

    #[test]
    fn what_is_lost_is_pressed_for_good() {
        let (mut steer, now) = (steer(), Instant::now());
        steer.take(&InputEvent::Lost("the terminal".into()), now);
        type_all(&mut steer, b"ri", now);
        assert!(steer.pressed() && steer.velocity(now) == [0.0; 3]);
    }
}
