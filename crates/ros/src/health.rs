//! Whether the threads of a process live: each that carries something counts its turns, and who watches notes that a
//! count stands still. Only time in which the watcher itself ran is held against the watched one.

use std::sync::atomic::{AtomicBool, AtomicU8, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, OnceLock, PoisonError, Weak};
use std::time::Duration;

use ros2_client::dds::rustdds::LoopWatch;

/// A thread that has not turned for so long has failed, in any node.
pub(crate) const SILENCE: Duration = Duration::from_secs(1);
/// One look counts at most this much of a thread's silence.
pub(crate) const LONGEST_LOOK: Duration = Duration::from_millis(10);

/// A thread of the process has panicked, and its message.
pub(crate) static PANICKED: AtomicBool = AtomicBool::new(false);
pub(crate) static PANIC: Mutex<String> = Mutex::new(String::new());

/// What the names of the threads that carry messages begin with: the middleware's event thread, and those that run
/// callbacks.
pub const THREADS: [&str; 2] = ["RustDDS Partici", "ros"];

/// A thread whose silence is a failure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Thread {
    /// The middleware's, which sends and receives.
    EventLoop = 1,
    /// The node's own, which run callbacks.
    Workers = 2,
    /// The middleware's, which finds other nodes.
    Discovery = 3,
    /// One of the program's: [`Health::watch`].
    Program = 4,
}

impl Thread {
    fn name(self) -> &'static str {
        match self {
            Thread::EventLoop => "the middleware's event thread",
            Thread::Workers => "the pool of threads that run callbacks",
            Thread::Discovery => "the middleware's discovery thread",
            Thread::Program => "a thread of the program",
        }
    }
}

/// [`Health`]'s number for a suspension, beside those of threads.
pub(crate) const SUSPENDED: u8 = 100;

#[derive(Debug, Default)]
pub(crate) struct WatchState {
    /// 0, a [`Thread`] that stands still, or [`SUSPENDED`]. The first failure stays.
    pub(crate) failure: AtomicU8,
    pub(crate) supervised: bool,
    pub(crate) ended: AtomicBool,
    workers: Arc<AtomicU64>,
    pub(crate) loops: OnceLock<(Arc<LoopWatch>, Arc<LoopWatch>)>,
    /// The program's threads, each with its silence.
    threads: Mutex<Vec<(Weak<AtomicU64>, Silence<1>)>>,
}

/// Whether a node's threads live. Clones share one state.
#[derive(Clone, Debug, Default)]
pub struct Health(pub(crate) Arc<WatchState>);

impl Health {
    /// With `supervised` a panic in any thread of the process is a failure.
    pub(crate) fn new(supervised: bool) -> Self {
        Health(Arc::new(WatchState { supervised, ..WatchState::default() }))
    }

    /// Whether anything has failed: the process ends soon, and a robot is damped now. Wait-free.
    #[must_use]
    pub fn has_failed(&self) -> bool {
        self.0.failure.load(Ordering::Acquire) != 0 || (self.0.supervised && PANICKED.load(Ordering::Acquire))
    }

    /// Declares that a thread has failed: the node ends with an error within 2 s. Wait-free.
    pub fn fail(&self, thread: Thread) {
        self.note(thread as u8);
    }

    pub(crate) fn note(&self, failure: u8) {
        // The first one stays.
        let _ = self.0.failure.compare_exchange(0, failure, Ordering::AcqRel, Ordering::Acquire);
    }

    /// What has failed, as a sentence.
    #[must_use]
    pub fn failure(&self) -> Option<String> {
        if self.0.supervised && PANICKED.load(Ordering::Acquire) {
            let text = PANIC.lock().unwrap_or_else(PoisonError::into_inner).clone();
            return Some(format!("a thread panicked: {text}"));
        }
        let threads = [Thread::EventLoop, Thread::Workers, Thread::Discovery, Thread::Program];
        match self.0.failure.load(Ordering::Acquire) {
            0 => None,
            SUSPENDED => Some(
                "the process had been stopped (SIGSTOP, Ctrl-Z, a machine that slept) and went on; its connections did not outlive that: \
                 start it again"
                    .to_string(),
            ),
            which => {
                let name = threads.into_iter().find(|thread| *thread as u8 == which).map_or("a thread", Thread::name);
                Some(format!("{name} stands still"))
            }
        }
    }

