//! `beo eval --leave-one-out`: each shape of a folder completed by a model of all others.

use super::failure::{Failure, cannot_write};
use super::progress;
use super::shapes::{self, ShapeArguments};
use super::train::Need;
use beo_core::grid::Dims;
use beo_core::learning::{FEWEST_SHAPES, Step, TrainOptions};
use beo_core::model::check_place;
use beo_core::whole_file::write_whole;
use beo_lab::evaluation::leave_one_out::{figures, table};
use beo_lab::evaluation::{OneView, Outcome, leave_one_out, sample_places};
use beo_picture::SaveError;
use beo_shapes::ReadError;
use beo_shapes::Units;
use beo_shapes::library::{self, LoadOptions, Shapes, SkipReason};
use std::path::{Path, PathBuf};

/// Bytes of a voxel beside those that training takes: the completion and its deviation, the mean of the shapes, the sets of an observation.
const ANSWER_BYTES: usize = 18;
/// Bytes of a voxel while it is drawn, of as many pictures at a time as there are threads.
const PICTURE_BYTES: usize = 12;

/// The requested evaluation.
pub struct LeaveOneOut<'a> {
    /// Folder of shapes.
    pub dir: &'a Path,
    /// Splits to take the shapes from; all that there are if none is named.
    pub splits: Vec<String>,
    /// Resolutions, one after the other.
    pub resolutions: &'a [usize],
    /// From where each shape is seen.
    pub view: OneView,
    /// Leave out a sample of this many.
    pub limit: Option<usize>,
    /// Seed of the sample and of the training.
    pub seed: u64,
    /// Where the outcome goes as JSON.
    pub json: Option<&'a PathBuf>,
    /// Where pictures go.
    pub png: Option<&'a PathBuf>,
    /// How meshes become voxels.
    pub shaping: &'a ShapeArguments,
}

impl LeaveOneOut<'_> {
    /// Runs the command.
    pub fn run(self) -> Result<(), Failure> {
        let grids = self.grids()?;
        if self.limit == Some(0) {
            return Err(Failure::Usage("--limit 0: nothing to leave out; use at least 1".into()));
        }
        let splits = if self.splits.is_empty() { library::splits(self.dir)? } else { self.splits.clone() };
        // All that can be found out before the work.
        let others: Vec<usize> = shapes::count(self.dir, &splits)?.into_iter().map(|count| count.saturating_sub(1)).collect();
        for dims in &grids {
            let pictures = if self.png.is_some() { PICTURE_BYTES * rayon::current_num_threads() } else { 0 };
            let options = TrainOptions::default();
            Need::new(&others, *dims, options.basis_range[0]).with(dims.voxels() * (ANSWER_BYTES + pictures)).check_memory(*dims)?;
        }
        if let Some(path) = self.json {
            check_place(path, 0)?;
        }
        if let Some(folder) = self.png {
            std::fs::create_dir_all(folder).map_err(cannot_write(folder))?;
        }
        let mut outcomes = Vec::new();
        for dims in grids {
            outcomes.push(self.at(dims, &splits)?);
        }
        say!("{}", table(&outcomes, self.view).trim_end());
        if let Some(path) = self.json {
            let outcome = serde_json::json!({ "view": self.view, "seed": self.seed, "resolutions": outcomes });
            write_whole(path, (serde_json::to_string_pretty(&outcome)? + "\n").as_bytes()).map_err(cannot_write(path))?;
        }
        if let Some(folder) = self.png {
            figures::save_errors(folder, &outcomes, self.view)?;
        }
        Ok(())
    }

    /// The grids, ascending, each once.
    fn grids(&self) -> Result<Vec<Dims>, Failure> {
        let usage = |line: String| Failure::Usage(line);
        let mut resolutions = self.resolutions.to_vec();
        resolutions.sort_unstable();
        resolutions.dedup();
        if resolutions.len() > 1 && self.shaping.mesh.longest.is_some() {
            return Err(usage("--longest is the same number of voxels at every resolution: give one --resolution with it".into()));
        }
        let grids = resolutions.iter().map(|n| Dims::cube(*n).map_err(|error| usage(format!("--resolution {n}: {error}"))));
        let grids = grids.collect::<Result<Vec<_>, _>>()?;
        grids.iter().try_for_each(|dims| self.shaping.read_options(*dims).map(drop))?;
        Ok(grids)
    }

    /// The outcome at one resolution. Shapes are read once, whatever their number.
    fn at(&self, dims: Dims, splits: &[String]) -> Result<Outcome, Failure> {
        let read = self.shaping.read_options(dims)?;
        // Without its twin, which would give the shape away.
        let shapes =
            shapes::load(self.dir, splits, &LoadOptions { read, skip_duplicates: true, minimum: FEWEST_SHAPES + 1, units: Units::None })?;
        require_one_size(&shapes)?;
        let chosen = sample_places(&shapes.set, self.limit, self.seed);
        let files: Vec<String> = chosen.iter().map(|place| shapes.set.shapes[*place].file.clone()).collect();
        let options = TrainOptions { seed: self.seed, splits: splits.to_vec(), longest_side: read.longest(), ..TrainOptions::default() };
        let folder = self.png.map(|folder| folder.join(dims.x().to_string()));
        if let Some(folder) = &folder {
            std::fs::create_dir_all(folder).map_err(cannot_write(folder))?;
        }
        let bar = progress::bar(chosen.len(), "leaving out");
        let learning = |n: usize, step: Step| {
            if step.pass.is_none() {
                bar.set_message(format!("{}³, without {}", dims.x(), files[n]));
                tracing::debug!(without = files[n], "{}", step.name);
            }
        };
        let mut drawn: Result<(), SaveError> = Ok(());
        let per_shape = leave_one_out(shapes.set, &chosen, self.view, &options, &learning, |example| {
            let errors = example.errors;
            tracing::info!(file = errors.file, side = dims.x(), iou_unknown = errors.beo.iou_unknown, "completed");
            if let (Some(folder), Ok(())) = (&folder, &drawn) {
                drawn = figures::draw_example(&example, self.view).save(&folder.join(figures::picture_name(errors)));
            }
            bar.inc(1);
        });
        bar.finish_and_clear();
        drawn?;
        Ok(Outcome::new(dims.x(), per_shape?))
    }
}

/// Voxel files of another size are no shapes that happen to be broken: the folder is of another resolution, or of several.
fn require_one_size(shapes: &Shapes) -> Result<(), Failure> {
    let of_other_size = |reason: &SkipReason| matches!(reason, SkipReason::Unreadable(ReadError::OtherDims { .. }));
    match shapes.skipped.iter().find(|skipped| of_other_size(&skipped.reason)) {
        Some(skipped) => Err(Failure::Failed(skipped.to_string())),
        None => Ok(()),
    }
}
