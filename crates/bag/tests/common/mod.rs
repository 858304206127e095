//! What the tests of reading share.
#![allow(dead_code)]

use std::path::Path;

use bag::{Bag, BagError, Message, Qos, Recorder, RecorderOptions};

/// A repeatable source of numbers.
pub struct Random(pub u64);

impl Random {
    pub fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 ^ (self.0 >> 31)).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 3
    }

    /// Below `end`.
    pub fn below(&mut self, end: usize) -> usize {
        (self.next() % end.max(1) as u64) as usize
    }
}

/// A std_msgs/msg/String in CDR.
pub fn text_cdr(text: &str) -> Vec<u8> {
    let mut cdr = vec![0, 1, 0, 0];
    cdr.extend_from_slice(&(text.len() as u32 + 1).to_le_bytes());
    cdr.extend_from_slice(text.as_bytes());
    cdr.push(0);
    cdr
}

/// A bag of two topics whose messages say their own number.
pub fn write(folder: &Path, messages: u64, options: RecorderOptions) {
    let recorder = Recorder::start(folder, options).unwrap();
    let words = recorder.topic("/words", "std_msgs/msg/String", Qos::reliable(10)).unwrap();
    let flags = recorder.topic("/flags", "std_msgs/msg/Bool", Qos::sensor(1)).unwrap();
    for number in 0..messages {
        while !recorder.push(&words, 1000 + number * 1_000_000, text_cdr(&format!("message {number}"))) {
            std::thread::yield_now();
        }
        while !recorder.push(&flags, 1000 + number * 1_000_000, [0, 1, 0, 0, (number % 2) as u8]) {
            std::thread::yield_now();
        }
    }
    recorder.finish().unwrap();
}

/// Every message with its topic's name.
pub fn read(path: &Path) -> Result<Vec<(String, Message)>, BagError> {
    let bag = Bag::open(path)?;
    bag.messages()?.map(|message| message.map(|message| (bag.topics()[message.topic].name.clone(), message))).collect()
}
