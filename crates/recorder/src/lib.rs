//! Recording of ROS 2 bags (rosbag2), and what they say of topics and types. Crate `bag` reads them.
//!
//! A bag is a folder: one or more MCAP files (profile `ros2`, messages in CDR, their `ros2msg` definitions embedded,
//! chunks compressed with zstd) and a `metadata.yaml` beside them. `ros2 bag info` and `play`, the `rosbags` and `mcap`
//! Python libraries, Foxglove and PlotJuggler read it.
//!
//! [`Recorder::start`] opens a new folder and a writer thread. [`Recorder::topic`] declares a topic; [`Recorder::push`]
//! hands over one serialised message and returns at once: between the caller and the thread stands a bounded queue, and
//! a message that does not fit is dropped and counted, so a slow disk never slows the caller. `push` allocates: call it
//! from the side that talks to DDS, never from the control thread.
//!
//! ```
//! use recorder::{Qos, Recorder, RecorderOptions};
//! # let folder = tempfile::tempdir().unwrap();
//! # let folder = folder.path().join("walk");
//! let recorder = Recorder::start(&folder, RecorderOptions::default())?;
//! let clock = recorder.topic("/clock", "rosgraph_msgs/msg/Clock", Qos::sensor(1))?;
//! let cdr = [0, 1, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0]; // encapsulation header, then sec = 1, nanosec = 0
//! assert!(recorder.push(&clock, 1_000_000_000, cdr));
//! let summary = recorder.finish()?;
//! assert_eq!((summary.written(), summary.dropped()), (1, 0));
//! # Ok::<(), recorder::BagError>(())
//! ```
//!
//! The open chunk is closed and the file synchronised to disk every [`RecorderOptions::flush_interval`] (half a
//! second), so a crash or a power cut loses less than the last second.
//!
//! # Invariants
//!
//! - Nothing here knows DDS, a robot or a controller: topics, types, stamps and bytes.
//! - Nothing is written over: a recording starts in a folder that does not hold a bag.
//! - A program that records links no reader: the controller's has neither SQLite nor pictures.

mod channel;
mod copy;
mod definition;
mod error;
mod message;
pub mod metadata;
mod options;
mod qos;
mod recorder;
mod shared;
mod writer;

pub use channel::{Channel, OFFERED, Schema, TYPE_HASH};
pub use copy::BagCopy;
pub use definition::{Count, Definition, Element, Field, Primitive, full_definition, known_types};
pub use error::BagError;
pub use message::Message;
pub use options::{RecorderOptions, WhenFull};
pub use qos::{Durability, Qos, Reliability};
pub use recorder::{Recorder, RecorderStatus, Summary, Topic, TopicSummary, to_cdr};
