//! The tasks of a sending and a receiving end, whatever the means.

use super::plan::{Wake, Work};
use crate::benchmark::limits::sum;
use crate::process::ProcessError;
use beo_core::grid::{Dims, Observation, UNKNOWN};
use beo_ipc::clock::monotonic_ns;
use beo_ipc::{LoanError, OpenError, ReceiveError, Refusal, SendError, WaitError};
use std::hint::black_box;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Longest wait for the other process.
pub(super) const PATIENCE: Duration = Duration::from_secs(20);
/// Longest sleep before looking whether to stop.
pub(super) const LONGEST_WAIT: Duration = Duration::from_millis(50);

/// The measurement could not be made.
#[derive(Debug, thiserror::Error)]
pub enum TransportError {
    /// A channel cannot be set up.
    #[error(transparent)]
    Open(#[from] OpenError),
    /// No memory for a grid.
    #[error(transparent)]
    Loan(#[from] LoanError),
    /// A grid cannot be sent.
    #[error(transparent)]
    Send(#[from] SendError),
    /// A grid cannot be received.
    #[error(transparent)]
    Receive(#[from] ReceiveError),
    /// The wake-up channel is broken.
    #[error(transparent)]
    Wait(#[from] WaitError),
    /// Our own channel refused the grid.
    #[error(transparent)]
    Refused(#[from] Refusal),
    /// Plain iceoryx2 failed.
    #[error("iceoryx2 could not {what}: {cause}")]
    Raw {
        /// The attempted operation.
        what: &'static str,
        /// Its error.
        cause: String,
    },
    /// The other process did not start, or failed.
    #[error(transparent)]
    Process(#[from] ProcessError),
    /// A core is not to be had.
    #[error(transparent)]
    Core(#[from] std::io::Error),
    /// The system failed.
    #[error("cannot {what}: {cause}")]
    System {
        /// The attempted operation.
        what: &'static str,
        /// Its error.
        cause: std::io::Error,
    },
    /// The other process is silent.
    #[error("the other process of the benchmark has not answered for {} s; its own message, if any, stands above", PATIENCE.as_secs())]
    Silent,
    /// The received bytes differ from the sent ones.
    #[error("a grid of {bytes} bytes arrived damaged: they give {found}, not {expected}")]
    Damaged {
        /// Its size.
        bytes: usize,
        /// The reader's result.
        found: u64,
        /// The expected result.
        expected: u64,
    },
    /// Someone asked it to end.
    #[error("interrupted before all was measured")]
    Interrupted,
}

pub(super) fn system(what: &'static str) -> impl FnOnce(std::io::Error) -> TransportError {
    move |cause| TransportError::System { what, cause }
}

pub(super) fn raw<E: std::fmt::Debug>(what: &'static str) -> impl FnOnce(E) -> TransportError {
    move |error| TransportError::Raw { what, cause: format!("{error:?}") }
}

/// Where grids of one size go out.
pub(super) trait Outgoing {
    /// Hands over one grid, every byte of it `fill` if given, else untouched.
    fn send(&mut self, fill: Option<u8>) -> Result<(), TransportError>;
}

/// Where grids of one size come in.
pub(super) trait Incoming {
    /// Waits for one grid and does `work` with it.
    fn receive(&mut self, wake: Wake, work: Work, reader: &mut Reader) -> Result<Received, TransportError>;
}

/// A grid that has arrived.
#[derive(Clone, Copy, Debug)]
pub(super) struct Received {
    /// When its sender began.
    pub sent_ns: u64,
    /// When its reader had done its work.
    pub done_ns: u64,
    /// The result: the sum of the bytes, or the number of filled voxels and of known ones.
    pub value: u64,
}

/// The reader's work on grids of one size.
pub(super) struct Reader<'a> {
    observation: Observation,
    stop: &'a AtomicBool,
}

impl<'a> Reader<'a> {
    /// A reader that gives up when `stop` is set.
    pub fn new(dims: Dims, stop: &'a AtomicBool) -> Self {
        Self { observation: Observation::unknown(dims), stop }
    }

    /// Does its work with a payload that was sent at `sent_ns`.
    pub fn work(&mut self, work: Work, sent_ns: u64, payload: &[u8]) -> Result<Received, TransportError> {
        let mut value = match work {
            Work::Pointer => black_box(payload).len() as u64,
            Work::Sum => black_box(sum(payload)),
            Work::Validate => {
                let refused = |cause: beo_core::grid::ObservationError| TransportError::Refused(Refusal::Internal(cause.to_string()));
                self.observation.read(payload).map_err(refused)?;
                0
            }
        };
        let done_ns = monotonic_ns();
        if work == Work::Validate {
            value = (self.observation.filled().count_ones(..) + self.observation.known().count_ones(..)) as u64;
        }
        Ok(Received { sent_ns, done_ns, value })
    }

    /// Tries until something is there: by `sleep`, which returns early when woken, or at once again.
    pub fn wait_for<T>(
        &self,
        wake: Wake,
        mut take: impl FnMut() -> Result<Option<T>, TransportError>,
        mut sleep: impl FnMut(Duration) -> Result<(), TransportError>,
    ) -> Result<T, TransportError> {
        let start = Instant::now();
        let mut tries = 0_u32;
        loop {
            if let Some(there) = take()? {
                return Ok(there);
            }
            tries = tries.wrapping_add(1);
            if wake == Wake::Event {
                sleep(LONGEST_WAIT)?;
            } else {
                std::hint::spin_loop();
            }
            // Looking at the clock at every try would delay what is measured.
            if wake == Wake::Event || tries.is_multiple_of(1 << 12) {
                self.go_on(start)?;
            }
        }
    }

    /// Fails when it should stop, or when it has waited too long.
    pub fn go_on(&self, start: Instant) -> Result<(), TransportError> {
        match (self.stop.load(Ordering::Relaxed), start.elapsed() > PATIENCE) {
            (true, _) => Err(TransportError::Interrupted),
            (_, true) => Err(TransportError::Silent),
            _ => Ok(()),
        }
    }
}

/// The byte that fills the grid number `count`: every voxel code in turn.
pub(super) fn fill(work: Work, count: usize) -> Option<u8> {
    (work != Work::Pointer).then(|| [0, 1, UNKNOWN][count % 3])
}

/// The reader's result for a grid of `bytes` bytes filled so.
pub(super) fn expected(work: Work, fill: Option<u8>, bytes: usize) -> u64 {
    let bytes = bytes as u64;
    match (work, fill) {
        (Work::Sum, Some(byte)) => u64::from(byte) * bytes,
        (Work::Validate, Some(1)) => 2 * bytes,
        (Work::Validate, Some(UNKNOWN)) => 0,
        _ => bytes,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_reader_notices_a_byte_that_was_not_written() {
        let stop = AtomicBool::new(false);
        let dims = Dims::cube(9).unwrap();
        let mut reader = Reader::new(dims, &stop);
        for work in [Work::Sum, Work::Validate] {
            for count in 0..3 {
                let byte = fill(work, count).unwrap();
                let mut payload = vec![byte; dims.voxels()];
                let received = reader.work(work, 5, &payload).unwrap();
                assert_eq!((received.sent_ns, received.value), (5, expected(work, Some(byte), payload.len())), "{work:?} {byte}");
                payload[700] = 1 - byte.min(1);
                assert_ne!(reader.work(work, 5, &payload).unwrap().value, received.value, "{work:?} {byte}");
            }
        }
        assert!(reader.work(Work::Validate, 5, &[7; 729]).is_err());
    }

    #[test]
    fn waiting_ends_when_asked_to() {
        let stop = AtomicBool::new(true);
        let reader = Reader::new(Dims::cube(8).unwrap(), &stop);
        for wake in [Wake::Event, Wake::Polling] {
            let outcome: Result<(), _> = reader.wait_for(wake, || Ok(None), |_| Ok(()));
            assert!(matches!(outcome, Err(TransportError::Interrupted)));
        }
    }
}
