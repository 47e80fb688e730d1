//! Errors of a measurement of latency.

use crate::process::ProcessError;
use beo_camera::GridError;
use beo_core::grid::DimsError;
use beo_ipc::{CarvedGridError, InstanceNameError, LoanError, OpenError, ReceiveError, SendError, WaitError};
use std::time::Duration;

/// A measurement could not be made.
#[derive(Debug, thiserror::Error)]
pub enum LatencyError {
    /// A process did not start, failed or hangs.
    #[error(transparent)]
    Process(#[from] ProcessError),
    /// A process ended without having said what it was to say.
    #[error("{0} ended before it was done; its own message stands above")]
    Silent(&'static str),
    /// A process does not go on.
    #[error("{name} said nothing for {patience:?}")]
    Hung {
        /// Which.
        name: &'static str,
        /// How long it was waited for.
        patience: Duration,
    },
    /// A process said something else than it was to say.
    #[error("{name} said what cannot be understood: {source}")]
    Garbled {
        /// Which.
        name: &'static str,
        /// Where reading it ended.
        source: serde_json::Error,
    },
    /// Ctrl-C.
    #[error("interrupted: everything that was started has been ended")]
    Interrupted,
    /// The daemon's counters do not come to rest after the load.
    #[error("the daemon still had observations to answer {0:?} after the last one was sent")]
    Unsettled(Duration),
    /// A core is not to be had, or a pipe is broken.
    #[error(transparent)]
    System(#[from] std::io::Error),
    /// The instance has no valid name.
    #[error(transparent)]
    Instance(#[from] InstanceNameError),
    /// The daemon cannot be reached.
    #[error(transparent)]
    Open(#[from] OpenError),
    /// No memory for an observation.
    #[error(transparent)]
    Loan(#[from] LoanError),
    /// An observation cannot be sent.
    #[error(transparent)]
    Send(#[from] SendError),
    /// The model's grids have sides outside the limits.
    #[error(transparent)]
    Dims(#[from] DimsError),
    /// A grid cannot be carved.
    #[error(transparent)]
    Grid(#[from] GridError),
    /// A grid cannot be told to the daemon.
    #[error(transparent)]
    Header(#[from] CarvedGridError),
    /// A percept cannot be received.
    #[error(transparent)]
    Receive(#[from] ReceiveError),
    /// The wake-up channel is broken.
    #[error(transparent)]
    Wait(#[from] WaitError),
}
