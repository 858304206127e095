//! What ends a node whatever hangs or panics in it: a thread that waits for nothing but time.
//!
//! Each thread that carries something counts its turns; who watches notes that a count stands still. Only time in which
//! the watcher itself ran is held against the watched one, so that a machine that stood still as a whole is no failure
//! of one thread.

use std::ffi::c_int;
use std::sync::Once;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};

use crate::RosError;
use crate::health::{Health, LONGEST_LOOK, PANIC, PANICKED, SILENCE, SUSPENDED, Silence, Thread};
use crate::stop::Stop;

/// Time between two looks.
const TICK: Duration = Duration::from_millis(5);
/// Signals within this time are one wish to end.
const SAME_WISH: Duration = Duration::from_secs(1);
/// From the wish to end, or a failure, to the end of the process, whatever hangs.
const END_PATIENCE: Duration = Duration::from_millis(1900);
/// Likewise the middleware's discovery, which carries no data and may work for long when many nodes come at once.
const DISCOVERY_SILENCE: Duration = Duration::from_secs(5);
/// A gap between two looks, with SIGCONT at its end, is a suspension of the process; a busy machine alone makes no
/// SIGCONT.
const SUSPENSION: Duration = Duration::from_millis(100);
/// The machine slept for so long. A gap alone, without SIGCONT and without sleep, is a machine that stands still: no
/// failure of this process.
const SLEEP: Duration = Duration::from_secs(1);

static ENDS: AtomicU32 = AtomicU32::new(0);
static CONTINUED: AtomicU32 = AtomicU32::new(0);

/// Marks the node as ended when it is dropped: from then on the process is the program's own again.
pub(crate) struct Guard(Health);

impl Drop for Guard {
    fn drop(&mut self) {
        self.0.0.ended.store(true, Ordering::Release);
    }
}

/// Starts the thread, the handlers of signals and, for a supervised process, the hook of panics.
pub(crate) fn start(stop: &Stop) -> Result<Guard, RosError> {
    let health = stop.health();
    install_handlers()?;
    if health.0.supervised {
        install_hook();
    }
    let watchdog = Watchdog::new(stop.clone());
    std::thread::Builder::new()
        .name("watchdog".into())
        .spawn(move || watchdog.run())
        .map_err(|error| RosError::Create { what: "watchdog thread".to_string(), reason: error.to_string() })?;
    Ok(Guard(health))
}

fn install_handlers() -> Result<(), RosError> {
    extern "C" fn end(_: c_int) {
        ENDS.fetch_add(1, Ordering::SeqCst);
    }
    extern "C" fn go_on(_: c_int) {
        CONTINUED.fetch_add(1, Ordering::SeqCst);
    }
    for (signal, handler) in [(libc::SIGINT, end as extern "C" fn(c_int)), (libc::SIGTERM, end), (libc::SIGCONT, go_on)]
    {
        // SAFETY: the structure is plain data, made whole here; the handlers only add to an atomic number.
        let result = unsafe {
            let mut action: libc::sigaction = std::mem::zeroed();
            action.sa_sigaction = handler as libc::sighandler_t;
            action.sa_flags = libc::SA_RESTART;
            libc::sigemptyset(&mut action.sa_mask);
            libc::sigaction(signal, &action, std::ptr::null_mut())
        };
        if result != 0 {
            let reason = std::io::Error::last_os_error().to_string();
            return Err(RosError::Create { what: "signal handler".to_string(), reason });
        }
    }
    Ok(())
}

fn install_hook() {
    static INSTALLED: Once = Once::new();
    INSTALLED.call_once(|| {
        let previous = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |info| {
            // First what damps the robot: printing may block.
            PANICKED.store(true, Ordering::Release);
            if let Ok(mut text) = PANIC.try_lock()
                && text.is_empty()
            {
                let thread = std::thread::current();
                *text = format!("{}: {info}", thread.name().unwrap_or("a thread without name")).replace('\n', " ");
            }
            previous(info);
        }));
    });
}

struct Watchdog {
    stop: Stop,
    health: Health,
    begun: Instant,
    ends: u32,
    continued: u32,
    asked: Option<Instant>,
    deadline: Option<Instant>,
    failed: bool,
    gap: Option<Instant>,
    middleware: Silence<3>,
}

impl Watchdog {
    fn new(stop: Stop) -> Self {
        Watchdog {
            health: stop.health(),
            stop,
            begun: Instant::now(),
            ends: ENDS.load(Ordering::SeqCst),
            continued: CONTINUED.load(Ordering::SeqCst),
            asked: None,
            deadline: None,
            failed: false,
            gap: None,
            middleware: Silence::new(LONGEST_LOOK),
        }
    }

