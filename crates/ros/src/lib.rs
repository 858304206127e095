//! The one crate that knows the ROS 2 middleware: nodes, topics, services, parameters, logging, time and shutdown.
//!
//! A node starts with one call that reads `--ros-args` and the environment (`ROS_DOMAIN_ID`,
//! `ROS_AUTOMATIC_DISCOVERY_RANGE`, `ROS_LOCALHOST_ONLY`), and ends in order on SIGINT and SIGTERM:
//!
//! ```no_run
//! use std::time::Duration;
//!
//! use ros::{Arguments, Node, Qos};
//! use tandem_msgs::sensor_msgs::JointState;
//! use tandem_msgs::std_srvs::{Trigger, TriggerRequest, TriggerResponse};
//!
//! fn main() -> Result<(), Box<dyn std::error::Error>> {
//!     let (arguments, _rest_for_the_program) = Arguments::from_process()?;
//!     let node = Node::start("walker", &arguments)?;
//!     let rate_hz = node.parameter("rate_hz", 200.0).description("Publishing rate, Hz.");
//!     let rate_hz = rate_hz.range(1.0, 1000.0).declare()?;
//!     let states = node.publisher::<JointState>("joint_states", Qos::reliable(10))?;
//!     node.subscribe("other_states", Qos::best_effort(1), |state: JointState| {
//!         tracing::debug!("{} joints", state.name.len()); // short, never blocking: hand data over by a channel
//!     })?;
//!     node.serve::<Trigger>("stand", |_request| TriggerResponse::done("standing"))?;
//!     node.every(Duration::from_secs_f64(1.0 / rate_hz.get()), move || {
//!         if let Err(error) = states.publish(JointState::default()) {
//!             tracing::warn!("{error}");
//!         }
//!     });
//!     let sit = node.client::<Trigger>("sit")?;
//!     let response = sit.call(TriggerRequest::default(), Duration::from_secs(5))?;
//!     tracing::info!("sit: {}", response.message);
//!     node.run(); // until SIGINT, SIGTERM or node.stop().request()
//!     Ok(())
//! }
//! ```
//!
//! # Rules that the middleware imposes
//!
//! - One node in a process: endpoints of one participant do not find each other where there is no multicast.
//! - Publishing takes 13 µs, locks and allocates: never from a control thread. Push into a wait-free queue (`rtrb`) and
//!   publish from a node's thread.
//! - A reliable publisher overwrites: a subscriber that has stalled or joins stops nobody, and misses what is older
//!   than `depth` messages. So every publisher of ours is reliable and serves both kinds of subscriptions; a control
//!   loop subscribes with best effort, because nobody is to send it old data again. Who can wait for its subscribers
//!   takes [`Qos::keep_all`].
//! - Large messages go out in fragments, 64 kB a millisecond, and what others publish goes out between them.
//! - Matching does not look at the type. [`Node::subscribe`] drops messages of publishers that announce another type;
//!   lengths and values of arrays are for the callback to check.
//! - A request or response needs at least one member: `std_srvs/Trigger`'s request carries the byte that ROS 2 puts
//!   there.

mod action;
mod arguments;
mod client;
mod error;
mod health;
mod lifecycle;
mod log_file;
mod log_text;
mod logging;
mod matches;
mod names;
mod node;
mod occasionally;
mod others;
mod parameters;
mod participant;
mod peers;
mod publisher;
mod qos;
mod security;
mod service;
mod shared;
mod start_log;
mod stop;
pub mod table;
mod time;
mod type_hash;
mod watchdog;

pub use action::{Goal, GoalEnd};
pub use arguments::{Arguments, DiscoveryRange};
pub use client::Client;
pub use error::{CallError, PublishError, RosError};
pub use health::{Health, Pulse, Silence, THREADS, Thread};
pub use lifecycle::{Change, ChangeError, Lifecycle, Managed, State};
pub use matches::{Departure, ProgramId, PublisherId};
pub use names::{PREFIX_RULE, check_prefix};
pub use node::Node;
pub use parameters::{Parameter, ParameterBuilder, ParameterType, ParameterValue, Ranged};
pub use publisher::{Publisher, RawPublisher};
pub use qos::{Promises, Qos};
pub use service::{ServeOptions, WAITING};
pub use stop::Stop;
pub use time::{Clock, wall_time};

// Does not compile? Cargo built the released RustDDS: a workspace that uses this crate needs Tandem's
// [patch.crates-io].
const _: &str = ros2_client::dds::rustdds::PATCHED_FOR_TANDEM;

/// A message as the middleware wants it: its marker trait cannot be implemented for types of another crate.
#[derive(Clone, Debug, serde::Serialize, serde::Deserialize)]
#[serde(transparent, bound = "")]
struct Wire<M: tandem_msgs::Message>(M);

impl<M: tandem_msgs::Message> ros2_client::Message for Wire<M> {}
