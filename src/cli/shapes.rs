//! Reading folders and files of shapes for the subcommands.

use super::failure::Failure;
use super::progress;
use beo_core::grid::{Dims, Observation, Occupancy, Outside, Turn, View, yaw};
#[cfg(feature = "lab")]
use beo_core::model::Model;
use beo_core::simulation::{self, Eye};
use beo_shapes::library::{self, LoadOptions, Shapes};
use beo_shapes::{Close, HOW_TO_CLOSE, Note, Placing, ReadOptions, Up, longest_side, read_observation, read_shape_noted};
use clap::{Args, ValueEnum};
use nalgebra::Vector3;
use std::borrow::Cow;
use std::path::Path;

/// How meshes become voxels.
#[derive(Args, Clone, Debug)]
pub struct MeshArguments {
    /// Voxels along the longest side of a mesh [default: 24 of 30, in proportion at other resolutions]
    #[arg(long, value_name = "VOXELS")]
    pub longest: Option<usize>,
    /// The axis of shapes that points up, of meshes and voxel files [default: y for glTF and ShapeNet's files, else z]
    #[arg(long, value_enum)]
    pub up: Option<UpArgument>,
    /// How open meshes are filled, which otherwise stay hollow and are named
    #[arg(long, value_enum)]
    pub close: Option<CloseArgument>,
    /// Resample voxel files of other sizes, by volume, their longest side as that of meshes
    #[arg(long)]
    pub resample: bool,
}

/// How the shapes of folders become voxels.
#[derive(Args, Clone, Debug)]
pub struct ShapeArguments {
    #[command(flatten)]
    pub mesh: MeshArguments,
    /// Take point clouds too, as the voxels that hold a point
    #[arg(long)]
    pub point_clouds: bool,
}

/// How open meshes are filled.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum CloseArgument {
    /// Every voxel that most rays through it find inside, as if a lid lay on each hole
    Holes,
    /// All of the visual hull: what every ray through it meets, hollows included
    Hull,
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
        let close = match self.close {
            None => Close::Not,
            Some(CloseArgument::Holes) => Close::Holes,
            Some(CloseArgument::Hull) => Close::Hull,
        };
        let (up, resample) = (self.up.map(UpArgument::up), self.resample);
        Ok(ReadOptions { dims, placing: Placing::LongestSide(longest), up, close, resample, ..ReadOptions::new(dims) })
    }

    /// The same for files that are seen as `view` says: an observation is taken as it is, so that no flag may be given.
    pub fn read_options_of(&self, view: ViewArgument, dims: Dims) -> Result<ReadOptions, Failure> {
        let given = [
            ("--longest", self.longest.is_some()),
            ("--up", self.up.is_some()),
            ("--close", self.close.is_some()),
            ("--resample", self.resample),
        ];
        match given.iter().find(|(_, is_given)| *is_given && view == ViewArgument::None) {
            Some((flag, _)) => Err(Failure::Usage(format!("{flag}: with --view none a grid is taken as it is; leave it out"))),
            None => self.read_options(dims),
        }
    }
}

impl ShapeArguments {
    /// The options for reading onto a grid.
    pub fn read_options(&self, dims: Dims) -> Result<ReadOptions, Failure> {
        Ok(ReadOptions { point_clouds: self.point_clouds, ..self.mesh.read_options(dims)? })
    }
}

impl UpArgument {
    /// The axis.
    pub fn up(self) -> Up {
        match self {
            UpArgument::Z => Up::Z,
            UpArgument::Y => Up::Y,
        }
    }
}

/// The view of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ViewArgument {
    /// A complete shape, seen straight from above
    Top,
    /// A complete shape, seen by a camera
    Camera,
    /// A grid of bytes (.npy) with 0 empty, 1 filled, 255 unknown, taken as it is
    None,
}

/// Where the camera of `--view camera` is.
#[derive(Args, Clone, Copy, Debug)]
pub struct CameraArguments {
    /// With --view camera, its height above the horizontal
    #[arg(long, default_value_t = 30.0, value_name = "DEGREES", allow_negative_numbers = true)]
    pub elevation: f64,
    /// With --view camera, its direction from the object, counter-clockwise from +x
    #[arg(long, default_value_t = 0.0, value_name = "DEGREES", allow_negative_numbers = true)]
    pub azimuth: f64,
}

