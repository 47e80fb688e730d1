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
pub(crate) struct Clock {
    started: Instant,
    /// Stages that are done so far.
    pub timings: Timings,
}

impl Clock {
    /// Starts now.
    pub fn start() -> Self {
        Self { started: Instant::now(), timings: Timings::default() }
    }

    /// Time since the start.
    pub fn elapsed(&self) -> Duration {
        self.started.elapsed()
    }

    /// The known voxels are projected.
    pub fn projected(&mut self) {
        self.timings.projected = self.elapsed();
    }

    /// The same, if nothing was projected before.
    pub fn projected_unless_before(&mut self) {
        if self.timings.projected.is_zero() {
            self.projected();
        }
    }

    /// The posterior over the classes stands.
    pub fn classified(&mut self) {
        self.timings.classified = self.elapsed();
        if self.timings.projected.is_zero() {
            self.timings.projected = self.timings.classified;
        }
    }

    /// The pose stands.
    pub fn posed(&mut self) {
        self.timings.posed = self.elapsed();
    }
}
