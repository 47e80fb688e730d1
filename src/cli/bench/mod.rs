//! `beo bench`: how fast it is, beside what it could be compared with.

mod query;
mod transport;

use super::failure::Failure;
use clap::{Args, Subcommand};

/// Measure how fast this machine perceives and hands over grids
#[derive(Args)]
pub struct Bench {
    #[command(subcommand)]
    what: What,
}

#[derive(Subcommand)]
enum What {
    /// Time the compute of queries alone, beside peers and the machine's own limits
    Query(query::Query),
    /// Time handing grids from one process to another, by our channels and by others
    Transport(transport::Transport),
    /// The reading process of `transport`
    #[command(hide = true)]
    TransportReader(transport::TransportReader),
}

impl Bench {
    /// Runs the command.
    pub fn run(self) -> Result<(), Failure> {
        match self.what {
            What::Query(command) => command.run(),
            What::Transport(command) => command.run(),
            What::TransportReader(command) => command.run(),
        }
    }
}
