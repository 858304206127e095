//! A node: one DDS participant, its publishers, subscriptions, services, parameters and its end.

use std::collections::HashMap;
use std::sync::atomic::{AtomicI64, Ordering};
use std::sync::{Arc, Mutex, PoisonError, Weak};
use std::time::{Duration, Instant};

use futures::StreamExt;
use ros2_client::action::ActionServerQosPolicies;
use ros2_client::dds::ServiceMapping;
use ros2_client::dds::rustdds::GUID;
use ros2_client::{ActionTypeName, Context, Gid, MessageTypeName, Name, NodeName, NodeOptions, ServiceTypeName};
use tandem_msgs::builtin_interfaces::Time;
use tandem_msgs::rcl_interfaces as wire;
use tandem_msgs::{Action, Message, Service, rosgraph_msgs};
use tokio::runtime::{Handle, Runtime};
use tokio::sync::mpsc::{UnboundedReceiver, UnboundedSender, unbounded_channel};
use tokio::sync::watch;
use tokio::task::JoinHandle;

use crate::action::{Dispatcher, Goal, GoalEnd};
use crate::arguments::Arguments;
use crate::client::Client;
use crate::matches::{Departure, Matches, Peers, PublisherId};
use crate::names::{self, Subject};
use crate::parameters::{ParameterBuilder, ParameterType, Store};
use crate::publisher::{Publisher, Raw, RawPublisher, Slot};
use crate::service::{ServeOptions, serve};
use crate::watchdog::{self, Health};
use crate::{Clock, Qos, RosError, Wire, logging, participant, start_log};

/// How long the end of a node may take before it is given up.
const SHUTDOWN_PATIENCE: Duration = Duration::from_millis(1200);

/// How long the middleware gets to send that the node is gone. Without it some peers keep the node for their lease, 20
/// to 50 s.
const FAREWELL: Duration = Duration::from_millis(150);

/// How long participants get to introduce themselves to each other before the node announces its endpoints. Fast DDS
/// acknowledges announcements that overtake the introduction, and then forgets them: the endpoints, often the whole
/// node, stay unseen there for good. Without the wait a node that started beside a running rclpy was lost in 15 of 30
/// starts on a busy machine, with 0.3 s in none of 60.
const INTRODUCTION: Duration = Duration::from_millis(500);

/// How often the threads that run callbacks show that they do.
const WORKERS_PERIOD: Duration = Duration::from_millis(5);

/// Asked to stop: by SIGINT, SIGTERM or the program itself. Clones share one state.
#[derive(Clone, Debug)]
pub struct Stop {
    sender: Arc<watch::Sender<bool>>,
    health: Health,
}

impl Stop {
    fn new(health: Health) -> Self {
        Stop { sender: Arc::new(watch::Sender::new(false)), health }
    }

    /// Asks everyone to stop.
    pub fn request(&self) {
        self.sender.send_replace(true);
    }

    /// Whether it has been asked. Wait-free enough for a loop, not for a control thread (a lock is taken).
    #[must_use]
    pub fn is_requested(&self) -> bool {
        *self.sender.borrow()
    }

    /// Why the node ends against its will, if it does: a thread panicked or stands still, or the process itself was
    /// stopped (SIGSTOP, Ctrl-Z) and went on, which its connections do not outlive. A program ends with an error then,
    /// for a supervisor to start it anew.
    #[must_use]
    pub fn failure(&self) -> Option<String> {
        self.health.failure()
    }

    /// Whether the node's threads live.
    #[must_use]
    pub fn health(&self) -> Health {
        self.health.clone()
    }

    /// Waits until it is asked.
    pub async fn requested(&self) {
        // The sender lives as long as self, so waiting cannot fail.
        let _ = self.sender.subscribe().wait_for(|asked| *asked).await;
    }
}

