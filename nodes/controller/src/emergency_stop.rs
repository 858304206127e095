//! The emergency stop: what everybody who may press it says, kept apart, and no press lost between two cycles.

use ros::{Departure, PublisherId};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

/// Publishers of the topic that are distinguished. One more is not listened to for its `false`, and its being there
/// counts as pressed.
pub const PUBLISHERS: usize = 32;

/// What the control cycle sees of one publisher.
#[derive(Debug, Default)]
struct Level {
    pressed: AtomicBool,
    /// Monotonic time of its last message, ns, where its silence counts as a press; else 0.
    heartbeat_ns: AtomicU64,
}

/// What the middleware's side remembers of one publisher.
#[derive(Clone, Copy, Debug)]
struct Known {
    id: PublisherId,
    last: Duration,
    pressed: bool,
    /// It has sent two messages within the heartbeat: its silence counts as a press.
    is_heartbeat: bool,
    gone: Gone,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Gone {
    No,
    /// It left in order, and had pressed.
    InOrder,
    /// It was lost, and had pressed or was a heartbeat.
    Lost,
}

/// The emergency stop's levels. Pressed by the service, by any publisher of the topic, by a heartbeat's silence, or
/// because the node is not active. The control cycle reads it without waiting; everything else is for the middleware's
/// threads.
#[derive(Debug, Default)]
pub struct EmergencyStop {
    /// Every press adds one: a cycle that finds more than the one before is pressed, whatever the levels say by then.
    presses: AtomicU64,
    /// Presses that a cycle has seen. The cycle's own.
    seen: AtomicU64,
    inactive: AtomicBool,
    service: AtomicBool,
    /// More publishers than places.
    overflow: AtomicBool,
    levels: [Level; PUBLISHERS],
    known: Mutex<[Option<Known>; PUBLISHERS]>,
    /// Monotonic time of the last message of anyone, ns.
    received_ns: AtomicU64,
    /// Longest silence, ns; 0: silence means nothing.
    heartbeat_ns: u64,
}

fn ns(time: Duration) -> u64 {
    u64::try_from(time.as_nanos()).unwrap_or(u64::MAX)
}

impl EmergencyStop {
    /// Released. With a heartbeat, pressed until the topic is received.
    pub fn new(heartbeat: Option<Duration>) -> Self {
        Self { heartbeat_ns: heartbeat.map_or(0, ns), ..Self::default() }
    }

    /// The node became active, or is no longer.
    pub fn set_active(&self, active: bool) {
        self.inactive.store(!active, Ordering::Release);
        self.latch(!active);
    }

    /// Whether the node is active.
    pub fn is_active(&self) -> bool {
        !self.inactive.load(Ordering::Acquire)
    }

    /// The service was called. Its `false` also forgets publishers that are gone or silent.
    pub fn set_by_service(&self, pressed: bool, wall: Duration) {
        self.service.store(pressed, Ordering::Release);
        self.latch(pressed);
        if !pressed {
            let mut known = self.known.lock().unwrap_or_else(PoisonError::into_inner);
            self.overflow.store(false, Ordering::Release);
            self.forget(&mut known, |publisher| publisher.gone != Gone::No || self.is_silent(publisher, wall));
        }
    }

    /// A publisher of the topic sent a message. False: there are too many publishers, and that counts as pressed.
    pub fn received(&self, id: PublisherId, pressed: bool, wall: Duration) -> bool {
        // First of all: nothing that follows may lose it.
        self.latch(pressed);
        let mut known = self.known.lock().unwrap_or_else(PoisonError::into_inner);
        self.received_ns.store(ns(wall), Ordering::Release);
        let place = known.iter().position(|known| known.is_some_and(|known| known.id == id));
        let Some(place) = place.or_else(|| self.free_place(&mut known, wall)) else {
            self.overflow.store(true, Ordering::Release);
            return false;
        };
        let before = known[place].filter(|known| known.id == id);
        let soon = self.heartbeat_ns > 0
            && before.is_some_and(|before| ns(wall.saturating_sub(before.last)) <= self.heartbeat_ns);
        let is_heartbeat = before.is_some_and(|before| before.is_heartbeat) || soon;
        known[place] = Some(Known { id, last: wall, pressed, is_heartbeat, gone: Gone::No });
        // A level that is to be pressed is so before it counts as received.
        let level = &self.levels[place];
        level.pressed.store(pressed, Ordering::Release);
        level.heartbeat_ns.store(if is_heartbeat { ns(wall) } else { 0 }, Ordering::Release);
        match before {
            _ if pressed => {}
            // A person at a button presses and lets go: what nobody else can take back is taken back.
            Some(before) if before.pressed => {
                self.overflow.store(false, Ordering::Release);
                self.forget(&mut known, |other| other.gone != Gone::No || self.is_silent(other, wall));
            }
            // The next one of those who come, say one thing, and go (`ros2 topic pub --once`).
            None => self.forget(&mut known, |other| other.gone == Gone::InOrder),
            Some(_) => {}
        }
        true
    }

