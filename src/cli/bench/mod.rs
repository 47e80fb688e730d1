//! `beo bench`: how fast it is.

mod scale;

use super::failure::Failure;
use clap::{Args, Subcommand};

/// Measure how fast this machine perceives
#[derive(Args)]
pub struct Bench {
    #[command(subcommand)]
    what: What,
}

#[derive(Subcommand)]
enum What {
    /// Measure how the cost of a query grows: with classes, basis size, resolution, hidden voxels, threads, subscribers
    Scale(scale::Scale),
}

impl Bench {
    /// Runs the command.
    pub fn run(self) -> Result<(), Failure> {
        match self.what {
            What::Scale(command) => command.run(),
        }
    }
}
