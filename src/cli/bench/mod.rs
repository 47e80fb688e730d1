//! `beo bench`: measurements of speed.

mod large;
mod latency;
mod part;
mod query;
mod scale;
mod transport;

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
    /// Time the compute of queries alone, beside peers and the machine's own limits
    Query(query::Query),
    /// Time queries of a model of a large grid, beside a plain read of all of its basis
    Large(large::Large),
    /// Measure how the cost of a query grows: with classes, basis size, resolution, hidden voxels, threads, subscribers
    Scale(scale::Scale),
    /// Time handing grids from one process to another, by our channels and by others
    Transport(transport::Transport),
    /// The reading process of `transport`
    #[command(hide = true)]
    TransportReader,
}

impl Bench {
    /// Runs the command.
    pub fn run(self) -> Result<(), Failure> {
        match self.what {
            What::Large(command) => command.run(),
            What::Latency(command) => command.run(),
            What::LatencyProducer => latency::producer(),
            What::LatencyReader => latency::reader(),
            What::Query(command) => command.run(),
            What::Scale(command) => command.run(),
            What::Transport(command) => command.run(),
            What::TransportReader => transport::reader(),
        }
    }
}
