//! `diagnostic_msgs`: how a node does.

use super::Header;

super::messages! {
    KeyValue { key: String, value: String }
    DiagnosticStatus { level: u8, name: String, message: String, hardware_id: String, values: Vec<KeyValue> }
    DiagnosticArray { header: Header, status: Vec<DiagnosticStatus> }
}
super::topics!("diagnostic_msgs": DiagnosticArray);

impl DiagnosticStatus {
    /// `level`: all is well.
    pub const OK: u8 = 0;
    /// `level`: something is amiss.
    pub const WARN: u8 = 1;
    /// `level`: it does not work.
    pub const ERROR: u8 = 2;
}
