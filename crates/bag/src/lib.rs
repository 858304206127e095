//! Recording and reading of ROS 2 bags (rosbag2).
//!
//! A bag is a folder: one or more MCAP files (profile `ros2`, messages in CDR, their `ros2msg` definitions embedded, chunks
//! compressed with zstd) and a `metadata.yaml` beside them. `ros2 bag info` and `play`, the `rosbags` and `mcap` Python libraries,
//! Foxglove and PlotJuggler read it.
//!
//! # Recording
//!
//! [`Recorder::start`] opens a new folder and a writer thread. [`Recorder::topic`] declares a topic; [`Recorder::push`] hands over one
//! serialised message and returns at once: between the caller and the thread stands a bounded queue, and a message that does
//! not fit is dropped and counted, so a slow disk never slows the caller. `push` allocates: call it from the side that talks to
//! DDS, never from the control thread.
//!
//! ```
//! use bag::{Qos, Recorder, RecorderOptions};
//! # let folder = tempfile::tempdir().unwrap();
//! # let folder = folder.path().join("walk");
//! let recorder = Recorder::start(&folder, RecorderOptions::default())?;
//! let clock = recorder.topic("/clock", "rosgraph_msgs/msg/Clock", Qos::sensor(1))?;
//! let cdr = [0, 1, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0]; // encapsulation header, then sec = 1, nanosec = 0
//! assert!(recorder.push(&clock, 1_000_000_000, cdr));
//! let summary = recorder.finish()?;
//! assert_eq!((summary.written(), summary.dropped()), (1, 0));
//! # Ok::<(), bag::BagError>(())
//! ```
//!
//! The open chunk is closed and the file synchronised to disk every [`RecorderOptions::flush_interval`] (half a second), so a
//! crash or a power cut loses less than the last second.
//!
//! # Reading
//!
//! [`Bag::open`] takes a folder or a file, MCAP or sqlite3, ours or another's; [`Bag::messages`] gives the messages in the order of
//! time. [`from_cdr`] reads one as a known Rust type, [`decode()`] by the definition in the bag. [`recover()`] makes a whole bag of
//! what a killed recorder or a broken disk left.
//!
//! # Invariants
//!
//! - Nothing here knows DDS, a robot or a controller: topics, types, stamps and bytes.
//! - Nothing is written over: a recording starts in a folder that does not hold a bag.

mod copy;
mod cursor;
mod data_file;
mod decode;
mod definition;
mod error;
mod mcap_file;
mod message;
mod metadata;
mod offer;
mod qos;
mod read;
mod recorder;
mod records;
mod recover;
mod sqlite_file;

pub use copy::{Filter, Filtered, filter};
pub use decode::{Value, decode};
pub use definition::{Definition, full_definition, known_types};
pub use error::BagError;
pub use message::Message;
pub use offer::{Liveliness, Offer};
pub use qos::{Durability, Qos, Reliability};
pub use read::{Bag, BagTopic, Messages, from_cdr};
pub use recorder::{Recorder, RecorderOptions, RecorderStatus, Summary, Topic, TopicSummary, WhenFull, to_cdr};
pub use recover::{Recovery, recover};