/// What publishers, clients and the tasks of a node share.
pub(crate) struct Core {
    /// None once the node is shut down.
    node: Mutex<Option<ros2_client::Node>>,
    pub(crate) handle: Handle,
    name: String,
    namespace: String,
    remaps: Vec<names::Remap>,
    context: Mutex<Option<Context>>,
    pub(crate) matches: Matches,
    /// Who wants to know of publishers that are gone.
    departures: Mutex<Vec<UnboundedSender<Departure>>>,
}

impl Core {
    pub(crate) fn with_node<T>(&self, action: impl FnOnce(&mut ros2_client::Node) -> T) -> Option<T> {
        // The middleware's node is a list of endpoints: usable after a panic elsewhere.
        let mut guard = self.node.lock().unwrap_or_else(PoisonError::into_inner);
        guard.as_mut().map(action)
    }

    pub(crate) fn context(&self) -> Option<Context> {
        self.context.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// The type that the publisher with this identity announces, if it is known.
    fn announced_type(&self, publisher: Gid) -> Option<String> {
        self.context()?
            .domain_participant()
            .discovered_writers()
            .into_iter()
            .find(|writer| Gid::from(writer.writer_proxy.remote_writer_guid) == publisher)
            .map(|writer| writer.publication_topic_data.type_name)
    }

    /// The other participants' readers on a topic (the middleware's name of it), as far as they are known.
    pub(crate) fn discovered_readers(&self, topic: &str) -> Vec<GUID> {
        let readers =
            self.context().map(|context| context.domain_participant().discovered_readers()).unwrap_or_default();
        let on_topic = readers.into_iter().filter(|reader| reader.subscription_topic_data.topic_name() == topic);
        on_topic.map(|reader| reader.reader_proxy.remote_reader_guid).collect()
    }

    /// The writers on a topic (the middleware's name of it), as far as they are known, this node's included.
    pub(crate) fn discovered_writers(&self, topic: &str) -> Vec<GUID> {
        let writers =
            self.context().map(|context| context.domain_participant().discovered_writers()).unwrap_or_default();
        let on_topic = writers.into_iter().filter(|writer| writer.publication_topic_data.topic_name == topic);
        on_topic.map(|writer| writer.writer_proxy.remote_writer_guid).collect()
    }

    /// Tells of every publisher, or whole participant, that is gone from now on.
    pub(crate) fn departures(&self) -> UnboundedReceiver<Departure> {
        let (sender, receiver) = unbounded_channel();
        self.departures.lock().unwrap_or_else(PoisonError::into_inner).push(sender);
        receiver
    }

    /// Tells every subscription that a publisher, or a whole participant, is gone.
    pub(crate) fn note_departure(&self, departure: Departure) {
        let mut departures = self.departures.lock().unwrap_or_else(PoisonError::into_inner);
        departures.retain(|subscription| subscription.send(departure).is_ok());
    }

    pub(crate) fn full_name(&self, name: &str, subject: Subject) -> Result<String, RosError> {
        names::resolve(name, subject, &self.namespace, &self.name, &self.remaps)
    }
}

pub(crate) fn dds_name(full: &str) -> Result<Name, RosError> {
    Name::parse(full).map_err(|error| RosError::Name { name: full.to_string(), reason: error.to_string() })
}

/// A ROS 2 node.
///
/// Callbacks run on the node's own threads (two of them): they must be short and must not block; hand data over by a
/// channel. Service handlers run on a thread where they may take their time, one request after the other for each
/// service.
///
/// A process has one node: the middleware does not match endpoints of one participant with each other where there is no
/// multicast.
pub struct Node {
    pub(crate) core: Arc<Core>,
    store: Arc<Store>,
    runtime: Option<Runtime>,
    tasks: Mutex<Vec<JoinHandle<()>>>,
    closers: Mutex<Vec<Box<dyn FnOnce() + Send>>>,
    stop: Stop,
    clock: Clock,
    /// Dropped last: until then the process ends in time, whatever hangs. A part has none.
    guard: Option<watchdog::Guard>,
}

impl Node {
    /// Starts a node with a default name and the namespace `/`; the command line may change both.
    /// Also installs the log subscriber (standard error and `/rosout`), the handlers of SIGINT and SIGTERM (the process
    /// ends within 2 s whatever hangs; a second one, a second later or more, ends it at once), the watch over its
    /// threads, the parameter services and, with `use_sim_time`, the clock.
    ///
    /// # Errors
    /// Wrong names or parameters, or when the middleware cannot start (no network interface, no free port).
    pub fn start(name: &str, arguments: &Arguments) -> Result<Self, RosError> {
        let (name, namespace) = arguments.node_name(name, "/")?;
        let lines = start_log::start(arguments, &namespace, &name);
        let create = |reason: String| RosError::Create {
            what: format!("node {name:?} in domain {}", arguments.domain_id),
            reason,
        };
        let runtime = tokio::runtime::Builder::new_multi_thread()
            .worker_threads(2)
            .thread_name("ros")
            .enable_all()
            .build()
            .map_err(|error| create(error.to_string()))?;

        // First of all: from the moment that others see anything of the node they may ask it to end.
        let stop = Stop::new(Health::new(arguments.supervised));
        let guard = watchdog::start(&stop)?;
        let participant = participant::start(arguments, &create)?;
        stop.health.set_loops(participant.loop_watches());
        std::thread::sleep(INTRODUCTION);
        let context = Context::from_domain_participant(participant).map_err(|error| create(error.to_string()))?;
        let node_name = NodeName::new(&namespace, &name).map_err(|error| create(error.to_string()))?;
        let options = NodeOptions::new().enable_rosout(false).start_parameter_services(false);
        let inner = context.new_node(node_name, options).map_err(|error| create(error.to_string()))?;
        let listener = context.domain_participant().status_listener();

        let full_name = names::expand("~", &namespace, &name)?;
        let core = Arc::new(Core {
            node: Mutex::new(Some(inner)),
            handle: runtime.handle().clone(),
            name,
            namespace,
            remaps: arguments.remaps.clone(),
            context: Mutex::new(Some(context)),
            matches: Matches::default(),
            departures: Mutex::default(),
        });
        let (changes, mut changed) = unbounded_channel();
        let store = Arc::new(Store::new(full_name.clone(), &arguments.overrides, move |change| {
            // Nobody listens once the node is shut down.
            let _ = changes.send(change);
        }));
        let mut node = Node {
            core,
            store,
            runtime: Some(runtime),
            tasks: Mutex::default(),
            closers: Mutex::default(),
            stop,
            clock: Clock::default(),
            guard: Some(guard),
        };
        let workers = node.stop.health.workers();
        node.every(WORKERS_PERIOD, move || {
            workers.fetch_add(1, Ordering::Relaxed);
        });
        // In place of the middleware's own task, which also follows other nodes' descriptions (and keeps them for ever)
        // and reads /clock as another type.
        node.spawn(Matches::follow(Arc::clone(&node.core), listener));
        node.serve_parameters()?;
        if let Some(lines) = lines {
            node.publish_log(lines)?;
        }
        let sim_time = node
            .parameter("use_sim_time", false)
            .description("Take the time from /clock instead of the machine's clock.")
            .read_only()
            .declare()?;
        if sim_time.get() {
            let time = Arc::new(AtomicI64::new(0));
            node.clock = Clock::simulated(&time);
            node.subscribe::<rosgraph_msgs::Clock>("/clock", Qos::best_effort(1), move |message| {
                time.store(message.clock.nanoseconds(), Ordering::Relaxed);
            })?;
        }
        let events = node.publisher::<wire::ParameterEvent>("/parameter_events", Qos::reliable(1000))?;
        let clock = node.clock();
        node.spawn(async move {
            while let Some(change) = changed.recv().await {
                let event = crate::parameters::Changes::into_event(change, full_name.clone(), clock.now());
                if let Err(error) = events.publish(event) {
                    tracing::warn!("{error}");
                }
            }
        });
        Ok(node)
    }

