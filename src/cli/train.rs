//! `beo train`: learn a model from a folder of shapes.

use super::failure::Failure;
use super::shapes::{self, MeshArguments, ViewArgument};
use super::{failure::cannot_write, progress};
use crate::grid::{Dims, View};
use crate::learning::{FEWEST_SHAPES, Step, TrainOptions, train};
use crate::memory::{self, Available};
use crate::model::{MOST_COMPONENTS, check_place, save};
use crate::shapes::library::{LoadOptions, Shapes};
use clap::Args;
use std::path::PathBuf;
use std::time::Instant;

/// Learn a model from a folder of shapes, DIR/<class>/<split>/*, or DIR/* for one class named after the folder
#[derive(Args)]
pub struct Train {
    /// Folder of shapes: .binvox, .npy, .off, .obj, .stl, .ply
    dir: PathBuf,
    /// Model file to write
    #[arg(long, value_name = "MODEL")]
    out: PathBuf,
    /// Splits to learn from [default: those of train, validation that exist]; none for DIR/*
    #[arg(long, value_delimiter = ',', value_name = "SPLITS")]
    split: Vec<String>,
    /// Voxels along each side of the grid
    #[arg(long, default_value_t = 30, value_name = "N")]
    resolution: usize,
    /// Views that queries will have: top, camera. Views from above are learned in any case
    #[arg(long, value_delimiter = ',', value_enum, default_values_t = [ViewArgument::Top])]
    views: Vec<ViewArgument>,
    /// With --views camera, elevations of the cameras to be met, degrees above the horizontal
    #[arg(long, value_delimiter = ',', default_values_t = [15.0, 30.0, 45.0, 60.0, 75.0], value_name = "DEGREES")]
    elevations: Vec<f64>,
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

/// Bytes of the smallest basis W' that these shapes can give: every class adds its least number of components, if it has the shapes.
fn least_basis(shapes: &Shapes, dims: Dims, least: usize) -> u64 {
    let mut counts = vec![0_usize; shapes.classes.len()];
    shapes.shapes.iter().for_each(|shape| counts[shape.class] += 1);
    let rank: usize = counts.iter().map(|count| count.saturating_sub(1).min(least)).sum();
    (rank * dims.voxels() * size_of::<half::f16>()) as u64
}

/// Training keeps the basis, its prefix sums, and the class bases as floats (twice the size) at a time.
fn require_memory(basis: u64) -> Result<(), Failure> {
    let needed = 4 * basis;
    match memory::available() {
        Some(Available { bytes, limit }) if bytes < needed => Err(Failure::Failed(format!(
            "the training needs at least {} MB of memory, {limit} has {} MB left: use a lower --resolution or fewer components (--least, --most)",
            needed.div_ceil(1_000_000),
            bytes / 1_000_000
        ))),
        _ => Ok(()),
    }
}

/// Elevations in the order in which models keep them, each once.
fn elevations(given: &[f64]) -> Result<Vec<f64>, Failure> {
    let mut elevations = given.to_vec();
    elevations.sort_by(f64::total_cmp);
    elevations.dedup();
    if elevations.is_empty() || elevations.len() > 32 || !elevations.iter().all(|e| (-80.0..=85.0).contains(e)) {
        return Err(Failure::Usage("--elevations: use 1 to 32 angles from -80 to 85 degrees above the horizontal".into()));
    }
    Ok(elevations)
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
        if self.views.contains(&ViewArgument::None) {
            return usage("--views none: a view must be simulated; use top or camera".into());
        }
        let camera_elevations_deg = match self.views.contains(&ViewArgument::Camera) {
            true => elevations(&self.elevations)?,
            false => Vec::new(),
        };
        let read = self.mesh.read_options(dims)?;
        if self.out.is_dir() {
            return usage(format!("--out {}: this is a folder; name a file, such as model.safetensors", self.out.display()));
        }
        let parent = self.out.parent().filter(|p| !p.as_os_str().is_empty());
        if let Some(parent) = parent {
            std::fs::create_dir_all(parent).map_err(cannot_write(parent))?;
        }
        // Found out now, not after the work.
        check_place(&self.out, 0)?;
        let splits = if self.split.is_empty() { shapes::existing_splits(&self.dir, &["train", "validation"])? } else { self.split };
        let start = Instant::now();
        let shapes = shapes::load(&self.dir, &splits, &LoadOptions { read, skip_duplicates: true, minimum: FEWEST_SHAPES })?;
        let loaded = start.elapsed();
        let least = least_basis(&shapes, dims, self.least);
        check_place(&self.out, least)?;
        require_memory(least)?;
        let options = TrainOptions {
            views: vec![View::Top],
            camera_elevations_deg,
            variance_share: self.variance,
            basis_range: [self.least, self.most],
            seed: self.seed,
            folds: self.folds,
            splits,
            longest_side: read.longest(),
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
