//! `beo bench`: measurements of speed.

mod latency;
mod scale;

use super::failure::Failure;
use clap::{Args, Subcommand};

/// Measure how fast it is
#[derive(Args)]
pub struct Bench {
    #[command(subcommand)]
    what: What,
}

#[derive(Subcommand)]
enum What {
    /// Measure how the cost of a query grows: with classes, basis size, resolution, hidden voxels, threads, subscribers
    Scale(scale::Scale),
    /// From an observation to its percept, through producer, daemon and readers as separate processes
    Latency(latency::Latency),
    /// The producer of `latency`
    #[command(hide = true)]
    LatencyProducer,
    /// A reader of `latency`
    #[command(hide = true)]
    LatencyReader,
}

impl Bench {
    /// Runs the command.
    pub fn run(self) -> Result<(), Failure> {
        match self.what {
            What::Scale(command) => command.run(),
            What::Latency(command) => command.run(),
            What::LatencyProducer => latency::producer(),
            What::LatencyReader => latency::reader(),
        }
    }
}
