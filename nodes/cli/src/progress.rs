//! What goes on, for whoever waits at a terminal: shown after two seconds, on standard error, and gone when it is over.

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::io::IsTerminal;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::thread::JoinHandle;
use std::time::Duration;

/// What takes less needs no word.
const QUIET: Duration = Duration::from_secs(2);

/// Shown until it is dropped.
pub struct Progress {
    bar: ProgressBar,
    end: Option<(Sender<()>, JoinHandle<()>)>,
}

impl Progress {
    /// Begins. Without a terminal nothing is ever shown.
    pub fn begin(what: &str) -> Progress {
        let bar = ProgressBar::with_draw_target(None, ProgressDrawTarget::hidden());
        let style = ProgressStyle::with_template("{spinner} {prefix} {msg} ({elapsed})");
        bar.set_style(style.expect("the template is a constant"));
        bar.set_prefix(what.to_owned());
        let (sender, ended) = channel();
        let shown = bar.clone();
        let thread = std::thread::Builder::new().name("progress".into());
        let thread = std::io::stderr().is_terminal().then(|| thread.spawn(move || show(&shown, &ended)));
        // Without the thread there is nothing to see: no reason to do nothing.
        Progress { bar, end: thread.and_then(Result::ok).map(|thread| (sender, thread)) }
    }

    /// How far it is.
    pub fn say(&self, far: String) {
        if self.end.is_some() {
            self.bar.set_message(far);
        }
    }
}

fn show(bar: &ProgressBar, ended: &Receiver<()>) {
    if ended.recv_timeout(QUIET) == Err(RecvTimeoutError::Timeout) {
        bar.set_draw_target(ProgressDrawTarget::stderr());
        bar.enable_steady_tick(Duration::from_millis(200));
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        if let Some((sender, thread)) = self.end.take() {
            drop(sender);
            // It has nothing to give and cannot fail.
            let _ = thread.join();
        }
        self.bar.finish_and_clear();
    }
}
