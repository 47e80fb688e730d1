//! A measurement of growth failed.

use beo_core::learning::TrainError;
use beo_core::perception::PerceiveError;
use beo_ipc::{InstanceNameError, LoanError, OpenError, ReceiveError, SendError, WaitError};
/// A measurement failed.
#[derive(Debug, thiserror::Error)]
pub enum ScaleError {
    /// A model could not be learned.
    #[error(transparent)]
    Train(#[from] TrainError),
    /// A query could not be answered.
    #[error(transparent)]
    Perceive(#[from] PerceiveError),
    /// Threads could not be started.
    #[error("cannot start worker threads: {0}; close other programs, or leave --only threads out")]
    Threads(#[from] rayon::ThreadPoolBuildError),
    /// The instance's name is none.
    #[error(transparent)]
    Name(#[from] InstanceNameError),
    /// The channels could not be opened.
    #[error(transparent)]
    Open(#[from] OpenError),
    /// There was no memory for a completion.
    #[error(transparent)]
    Loan(#[from] LoanError),
    /// It could not be sent.
    #[error(transparent)]
    Send(#[from] SendError),
    /// It could not be received.
    #[error(transparent)]
    Receive(#[from] ReceiveError),
    /// The wake-up channel is broken.
    #[error(transparent)]
    Wait(#[from] WaitError),
    /// A subscriber did not get what was sent.
    #[error("percept and completion {sequence} did not reach every subscriber: is another program using the same instance?")]
    Lost {
        /// Their sequence number.
        sequence: u64,
    },
}