    /// The node's full name, such as `/robot/controller`.
    #[must_use]
    pub fn full_name(&self) -> String {
        if self.core.namespace == "/" {
            format!("/{}", self.core.name)
        } else {
            format!("{}/{}", self.core.namespace, self.core.name)
        }
    }

    /// The node's namespace, `/` or `/robot`.
    #[must_use]
    pub fn namespace(&self) -> &str {
        &self.core.namespace
    }

    /// Simulated time where the parameter `use_sim_time` says so (0 until a clock is received), else the wall clock.
    #[must_use]
    pub fn now(&self) -> Time {
        self.clock.now()
    }

    /// What tells [`Node::now`] to threads that do not hold the node.
    #[must_use]
    pub fn clock(&self) -> Clock {
        self.clock.clone()
    }

    /// A publisher. Names are expanded and remapped as in ROS 2.
    ///
    /// # Errors
    /// A wrong name, or the middleware's reason.
    pub fn publisher<M: Message>(&self, topic: &str, qos: Qos) -> Result<Publisher<M>, RosError> {
        let full = self.core.full_name(topic, Subject::Topic)?;
        let create = |reason: String| RosError::Create { what: format!("publisher on {full}"), reason };
        let name = dds_name(&full)?;
        let inner = self
            .core
            .with_node(|node| {
                let topic = node.create_topic(&name, MessageTypeName::new(M::PACKAGE, M::NAME), &qos.profile())?;
                node.create_publisher::<M>(&topic, Some(qos.profile()))
            })
            .ok_or_else(|| self.shut_down(&full))?
            .map_err(|error| create(error.to_string()))?;
        let slot = Arc::new(Slot::new(inner));
        self.close_with(Arc::downgrade(&slot), Slot::close);
        Ok(Publisher::new(full, slot))
    }

