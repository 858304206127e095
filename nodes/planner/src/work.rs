//! The planner as a managed node: configured it knows its robot and is seen in the graph, active it plans.

use std::ops::ControlFlow;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicI64, AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use robot::Robot;
use ros::{Clock, GoalEnd, Managed, Node, Publisher, Qos, RosError, ServeOptions};
use tandem_msgs::builtin_interfaces::Time;
use tandem_msgs::text::{NAME_CHARS, SENTENCE_CHARS, printable};
use tandem_msgs::{
    Gait, GenerateGait, GenerateGaitAction, GenerateGaitFeedback, GenerateGaitRequest, GenerateGaitResponse,
};

use crate::parameters::Table;
use crate::planner::Planner;
use crate::ports;

/// How long deactivating waits for plans that are being made; they are asked to stop.
const PATIENCE: Duration = Duration::from_secs(5);

/// What the parameters say.
#[derive(Clone, Debug)]
pub struct Parameters {
    folder: String,
    time_limit: Duration,
    waiting: usize,
    parallel: usize,
    find_nearest: bool,
}

impl Parameters {
    /// Declares every parameter and reads its value.
    ///
    /// # Errors
    /// The first parameter whose value is of another type or out of its range.
    pub fn declare(node: &Node) -> Result<Self, RosError> {
        let table = Table::declare(node)?;
        // The ranges keep both at or above 0.
        let count = |value: i64| usize::try_from(value).unwrap_or_default();
        Ok(Parameters {
            folder: table.robot,
            time_limit: Duration::from_secs_f64(table.time_limit_s),
            waiting: count(table.waiting_requests),
            parallel: count(table.parallel_requests),
            find_nearest: table.find_nearest,
        })
    }
}

/// What the requests' threads share.
struct Shared {
    planner: Planner,
    gaits: Publisher<Gait>,
    clock: Clock,
    /// Of the gait before, ns.
    stamped: AtomicI64,
    active: Arc<AtomicBool>,
    /// Requests that are being planned.
    busy: AtomicUsize,
}

impl Shared {
    fn is_active(&self) -> bool {
        self.active.load(Ordering::Acquire)
    }

    /// The time by the node's clock, and later than that of the gait before: an answer names its gait by its stamp, and
    /// simulated time may stand still.
    fn stamp(&self) -> Time {
        let now = self.clock.now().nanoseconds();
        let later = |before: i64| now.max(before.saturating_add(1));
        // A function that always gives a value is always applied.
        let before = self.stamped.fetch_update(Ordering::AcqRel, Ordering::Acquire, |before| Some(later(before)));
        Time::from_nanoseconds(before.map_or(now, later))
    }

    fn answer(
        &self,
        request: &GenerateGaitRequest,
        go_on: impl Fn() -> bool,
        mut feedback: impl FnMut(GenerateGaitFeedback),
    ) -> GenerateGaitResponse {
        self.busy.fetch_add(1, Ordering::AcqRel);
        let go_on = || go_on() && self.is_active();
        let response = if self.is_active() {
            let mut reported = 0;
            let (mut response, gait) = self.planner.generate(request, go_on, |iteration, elapsed| {
                reported = iteration.number;
                feedback(ports::feedback(iteration, elapsed));
                if go_on() { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
            });
            // The iteration that finds the solution good ends the solve without asking whether to go on.
            if response.success && response.solver.iterations > reported {
                feedback(ports::last_feedback(&response.solver));
            }
            announce(&request.behaviour, &mut response, gait, self.stamp(), &self.gaits);
            response
        } else {
            inactive()
        };
        self.busy.fetch_sub(1, Ordering::AcqRel);
        response
    }
}

fn inactive() -> GenerateGaitResponse {
    ports::failure(
        ports::INACTIVE,
        "the planner is not active: activate it (its service change_state) and ask again".into(),
    )
}

/// The planner between its transitions.
pub struct Work {
    node: Node,
    parameters: Parameters,
    active: Arc<AtomicBool>,
    open: Option<(Node, Arc<Shared>)>,
}

impl Work {
    /// Endpoints will be the node's.
    #[must_use]
    pub fn new(node: &Node, parameters: Parameters) -> Self {
        Work { node: node.part(), parameters, active: Arc::default(), open: None }
    }