    /// Publishers are gone. What they had pressed stays pressed; one that was lost is missed as a heartbeat, one that
    /// took its leave is not.
    pub fn left(&self, departure: Departure) {
        let mut known = self.known.lock().unwrap_or_else(PoisonError::into_inner);
        for place in 0..PUBLISHERS {
            let Some(publisher) = known[place].filter(|publisher| departure.covers(publisher.id)) else { continue };
            let missed = publisher.is_heartbeat && !departure.in_order;
            if !publisher.pressed && !missed {
                self.clear(&mut known[place], place);
                continue;
            }
            let gone = if departure.in_order { Gone::InOrder } else { Gone::Lost };
            known[place] = Some(Known { gone, ..publisher });
            self.levels[place].pressed.store(true, Ordering::Release);
        }
    }

    /// Whether the robot is to be damped now. For the control cycle alone: a press counts as seen. Wait-free.
    pub fn is_pressed(&self, wall: Duration) -> bool {
        let presses = self.presses.load(Ordering::Acquire);
        let latched = self.seen.swap(presses, Ordering::Relaxed) != presses;
        let silent = |received: u64| ns(wall).saturating_sub(received) > self.heartbeat_ns;
        let by_topic = self.levels.iter().any(|level| {
            let received = level.heartbeat_ns.load(Ordering::Acquire);
            level.pressed.load(Ordering::Acquire) || (received > 0 && silent(received))
        });
        let not_received = self.heartbeat_ns > 0 && {
            let received = self.received_ns.load(Ordering::Acquire);
            received == 0 || silent(received)
        };
        latched
            || by_topic
            || not_received
            || !self.is_active()
            || self.service.load(Ordering::Acquire)
            || self.overflow.load(Ordering::Acquire)
    }

    fn latch(&self, pressed: bool) {
        if pressed {
            self.presses.fetch_add(1, Ordering::AcqRel);
        }
    }

    fn is_silent(&self, publisher: &Known, wall: Duration) -> bool {
        publisher.is_heartbeat && ns(wall.saturating_sub(publisher.last)) > self.heartbeat_ns
    }

    /// An empty place, or that of the one who was silent longest among those whose silence and level mean nothing.
    fn free_place(&self, known: &mut [Option<Known>; PUBLISHERS], wall: Duration) -> Option<usize> {
        if let Some(empty) = known.iter().position(Option::is_none) {
            return Some(empty);
        }
        let idle = |publisher: &Known| !publisher.pressed && !publisher.is_heartbeat && publisher.gone == Gone::No;
        let oldest = (0..PUBLISHERS)
            .filter_map(|place| known[place].filter(idle).map(|publisher| (publisher.last, place)))
            .filter(|(last, _)| wall.saturating_sub(*last) > Duration::from_secs(1))
            .min()?;
        self.clear(&mut known[oldest.1], oldest.1);
        Some(oldest.1)
    }

    fn forget(&self, known: &mut [Option<Known>; PUBLISHERS], which: impl Fn(&Known) -> bool) {
        for place in 0..PUBLISHERS {
            if known[place].as_ref().is_some_and(&which) {
                self.clear(&mut known[place], place);
            }
        }
    }

