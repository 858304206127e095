//! Diagnostics (REP 107).

use crate::std_msgs::Header;

messages! { "diagnostic_msgs";
    /// The state of several parts.
    DiagnosticArray {
        /// When.
        header: Header,
        /// One for each part.
        status: Vec<DiagnosticStatus>,
    }
    /// The state of one part.
    DiagnosticStatus {
        /// [`DiagnosticStatus::OK`], `WARN`, `ERROR` or `STALE`.
        level: u8 as "byte",
        /// The part, such as `/robot/controller: control loop`.
        name: String,
        /// What is the matter.
        message: String,
        /// Which hardware.
        hardware_id: String,
        /// Figures.
        values: Vec<KeyValue>,
    }
    /// A named figure.
    KeyValue {
        /// Its name.
        key: String,
        /// Its value as text.
        value: String,
    }
}

impl DiagnosticStatus {
    /// All is well.
    pub const OK: u8 = 0;
    /// Something is odd.
    pub const WARN: u8 = 1;
    /// Something is wrong.
    pub const ERROR: u8 = 2;
    /// No fresh data.
    pub const STALE: u8 = 3;
}