    /// A publisher of messages that are serialised already, of any type: `package/msg/Type`. For playing bags.
    ///
    /// # Errors
    /// A wrong name or type, or the middleware's reason.
    pub fn raw_publisher(&self, topic: &str, type_name: &str, qos: Qos) -> Result<RawPublisher, RosError> {
        let full = self.core.full_name(topic, Subject::Topic)?;
        let create = |reason: String| RosError::Create { what: format!("publisher on {full}"), reason };
        let name = dds_name(&full)?;
        let parts: Vec<&str> = type_name.split('/').collect();
        let [package, "msg", type_in_package] = parts.as_slice() else {
            return Err(create(format!("type '{type_name}'; expected package/msg/Type")));
        };
        let inner = self
            .core
            .with_node(|node| {
                let topic = node.create_topic(&name, MessageTypeName::new(package, type_in_package), &qos.profile())?;
                node.create_publisher::<Raw>(&topic, Some(qos.profile()))
            })
            .ok_or_else(|| self.shut_down(&full))?
            .map_err(|error| create(error.to_string()))?;
        let slot = Arc::new(Slot::new(inner));
        self.close_with(Arc::downgrade(&slot), Slot::close);
        Ok(RawPublisher::new(full, slot))
    }

    /// A subscription that lives as long as the node. Messages of publishers that announce another type, and messages
    /// that do not decode, are dropped with a warning; arrays' lengths and values are the callback's to check.
    ///
    /// # Errors
    /// A wrong name, or the middleware's reason.
    pub fn subscribe<M: Message>(
        &self,
        topic: &str,
        qos: Qos,
        mut callback: impl FnMut(M) + Send + 'static,
    ) -> Result<(), RosError> {
        self.subscribe_from(topic, qos, move |_, message| callback(message), |_| {})
    }

