//! Reading of ROS 2 bags (rosbag2); crate [`recorder`] writes them, and what it gives is here too.
//!
//! [`Bag::open`] takes a folder or a file, MCAP or sqlite3, ours or another's; [`Bag::messages`] gives the messages in
//! the order of time. [`from_cdr`] reads one as a known Rust type, [`decode()`] by the definition in the bag.
//! [`recover()`] makes a whole bag of what a killed recorder or a broken disk left.
//!
//! # Invariants
//!
//! - Nothing here knows DDS, a robot or a controller: topics, types, stamps and bytes.
//! - Nothing is written over: a copy starts in a folder that does not hold a bag.

mod copy;
mod cursor;
mod data_file;
mod decode;
mod mcap_file;
mod offer;
mod read;
mod records;
mod recover;
mod sqlite_file;

pub use copy::{Filter, Filtered, filter};
pub use decode::{Value, decode};
pub use offer::{Liveliness, Offer};
pub use read::{Bag, BagTopic, Messages, from_cdr};
pub use recorder::{
    BagError, Definition, Durability, Message, Qos, Recorder, RecorderOptions, RecorderStatus, Reliability, Summary,
    Topic, TopicSummary, WhenFull, full_definition, known_types, to_cdr,
};
pub use recover::{Recovery, recover};