    fn open(&self, robot: Robot) -> Result<(Node, Arc<Shared>), RosError> {
        let Parameters { time_limit, waiting, parallel, find_nearest, .. } = self.parameters;
        let node = self.node.part();
        let shared = Arc::new(Shared {
            planner: Planner::new(robot, time_limit, find_nearest),
            gaits: node.publisher("gait", Qos::latched())?,
            clock: node.clock(),
            stamped: AtomicI64::new(i64::MIN),
            active: Arc::clone(&self.active),
            busy: AtomicUsize::new(0),
        });
        let busy =
            move |_: &_| ports::failure(ports::BUSY, format!("{waiting} requests wait already: ask again later"));
        let this = Arc::clone(&shared);
        let options = ServeOptions::bounded(waiting, busy).parallel(parallel);
        node.serve_with::<GenerateGait>("generate_gait", options, move |request: GenerateGaitRequest| {
            this.answer(
                &request,
                || true,
                |feedback| {
                    tracing::debug!(
                        "{}: iteration {} after {:.6} s: cost {:.6e}, violation {:.1e}",
                        request.behaviour,
                        feedback.iteration,
                        feedback.elapsed_s,
                        feedback.objective,
                        feedback.max_violation
                    );
                },
            )
        })?;
        let this = Arc::clone(&shared);
        let accept = {
            let active = Arc::clone(&self.active);
            move || if active.load(Ordering::Acquire) { Ok(()) } else { Err("the planner is not active".to_string()) }
        };
        node.serve_action::<GenerateGaitAction>("generate_gait", waiting, accept, move |request, goal| {
            let go_on = || !goal.is_cancelled();
            let response = this.answer(&request, go_on, |feedback| goal.feedback(feedback));
            let end = match (response.success, goal.is_cancelled()) {
                (true, _) => GoalEnd::Succeeded,
                (false, true) => GoalEnd::Cancelled,
                (false, false) => GoalEnd::Aborted,
            };
            (end, response)
        })?;
        Ok((node, shared))
    }
}

impl Managed for Work {
    fn configure(&mut self, goes_active: bool) -> Result<(), String> {
        let folder = robot::find(Path::new(&self.parameters.folder)).map_err(|error| error.to_string())?;
        let robot = Robot::load(&folder).map_err(|error| format!("robot folder {}: {error}", folder.display()))?;
        for note in &robot.notes {
            tracing::info!("robot '{}': {note}", robot.name);
        }
        self.active.store(goes_active, Ordering::Release);
        self.open = Some(self.open(robot).map_err(|error| error.to_string())?);
        Ok(())
    }

    fn activate(&mut self) -> Result<(), String> {
        self.active.store(true, Ordering::Release);
        tracing::info!("ready");
        Ok(())
    }

    /// What is being planned is given up and answered so.
    fn deactivate(&mut self) -> Result<(), String> {
        self.active.store(false, Ordering::Release);
        let deadline = Instant::now() + PATIENCE;
        while let Some((_, shared)) = &self.open
            && shared.busy.load(Ordering::Acquire) > 0
            && Instant::now() < deadline
        {
            std::thread::sleep(Duration::from_millis(2));
        }
        Ok(())
    }

    fn clean_up(&mut self) -> Result<(), String> {
        self.active.store(false, Ordering::Release);
        self.open = None;
        Ok(())
    }
}

/// Says what came of a request, and publishes its gait if there is one; the answer then carries the gait's stamp.
fn announce(
    behaviour: &str,
    response: &mut GenerateGaitResponse,
    gait: Option<Gait>,
    stamp: Time,
    gaits: &Publisher<Gait>,
) {
    // It may repeat what was asked for.
    response.message = printable(&response.message, SENTENCE_CHARS).into_owned();
    if let Some(mut gait) = gait {
        tracing::info!("planned {}", response.message);
        gait.header.stamp = stamp;
        response.gait_stamp = gait.header.stamp;
        if let Err(error) = gaits.publish(gait) {
            tracing::error!("{error}");
        }
    } else {
        let behaviour = printable(behaviour, NAME_CHARS);
        tracing::warn!("{behaviour:?} was not planned: {}: {}", response.status, response.message);
    }
}
