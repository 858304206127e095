//! A node's services, actions, clients and parameters.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use ros2_client::action::ActionServerQosPolicies;
use ros2_client::dds::ServiceMapping;
use ros2_client::{ActionTypeName, ServiceTypeName};
use tandem_msgs::rcl_interfaces as wire;
use tandem_msgs::{Action, Service};

use super::Node;
use crate::action::{Dispatcher, Goal, GoalEnd};
use crate::client::Client;
use crate::matches::{Departure, ProgramId};
use crate::names::Subject;
use crate::parameters::{ParameterBuilder, ParameterType};
use crate::peers::Peers;
use crate::service::{ServeOptions, serve};
use crate::shared::dds_name;
use crate::type_hash::{announce_action, announce_service};
use crate::{Qos, RosError, Wire, logging};

impl Node {
    /// A service. `handler` runs on a thread where it may take its time; requests are answered one after the other, in
    /// the order of their arrival; when [`WAITING`](crate::WAITING) wait, further ones are answered that it is busy.
    ///
    /// # Errors
    /// A wrong name, or the middleware's reason.
    pub fn serve<S: Service>(
        &self,
        service: &str,
        handler: impl FnMut(S::Request) -> S::Response + Send + 'static,
    ) -> Result<(), RosError> {
        let handler = Mutex::new(handler);
        self.serve_with::<S>(service, ServeOptions::default(), move |request| {
            // A handler that panicked once may be called again: it owns its consistency.
            let mut handler = handler.lock().unwrap_or_else(PoisonError::into_inner);
            (*handler)(request)
        })
    }

    /// As [`Node::serve`], with a bound on the requests that wait, and several answered at once.
    ///
    /// # Errors
    /// A wrong name, or the middleware's reason.
    pub fn serve_with<S: Service>(
        &self,
        service: &str,
        options: ServeOptions<S>,
        handler: impl Fn(S::Request) -> S::Response + Send + Sync + 'static,
    ) -> Result<(), RosError> {
        self.serve_programs::<S>(service, options, move |_, request| handler(request))
    }

    /// As [`Node::serve_with`], for a handler that wants to know which program asks.
    ///
    /// # Errors
    /// A wrong name, or the middleware's reason.
    pub fn serve_programs<S: Service>(
        &self,
        service: &str,
        options: ServeOptions<S>,
        handler: impl Fn(ProgramId, S::Request) -> S::Response + Send + Sync + 'static,
    ) -> Result<(), RosError> {
        let full = self.core.full_name(service, Subject::Service)?;
        let name = dds_name(&full)?;
        let callers = Peers::new(&self.core, &full);
        announce_service::<S>();
        let server = self
            .core
            .with_node(|node| {
                node.create_server::<Wire<S::Request>, Wire<S::Response>>(
                    ServiceMapping::Enhanced,
                    &name,
                    &ServiceTypeName::new(S::PACKAGE, S::NAME),
                    Qos::service(),
                    Qos::service(),
                )
            })
            .ok_or_else(|| self.shut_down(&full))?
            .map_err(|error| RosError::Create { what: format!("service {full}"), reason: error.to_string() })?;
        self.spawn(serve::<S>(full, server, callers, options, handler));
        Ok(())
    }

    /// Reports every publisher and every program that is gone. `left` runs on the node's threads and must be short.
    pub fn watch_departures(&self, mut left: impl FnMut(Departure) + Send + 'static) {
        let mut departures = self.core.departures();
        self.spawn(async move {
            while let Some(departure) = departures.recv().await {
                left(departure);
            }
        });
    }

