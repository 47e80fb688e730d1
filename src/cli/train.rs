//! `beo train`: learn a model from a folder of shapes.

use super::failure::Failure;
use super::shapes::{self, ShapeArguments, ViewArgument};
use super::{failure::cannot_write, progress};
use beo_core::grid::{Dims, View};
use beo_core::learning::{FEWEST_SHAPES, Pass, Step, TrainOptions, train};
use beo_core::memory::{self, Available};
use beo_core::model::{LEVELS, MOST_COMPONENTS, check_place, levels_of, save};
use beo_core::simulation::{Sensing, SensorKind};
use beo_shapes::library::LoadOptions;
use beo_shapes::{UNITS_FILE, Units};
use clap::{Args, ValueEnum};
use half::f16;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// How many times finer than the model's the grids are whose shapes cameras see.
const FINER: usize = 2;

/// How many times finer the grids of a model of this size are on which cameras see its shapes: of few voxels, a slender cylinder looks like a
/// box. `None` where the model's own are fine enough.
pub(super) fn finer(dims: Dims) -> Option<usize> {
    let finest = <[usize; 3]>::from(dims).into_iter().fold(0, usize::max) * FINER;
    (finest <= LEVELS[1]).then_some(FINER)
}

/// Learn a model from a folder of shapes, DIR/<class>/<split>/*, or DIR/* for one class named after the folder, or as ShapeNet and YCB lay
/// them out
#[derive(Args)]
pub struct Train {
    /// Folder of shapes: .binvox, .npy, .npz, .off, .obj, .stl, .ply, .glb, .gltf
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
    /// With --views camera, the unit of length of the files, from which true sizes are learned [default: what DIR/units.txt says, or none]
    #[arg(long, value_enum, value_name = "UNIT")]
    units: Option<UnitsArgument>,
    /// With --views camera, the depth sensors to be met, with what they and masks get wrong [default: mild]
    #[arg(long, value_enum, value_name = "SENSORS")]
    sensors: Option<SensorsArgument>,
    /// With --views camera, in which poses objects rest [default: upright]
    #[arg(long, value_enum, value_name = "POSES")]
    resting: Option<RestingArgument>,
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
    shaping: ShapeArguments,
}

/// The unit of length of the files.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub(super) enum UnitsArgument {
    /// Metres
    M,
    /// Centimetres
    Cm,
    /// Millimetres
    Mm,
    /// The unit that DIR/units.txt names
    Folder,
    /// Not known, or different from file to file
    None,
}

impl UnitsArgument {
    /// The unit of a folder's files: the given one, else what the folder says, or none.
    pub fn units(given: Option<Self>, folder: &Path) -> Result<Units, Failure> {
        let of_folder = || Units::of_folder(folder).map_err(|error| Failure::Failed(error.to_string()));
        Ok(match given {
            Some(Self::M) => Units::Metres,
            Some(Self::Cm) => Units::Centimetres,
            Some(Self::Mm) => Units::Millimetres,
            Some(Self::None) => Units::None,
            Some(Self::Folder) => match of_folder()? {
                Units::None => {
                    let path = folder.join(UNITS_FILE);
                    let problem = format!("--units folder: {} names no unit; give the unit here", path.display());
                    return Err(Failure::Usage(problem));
                }
                units => units,
            },
            None => of_folder()?,
        })
    }
}

/// The errors of sensors and masks.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub(super) enum SensorsArgument {
    /// No noise, nothing else in view, masks without faults
    Ideal,
    /// Little noise, near by, masks without faults
    Mild,
    /// Structured light, as of the first Kinect
    Kinect,
    /// Active stereo
    Realsense,
    /// Time of flight
    Tof,
    /// All of these in turn
    Mixed,
}

impl SensorsArgument {
    pub fn sensing(self) -> Sensing {
        match self {
            Self::Ideal => Sensing::Ideal,
            Self::Mild => Sensing::Mild,
            Self::Kinect => Sensing::Of(SensorKind::StructuredLight),
            Self::Realsense => Sensing::Of(SensorKind::Stereo),
            Self::Tof => Sensing::Of(SensorKind::TimeOfFlight),
            Self::Mixed => Sensing::Mixed,
        }
    }
}

/// In which poses objects rest.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum RestingArgument {
    /// As the shapes stand canonically
    Upright,
    /// In all stable poses of their convex hulls, and as they stand canonically
    Rest,
}

/// The least memory of a training, known from the number of files before any is read.
#[derive(Clone, Copy, Debug)]
pub(super) struct Need {
    /// Bytes of the basis W': every class adds its least number of components, if it has the shapes, and its mean.
    basis: u64,
    /// Bytes of memory at a time.
    memory: u64,
}

impl Need {
    /// For so many shapes of each class.
    pub fn new(shapes: &[usize], dims: Dims, least: usize) -> Self {
        let rank: usize = shapes.iter().map(|count| count.saturating_sub(1).min(least)).sum();
        let (basis, packed) = (rank * dims.voxels() * size_of::<f16>(), shapes.iter().sum::<usize>() * dims.voxels() / 8);
        // Read in place, the basis is all there is beside the shapes. Tables for a grid on which poses are searched take the prefix sums, and
        // the class bases as floats (twice the size) at a time.
        let memory = if levels_of(dims).is_empty() { 4 * basis } else { basis + basis / 4 } + packed;
        Self { basis: basis as u64, memory: memory as u64 }
    }

    /// The same with so much more memory.
    #[cfg(feature = "lab")]
    pub fn with(self, more: usize) -> Self {
        Self { memory: self.memory.saturating_add(more as u64), ..self }
    }