    /// As [`Node::subscribe`], with each message's publisher, and notified of every publisher (of any topic) that is
    /// gone. A publisher's messages come before its departure.
    ///
    /// # Errors
    /// A wrong name, or the middleware's reason.
    pub fn subscribe_from<M: Message>(
        &self,
        topic: &str,
        qos: Qos,
        mut callback: impl FnMut(PublisherId, M) + Send + 'static,
        mut left: impl FnMut(Departure) + Send + 'static,
    ) -> Result<(), RosError> {
        let full = self.core.full_name(topic, Subject::Topic)?;
        let create = |reason: String| RosError::Create { what: format!("subscription to {full}"), reason };
        let name = dds_name(&full)?;
        let type_name = MessageTypeName::new(M::PACKAGE, M::NAME);
        let expected = type_name.dds_msg_type();
        let subscription = self
            .core
            .with_node(|node| {
                let topic = node.create_topic(&name, type_name, &qos.profile())?;
                node.create_subscription::<M>(&topic, Some(qos.profile()))
            })
            .ok_or_else(|| self.shut_down(&full))?
            .map_err(|error| create(error.to_string()))?;
        let core = Arc::clone(&self.core);
        let mut departures = core.departures();
        self.spawn(async move {
            let mut known = HashMap::new();
            let mut undecoded = Occasionally::default();
            let mut messages = Box::pin(subscription.async_stream());
            loop {
                let received = tokio::select! {
                    // What a publisher said comes before its leave.
                    biased;
                    received = messages.next() => received,
                    Some(departure) = departures.recv() => {
                        known.retain(|publisher, _| !departure.covers(*publisher));
                        left(departure);
                        continue;
                    }
                };
                match received {
                    None => return,
                    Some(Ok((message, info))) => {
                        let gid = info.publisher_gid();
                        let publisher = PublisherId::from(gid);
                        let right = known.get(&publisher).copied().unwrap_or_else(|| {
                            // Not known yet: take it, and ask again at its next message.
                            let Some(announced) = core.announced_type(gid) else { return true };
                            let right = announced == expected;
                            if !right {
                                tracing::warn!(
                                    "topic {full}: a publisher sends {announced}, expected {expected}: its messages are dropped"
                                );
                            }
                            known.insert(publisher, right);
                            right
                        });
                        if right {
                            callback(publisher, message);
                        }
                    }
                    Some(Err(error)) => {
                        if let Some(count) = undecoded.now() {
                            tracing::warn!("topic {full}: {count} messages could not be read, the last: {error}");
                        }
                    }
                }
            }
        });
        Ok(())
    }

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
        let full = self.core.full_name(service, Subject::Service)?;
        let name = dds_name(&full)?;
        let callers = Peers::new(&self.core, &full);
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

    /// How many publishers of other nodes are seen on a topic.
    #[must_use]
    pub fn publisher_count(&self, topic: &str) -> usize {
        self.count(topic, |node, full| node.publisher_count(full))
    }

    /// How many subscriptions of other nodes are seen on a topic.
    #[must_use]
    pub fn subscription_count(&self, topic: &str) -> usize {
        self.count(topic, |node, full| node.subscription_count(full))
    }

    fn count(&self, topic: &str, count: impl FnOnce(&ros2_client::Node, &str) -> usize) -> usize {
        match self.core.full_name(topic, Subject::Topic) {
            Ok(full) => self.core.with_node(|node| count(node, &full)).unwrap_or_default(),
            Err(_) => 0,
        }
    }

    /// The same node once more, for endpoints and tasks that come and go while the node stays: they are gone when the
    /// part is dropped (or [shut down](Node::shutdown)), and at the latest with the node itself. Parameters, name,
    /// clock and [`Node::stop`] are the whole node's.
    #[must_use]
    pub fn part(&self) -> Node {
        Node {
            core: Arc::clone(&self.core),
            store: Arc::clone(&self.store),
            runtime: None,
            tasks: Mutex::default(),
            closers: Mutex::default(),
            stop: self.stop.clone(),
            clock: self.clock.clone(),
            guard: None,
        }
    }

    /// The handle that asks for the end, to be given to other threads.
    #[must_use]
    pub fn stop(&self) -> Stop {
        self.stop.clone()
    }

    /// Runs a task on the node's threads until the node ends.
    pub fn spawn(&self, task: impl Future<Output = ()> + Send + 'static) {
        let handle = self.core.handle.spawn(task);
        self.tasks.lock().unwrap_or_else(PoisonError::into_inner).push(handle);
    }