    /// Turns of the middleware's event thread, and of the threads that run callbacks. The first grows every 5 ms and
    /// the second too, where nothing holds them up. Wait-free.
    #[must_use]
    pub fn turns(&self) -> [u64; 2] {
        [self.0.loops.get().map_or(0, |loops| loops.0.turns()), self.0.workers.load(Ordering::Relaxed)]
    }

    /// A pulse for a thread of the program, to beat at least every 0.2 s; a second without one ends the node. Dropping
    /// it ends the watch.
    #[must_use]
    pub fn watch(&self) -> Pulse {
        let pulse = Pulse::default();
        let watched = (Arc::downgrade(&pulse.0), Silence::new(LONGEST_LOOK));
        self.0.threads.lock().unwrap_or_else(PoisonError::into_inner).push(watched);
        pulse
    }

    pub(crate) fn workers(&self) -> Arc<AtomicU64> {
        Arc::clone(&self.0.workers)
    }

    pub(crate) fn set_loops(&self, loops: (Arc<LoopWatch>, Arc<LoopWatch>)) {
        // Set once, by the node's start.
        let _ = self.0.loops.set(loops);
    }

    /// For tests of what watches: the middleware's event thread panics, or hangs, at its next turn.
    #[doc(hidden)]
    pub fn fail_event_loop_for_test(&self, hang: bool) {
        if let Some((event_loop, _)) = self.0.loops.get() {
            event_loop.fail_next_turn(hang);
        }
    }

    pub(crate) fn discovery_turns(&self) -> u64 {
        self.0.loops.get().map_or(0, |loops| loops.1.turns())
    }

    /// Whether one of the program's threads has been silent for too long.
    pub(crate) fn program_is_silent(&self, now: Duration) -> bool {
        let mut threads = self.0.threads.lock().unwrap_or_else(PoisonError::into_inner);
        let mut silent = false;
        threads.retain_mut(|(pulse, silence)| {
            // Gone: its thread has ended.
            let Some(pulse) = pulse.upgrade() else { return false };
            silent |= silence.look([pulse.load(Ordering::Relaxed)], now)[0] > SILENCE;
            true
        });
        silent
    }
}

/// A count that its thread adds to as long as it lives.
#[derive(Debug, Default)]
pub struct Pulse(Arc<AtomicU64>);

impl Pulse {
    /// The thread lives. Wait-free.
    pub fn beat(&self) {
        self.0.fetch_add(1, Ordering::Relaxed);
    }
}

/// Notes for how long counts have stood still, as far as the one who looks ran himself.
#[derive(Clone, Copy, Debug)]
pub struct Silence<const N: usize> {
    turns: [u64; N],
    silent: [Duration; N],
    looked: Option<Duration>,
    longest_look: Duration,
}

impl<const N: usize> Silence<N> {
    /// Nothing is silent yet. One look counts at most `longest_look`.
    #[must_use]
    pub fn new(longest_look: Duration) -> Self {
        Silence { turns: [0; N], silent: [Duration::ZERO; N], looked: None, longest_look }
    }

    /// How long each count has stood still at time `now`. Allocates nothing.
    pub fn look(&mut self, turns: [u64; N], now: Duration) -> [Duration; N] {
        let since = self.looked.map_or(Duration::ZERO, |looked| now.saturating_sub(looked)).min(self.longest_look);
        self.looked = Some(now);
        for n in 0..N {
            self.silent[n] = if turns[n] == self.turns[n] { self.silent[n] + since } else { Duration::ZERO };
            self.turns[n] = turns[n];
        }
        self.silent
    }
}