    /// Fails if there is too little memory, or too little room for the model.
    fn check(&self, out: &Path, dims: Dims) -> Result<(), Failure> {
        check_place(out, self.basis)?;
        self.check_memory(dims)
    }

    /// Fails if there is too little memory.
    pub fn check_memory(&self, dims: Dims) -> Result<(), Failure> {
        let megabytes = |bytes: u64| bytes.div_ceil(1_000_000);
        match memory::available() {
            Some(Available { bytes, limit }) if bytes < self.memory => Err(Failure::Failed(format!(
                "training on {dims} needs at least {} MB of memory, {limit} has {} MB left: use a lower --resolution or fewer components (--least, --most)",
                megabytes(self.memory),
                bytes / 1_000_000
            ))),
            _ => Ok(()),
        }
    }
}

/// How long each step took, and within the steps each pass over the voxels.
#[derive(Default)]
struct Times(Mutex<Clock>);

/// The running steps with their start, and the total duration and count of those that ended.
#[derive(Default)]
struct Clock {
    running: Option<(Instant, String)>,
    ended: Vec<(String, Duration, usize)>,
}

impl Times {
    /// A step, or a pass, begins: what came before has ended.
    fn begin(&self, name: Option<String>) {
        let mut guard = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let Clock { running, ended } = &mut *guard;
        if let Some((start, name)) = running.take() {
            let elapsed = start.elapsed();
            match ended.iter_mut().find(|(known, ..)| *known == name) {
                Some((_, time, count)) => (*time, *count) = (*time + elapsed, *count + 1),
                None => ended.push((name, elapsed, 1)),
            }
        }
        *running = name.map(|name| (Instant::now(), name));
    }

    /// One line each.
    fn lines(&self) -> String {
        self.begin(None);
        let times = &self.0.lock().unwrap_or_else(PoisonError::into_inner).ended;
        let line = |(name, time, count): &(String, Duration, usize)| {
            let often = if *count > 1 { format!(", {count} times") } else { String::new() };
            format!("  {:>7.2} s  {name}{often}\n", time.as_secs_f64())
        };
        times.iter().map(line).collect()
    }
}

fn pass_name(pass: Pass) -> &'static str {
    match pass {
        Pass::Gram => "Gram matrix of the class bases",
        Pass::Basis => "forming W'",
        Pass::Reading => "Gram matrix or prefix sums of W'",
        Pass::Projecting => "projecting shapes and hulls, and what follows",
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
        let mut read = self.shaping.read_options(dims)?;
        read.finer = finer(dims).filter(|_| !camera_elevations_deg.is_empty());
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
        let with_cameras = !camera_elevations_deg.is_empty();
        let units = if with_cameras { UnitsArgument::units(self.units, &self.dir)? } else { Units::None };
        let given = [("--units", self.units.is_some()), ("--sensors", self.sensors.is_some()), ("--resting", self.resting.is_some())];
        for (flag, is_given) in given {
            if is_given && !with_cameras {
                return usage(format!("{flag}: cameras are not learned; add --views camera"));
            }
        }
        let start = Instant::now();
        let counts = shapes::count(&self.dir, &splits)?;
        Need::new(&counts, dims, self.least).check(&self.out, dims)?;
        let shapes = shapes::load(&self.dir, &splits, &LoadOptions { read, skip_duplicates: true, minimum: FEWEST_SHAPES, units })?;
        let loaded = start.elapsed();
        let is_metric = shapes.set.lengths_m.is_some();
        if units != Units::None && !is_metric {
            warn!(
                "true sizes are not learned: of some shapes the size is not known (.npy has none, and what `beo align` wrote has lost it)"
            );
        }
        let options = TrainOptions {
            views: vec![View::Top],
            camera_elevations_deg,
            sensing: self.sensors.map_or(Sensing::Mild, SensorsArgument::sensing),
            lying: self.resting == Some(RestingArgument::Rest),
            variance_share: self.variance,
            basis_range: [self.least, self.most],
            seed: self.seed,
            folds: self.folds,
            poses: true,
            splits,
            longest_side: read.longest(),
            licence: self.licence,
        };
        let bar = progress::bar(self.folds + 2, "learning");
        let times = Times::default();
        let model = train(&shapes.set, &options, &|Step { name, side, pass, done, total }: Step| {
            let what = pass.map_or(name, pass_name);
            times.begin(Some(format!("on a grid of {side}: {what}")));
            match pass {
                Some(_) => tracing::debug!(side, "{name}: {what}"),
                None => tracing::info!(step = done + 1, of = total, side, "{name}"),
            }
            bar.set_message(name);
            bar.set_length(total as u64);
            bar.set_position(done as u64);
        });
        bar.finish_and_clear();
        let model = model?;
        times.begin(Some("writing the model".into()));
        save(&model, &self.out)?;
        let times = times.lines();
        let bytes = std::fs::metadata(&self.out).map(|m| m.len()).unwrap_or(0);
        let calibration = &model.metadata.calibration;
        say!(
            "learned {} classes from {} shapes in {:.1} s ({:.1} s reading): rank {}, held-out accuracy {:.3} on {} objects",
            model.classes.len(),
            shapes.set.shapes.len(),
            start.elapsed().as_secs_f64(),
            loaded.as_secs_f64(),
            model.rank(),
            calibration.accuracy,
            calibration.objects,
        );
        say!("{}", times.trim_end());
        say!("wrote {} ({:.1} MB)", self.out.display(), bytes as f64 / 1e6);
        Ok(())
    }
}
