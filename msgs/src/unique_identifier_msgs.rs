//! Identifiers.

messages! { "unique_identifier_msgs";
    /// A UUID (RFC 4122).
    #[derive(Copy, Eq, Hash, PartialOrd, Ord)]
    UUID {
        /// Its 16 bytes.
        uuid: [u8; 16],
    }
}
