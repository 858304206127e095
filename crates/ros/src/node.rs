//! A node: one DDS participant, its publishers, subscriptions, services, parameters and its end.

use std::sync::atomic::{AtomicI64, Ordering};
use std::sync::{Arc, Mutex, PoisonError, Weak};
use std::time::{Duration, Instant};

use ros2_client::{Context, NodeName, NodeOptions};
use tandem_msgs::builtin_interfaces::Time;
use tandem_msgs::rcl_interfaces as wire;
use tandem_msgs::rosgraph_msgs;
use tokio::runtime::Runtime;
use tokio::sync::mpsc::{UnboundedReceiver, unbounded_channel};
use tokio::task::JoinHandle;

use crate::arguments::Arguments;
use crate::health::Health;
use crate::matches::Matches;
use crate::parameters::{Changes, Store};
use crate::shared::Core;
use crate::stop::Stop;
use crate::{Clock, Qos, RosError, names, participant, start_log, type_hash, watchdog};

mod services;
mod topics;

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
        stop.health().set_loops(participant.loop_watches());
        std::thread::sleep(INTRODUCTION);
        type_hash::announce_graph();
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
        let (changes, changed) = unbounded_channel();
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
        let workers = node.stop.health().workers();
        node.every(WORKERS_PERIOD, move || {
            workers.fetch_add(1, Ordering::Relaxed);
        });
        // In place of the middleware's own task, which also follows other nodes' descriptions (and keeps them for ever)
        // and reads /clock as another type.
        node.spawn(Core::follow(Arc::clone(&node.core), listener));
        node.serve_parameters()?;
        if let Some(lines) = lines {
            node.publish_log(lines)?;
        }
        node.follow_clock()?;
        node.publish_parameter_events(full_name, changed)?;
        Ok(node)
    }

    /// Declares `use_sim_time`, and takes the time from `/clock` where it is set.
    fn follow_clock(&mut self) -> Result<(), RosError> {
        let sim_time = self
            .parameter("use_sim_time", false)
            .description("Take the time from /clock instead of the machine's clock.")
            .read_only()
            .declare()?;
        if sim_time.get() {
            let time = Arc::new(AtomicI64::new(0));
            self.clock = Clock::simulated(&time);
            self.subscribe::<rosgraph_msgs::Clock>("/clock", Qos::best_effort(1), move |message| {
                time.store(message.clock.nanoseconds(), Ordering::Relaxed);
            })?;
        }
        Ok(())
    }

    fn publish_parameter_events(
        &self,
        full_name: String,
        mut changed: UnboundedReceiver<Changes>,
    ) -> Result<(), RosError> {
        let events = self.publisher::<wire::ParameterEvent>("/parameter_events", Qos::reliable(1000))?;
        let clock = self.clock();
        self.spawn(async move {
            while let Some(change) = changed.recv().await {
                let event = change.into_event(full_name.clone(), clock.now());
                if let Err(error) = events.publish(event) {
                    tracing::warn!("{error}");
                }
            }
        });
        Ok(())
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

    /// What gives [`Node::now`] to threads that do not hold the node.
    #[must_use]
    pub fn clock(&self) -> Clock {
        self.clock.clone()
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
}

impl Drop for Node {
    fn drop(&mut self) {
        self.end();
    }
}