    /// Calls `action` at a fixed rate on the node's threads; a late call is skipped, not made up for.
    pub fn every(&self, period: Duration, mut action: impl FnMut() + Send + 'static) {
        self.spawn(async move {
            let mut interval = tokio::time::interval(period);
            interval.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Skip);
            loop {
                interval.tick().await;
                action();
            }
        });
    }

    /// Waits for SIGINT, SIGTERM or [`Stop::request`], then shuts down.
    pub fn run(self) {
        self.wait_for_stop();
        self.shutdown();
    }

    pub(crate) fn wait_for_stop(&self) {
        self.core.handle.block_on(self.stop.requested());
    }

    /// Ends the node so that others see it leave at once: publishers and clients first, then the node and the
    /// participant. Publishers that are still held elsewhere report
    /// [`PublishError::ShutDown`](crate::PublishError::ShutDown).
    pub fn shutdown(mut self) {
        self.end();
    }

    fn end(&mut self) {
        let Some(runtime) = self.runtime.take() else {
            return self.end_part();
        };
        self.stop.request();
        let mut tasks: Vec<_> = std::mem::take(&mut *self.tasks.lock().unwrap_or_else(PoisonError::into_inner));
        for task in &tasks {
            task.abort();
        }
        let deadline = Instant::now() + SHUTDOWN_PATIENCE;
        let closers = std::mem::take(&mut *self.closers.lock().unwrap_or_else(PoisonError::into_inner));
        let core = Arc::clone(&self.core);
        runtime.block_on(async move {
            for task in tasks.drain(..) {
                // Aborted or finished: either is the end that was asked for.
                let _ = tokio::time::timeout_at(deadline.into(), task).await;
            }
            for close in closers {
                close();
            }
            drop(core.node.lock().unwrap_or_else(PoisonError::into_inner).take());
            // The announcement that the node is gone is on its way; the participant must not end before it has left.
            tokio::time::sleep(FAREWELL).await;
        });
        drop(self.core.context.lock().unwrap_or_else(PoisonError::into_inner).take());
        runtime.shutdown_timeout(deadline.saturating_duration_since(Instant::now()));
        drop(self.guard.take());
    }

    /// Takes a part's endpoints away. Waits without the runtime: the last holder of a part may be one of the runtime's
    /// own tasks.
    fn end_part(&mut self) {
        let tasks = std::mem::take(&mut *self.tasks.lock().unwrap_or_else(PoisonError::into_inner));
        for task in &tasks {
            task.abort();
        }
        for close in std::mem::take(&mut *self.closers.lock().unwrap_or_else(PoisonError::into_inner)) {
            close();
        }
        let deadline = Instant::now() + SHUTDOWN_PATIENCE;
        while !tasks.iter().all(JoinHandle::is_finished) && Instant::now() < deadline {
            std::thread::sleep(Duration::from_millis(1));
        }
    }

    fn shut_down(&self, what: &str) -> RosError {
        RosError::ShutDown { what: what.to_string() }
    }

    fn close_with<T: Send + Sync + 'static>(&self, target: Weak<T>, close: impl FnOnce(&T) + Send + 'static) {
        self.closers.lock().unwrap_or_else(PoisonError::into_inner).push(Box::new(move || {
            if let Some(target) = target.upgrade() {
                close(&target);
            }
        }));
    }

    fn serve_parameters(&self) -> Result<(), RosError> {
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

    fn publish_log(&self, lines: std::sync::mpsc::Receiver<wire::Log>) -> Result<(), RosError> {
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

impl Drop for Node {
    fn drop(&mut self) {
        self.end();
    }
}

/// Says at most every five seconds how often something happened since it last said so.
#[derive(Default)]
pub(crate) struct Occasionally {
    count: u64,
    last: Option<Instant>,
}

impl Occasionally {
    pub(crate) fn now(&mut self) -> Option<u64> {
        self.count += 1;
        if self.last.is_none_or(|last| last.elapsed() >= Duration::from_secs(5)) {
            self.last = Some(Instant::now());
            Some(std::mem::take(&mut self.count))
        } else {
            None
        }
    }
}