    fn run(mut self) {
        let mut last = (Instant::now(), time_with_sleep());
        while !self.health.0.ended.load(Ordering::Acquire) {
            std::thread::sleep(TICK);
            let now = (Instant::now(), time_with_sleep());
            let ran = now.0 - last.0;
            let slept = now.1.saturating_sub(last.1);
            last = now;
            self.take_signals(now.0);
            self.notice_suspension(now.0, ran, slept.saturating_sub(ran));
            self.watch_threads(now.0);
            if !self.failed && self.health.has_failed() {
                self.failed = true;
                self.deadline = self.deadline.or(Some(now.0 + END_PATIENCE));
                self.stop.request();
                let health = self.health.clone();
                // Writing may block, and this thread must not. Without a thread for it the program says it at its end.
                let _ = std::thread::Builder::new().name("last words".into()).spawn(move || {
                    let why = health.failure().unwrap_or_default();
                    tracing::error!("{why}; a robot is damped and the node ends with an error");
                });
            }
            if self.deadline.is_some_and(|deadline| now.0 >= deadline) && !self.health.0.ended.load(Ordering::Acquire) {
                end_process("the node did not end within 2 s: something in it hangs; the process ends\n", 1);
            }
        }
    }

    fn take_signals(&mut self, now: Instant) {
        let ends = ENDS.load(Ordering::SeqCst);
        if ends == self.ends {
            return;
        }
        self.ends = ends;
        match self.asked {
            None => {
                self.asked = Some(now);
                self.deadline = self.deadline.or(Some(now + END_PATIENCE));
            }
            // The same wish twice: a terminal signals the whole group, and a launch system signals its nodes once more.
            Some(first) if now - first < SAME_WISH => {}
            // The shell's number for a process ended by SIGINT.
            Some(_) => end_process("", 130),
        }
        self.stop.request();
    }

    /// SIGCONT alone says nothing: systemd and `timeout` send it after SIGTERM to processes that were never stopped.
    fn notice_suspension(&mut self, now: Instant, gap: Duration, suspended: Duration) {
        if gap >= SUSPENSION {
            self.gap = Some(now);
        }
        let continued = CONTINUED.load(Ordering::SeqCst);
        let goes_on = std::mem::replace(&mut self.continued, continued) != continued;
        let recent = self.gap.is_some_and(|gap| now - gap < SUSPENSION);
        if self.asked.is_none() && ((goes_on && recent) || suspended >= SLEEP) {
            self.health.note(SUSPENDED);
        }
    }

    fn watch_threads(&mut self, now: Instant) {
        // Until the participant is made there is nothing to watch.
        if self.health.0.loops.get().is_none() || self.asked.is_some() {
            return;
        }
        let now = now - self.begun;
        let [event_loop, workers] = self.health.turns();
        let silent = self.middleware.look([event_loop, workers, self.health.discovery_turns()], now);
        let threads = [Thread::EventLoop, Thread::Workers, Thread::Discovery];
        for ((silent, thread), limit) in silent.into_iter().zip(threads).zip([SILENCE, SILENCE, DISCOVERY_SILENCE]) {
            if silent > limit {
                self.health.fail(thread);
            }
        }
        if self.health.program_is_silent(now) {
            self.health.fail(Thread::Program);
        }
    }
}

/// Seconds since boot, those in which the machine slept included.
fn time_with_sleep() -> Duration {
    let mut now = libc::timespec { tv_sec: 0, tv_nsec: 0 };
    // SAFETY: the pointer is to a local.
    unsafe { libc::clock_gettime(libc::CLOCK_BOOTTIME, &mut now) };
    Duration::new(now.tv_sec.unsigned_abs(), u32::try_from(now.tv_nsec).unwrap_or_default())
}

/// Ends the process without waiting for anything.
fn end_process(words: &str, code: i32) -> ! {
    let mut standard_error = libc::pollfd { fd: 2, events: libc::POLLOUT, revents: 0 };
    // SAFETY: the pointers are to locals. A pipe that is full is not written to: that would block.
    unsafe {
        if !words.is_empty() && libc::poll(&mut standard_error, 1, 0) == 1 {
            libc::write(2, words.as_ptr().cast(), words.len());
        }
        libc::_exit(code)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Duration = Duration::from_millis(1);

    #[test]
    fn silence_counts_from_the_last_turn() {
        let mut silence = Silence::new(2 * MS);
        assert_eq!(silence.look([1, 7], MS), [Duration::ZERO; 2]);
        assert_eq!(silence.look([1, 8], 2 * MS), [MS, Duration::ZERO]);
        assert_eq!(silence.look([1, 8], 3 * MS), [2 * MS, MS]);
        assert_eq!(silence.look([2, 8], 4 * MS), [Duration::ZERO, 2 * MS]);
    }

    #[test]
    fn a_machine_that_stood_still_is_no_silence_of_one_thread() {
        let mut silence = Silence::new(2 * MS);
        silence.look([1], MS);
        assert_eq!(silence.look([1], 500 * MS), [2 * MS]);
        assert_eq!(silence.look([1], 1000 * MS), [4 * MS]);
    }

    #[test]
    fn the_first_failure_stays() {
        let health = Health::new(false);
        assert!(!health.has_failed() && health.failure().is_none());
        health.fail(Thread::Workers);
        health.note(SUSPENDED);
        assert!(health.has_failed());
        assert_eq!(health.failure().unwrap(), "the pool of threads that run callbacks stands still");
    }
}
