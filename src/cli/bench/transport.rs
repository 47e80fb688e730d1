//! `beo bench transport`, and its reading process.

use crate::benchmark::machine::{Machine, pin};
use crate::benchmark::transport::{Plan, Report, measure, receive};
use crate::cli::failure::Failure;
use crate::cli::{progress, stop};
use clap::Args;
use std::path::PathBuf;
use std::process::Command;

/// Time handing grids from one process to another, by our channels and by others
#[derive(Args)]
pub struct Transport {
    /// Sides of the cubic grids, voxels of one byte each
    #[arg(long, value_delimiter = ',', default_values_t = [30, 64, 254], value_parser = clap::value_parser!(u32).range(8..=256))]
    sides: Vec<u32>,
    /// Hand-overs of each kind in a repeat; fewer where big payloads are touched
    #[arg(long, default_value_t = 1000, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    messages: u32,
    /// Rounds over everything; medians over them are reported
    #[arg(long, default_value_t = 5, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1000))]
    repeats: u32,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
    /// Draw the medians into this file
    #[arg(long, value_name = "FILE")]
    png: Option<PathBuf>,
}

/// The reading process
#[derive(Args)]
pub struct TransportReader {
    name: String,
    plan: String,
}

impl Transport {
    /// Runs the command.
    pub fn run(self) -> Result<(), Failure> {
        let mut sides = self.sides;
        sides.sort_unstable();
        sides.dedup();
        let plan = Plan { sides, messages: self.messages as usize, repeats: self.repeats as usize };
        let machine = Machine::now();
        let stop = stop::on_signal()?;
        let name = format!("transport-{}", std::process::id());
        let mut command = Command::new(std::env::current_exe()?);
        command.args(["bench", "transport-reader", &name, &serde_json::to_string(&plan)?]);
        // The reader must not inherit this thread's core: it takes the next one itself.
        let pinned = machine.cores > 1;
        let bar = progress::bar(plan.steps().count(), "handing over");
        let measured = measure(&name, &plan, command, &stop, || bar.inc(1));
        bar.finish_and_clear();
        let report = Report::new(machine, pinned, &plan, &measured?);
        if let Some(path) = &self.png {
            report.chart().save(path)?;
        }
        if self.json {
            say!("{}", serde_json::to_string(&report)?);
        } else {
            say!("{}", report.text().trim_end());
        }
        Ok(())
    }
}

impl TransportReader {
    /// Runs the command.
    pub fn run(self) -> Result<(), Failure> {
        let plan: Plan = serde_json::from_str(&self.plan)?;
        pin(1);
        Ok(receive(&self.name, &plan, &*stop::on_signal()?)?)
    }
}
