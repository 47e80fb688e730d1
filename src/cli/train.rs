//! `beo train`: learn a model from a folder of shapes.

use super::failure::Failure;
use super::shapes::{self, MeshArguments, ViewArgument};
use super::{failure::cannot_write, progress};
use crate::grid::Dims;
use crate::learning::{FEWEST_SHAPES, Step, TrainOptions, train};
use crate::model::{MOST_COMPONENTS, save};
use crate::shapes::library::LoadOptions;
use clap::Args;
use std::path::PathBuf;
use std::time::Instant;

/// Learn a model from a folder of shapes, DIR/<class>/<split>/*
#[derive(Args)]
pub struct Train {
    /// Folder of shapes: .binvox, .npy, .off, .obj, .stl, .ply
    dir: PathBuf,
    /// Model file to write
    #[arg(long, value_name = "MODEL")]
    out: PathBuf,
    /// Splits to learn from [default: those of train, validation that exist]
    #[arg(long, value_delimiter = ',', value_name = "SPLITS")]
    split: Vec<String>,
    /// Voxels along each side of the grid
    #[arg(long, default_value_t = 30, value_name = "N")]
    resolution: usize,
    /// Views that queries will have
    #[arg(long, value_delimiter = ',', value_enum, default_values_t = [ViewArgument::Top])]
    views: Vec<ViewArgument>,
    /// Share of a class's variance that its basis carries
    #[arg(long, default_value_t = 0.6, value_name = "SHARE")]
    variance: f64,
    /// Fewest components of a class basis
    #[arg(long, default_value_t = 30, value_name = "N")]
    least: usize,
    /// Most components of a class basis
    #[arg(long, default_value_t = 70, value_name = "N")]
    most: usize,
    /// Folds of the internal cross-validation
    #[arg(long, default_value_t = 3, value_name = "N")]
    folds: usize,
    /// Seed of the folds
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Terms of the shapes, kept in the model
    #[arg(long, default_value = "", value_name = "TEXT")]
    licence: String,
    #[command(flatten)]
    mesh: MeshArguments,
}

impl Train {
    /// Runs the command.
    pub fn run(self) -> Result<(), Failure> {
        let usage = |line: String| Err(Failure::Usage(line));
        let dims = match Dims::cube(self.resolution) {
            Ok(dims) => dims,
            Err(error) => return usage(format!("--resolution {}: {error}", self.resolution)),
        };
        if !(self.variance > 0.0 && self.variance <= 1.0) {
            return usage(format!("--variance {}: a share lies above 0 and up to 1", self.variance));
        }
        if self.least == 0 || self.least > self.most || self.most > MOST_COMPONENTS {
            return usage(format!("--least {} --most {}: use 1 ≤ least ≤ most ≤ {MOST_COMPONENTS}", self.least, self.most));
        }
        if !(2..=FEWEST_SHAPES).contains(&self.folds) {
            return usage(format!("--folds {}: use 2 to {FEWEST_SHAPES}", self.folds));
        }
        let Some(views) = self.views.iter().map(|v| v.view()).collect::<Option<Vec<_>>>() else {
            return usage("--views none: a view must be simulated; use top".into());
        };
        let read = self.mesh.read_options(dims)?;
        if self.out.is_dir() {
            return usage(format!("--out {}: this is a folder; name a file, such as model.safetensors", self.out.display()));
        }
        let parent = self.out.parent().filter(|p| !p.as_os_str().is_empty());
        if let Some(parent) = parent {
            std::fs::create_dir_all(parent).map_err(cannot_write(parent))?;
        }
        let splits = if self.split.is_empty() { shapes::existing_splits(&self.dir, &["train", "validation"])? } else { self.split };
        let start = Instant::now();
        let shapes = shapes::load(&self.dir, &splits, &LoadOptions { read, skip_duplicates: true, minimum: FEWEST_SHAPES })?;
        let loaded = start.elapsed();
        let options = TrainOptions {
            views,
            variance_share: self.variance,
            basis_range: [self.least, self.most],
            seed: self.seed,
            folds: self.folds,
            splits,
            longest_side: read.longest,
            licence: self.licence,
        };
        let bar = progress::bar(self.folds + 2, "learning");
        let model = train(&shapes, &options, &|step: Step| {
            tracing::info!(step = step.done + 1, of = step.total, "{}", step.name);
            bar.set_message(step.name);
            bar.set_position(step.done as u64);
        });
        bar.finish_and_clear();
        let model = model?;
        save(&model, &self.out)?;
        let bytes = std::fs::metadata(&self.out).map(|m| m.len()).unwrap_or(0);
        let calibration = &model.metadata.calibration;
        say!(
            "learned {} classes from {} shapes in {:.1} s ({:.1} s reading): rank {}, held-out accuracy {:.3} on {} objects",
            model.classes.len(),
            shapes.shapes.len(),
            start.elapsed().as_secs_f64(),
            loaded.as_secs_f64(),
            model.rank(),
            calibration.accuracy,
            calibration.objects,
        );
        say!("wrote {} ({:.1} MB)", self.out.display(), bytes as f64 / 1e6);
        Ok(())
    }
}
