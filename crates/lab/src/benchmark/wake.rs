//! How a process learns that something has come.

use serde::{Deserialize, Serialize};

/// How a process learns that something has come.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Wake {
    /// It sleeps until an event.
    Event,
    /// It looks again and again: faster, where each process has a core of its own.
    Polling,
}
