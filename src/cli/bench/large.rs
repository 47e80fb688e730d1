//! `beo bench large`: queries of large grids.

use crate::cli::failure::Failure;
use crate::cli::progress;
use crate::cli::shapes::{self, ShapeArguments};
use beo_core::grid::{Occupancy, View};
use beo_core::perception::Perceiver;
use beo_lab::benchmark::large::{Large as Measured, POSES, measure};
use beo_lab::benchmark::machine::{Circumstances, Watch};
use beo_shapes::Units;
use beo_shapes::library::LoadOptions;
use beo_shapes::read_shape;
use clap::Args;
use std::path::PathBuf;

/// Time queries of a model of a large grid, beside a plain read of all of its basis in the same run
#[derive(Args)]
pub struct Large {
    /// Complete shapes to ask about as seen from above, or one folder of them
    #[arg(required = true)]
    shapes: Vec<PathBuf>,
    /// Model file
    #[arg(long)]
    model: PathBuf,
    /// Bound memory to so many megabytes
    #[arg(long, value_name = "MB")]
    memory: Option<u64>,
    /// Rounds over all shapes
    #[arg(long, default_value_t = 5, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1000))]
    repeats: u32,
    /// Leave the searches for the pose out
    #[arg(long)]
    known: bool,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    shaping: ShapeArguments,
}

/// The output of `--json`.
#[derive(serde::Serialize)]
struct Outcome {
    #[serde(flatten)]
    circumstances: Circumstances,
    threads: usize,
    dims: [usize; 3],
    #[serde(flatten)]
    measured: Measured,
}

impl Large {
    /// Runs the command.
    pub fn run(self) -> Result<(), Failure> {
        let watch = Watch::start();
        let perceiver = Perceiver::open_within(&self.model, self.memory.map(|mb| mb.saturating_mul(1_000_000)))?;
        let dims = perceiver.model().dims();
        let read = self.shaping.read_options(dims)?;
        let objects: Vec<Occupancy> = match &self.shapes[..] {
            [folder] if folder.is_dir() => {
                shapes::require_flat(folder)?;
                let found = shapes::load(folder, &[], &LoadOptions { read, skip_duplicates: false, minimum: 1, units: Units::None })?;
                found.set.shapes.into_iter().map(|shape| shape.object).collect()
            }
            files => files.iter().map(|file| read_shape(file, &read)).collect::<Result<_, _>>()?,
        };
        let grid = |object: &Occupancy| {
            let mut bytes = vec![0; dims.voxels()];
            View::Top.of(object).write(&mut bytes);
            bytes
        };
        let grids: Vec<Vec<u8>> = objects.iter().map(grid).collect();
        let rounds = self.repeats as usize;
        let bar = progress::bar(grids.len() * (rounds + 1), "answering");
        let measured = measure(&perceiver, &grids, rounds, if self.known { 0 } else { POSES }, || bar.inc(1))?;
        bar.finish_and_clear();
        let (machine, threads) = (watch.machine().to_string(), rayon::current_num_threads());
        let circumstances = watch.end();
        if self.json {
            let outcome = Outcome { circumstances, threads, dims: dims.into(), measured };
            say!("{}", serde_json::to_string_pretty(&outcome)?);
            return Ok(());
        }
        say!("{machine}\n{threads} worker threads, grids of {dims}, {} shapes seen from above, {rounds} rounds", grids.len());
        say!("{measured}");
        if !circumstances.warnings.is_empty() {
            say!("{}", circumstances.warning_lines().trim_end());
        }
        Ok(())
    }
}