/// Distance of a camera from a shape, in longest sides of the shape.
pub const CAMERA_DISTANCE: f64 = 4.0;

impl CameraArguments {
    /// The place about a shape.
    fn eye(&self, object: &Occupancy) -> Result<Eye, Failure> {
        if !((-90.0..=90.0).contains(&self.elevation) && self.azimuth.is_finite()) {
            let Self { elevation, azimuth } = self;
            return Err(Failure::Usage(format!("--elevation {elevation} --azimuth {azimuth}: use -90 to 90 degrees, and a finite angle")));
        }
        let longest = object.bounds().map_or(1, |[low, high]| (0..3).map(|a| high[a] - low[a]).max().unwrap_or(1));
        Ok(Eye { azimuth: self.azimuth.to_radians(), elevation: self.elevation.to_radians(), distance: CAMERA_DISTANCE * longest as f64 })
    }
}

/// Something to be observed.
pub enum Source {
    /// A complete shape, seen from above.
    Above(Occupancy),
    /// A complete shape, seen by a camera.
    Camera(Occupancy, Eye),
    /// The observation of a shape.
    Observation(Observation),
}

impl Source {
    /// Size of its grid.
    pub fn dims(&self) -> Dims {
        match self {
            Source::Above(object) | Source::Camera(object, _) => object.dims(),
            Source::Observation(observation) => observation.dims(),
        }
    }

    /// Where the camera is, in voxels from the grid's centre, if there is one.
    pub fn camera(&self) -> Option<Vector3<f64>> {
        match self {
            Source::Camera(_, eye) => Some(eye.position()),
            _ => None,
        }
    }

    /// The observation of it, a shape being first turned about z by `angle` radians.
    pub fn turned_by(&self, angle: f64) -> Cow<'_, Observation> {
        let turned = |object: &Occupancy| match angle {
            0.0 => object.clone(),
            _ => Turn::new(object.dims(), &yaw(angle)).occupancy(object),
        };
        match self {
            Source::Above(object) => Cow::Owned(View::Top.of(&turned(object))),
            Source::Camera(object, eye) => Cow::Owned(simulation::observe(&turned(object), eye)),
            Source::Observation(observation) => Cow::Borrowed(observation),
        }
    }
}

impl ViewArgument {
    /// Reads what a file holds.
    pub fn source(self, path: &Path, options: &ReadOptions, camera: &CameraArguments) -> Result<Source, Failure> {
        match self {
            ViewArgument::Top => Ok(Source::Above(read(path, options)?)),
            ViewArgument::Camera => {
                let object = read(path, options)?;
                let eye = camera.eye(&object)?;
                Ok(Source::Camera(object, eye))
            }
            ViewArgument::None => Ok(Source::Observation(read_observation(path)?)),
        }
    }

    /// The view from above, where it is that.
    pub fn view(self) -> Option<View> {
        (self == ViewArgument::Top).then_some(View::Top)
    }

    /// The assumption about voxels outside of the grid.
    pub fn outside(self) -> Outside {
        if self == ViewArgument::Camera { Outside::Unknown } else { Outside::Empty }
    }
}

/// Reads one file as a shape and says on standard error what should be known about it.
fn read(path: &Path, options: &ReadOptions) -> Result<Occupancy, Failure> {
    let reading = read_shape_noted(path, &options.for_file(path)?)?;
    for note in &reading.notes {
        warn!("note: {}: {note}", path.display());
    }
    Ok(reading.object)
}

/// Files named in one line.
const MOST_NAMED: usize = 20;

