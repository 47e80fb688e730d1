//! `beo bench transport`, and its reading process.

use super::part::plan;
use crate::cli::failure::Failure;
use crate::cli::{progress, stop};
use beo_lab::benchmark::machine::Watch;
use beo_lab::benchmark::transport::{Plan, ReaderPlan, Report, measure, receive};
use beo_lab::process::this_program;
use clap::Args;
use std::io::stdin;
use std::path::PathBuf;

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

impl Transport {
    /// Runs the command.
    pub fn run(self) -> Result<(), Failure> {
        let mut sides = self.sides;
        sides.sort_unstable();
        sides.dedup();
        let plan = Plan { sides, messages: self.messages as usize, repeats: self.repeats as usize };
        let watch = Watch::start();
        let stop = stop::on_signal()?;
        let pinned = watch.machine().cores > 1;
        let bar = progress::bar(plan.steps().count(), "handing over");
        let plan = ReaderPlan { name: format!("transport-{}", std::process::id()), plan };
        let measured = measure(&plan, this_program()?.args(["bench", "transport-reader"]), &stop, || bar.inc(1));
        bar.finish_and_clear();
        let report = Report::new(watch.end(), pinned, &plan.plan, &measured?);
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

/// The reading process: a plan on a line of standard input, the pipe's grids after it; what it measured on standard output.
pub fn reader() -> Result<(), Failure> {
    let stop = stop::on_signal()?;
    // Nothing is read beyond the line: the first grid follows when this process has said that it is ready.
    let plan: ReaderPlan = plan("transport", &mut stdin().lock())?;
    Ok(receive(&plan, &stop)?)
}
