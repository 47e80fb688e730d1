//! How long the stages of a query took.

use std::time::{Duration, Instant};

/// When each stage of a query was done, counted from its start. Stages that were not run keep the time of the one before.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Timings {
    /// The known voxels were projected; in a search, every rotation's score stood.
    pub projected: Duration,
    /// The posterior over the classes stood.
    pub classified: Duration,
    /// The pose hypotheses stood.
    pub posed: Duration,
}

/// The clock of one query: CLOCK_MONOTONIC on Linux.
#[derive(Clone, Copy, Debug)]
pub(super) struct Stopwatch(Instant);

impl Stopwatch {
    /// Starts now.
    pub fn start() -> Self {
        Self(Instant::now())
    }

    /// Time since the start.
    pub fn elapsed(self) -> Duration {
        self.0.elapsed()
    }
}
