//! Servers of services.

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Duration;

use futures::StreamExt;
use futures::stream::FuturesUnordered;
use ros2_client::RmwRequestId;
use tandem_msgs::Service;

use crate::Wire;
use crate::matches::ProgramId;
use crate::occasionally::Occasionally;
use crate::peers::Peers;

/// How long an answer waits for a caller whose reader is not known yet. A request can overtake the news of it, and what
/// is sent before is lost; whoever is unknown after this has gone or never listened.
pub(crate) const INTRODUCTION_OF_CALLER: Duration = Duration::from_secs(5);

/// Requests that wait for a service, unless it says otherwise: whoever floods it holds no more memory than these.
pub const WAITING: usize = 64;
/// Answers on their way, at most: to callers that are not known yet, or that do not read.
const UNSENT: usize = 256;

type Refuse<S> = Box<dyn Fn(&<S as Service>::Request) -> <S as Service>::Response + Send + Sync>;

/// How a service deals with requests that wait.
pub struct ServeOptions<S: Service> {
    waiting: usize,
    parallel: usize,
    refuse: Option<Refuse<S>>,
}

impl<S: Service> Default for ServeOptions<S> {
    /// [`WAITING`] requests wait for their turn. Those beyond are refused where the response can say so; else they get
    /// no answer, as if they had not reached the queue.
    fn default() -> Self {
        ServeOptions { waiting: WAITING, parallel: 1, refuse: None }
    }
}

impl<S: Service> ServeOptions<S> {
    /// At most `waiting` requests wait behind those that are being answered; `refuse` answers the ones beyond.
    pub fn bounded(waiting: usize, refuse: impl Fn(&S::Request) -> S::Response + Send + Sync + 'static) -> Self {
        ServeOptions { waiting, refuse: Some(Box::new(refuse)), ..ServeOptions::default() }
    }

    /// So many requests, at least one, are answered at the same time, each on a thread of its own.
    #[must_use]
    pub fn parallel(mut self, parallel: usize) -> Self {
        self.parallel = parallel.max(1);
        self
    }
}

impl<S: Service> ServeOptions<S> {
    fn refusal(&self, request: &S::Request) -> Option<S::Response> {
        match &self.refuse {
            Some(refuse) => Some(refuse(request)),
            None => S::refusal(request, &format!("busy: {} requests wait already; ask again later", self.waiting)),
        }
    }
}

type Endpoint<S> = ros2_client::Server<Wire<<S as Service>::Request>, Wire<<S as Service>::Response>>;

/// Receives at all times, so that the middleware's own short queue never overflows, and answers as many at once as the
/// options say.
pub(crate) async fn serve<S: Service>(
    service: String,
    server: Endpoint<S>,
    callers: Peers,
    options: ServeOptions<S>,
    handler: impl Fn(ProgramId, S::Request) -> S::Response + Send + Sync + 'static,
) {
    let handler = Arc::new(handler);
    let mut requests = server.receive_request_stream();
    let mut waiting: VecDeque<(RmwRequestId, S::Request)> = VecDeque::new();
    let mut running = FuturesUnordered::new();
    // An answer may wait for its caller to become known; no other request must wait for that, least of all one to stop.
    let mut unsent = FuturesUnordered::new();
    let mut unreadable = Occasionally::default();
    let mut unanswered = Occasionally::default();
    loop {
        while running.len() < options.parallel
            && let Some((id, request)) = waiting.pop_front()
        {
            let handler = Arc::clone(&handler);
            let caller = ProgramId::of(id.writer_gid);
            let job = tokio::task::spawn_blocking(move || (*handler)(caller, request));
            running.push(async move { (id, job.await) });
        }
        tokio::select! {
            received = requests.next() => match received {
                Some(Ok((id, Wire(request)))) => {
                    if running.len() < options.parallel || waiting.len() < options.waiting {
                        waiting.push_back((id, request));
                        continue;
                    }
                    // A refusal may act, as one of the emergency stop does: it is made whether or not it can be sent.
                    let refusal = options.refusal(&request);
                    match refusal.filter(|_| unsent.len() < UNSENT) {
                        Some(refusal) => unsent.push(respond::<S>(&service, &server, &callers, id, refusal)),
                        None => {
                            if let Some(count) = unanswered.now() {
                                tracing::warn!(
                                    "service {service}: {} requests wait already; {count} got no answer",
                                    waiting.len()
                                );
                            }
                        }
                    }
                }
                Some(Err(error)) => {
                    if let Some(count) = unreadable.now() {
                        tracing::warn!("service {service}: {count} requests could not be read, the last: {error}");
                    }
                }
                None => return,
            },
            Some((id, outcome)) = running.next() => match outcome {
                // The work is done; whoever leaves so many answers unread gets no more.
                Ok(_) if unsent.len() >= UNSENT => tracing::debug!("service {service}: an answer is not sent"),
                Ok(response) => unsent.push(respond::<S>(&service, &server, &callers, id, response)),
                Err(error) => {
                    tracing::error!("service {service}: the handler failed, the caller gets no response: {error}");
                }
            },
            Some(()) = unsent.next() => {}
        }
    }
}

async fn respond<S: Service>(
    service: &str,
    server: &Endpoint<S>,
    callers: &Peers,
    id: RmwRequestId,
    response: S::Response,
) {
    if tokio::time::timeout(INTRODUCTION_OF_CALLER, callers.caller_matched(id)).await.is_err() {
        tracing::debug!(
            "service {service}: nobody is known to wait for the response to {:?}; it is sent anyway",
            id.writer_gid
        );
    }
    if let Err(error) = server.async_send_response(id, Wire(response)).await {
        tracing::error!("service {service}: the response could not be sent: {error}");
    }
}
