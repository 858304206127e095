//! Servers of services.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};

use futures::StreamExt;
use ros2_client::RmwRequestId;
use tandem_msgs::Service;
use tokio::task::JoinHandle;

use crate::Wire;

type Refuse<S> = Box<dyn Fn(&<S as Service>::Request) -> <S as Service>::Response + Send + Sync>;

/// How a service deals with requests that wait.
pub struct ServeOptions<S: Service> {
    waiting: usize,
    refuse: Option<Refuse<S>>,
}

impl<S: Service> Default for ServeOptions<S> {
    /// Every request waits for its turn.
    fn default() -> Self {
        ServeOptions { waiting: usize::MAX, refuse: None }
    }
}

impl<S: Service> ServeOptions<S> {
    /// At most `waiting` requests wait behind the one that is being answered; `refuse` answers those beyond.
    pub fn bounded(waiting: usize, refuse: impl Fn(&S::Request) -> S::Response + Send + Sync + 'static) -> Self {
        ServeOptions { waiting, refuse: Some(Box::new(refuse)) }
    }
}

type Endpoint<S> = ros2_client::Server<Wire<<S as Service>::Request>, Wire<<S as Service>::Response>>;

/// Receives at all times, so that the middleware's own short queue never overflows, and answers one after the other.
pub(crate) async fn serve<S: Service>(
    service: String,
    server: Endpoint<S>,
    options: ServeOptions<S>,
    handler: impl FnMut(S::Request) -> S::Response + Send + 'static,
) {
    let handler = Arc::new(Mutex::new(handler));
    let mut requests = server.receive_request_stream();
    let mut waiting: VecDeque<(RmwRequestId, S::Request)> = VecDeque::new();
    let mut running: Option<(RmwRequestId, JoinHandle<S::Response>)> = None;
    loop {
        if running.is_none()
            && let Some((id, request)) = waiting.pop_front()
        {
            let handler = Arc::clone(&handler);
            let job = tokio::task::spawn_blocking(move || {
                // A handler that panicked once may be called again: it owns its consistency.
                let mut handler = handler.lock().unwrap_or_else(PoisonError::into_inner);
                (*handler)(request)
            });
            running = Some((id, job));
        }
        let finished = async {
            match running.as_mut() {
                Some((_, job)) => job.await,
                None => std::future::pending().await,
            }
        };
        tokio::select! {
            received = requests.next() => match received {
                Some(Ok((id, Wire(request)))) => match &options.refuse {
                    Some(refuse) if running.is_some() && waiting.len() >= options.waiting => {
                        respond::<S>(&service, &server, id, refuse(&request)).await;
                    }
                    _ => waiting.push_back((id, request)),
                },
                Some(Err(error)) => tracing::warn!("service {service}: a request could not be read: {error}"),
                None => return,
            },
            outcome = finished => {
                if let Some((id, _)) = running.take() {
                    match outcome {
                        Ok(response) => respond::<S>(&service, &server, id, response).await,
                        Err(error) => {
                            tracing::error!("service {service}: the handler failed, the caller gets no response: {error}");
                        }
                    }
                }
            }
        }
    }
}

async fn respond<S: Service>(service: &str, server: &Endpoint<S>, id: RmwRequestId, response: S::Response) {
    if let Err(error) = server.async_send_response(id, Wire(response)).await {
        tracing::error!("service {service}: the response could not be sent: {error}");
    }
}
