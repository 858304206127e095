//! Servers of actions: goals queue, one runs at a time, each can be cancelled and reports its progress.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::channel;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use ros2_client::RmwRequestId;
use ros2_client::action::{ActionServer, GetResultResponse, SendGoalResponse};
use ros2_client::action_msgs::{
    CancelGoalResponse, CancelGoalResponseEnum, GoalId, GoalInfo, GoalStatus, GoalStatusArray, GoalStatusEnum,
};
use ros2_client::error::WriteError;
use tandem_msgs::{Action, action_msgs};
use tokio::task::JoinHandle;

mod goal;
mod tracked;

pub use goal::{Goal, GoalEnd};

use crate::Wire;
use crate::peers::Peers;
use crate::service::INTRODUCTION_OF_CALLER;
use tracked::{Tracked, cancel_target, is_over, now};

/// How often the dispatcher looks for requests. A goal takes longer than this by far.
const TICK: Duration = Duration::from_millis(10);
/// How far feedback goes ahead of the result: rclpy's client forgets a goal's feedback callback with the goal's result,
/// and what it receives together it does not handle in order.
const FEEDBACK_LEAD: Duration = Duration::from_millis(30);
/// How long a result is kept for clients that ask late, as in ROS 2's own servers.
const RESULT_LIFETIME: Duration = Duration::from_secs(900);

/// Goals whose result is kept, at most: of more the oldest are forgotten sooner.
const MAX_GOALS: usize = 256;
/// Questions for the result of one goal that wait for it, and answers on their way.
const MAX_WAITING: usize = 256;

type Endpoint<A> = ActionServer<Wire<<A as Action>::Goal>, Wire<<A as Action>::Result>, Wire<<A as Action>::Feedback>>;

struct Running<A: Action> {
    id: GoalId,
    job: JoinHandle<(GoalEnd, A::Result)>,
    feedback: std::sync::mpsc::Receiver<A::Feedback>,
    fed: Option<Instant>,
}

/// Says why no goal is accepted at present.
type Accept = Box<dyn Fn() -> Result<(), String> + Send>;

/// Hands an answer to the middleware.
type Sending<A> = Box<dyn FnOnce(&Endpoint<A>) -> Result<(), WriteError<()>> + Send>;

/// An answer on its way, to be sent as soon as its caller is known.
struct Unsent<A: Action> {
    request: RmwRequestId,
    since: Instant,
    callers: Arc<Peers>,
    what: &'static str,
    send: Sending<A>,
}

/// The one dispatcher of an action's goals, cancels and results.
pub(crate) struct Dispatcher<A: Action, H> {
    name: String,
    server: Endpoint<A>,
    goal_callers: Arc<Peers>,
    cancel_callers: Arc<Peers>,
    result_callers: Arc<Peers>,
    unsent: Vec<Unsent<A>>,
    waiting_limit: usize,
    accept: Accept,
    handler: Arc<Mutex<H>>,
    goals: BTreeMap<GoalId, Tracked<A::Result>>,
    waiting: VecDeque<(GoalId, A::Goal)>,
    running: Option<Running<A>>,
}

