//! `beo bench`: measurements of speed.

mod latency;

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
            What::Latency(command) => command.run(),
            What::LatencyProducer => latency::producer(),
            What::LatencyReader => latency::reader(),
        }
    }
}