/// Says once for each kind of note which files it concerns.
fn say_notes(notes: &[(String, Note)]) {
    let about = |is_kind: &dyn Fn(&Note) -> bool| -> Option<(usize, String)> {
        let files: Vec<&str> = notes.iter().filter(|(_, note)| is_kind(note)).map(|(file, _)| file.as_str()).collect();
        let more = files.len().saturating_sub(MOST_NAMED);
        let others = if more > 0 { format!(" and {more} more") } else { String::new() };
        (!files.is_empty()).then(|| (files.len(), files[..files.len() - more].join(", ") + &others))
    };
    if let Some((count, files)) = about(&|note| matches!(note, Note::Open { .. })) {
        warn!("warning: {count} meshes are open, so that they are learned hollow ({HOW_TO_CLOSE}): {files}");
    }
    if let Some((count, files)) = about(&|note| matches!(note, Note::Closed { .. })) {
        warn!("closed {count} open meshes: {files}");
    }
    if let Some((count, files)) = about(&|note| matches!(note, Note::PointCloud { .. })) {
        warn!("warning: {count} point clouds are taken as the voxels that hold a point: {files}");
    }
    if let Some((count, files)) = about(&|note| matches!(note, Note::Resampled { .. })) {
        warn!("resampled {count} voxel files of other sizes: {files}");
    }
    for (file, note) in notes.iter().filter(|(_, note)| matches!(note, Note::Count(_))).take(MOST_NAMED) {
        warn!("warning: {file}: {note}");
    }
}

/// Loads a folder of shapes and says on standard error what was left out.
pub fn load(folder: &Path, splits: &[String], options: &LoadOptions) -> Result<Shapes, Failure> {
    let wanted: Vec<&str> = splits.iter().map(String::as_str).collect();
    let library = library::scan(folder, &wanted)?;
    if library.placed {
        warn!("{}: the meshes were placed by `beo align` and are taken as they lie, whatever --longest and --up", folder.display());
    }
    let bar = progress::bar(library.files.len(), "reading shapes");
    let shapes = library::load(&library, options, |_| bar.inc(1));
    bar.finish_and_clear();
    let shapes = shapes?;
    for skipped in &shapes.skipped {
        warn!("skipped {skipped}");
    }
    for (one, other) in &shapes.shared {
        warn!("warning: {one} and {other} are the same shape under two classes; both are kept");
    }
    say_notes(&shapes.notes);
    let counts = shapes.skip_counts();
    if !shapes.skipped.is_empty() {
        warn!(
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

/// Files of each class, before any is read.
pub fn count(folder: &Path, splits: &[String]) -> Result<Vec<usize>, Failure> {
    let wanted: Vec<&str> = splits.iter().map(String::as_str).collect();
    let library = library::scan(folder, &wanted)?;
    let mut counts = vec![0; library.classes.len()];
    library.files.iter().for_each(|file| counts[file.class] += 1);
    Ok(counts)
}

/// The splits among `wanted` that exist, none for a flat folder, or an error that says what there is.
pub fn existing_splits(folder: &Path, wanted: &[&str]) -> Result<Vec<String>, Failure> {
    let found = library::splits(folder)?;
    let splits: Vec<String> = wanted.iter().filter(|w| found.iter().any(|f| f == *w)).map(|w| w.to_string()).collect();
    if splits.is_empty() && !library::is_flat(folder)? {
        // The scan's own error says what the folder should look like.
        library::scan(folder, wanted)?;
    }
    Ok(splits)
}

/// Where no split was named: an error unless the folder has none.
#[cfg(feature = "lab")]
pub fn require_flat(folder: &Path) -> Result<(), Failure> {
    let splits = library::splits(folder)?;
    if splits.is_empty() {
        Ok(())
    } else {
        Err(Failure::Usage(format!("name one of the splits of {} with --split: {}", folder.display(), splits.join(", "))))
    }
}

/// For each class of some shapes its place among a model's classes.
#[cfg(feature = "lab")]
pub fn classes_in(classes: &[String], model: &Model) -> Result<Vec<usize>, Failure> {
    let place = |class: &String| {
        let known = || model.class_names().collect::<Vec<_>>().join(", ");
        let unknown = || Failure::Failed(format!("class `{class}` is not in the model, which knows {}", known()));
        model.class_names().position(|name| name == class).ok_or_else(unknown)
    };
    classes.iter().map(place).collect()
}
