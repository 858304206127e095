//! Ctrl-C while something is being recorded: it ends at once, and in order. At any other time it ends the program as
//! ever.

use anyhow::{Context, Result};
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, OnceLock};

/// What the handlers share.
#[derive(Default)]
struct State {
    /// A signal ends the program as if it were not handled.
    plain: Arc<AtomicBool>,
    /// The signal that came.
    came: Arc<AtomicUsize>,
}

static STATE: OnceLock<State> = OnceLock::new();

/// While this lives a first signal is a wish; a second one ends the program.
pub struct Interrupt(&'static State);

impl Interrupt {
    /// Begins to watch for Ctrl-C, for SIGTERM and for a terminal that is gone.
    pub fn watch() -> Result<Interrupt> {
        let state = STATE.get_or_init(State::default);
        if state.came.load(Ordering::Relaxed) == 0 && !state.plain.swap(false, Ordering::SeqCst) {
            // The first time.
            for signal in [SIGINT, SIGTERM, SIGHUP] {
                let number = usize::try_from(signal).context("a signal's number")?;
                signal_hook::flag::register_conditional_default(signal, Arc::clone(&state.plain))
                    .and_then(|_| signal_hook::flag::register(signal, Arc::clone(&state.plain)))
                    .and_then(|_| signal_hook::flag::register_usize(signal, Arc::clone(&state.came), number))
                    .context("cannot watch for Ctrl-C")?;
            }
        }
        Ok(Interrupt(state))
    }

    /// Whether one came.
    pub fn came(&self) -> bool {
        self.0.came.load(Ordering::Relaxed) != 0
    }

    /// The code that a shell expects of a program that a signal has ended, if one came.
    pub fn code(&self) -> Option<ExitCode> {
        let signal = self.0.came.load(Ordering::Relaxed);
        (signal != 0).then(|| ExitCode::from(u8::try_from(128 + signal).unwrap_or(1)))
    }
}

impl Drop for Interrupt {
    fn drop(&mut self) {
        self.0.plain.store(true, Ordering::SeqCst);
    }
}
