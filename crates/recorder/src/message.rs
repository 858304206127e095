//! A message of a bag.

/// One recorded message.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Message {
    /// Index of its topic in its bag, in the order in which a reader lists them.
    pub topic: usize,
    /// When it was recorded, ns since the epoch of the recording's clock.
    pub stamp_ns: u64,
    /// When it was published, ns, where the recorder knew; else as `stamp_ns`.
    pub publish_ns: u64,
    /// Its number on its topic, where the recorder counted; else 0.
    pub sequence: u32,
    /// The message in CDR, with its four-byte encapsulation header.
    pub data: Vec<u8>,
}