impl<A, H> Dispatcher<A, H>
where
    A: Action,
    A::Result: Default,
    H: FnMut(A::Goal, &Goal<A>) -> (GoalEnd, A::Result) + Send + 'static,
{
    /// `callers`: of its services for goals, cancels and results.
    pub(crate) fn new(
        name: String,
        server: Endpoint<A>,
        callers: [Arc<Peers>; 3],
        waiting_limit: usize,
        accept: Accept,
        handler: H,
    ) -> Self {
        let [goal_callers, cancel_callers, result_callers] = callers;
        Dispatcher {
            name,
            server,
            goal_callers,
            cancel_callers,
            result_callers,
            unsent: Vec::new(),
            waiting_limit,
            accept,
            handler: Arc::new(Mutex::new(handler)),
            goals: BTreeMap::new(),
            waiting: VecDeque::new(),
            running: None,
        }
    }

    pub(crate) async fn run(mut self) {
        let mut ticks = tokio::time::interval(TICK);
        ticks.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Skip);
        loop {
            ticks.tick().await;
            self.take_goals();
            self.take_cancels();
            self.take_result_requests();
            self.pass_feedback();
            if self.running.as_ref().is_some_and(|running| running.job.is_finished()) {
                self.finish().await;
            }
            self.start_next();
            self.send_answers();
            self.forget();
        }
    }

    /// Results that are old, and the oldest of more than are kept: a client that cancels what it asks for makes many.
    fn forget(&mut self) {
        self.goals.retain(|_, goal| goal.result.as_ref().is_none_or(|(_, since)| since.elapsed() < RESULT_LIFETIME));
        while self.goals.len() > MAX_GOALS {
            let since = |goal: &Tracked<A::Result>| goal.result.as_ref().map(|(_, since)| *since);
            let oldest = self.goals.iter().filter_map(|(id, goal)| Some((since(goal)?, *id))).min_by_key(|(at, _)| *at);
            // Those that still run or wait are bounded by themselves.
            let Some((_, id)) = oldest else { return };
            self.goals.remove(&id);
        }
    }

    fn warn(&self, what: &str, error: &impl std::fmt::Display) {
        tracing::warn!("action {}: {what}: {error}", self.name);
    }

    fn take_goals(&mut self) {
        loop {
            let (request_id, request) = match self.server.receive_goal() {
                Ok(Some(request)) => request,
                Ok(None) => return,
                Err(error) => {
                    self.warn("a goal could not be read", &error);
                    continue;
                }
            };
            let refusal = if self.running.is_some() && self.waiting.len() >= self.waiting_limit {
                Some(format!("{} others wait", self.waiting.len()))
            } else if self.goals.contains_key(&request.goal_id) {
                Some("its id has been used".to_string())
            } else {
                (self.accept)().err()
            };
            let accepted = refusal.is_none();
            let stamp = now();
            let callers = Arc::clone(&self.goal_callers);
            self.answer(request_id, callers, "a goal could not be answered", move |server| {
                server.send_goal_response(request_id, SendGoalResponse { accepted, stamp })
            });
            if let Some(refusal) = refusal {
                tracing::warn!("action {}: a goal is rejected: {refusal}", self.name);
                continue;
            }
            self.forget();
            self.goals.insert(
                request.goal_id,
                Tracked {
                    status: GoalStatusEnum::Accepted,
                    accepted: stamp,
                    cancelled: Arc::new(AtomicBool::new(false)),
                    result: None,
                    asked: Vec::new(),
                },
            );
            let Wire(goal) = request.goal;
            self.waiting.push_back((request.goal_id, goal));
            self.publish_status();
        }
    }

    fn take_cancels(&mut self) {
        loop {
            let (request_id, request) = match self.server.receive_cancel_request() {
                Ok(Some(request)) => request,
                Ok(None) => return,
                Err(error) => {
                    self.warn("a cancel request could not be read", &error);
                    continue;
                }
            };
            let response = match cancel_target(&request) {
                Ok(target) => self.cancel(&target),
                Err(error) => {
                    self.warn("a cancel request could not be read", &error);
                    CancelGoalResponse { return_code: CancelGoalResponseEnum::Rejected, goals_canceling: Vec::new() }
                }
            };
            let callers = Arc::clone(&self.cancel_callers);
            self.answer(request_id, callers, "a cancel request could not be answered", move |server| {
                server.send_cancel_response(request_id, response)
            });
            self.publish_status();
        }
    }

    /// An id alone names one goal; a time alone all accepted until then; both: either; neither: all.
    fn cancel(&mut self, target: &action_msgs::GoalInfo) -> CancelGoalResponse {
        let no_id = target.goal_id.uuid == [0; 16];
        let until = target.stamp.nanoseconds();
        let named = |id: &GoalId| id.uuid.as_bytes() == &target.goal_id.uuid;
        let mut goals_canceling = Vec::new();
        let mut terminated = false;
        let mut ended = Vec::new();
        for (id, goal) in &mut self.goals {
            let early = until != 0 && goal.accepted.to_nanos() <= until;
            if !(named(id) || early || (no_id && until == 0)) {
                continue;
            }
            if is_over(goal.status) {
                terminated |= named(id);
                continue;
            }
            goal.cancelled.store(true, Ordering::Relaxed);
            goal.status = GoalStatusEnum::Canceling;
            goals_canceling.push(GoalInfo { goal_id: *id, stamp: goal.accepted });
            if self.waiting.iter().any(|(waiting, _)| waiting == id) {
                ended.push(*id);
            }
        }
        let ended: BTreeSet<GoalId> = ended.into_iter().collect();
        self.waiting.retain(|(id, _)| !ended.contains(id));
        for id in ended {
            self.conclude(id, GoalEnd::Cancelled, A::Result::default());
        }
        let return_code = match (goals_canceling.is_empty(), terminated) {
            (false, _) => CancelGoalResponseEnum::None,
            (true, true) => CancelGoalResponseEnum::GoalTerminated,
            (true, false) => CancelGoalResponseEnum::UnknownGoal,
        };
        CancelGoalResponse { return_code, goals_canceling }
    }

    fn take_result_requests(&mut self) {
        loop {
            let (request_id, request) = match self.server.receive_result_request() {
                Ok(Some(request)) => request,
                Ok(None) => return,
                Err(error) => {
                    self.warn("a result request could not be read", &error);
                    continue;
                }
            };
            match self.goals.get_mut(&request.goal_id) {
                Some(goal) if goal.asked.len() >= MAX_WAITING => {
                    self.warn("a question for a result gets no answer", &format!("{MAX_WAITING} wait already"));
                }
                Some(goal) => {
                    goal.asked.push(request_id);
                    self.send_results(request.goal_id);
                }
                None => self.respond(request_id, GoalStatusEnum::Unknown, A::Result::default()),
            }
        }
    }

    fn respond(&mut self, request_id: RmwRequestId, status: GoalStatusEnum, result: A::Result) {
        let callers = Arc::clone(&self.result_callers);
        self.answer(request_id, callers, "a result could not be sent", move |server| {
            server.send_result(request_id, GetResultResponse { status, result: Wire(result) })
        });
    }

    fn answer(
        &mut self,
        request: RmwRequestId,
        callers: Arc<Peers>,
        what: &'static str,
        send: impl FnOnce(&Endpoint<A>) -> Result<(), WriteError<()>> + Send + 'static,
    ) {
        if self.unsent.len() >= MAX_WAITING {
            self.warn("an answer is not sent", &format!("{MAX_WAITING} wait for their callers already"));
            return;
        }
        self.unsent.push(Unsent { request, since: Instant::now(), callers, what, send: Box::new(send) });
        self.send_answers();
    }

    /// Sends what can be received, and what nobody has become known for in time.
    fn send_answers(&mut self) {
        let ready = |answer: &mut Unsent<A>| {
            answer.callers.caller_is_matched(answer.request) || answer.since.elapsed() >= INTRODUCTION_OF_CALLER
        };
        for answer in self.unsent.extract_if(.., ready) {
            if let Err(error) = (answer.send)(&self.server) {
                tracing::warn!("action {}: {}: {error}", self.name, answer.what);
            }
        }
    }

    fn send_results(&mut self, id: GoalId) {
        let Some(goal) = self.goals.get_mut(&id) else { return };
        let Some((result, _)) = &goal.result else { return };
        let (status, result, asked) = (goal.status, result.clone(), std::mem::take(&mut goal.asked));
        for request_id in asked {
            self.respond(request_id, status, result.clone());
        }
    }

    fn pass_feedback(&mut self) {
        let Some(running) = &mut self.running else { return };
        for feedback in running.feedback.try_iter() {
            running.fed = Some(Instant::now());
            if let Err(error) = self.server.send_feedback(running.id, Wire(feedback)) {
                tracing::warn!("action {}: feedback could not be sent: {}", self.name, error.forget_data());
            }
        }
    }

    async fn finish(&mut self) {
        // What the handler reported last comes before its result.
        self.pass_feedback();
        let Some(running) = self.running.take() else { return };
        if let Some(fed) = running.fed {
            tokio::time::sleep(FEEDBACK_LEAD.saturating_sub(fed.elapsed())).await;
        }
        let (end, result) = match running.job.await {
            Ok(ended) => ended,
            Err(error) => {
                tracing::error!("action {}: the handler failed: {error}", self.name);
                (GoalEnd::Aborted, A::Result::default())
            }
        };
        self.conclude(running.id, end, result);
        self.publish_status();
    }

    fn conclude(&mut self, id: GoalId, end: GoalEnd, result: A::Result) {
        if let Some(goal) = self.goals.get_mut(&id) {
            goal.status = match end {
                GoalEnd::Succeeded => GoalStatusEnum::Succeeded,
                // Its end was decided before the cancellation came: whoever was answered that it stops sees it stopped.
                GoalEnd::Aborted if goal.status == GoalStatusEnum::Canceling => GoalStatusEnum::Canceled,
                GoalEnd::Aborted => GoalStatusEnum::Aborted,
                GoalEnd::Cancelled => GoalStatusEnum::Canceled,
            };
            goal.result = Some((result, Instant::now()));
        }
        self.send_results(id);
    }

    fn start_next(&mut self) {
        if self.running.is_some() {
            return;
        }
        let Some((id, request)) = self.waiting.pop_front() else { return };
        let Some(tracked) = self.goals.get_mut(&id) else { return };
        tracked.status = GoalStatusEnum::Executing;
        let (sender, feedback) = channel();
        let goal = Goal { cancelled: Arc::clone(&tracked.cancelled), feedback: sender };
        let handler = Arc::clone(&self.handler);
        let job = tokio::task::spawn_blocking(move || {
            // A handler that panicked once may be called again: it owns its consistency.
            let mut handler = handler.lock().unwrap_or_else(PoisonError::into_inner);
            (*handler)(request, &goal)
        });
        self.running = Some(Running { id, job, feedback, fed: None });
        self.publish_status();
    }

    fn publish_status(&self) {
        let status_list = self
            .goals
            .iter()
            .map(|(id, goal)| GoalStatus {
                goal_info: GoalInfo { goal_id: *id, stamp: goal.accepted },
                status: goal.status,
            })
            .collect();
        if let Err(error) = self.server.send_goal_statuses(GoalStatusArray { status_list }) {
            self.warn("the status could not be sent", &error.forget_data());
        }
    }
}
