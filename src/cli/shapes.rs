//! Reading folders and files of shapes for the subcommands.

use super::failure::Failure;
use super::progress;
use crate::grid::{Dims, Observation, Occupancy, Turn, View, yaw};
use crate::shapes::library::{self, LoadOptions, Shapes};
use crate::shapes::{ReadOptions, Up, longest_side, read_observation, read_shape};
use clap::{Args, ValueEnum};
use std::borrow::Cow;
use std::path::Path;

/// How meshes become voxels.
#[derive(Args, Clone, Debug)]
pub struct MeshArguments {
    /// Voxels along the longest side of a mesh [default: 24 of 30, in proportion at other resolutions]
    #[arg(long, value_name = "VOXELS")]
    pub longest: Option<usize>,
    /// The axis of meshes that points up
    #[arg(long, value_enum, default_value_t = UpArgument::Z)]
    pub up: UpArgument,
}

/// The axis of meshes that points up.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum UpArgument {
    /// z
    Z,
    /// y
    Y,
}

impl MeshArguments {
    /// The options for reading onto a grid.
    pub fn read_options(&self, dims: Dims) -> Result<ReadOptions, Failure> {
        let most = dims.x().min(dims.y()).min(dims.z());
        let longest = self.longest.unwrap_or(longest_side(dims));
        if longest == 0 || longest > most {
            return Err(Failure::Usage(format!("--longest {longest}: use 1 to {most}, the side of the grid")));
        }
        let up = match self.up {
            UpArgument::Z => Up::Z,
            UpArgument::Y => Up::Y,
        };
        Ok(ReadOptions { longest, up, ..ReadOptions::new(dims) })
    }
}

/// What is seen of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ViewArgument {
    /// A complete shape, seen straight from above
    Top,
    /// A grid of bytes (.npy) with 0 empty, 1 filled, 255 unknown, taken as it is
    None,
}

/// Something to be observed.
pub enum Source {
    /// A complete shape and from where it is seen.
    Shape(Occupancy, View),
    /// What was seen of a shape.
    Observation(Observation),
}

impl Source {
    /// Size of its grid.
    pub fn dims(&self) -> Dims {
        match self {
            Source::Shape(object, _) => object.dims(),
            Source::Observation(observation) => observation.dims(),
        }
    }

    /// What is seen of it, a shape being first turned about z by `angle` radians.
    pub fn turned_by(&self, angle: f64) -> Cow<'_, Observation> {
        match self {
            Source::Shape(object, view) if angle == 0.0 => Cow::Owned(view.of(object)),
            Source::Shape(object, view) => Cow::Owned(view.of(&Turn::new(object.dims(), &yaw(angle)).occupancy(object))),
            Source::Observation(observation) => Cow::Borrowed(observation),
        }
    }
}

impl ViewArgument {
    /// Reads what a file holds.
    pub fn source(self, path: &Path, options: &ReadOptions) -> Result<Source, Failure> {
        match self {
            ViewArgument::Top => Ok(Source::Shape(read_shape(path, options)?, View::Top)),
            ViewArgument::None => Ok(Source::Observation(read_observation(path)?)),
        }
    }

    /// The view, where it is known.
    pub fn view(self) -> Option<View> {
        match self {
            ViewArgument::Top => Some(View::Top),
            ViewArgument::None => None,
        }
    }
}

/// Loads a folder of shapes and says on standard error what was left out.
pub fn load(folder: &Path, splits: &[String], options: &LoadOptions) -> Result<Shapes, Failure> {
    let wanted: Vec<&str> = splits.iter().map(String::as_str).collect();
    let library = library::scan(folder, &wanted)?;
    let bar = progress::bar(library.files.len(), "reading shapes");
    let shapes = library::load(&library, options, |_| bar.inc(1));
    bar.finish_and_clear();
    let shapes = shapes?;
    for skipped in &shapes.skipped {
        eprintln!("skipped {skipped}");
    }
    for (one, other) in &shapes.shared {
        eprintln!("warning: {one} and {other} are the same shape under two classes; both are kept");
    }
    let counts = shapes.skip_counts();
    if !shapes.skipped.is_empty() {
        eprintln!(
            "skipped {} of {} files: {} unreadable, {} empty or nearly so, {} duplicates",
            shapes.skipped.len(),
            library.files.len(),
            counts.unreadable,
            counts.nearly_empty,
            counts.duplicates
        );
    }
    Ok(shapes)
}

/// The splits among `wanted` that exist, or an error that says what there is.
pub fn existing_splits(folder: &Path, wanted: &[&str]) -> Result<Vec<String>, Failure> {
    let found = library::splits(folder)?;
    let splits: Vec<String> = wanted.iter().filter(|w| found.iter().any(|f| f == *w)).map(|w| w.to_string()).collect();
    if splits.is_empty() {
        // The scan's own error says what the folder should look like.
        library::scan(folder, wanted)?;
    }
    Ok(splits)
}