    fn clear(&self, known: &mut Option<Known>, place: usize) {
        *known = None;
        self.levels[place].heartbeat_ns.store(0, Ordering::Release);
        self.levels[place].pressed.store(false, Ordering::Release);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Duration = Duration::from_millis(1);
    const NOW: Duration = Duration::from_secs(100);

    fn id(n: u8) -> PublisherId {
        PublisherId([n; 16])
    }

    fn leaves(n: u8, in_order: bool) -> Departure {
        Departure::of_publisher(id(n), in_order)
    }

    #[test]
    fn a_press_is_seen_by_one_cycle_though_it_is_taken_back_before() {
        let stop = EmergencyStop::new(None);
        stop.received(id(1), true, NOW);
        stop.received(id(1), false, NOW);
        assert!(stop.is_pressed(NOW));
        assert!(!stop.is_pressed(NOW));
        stop.set_by_service(true, NOW);
        stop.set_by_service(false, NOW);
        assert!(stop.is_pressed(NOW));
        assert!(!stop.is_pressed(NOW));
        stop.set_active(false);
        stop.set_active(true);
        assert!(stop.is_pressed(NOW));
        assert!(!stop.is_pressed(NOW));
    }

    #[test]
    fn what_others_send_does_not_release_a_publishers_press() {
        let stop = EmergencyStop::new(None);
        stop.received(id(2), false, NOW);
        stop.received(id(1), true, NOW);
        for n in 0..100 {
            stop.received(id(2), false, NOW + n * MS);
            assert!(stop.is_pressed(NOW + n * MS));
        }
        stop.set_by_service(false, NOW);
        assert!(stop.is_pressed(NOW), "neither does the service: the button is there and can be let go");
        stop.received(id(1), false, NOW);
        assert!(!stop.is_pressed(NOW + MS));
    }

    #[test]
    fn each_way_presses_alone() {
        let stop = EmergencyStop::new(None);
        assert!(!stop.is_pressed(NOW));
        stop.set_by_service(true, NOW);
        assert!(stop.is_pressed(NOW) && stop.is_pressed(NOW));
        stop.set_by_service(false, NOW);
        assert!(!stop.is_pressed(NOW));
        stop.set_active(false);
        assert!(stop.is_pressed(NOW) && stop.is_pressed(NOW));
        stop.set_active(true);
        assert!(!stop.is_pressed(NOW));
        stop.received(id(1), false, NOW);
        assert!(!stop.is_pressed(NOW + Duration::from_secs(1000)), "without a heartbeat silence means nothing");
    }

    #[test]
    fn a_heartbeat_that_stops_is_a_press_though_others_talk() {
        let stop = EmergencyStop::new(Some(500 * MS));
        assert!(stop.is_pressed(NOW), "not received yet");
        for n in 0..20 {
            stop.received(id(1), false, NOW + n * 50 * MS);
            stop.received(id(2), false, NOW + n * 50 * MS);
        }
        let mut now = NOW + 950 * MS;
        assert!(!stop.is_pressed(now));
        for _ in 0..12 {
            now += 50 * MS;
            stop.received(id(2), false, now);
        }
        assert!(stop.is_pressed(now), "the first one is silent");
        stop.received(id(3), false, now);
        assert!(stop.is_pressed(now), "a newcomer does not stand in for it");
        stop.received(id(1), false, now);
        assert!(!stop.is_pressed(now), "it is back");
    }

    #[test]
    fn one_message_makes_no_heartbeat() {
        let stop = EmergencyStop::new(Some(500 * MS));
        stop.received(id(1), true, NOW);
        stop.received(id(2), false, NOW);
        stop.left(leaves(1, true));
        assert!(stop.is_pressed(NOW));
        stop.received(id(3), false, NOW + 50 * MS);
        stop.left(leaves(3, true));
        let mut now = NOW + 50 * MS;
        for _ in 0..100 {
            now += 50 * MS;
            stop.received(id(2), false, now);
        }
        stop.is_pressed(now);
        assert!(!stop.is_pressed(now), "neither the one nor the other is missed");
    }

    #[test]
    fn a_heartbeat_that_takes_its_leave_is_not_missed_but_somebody_must_be_received() {
        let stop = EmergencyStop::new(Some(500 * MS));
        for n in 0..3 {
            stop.received(id(1), false, NOW + n * 50 * MS);
            stop.received(id(2), false, NOW + n * 50 * MS);
        }
        stop.left(leaves(1, true));
        stop.received(id(2), false, NOW + 590 * MS);
        assert!(!stop.is_pressed(NOW + 700 * MS));
        stop.left(leaves(2, true));
        assert!(!stop.is_pressed(NOW + 700 * MS));
        assert!(stop.is_pressed(NOW + 1200 * MS), "no publisher is received");
    }

    #[test]
    fn a_lost_heartbeat_and_a_lost_press_are_released_by_the_service_or_by_pressing_and_letting_go() {
        for by_service in [true, false] {
            let stop = EmergencyStop::new(Some(500 * MS));
            for n in 0..3 {
                stop.received(id(1), false, NOW + n * 50 * MS);
                stop.received(id(2), true, NOW + n * 50 * MS);
                stop.received(id(3), false, NOW + n * 50 * MS);
            }
            stop.left(leaves(1, false));
            stop.left(leaves(2, false));
            let now = NOW + 150 * MS;
            stop.received(id(3), false, now);
            stop.received(id(4), false, now);
            assert!(stop.is_pressed(now) && stop.is_pressed(now));
            if by_service {
                stop.set_by_service(false, now);
            } else {
                stop.received(id(4), true, now);
                stop.received(id(4), false, now);
                assert!(stop.is_pressed(now), "the press was one");
            }
            assert!(!stop.is_pressed(now), "by service: {by_service}");
        }
    }

    #[test]
    fn a_press_whose_publisher_took_its_leave_stays_until_the_next_one_sends_otherwise() {
        let stop = EmergencyStop::new(None);
        stop.received(id(1), false, NOW);
        stop.received(id(2), true, NOW);
        stop.left(leaves(2, true));
        stop.received(id(1), false, NOW);
        assert!(stop.is_pressed(NOW) && stop.is_pressed(NOW), "one who talked all the time releases nothing");
        stop.received(id(3), false, NOW);
        assert!(!stop.is_pressed(NOW));
    }

    #[test]
    fn more_publishers_than_places_count_as_pressed() {
        let stop = EmergencyStop::new(None);
        let now = NOW + 1500 * MS;
        for n in 0..PUBLISHERS as u8 {
            assert!(stop.received(id(n), false, now));
        }
        assert!(!stop.is_pressed(now));
        assert!(!stop.received(id(200), false, now));
        assert!(stop.is_pressed(now) && stop.is_pressed(now));
        stop.set_by_service(false, now);
        assert!(!stop.is_pressed(now));
        // Those that were not received for a while make room.
        assert!(stop.received(id(200), false, now + 1001 * MS));
        assert!(!stop.received(id(201), true, now + 500 * MS), "nobody has been silent for long");
    }
}
