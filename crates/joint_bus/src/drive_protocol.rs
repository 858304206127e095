//! The protocol that a wiring file names: the one place where its name selects an implementation.

use crate::{BusConfig, DriveReply, DriveRequest, EncodeError, Frame, Mit, Protocol, ProtocolName, Ranges, Registers};

impl ProtocolName {
    /// Whether its frames are CAN FD's.
    pub fn uses_can_fd(self) -> bool {
        match self {
            Self::Mit => false,
            Self::Registers => true,
        }
    }

    /// Whether its commands carry limits: a largest torque and a watchdog.
    pub fn carries_limits(self) -> bool {
        match self {
            Self::Mit => false,
            Self::Registers => true,
        }
    }

    /// The largest identifier of replies: one of 11 bits, of which a register frame has 7.
    pub fn largest_host_id(self) -> u32 {
        match self {
            Self::Mit => 0x7ff,
            Self::Registers => 0x7f,
        }
    }
}

/// The protocol that a wiring file names.
#[derive(Clone, Copy, Debug)]
pub enum DriveProtocol {
    /// The MIT mini-cheetah's frames.
    Mit(Mit),
    /// Register frames over CAN FD.
    Registers(Registers),
}

impl DriveProtocol {
    /// The protocol of a wiring file.
    pub fn of(config: &BusConfig) -> Self {
        let host_id = config.host_id & config.protocol.largest_host_id();
        match config.protocol {
            ProtocolName::Mit => Self::Mit(Mit { host_id, ..Mit::default() }),
            ProtocolName::Registers => Self::Registers(Registers { host_id: host_id as u8 }),
        }
    }

    fn implementation(&self) -> &dyn Protocol {
        match self {
            Self::Mit(mit) => mit,
            Self::Registers(registers) => registers,
        }
    }
}

impl Protocol for DriveProtocol {
    fn has_query(&self) -> bool {
        self.implementation().has_query()
    }

    fn encode_request(&self, id: u8, ranges: &Ranges, request: &DriveRequest) -> Result<Frame, EncodeError> {
        self.implementation().encode_request(id, ranges, request)
    }

    fn reply_id(&self, frame: &Frame) -> Option<u8> {
        self.implementation().reply_id(frame)
    }

    fn decode_reply(&self, ranges: &Ranges, frame: &Frame) -> Option<DriveReply> {
        self.implementation().decode_reply(ranges, frame)
    }

    fn decode_request(&self, id: u8, ranges: &Ranges, frame: &Frame) -> Option<DriveRequest> {
        self.implementation().decode_request(id, ranges, frame)
    }

    fn encode_reply(&self, id: u8, ranges: &Ranges, reply: &DriveReply) -> Frame {
        self.implementation().encode_reply(id, ranges, reply)
    }
}
