//! The protocol that a wiring file names: the one place where it is chosen.

use crate::{BusConfig, DriveReply, DriveRequest, EncodeError, Frame, Mit, Protocol, ProtocolName, Ranges, Registers};

/// The protocol that a wiring file names.
#[derive(Clone, Copy, Debug)]
pub enum Speech {
    /// The MIT mini-cheetah's frames.
    Mit(Mit),
    /// Register frames over CAN FD.
    Registers(Registers),
}

impl Speech {
    /// The protocol of a wiring file.
    pub fn of(config: &BusConfig) -> Self {
        match config.protocol {
            ProtocolName::Mit => Self::Mit(Mit { host_id: config.host_id, ..Mit::default() }),
            // The file's check has kept it to seven bits.
            ProtocolName::Registers => Self::Registers(Registers { host_id: (config.host_id & 0x7f) as u8 }),
        }
    }
}

impl Protocol for Speech {
    fn has_query(&self) -> bool {
        match self {
            Self::Mit(p) => p.has_query(),
            Self::Registers(p) => p.has_query(),
        }
    }

    fn encode_request(&self, id: u8, ranges: &Ranges, request: &DriveRequest) -> Result<Frame, EncodeError> {
        match self {
            Self::Mit(p) => p.encode_request(id, ranges, request),
            Self::Registers(p) => p.encode_request(id, ranges, request),
        }
    }

    fn reply_id(&self, frame: &Frame) -> Option<u8> {
        match self {
            Self::Mit(p) => p.reply_id(frame),
            Self::Registers(p) => p.reply_id(frame),
        }
    }

    fn decode_reply(&self, ranges: &Ranges, frame: &Frame) -> Option<DriveReply> {
        match self {
            Self::Mit(p) => p.decode_reply(ranges, frame),
            Self::Registers(p) => p.decode_reply(ranges, frame),
        }
    }

    fn decode_request(&self, id: u8, ranges: &Ranges, frame: &Frame) -> Option<DriveRequest> {
        match self {
            Self::Mit(p) => p.decode_request(id, ranges, frame),
            Self::Registers(p) => p.decode_request(id, ranges, frame),
        }
    }

    fn encode_reply(&self, id: u8, ranges: &Ranges, reply: &DriveReply) -> Frame {
        match self {
            Self::Mit(p) => p.encode_reply(id, ranges, reply),
            Self::Registers(p) => p.encode_reply(id, ranges, reply),
        }
    }
}