    /// An action. One goal runs at a time, on a thread where it may take its time; `waiting` goals may wait behind it,
    /// more are rejected, and all while `accept` gives a reason to. The handler looks at [`Goal::is_cancelled`] and
    /// ends with [`GoalEnd::Cancelled`] when it is.
    ///
    /// # Errors
    /// A wrong name, or the middleware's reason.
    pub fn serve_action<A: Action>(
        &self,
        action: &str,
        waiting: usize,
        accept: impl Fn() -> Result<(), String> + Send + 'static,
        handler: impl FnMut(A::Goal, &Goal<A>) -> (GoalEnd, A::Result) + Send + 'static,
    ) -> Result<(), RosError>
    where
        A::Result: Default,
    {
        let full = self.core.full_name(action, Subject::Service)?;
        let name = dds_name(&full)?;
        let service = Qos::service();
        let qos = ActionServerQosPolicies {
            goal_service: service.clone(),
            result_service: service.clone(),
            cancel_service: service,
            feedback_publisher: Qos::reliable(100).profile(),
            status_publisher: Qos::latched().profile(),
        };
        let callers = ["send_goal", "cancel_goal", "get_result"]
            .map(|service| Arc::new(Peers::new(&self.core, &format!("{full}/_action/{service}"))));
        announce_action::<A>();
        let server = self
            .core
            .with_node(|node| {
                node.create_action_server::<Wire<A::Goal>, Wire<A::Result>, Wire<A::Feedback>>(
                    ServiceMapping::Enhanced,
                    &name,
                    &ActionTypeName::new(A::PACKAGE, A::NAME),
                    qos,
                )
            })
            .ok_or_else(|| self.shut_down(&full))?
            .map_err(|error| RosError::Create { what: format!("action {full}"), reason: error.to_string() })?;
        self.spawn(Dispatcher::<A, _>::new(full, server, callers, waiting, Box::new(accept), handler).run());
        Ok(())
    }

    /// A client of a service.
    ///
    /// # Errors
    /// A wrong name, or the middleware's reason.
    pub fn client<S: Service>(&self, service: &str) -> Result<Client<S>, RosError> {
        let full = self.core.full_name(service, Subject::Service)?;
        let name = dds_name(&full)?;
        let profile = Qos::service();
        let servers = Peers::new(&self.core, &full);
        announce_service::<S>();
        let inner = self
            .core
            .with_node(|node| {
                node.create_client::<Wire<S::Request>, Wire<S::Response>>(
                    ServiceMapping::Enhanced,
                    &name,
                    &ServiceTypeName::new(S::PACKAGE, S::NAME),
                    profile.clone(),
                    profile.clone(),
                )
            })
            .ok_or_else(|| self.shut_down(&full))?
            .map_err(|error| RosError::Create { what: format!("client of {full}"), reason: error.to_string() })?;
        let client = Client::new(full, inner, servers, Arc::clone(&self.core));
        self.close_with(client.weak(), |inner| inner.close());
        Ok(client)
    }

    /// A parameter with its default, to be described and declared.
    pub fn parameter<T: ParameterType>(&self, name: &str, default: T) -> ParameterBuilder<T> {
        ParameterBuilder::new(Arc::clone(&self.store), name, default)
    }

    /// Call it when all parameters are declared: from then on (and at the latest a second after the node's start) the
    /// parameter services answer. Warns of values given on the command line or in files that no parameter of this node
    /// takes.
    pub fn parameters_are_declared(&self) {
        self.store.complete();
        for name in self.store.unused_overrides() {
            tracing::warn!("parameter {name:?} was given but {} has no such parameter", self.full_name());
        }
    }

    pub(super) fn serve_parameters(&self) -> Result<(), RosError> {
        macro_rules! service {
            ($service:ident, $name:literal, $method:ident) => {
                let store = Arc::clone(&self.store);
                self.serve::<wire::$service>(concat!("~/", $name), move |request| {
                    store.wait_until_complete();
                    store.$method(&request)
                })?;
            };
        }
        service!(ListParameters, "list_parameters", list_parameters);
        service!(GetParameters, "get_parameters", get_parameters);
        service!(GetParameterTypes, "get_parameter_types", get_parameter_types);
        service!(DescribeParameters, "describe_parameters", describe_parameters);
        service!(SetParameters, "set_parameters", set_parameters);
        service!(SetParametersAtomically, "set_parameters_atomically", set_parameters_atomically);
        Ok(())
    }

    pub(super) fn publish_log(&self, lines: std::sync::mpsc::Receiver<wire::Log>) -> Result<(), RosError> {
        let rosout = self.publisher::<wire::Log>("/rosout", Qos::transient_local(1000))?;
        let logger = self.full_name()[1..].replace('/', ".");
        self.every(Duration::from_millis(50), move || {
            for line in lines.try_iter() {
                // An error here cannot be logged without making another line.
                let _ = rosout.publish(logging::named(line, &logger));
            }
        });
        Ok(())
    }
}
