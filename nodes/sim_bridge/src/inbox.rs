//! What the node's callbacks leave for the thread that steps the simulation. Bounded: only the newest command is kept,
//! and requests are refused when too many wait.

use control::JointCommand;
use std::collections::VecDeque;
use std::sync::mpsc::Sender;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Requests that may wait.
const MAX_REQUESTS: usize = 64;

/// A command and the stamp of the joint state that it answers.
#[derive(Clone, Copy, Debug)]
pub struct Answer {
    /// Nanoseconds of the joint state's stamp.
    pub stamp_ns: i64,
    /// The command.
    pub command: JointCommand,
}

/// What a client asks of the simulation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Ask {
    /// Begin or go on, or stand still and publish nothing.
    Activate(bool),
    /// Let time stand still, or go on.
    Pause(bool),
    /// One control period, while paused.
    Step,
    /// Put the robot down again.
    Reset,
    /// Push the base with this force in world axes, N.
    Push([f64; 3]),
}

/// A request and where its answer goes: what was done, or why not.
pub struct Request {
    /// What is asked.
    pub ask: Ask,
    /// The answer's way back; none for messages.
    pub reply: Option<Sender<Result<String, String>>>,
}

#[derive(Default)]
struct Content {
    answer: Option<Answer>,
    /// The last refused command, for error messages.
    refused: Option<String>,
    requests: VecDeque<Request>,
    closed: bool,
}

/// See the module.
#[derive(Default)]
pub struct Inbox {
    content: Mutex<Content>,
    news: Condvar,
}

impl Inbox {
    fn lock(&self) -> MutexGuard<'_, Content> {
        // A panic elsewhere leaves plain data that is still whole.
        self.content.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A command came in.
    pub fn put_command(&self, answer: Answer) {
        self.lock().answer = Some(answer);
        self.news.notify_one();
    }

    /// A command came in and was refused.
    pub fn put_refusal(&self, reason: String) {
        self.lock().refused = Some(reason);
    }

    /// A request came in; false if too many wait.
    pub fn put_request(&self, request: Request) -> bool {
        let mut content = self.lock();
        if content.requests.len() >= MAX_REQUESTS || content.closed {
            return false;
        }
        content.requests.push_back(request);
        self.news.notify_one();
        true
    }

    /// Nobody will read any more: wakes the reader.
    pub fn close(&self) {
        self.lock().closed = true;
        self.news.notify_one();
    }

    /// Whether it was closed.
    pub fn is_closed(&self) -> bool {
        self.lock().closed
    }

    /// The next request.
    pub fn take_request(&self) -> Option<Request> {
        self.lock().requests.pop_front()
    }

    /// The newest command.
    pub fn newest(&self) -> Option<Answer> {
        self.lock().answer
    }

    /// Why the last command was refused, if one was.
    pub fn last_refusal(&self) -> Option<String> {
        self.lock().refused.clone()
    }

    /// Waits for the answer to `stamp_ns`, a request or the end, whichever comes first, for at most `patience`.
    pub fn wait_for_answer(&self, stamp_ns: i64, patience: Duration) -> Option<Answer> {
        let deadline = Instant::now() + patience;
        let mut content = self.lock();
        loop {
            if let Some(answer) = content.answer.filter(|a| a.stamp_ns == stamp_ns) {
                return Some(answer);
            }
            let left = deadline.saturating_duration_since(Instant::now());
            if content.closed || !content.requests.is_empty() || left.is_zero() {
                return None;
            }
            content = self.news.wait_timeout(content, left).unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    /// Waits for a request or the end, for at most `patience`.
    pub fn wait_for_request(&self, patience: Duration) {
        let deadline = Instant::now() + patience;
        let mut content = self.lock();
        while !content.closed && content.requests.is_empty() {
            let left = deadline.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return;
            }
            content = self.news.wait_timeout(content, left).unwrap_or_else(PoisonError::into_inner).0;
        }
    }
}
