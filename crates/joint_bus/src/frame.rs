/// A CAN frame (up to 8 bytes) or CAN FD frame (up to 64).
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Frame {
    /// Identifier: 11 bits, or 29 where `extended`.
    pub id: u32,
    /// Whether the identifier has 29 bits.
    pub extended: bool,
    /// Whether it is a CAN FD frame.
    pub fd: bool,
    length: u8,
    data: [u8; 64],
}

impl Frame {
    /// A classical frame with an 11-bit identifier; `None` if the identifier or the data is too long.
    pub fn new(id: u32, data: &[u8]) -> Option<Self> {
        if id > 0x7ff || data.len() > 8 {
            return None;
        }
        Some(Self::unchecked(id, false, false, data))
    }

    /// A CAN FD frame with a 29-bit identifier; padded with `pad` to a length that CAN FD knows.
    pub fn new_fd(id: u32, data: &[u8], pad: u8) -> Option<Self> {
        if id > 0x1fff_ffff {
            return None;
        }
        let length = [0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64].into_iter().find(|n| *n >= data.len())?;
        let mut padded = [pad; 64];
        padded[..data.len()].copy_from_slice(data);
        Some(Self::unchecked(id, true, true, &padded[..length]))
    }

    /// A frame as it came off a bus: lengths are those of the bus.
    pub(crate) fn unchecked(id: u32, extended: bool, fd: bool, bytes: &[u8]) -> Self {
        let mut data = [0; 64];
        let length = bytes.len().min(64);
        data[..length].copy_from_slice(&bytes[..length]);
        Self { id, extended, fd, length: length as u8, data }
    }

    /// The data.
    pub fn data(&self) -> &[u8] {
        &self.data[..self.length as usize]
    }

    /// The data, to spoil it.
    pub fn data_mut(&mut self) -> &mut [u8] {
        &mut self.data[..self.length as usize]
    }
}

impl core::fmt::Debug for Frame {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "{:03x}#", self.id)?;
        for byte in self.data() {
            write!(f, "{byte:02x}")?;
        }
        Ok(())
    }
}
