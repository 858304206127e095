//! Clients of services.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, PoisonError, RwLock, Weak};
use std::time::{Duration, Instant};

use tandem_msgs::Service;

use crate::peers::Peers;
use crate::shared::Core;
use crate::{CallError, Wire};

/// How often a client looks whether its server has appeared.
const LOOK_PERIOD: Duration = Duration::from_millis(20);

/// After the server is seen, its side of the match needs a moment: a request sent at once can be answered into the
/// void.
const SETTLE: Duration = Duration::from_millis(100);

type Endpoint<S> = ros2_client::Client<Wire<<S as Service>::Request>, Wire<<S as Service>::Response>>;

pub(crate) struct ClientInner<S: Service> {
    /// None once the node is shut down.
    endpoint: RwLock<Option<Arc<Endpoint<S>>>>,
    /// One call at a time: with more in flight the middleware loses responses.
    turn: tokio::sync::Mutex<()>,
    settled: AtomicBool,
    servers: Peers,
}

impl<S: Service> ClientInner<S> {
    pub(crate) fn close(&self) {
        drop(self.endpoint.write().unwrap_or_else(PoisonError::into_inner).take());
    }
}

/// Calls a service, one call after the other. Clones share the endpoint.
pub struct Client<S: Service> {
    service: Arc<str>,
    inner: Arc<ClientInner<S>>,
    core: Arc<Core>,
}

impl<S: Service> Clone for Client<S> {
    fn clone(&self) -> Self {
        Client { service: Arc::clone(&self.service), inner: Arc::clone(&self.inner), core: Arc::clone(&self.core) }
    }
}

impl<S: Service> Client<S> {
    pub(crate) fn new(service: String, endpoint: Endpoint<S>, servers: Peers, core: Arc<Core>) -> Self {
        Client {
            service: service.into(),
            inner: Arc::new(ClientInner {
                endpoint: RwLock::new(Some(Arc::new(endpoint))),
                turn: tokio::sync::Mutex::new(()),
                settled: AtomicBool::new(false),
                servers,
            }),
            core,
        }
    }

    pub(crate) fn weak(&self) -> Weak<ClientInner<S>> {
        Arc::downgrade(&self.inner)
    }

    /// The service's full name.
    #[must_use]
    pub fn service(&self) -> &str {
        &self.service
    }

    /// Calls the service and waits for the response, from a thread outside the node. A server that has not been seen
    /// yet is waited for within the same time. Times below 4 s are too short for a first call to rclpy.
    ///
    /// # Errors
    /// No server or no response in time, the node's end, or the middleware's reason.
    ///
    /// # Panics
    /// Inside a callback or an asynchronous task: use [`Client::call_async`] there.
    pub fn call(&self, request: S::Request, patience: Duration) -> Result<S::Response, CallError> {
        self.core.handle.block_on(self.call_async(request, patience))
    }

    /// As [`Client::call`], for asynchronous tasks.
    ///
    /// # Errors
    /// As [`Client::call`].
    pub async fn call_async(&self, request: S::Request, patience: Duration) -> Result<S::Response, CallError> {
        let service = || self.service.to_string();
        let deadline = Instant::now() + patience;
        let no_response = || CallError::NoResponse { service: service(), waited: patience };
        let Ok(_turn) = tokio::time::timeout_at(deadline.into(), self.inner.turn.lock()).await else {
            return Err(no_response());
        };
        let endpoint = self
            .inner
            .endpoint
            .read()
            .unwrap_or_else(PoisonError::into_inner)
            .clone()
            .ok_or_else(|| CallError::ShutDown { service: service() })?;
        while !self.inner.servers.server_is_matched() {
            if Instant::now() >= deadline {
                return Err(CallError::NoServer { service: service(), waited: patience });
            }
            self.inner.settled.store(false, Ordering::Relaxed);
            tokio::time::sleep(LOOK_PERIOD).await;
        }
        if !self.inner.settled.swap(true, Ordering::Relaxed) {
            tokio::time::sleep(SETTLE).await;
        }
        let middleware = |reason: String| CallError::Middleware { service: service(), reason };
        let call = async {
            let id = endpoint.async_send_request(Wire(request)).await.map_err(|error| middleware(error.to_string()))?;
            endpoint.async_receive_response(id).await.map_err(|error| middleware(error.to_string()))
        };
        match tokio::time::timeout_at(deadline.into(), call).await {
            Ok(response) => response.map(|Wire(response)| response),
            Err(_) => Err(no_response()),
        }
    }
}
