//! `beo bench scale`: how the cost of a query grows.

use crate::cli::failure::{Failure, cannot_write};
use crate::cli::progress;
use beo_lab::benchmark::machine::{Circumstances, Watch};
use beo_lab::benchmark::scale::{self, Series, Sweep, chart, table};
use clap::{Args, ValueEnum};
use std::path::PathBuf;

/// Measure how queries and learning grow, on models learned in memory from made-up shapes
#[derive(Args)]
pub struct Scale {
    /// The quantities to vary, separated by commas
    #[arg(long, value_enum, value_delimiter = ',', default_values_t = Sweep::value_variants().iter().copied())]
    only: Vec<Sweep>,
    /// Few small sizes: to see that it works, not to learn from it
    #[arg(long)]
    quick: bool,
    /// Print JSON instead of tables: points are (size, median)
    #[arg(long)]
    json: bool,
    /// Draw one chart of each into this folder
    #[arg(long, value_name = "DIR")]
    png: Option<PathBuf>,
}

/// The output of `--json`.
#[derive(serde::Serialize)]
struct Outcome {
    #[serde(flatten)]
    circumstances: Circumstances,
    threads: usize,
    quick: bool,
    series: Vec<Series>,
}

impl Scale {
    /// Runs the command.
    pub fn run(self) -> Result<(), Failure> {
        if let Some(folder) = &self.png {
            std::fs::create_dir_all(folder).map_err(cannot_write(folder))?;
        }
        let watch = Watch::start();
        let threads = rayon::current_num_threads();
        if !self.json {
            say!("{}", watch.machine());
            say!("{threads} worker threads; exponents are those of time ∝ size^e\n");
        }
        let bar = progress::bar(self.only.len(), "measuring");
        let scale = scale::Scale::new(self.quick);
        let mut measured = Vec::new();
        for sweep in self.only {
            let series = scale.measure(sweep)?;
            if let Some(folder) = &self.png {
                let name = sweep.to_possible_value().expect("none is hidden").get_name().to_owned();
                chart(&series).save(&folder.join(format!("scale-{name}.png")))?;
            }
            if !self.json {
                bar.suspend(|| -> Result<(), Failure> {
                    say!("{}", table(&series));
                    Ok(())
                })?;
            }
            measured.push(series);
            bar.inc(1);
        }
        bar.finish_and_clear();
        let circumstances = watch.end();
        if self.json {
            let outcome = Outcome { circumstances, threads, quick: self.quick, series: measured };
            say!("{}", serde_json::to_string_pretty(&outcome)?);
        } else if !circumstances.warnings.is_empty() {
            say!("{}", circumstances.warning_lines().trim_end());
        }
        Ok(())
    }
}
