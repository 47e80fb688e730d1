//! `beo bench latency`, and what its other processes run.

use super::part::{not_planned, plan};
use crate::cli::failure::{Failure, cannot_write};
use crate::cli::{progress, stop};
use beo_core::grid::Occupancy;
use beo_core::model::load;
use beo_lab::benchmark::latency::{self, CameraRate, Grids, Load, MOST_ON_TABLE, Pose, ProducerPlan, ReaderPlan, Settings, Wake};
use beo_shapes::{ReadOptions, read_shape};
use clap::{Args, ValueEnum};
use std::io::stdin;
use std::path::PathBuf;

/// Most readers: as many as a daemon serves, less the producer's own.
const MOST_SUBSCRIBERS: usize = beo_ipc::limits::MAX_SUBSCRIBERS - 1;
/// Longest run.
const LONGEST_S: f64 = 3600.0;

/// From an observation to its percept, through producer, daemon and readers as separate processes
#[derive(Args)]
pub struct Latency {
    /// Complete shapes to observe from above [default: made-up furniture]
    files: Vec<PathBuf>,
    /// Model file
    #[arg(long, default_value = "models/modelnet10.safetensors")]
    model: PathBuf,
    /// In what rhythm observations come; several are separated by commas
    #[arg(long, value_enum, value_delimiter = ',', default_value = "all")]
    load: Vec<LoadArgument>,
    /// How daemon and readers learn that something has come
    #[arg(long, value_enum, default_value_t = WakeArgument::Event)]
    wake: WakeArgument,
    /// The prior knowledge of the pose that observations carry
    #[arg(long, value_enum, default_value_t = PoseArgument::Known)]
    pose: PoseArgument,
    /// Of the load `camera`: objects on the table [default: 6]
    #[arg(long, value_name = "N")]
    objects: Option<u32>,
    /// Of the load `camera`: depth images a second [default: 30]
    #[arg(long, value_name = "HZ")]
    rate: Option<f64>,
    /// Processes that read
    #[arg(long, default_value_t = 1, value_name = "N")]
    subscribers: usize,
    /// Length of each run, after a warm-up of half a second
    #[arg(long, default_value_t = 10.0, value_name = "SECONDS")]
    seconds: f64,
    /// Runs of each load, of which medians are taken
    #[arg(long, default_value_t = 3, value_name = "N")]
    repeat: usize,
    /// Print everything as one JSON object
    #[arg(long)]
    json: bool,
    /// Draw latencies and stages into this folder
    #[arg(long, value_name = "DIR")]
    png: Option<PathBuf>,
}

/// In what rhythm observations come.
#[derive(Clone, Copy, ValueEnum)]
enum LoadArgument {
    /// One object, the next as soon as the last one's answer was read
    FlatOut,
    /// One object, 30 times a second
    #[value(name = "30hz")]
    Steady,
    /// Eight objects in each frame, 30 frames a second
    #[value(name = "8x30hz")]
    Frames,
    /// Sixteen objects at once, four times a second
    Burst,
    /// Depth images of --objects on a table, --rate times a second, carved by the producer
    Camera,
    /// All of these
    All,
}

impl LoadArgument {
    fn loads(self) -> &'static [Load] {
        match self {
            Self::FlatOut => &[Load::FlatOut],
            Self::Steady => &[Load::Steady],
            Self::Frames => &[Load::Frames],
            Self::Burst => &[Load::Bursts],
            Self::Camera => &[Load::Camera],
            Self::All => &Load::ALL,
        }
    }
}

/// How daemon and readers learn that something has come.
#[derive(Clone, Copy, ValueEnum)]
enum WakeArgument {
    /// They sleep until an event
    Event,
    /// They look again and again, each on a core
    Polling,
}

/// The prior knowledge of the pose that observations carry.
#[derive(Clone, Copy, ValueEnum)]
enum PoseArgument {
    /// Objects stand upright, and it is told so
    Known,
    /// Turned about the vertical axis
    Yaw,
    /// In any way in which its class can rest, turned about the vertical axis: of what cameras see
    Rest,
    /// Turned in any way
    Full,
    /// Turning about the vertical axis from frame to frame, each observation continuing the last
    Track,
}

impl Latency {
    /// Runs the command.
    pub fn run(self) -> Result<(), Failure> {
        if !(0.1..=LONGEST_S).contains(&self.seconds) {
            return Err(Failure::Usage(format!("--seconds {}: use 0.1 to {LONGEST_S}", self.seconds)));
        }
        if !(1..=MOST_SUBSCRIBERS).contains(&self.subscribers) {
            return Err(Failure::Usage(format!("--subscribers {}: use 1 to {MOST_SUBSCRIBERS}", self.subscribers)));
        }
        if !(1..=1000).contains(&self.repeat) {
            return Err(Failure::Usage(format!("--repeat {}: use 1 to 1000", self.repeat)));
        }
        let camera = self.camera()?;
        if let Some(folder) = &self.png {
            std::fs::create_dir_all(folder).map_err(cannot_write(folder))?;
        }
        let model = load(&self.model)?;
        let pose = self.pose.into();
        let shapes = match self.files.as_slice() {
            [] => Grids::furniture(model.dims()),
            files => files
                .iter()
                .map(|file| read_shape(file, &ReadOptions::new(model.dims()).for_file(file)?))
                .collect::<Result<Vec<Occupancy>, _>>()?,
        };
        let grids = Grids::new(&shapes, pose);
        let mut loads: Vec<Load> = Vec::new();
        for load in self.load.iter().flat_map(|argument| argument.loads()) {
            if !loads.contains(load) {
                loads.push(*load);
            }
        }
        let settings = Settings {
            model: self.model,
            pose,
            camera,
            wake: self.wake.into(),
            subscribers: self.subscribers,
            seconds: self.seconds,
            repeat: self.repeat,
        };
        let stop = stop::on_signal()?;
        let bar = progress::bar(loads.len() * settings.repeat, "measuring");
        let report = latency::measure(&settings, &loads, &model, &grids, &stop, || bar.inc(1));
        bar.finish_and_clear();
        let report = report?;
        match self.json {
            true => say!("{}", serde_json::to_string_pretty(&report)?),
            false => say!("{}", latency::text(&report).trim_end()),
        }
        if let Some(folder) = &self.png {
            latency::save(folder, &report)?;
        }
        Ok(())
    }
}

impl Latency {
    /// Objects and frame rate of the load `camera`.
    fn camera(&self) -> Result<CameraRate, Failure> {
        let is_seen = self.load.iter().flat_map(|argument| argument.loads()).any(|load| *load == Load::Camera);
        if !is_seen && (self.objects.is_some() || self.rate.is_some()) {
            return Err(Failure::Usage("--objects and --rate are of the load `camera`: add it to --load".into()));
        }
        let usual = CameraRate::default();
        let camera = CameraRate { objects: self.objects.unwrap_or(usual.objects), rate_hz: self.rate.unwrap_or(usual.rate_hz) };
        if !(1..=MOST_ON_TABLE).contains(&camera.objects) {
            return Err(Failure::Usage(format!("--objects {}: use 1 to {MOST_ON_TABLE}", camera.objects)));
        }
        if !(0.1..=1000.0).contains(&camera.rate_hz) {
            return Err(Failure::Usage(format!("--rate {}: use 0.1 to 1000 images a second", camera.rate_hz)));
        }
        Ok(camera)
    }
}

impl From<WakeArgument> for Wake {
    fn from(argument: WakeArgument) -> Self {
        match argument {
            WakeArgument::Event => Self::Event,
            WakeArgument::Polling => Self::Polling,
        }
    }
}

impl From<PoseArgument> for Pose {
    fn from(argument: PoseArgument) -> Self {
        match argument {
            PoseArgument::Known => Self::Known,
            PoseArgument::Yaw => Self::Yaw,
            PoseArgument::Rest => Self::Rest,
            PoseArgument::Full => Self::Full,
            PoseArgument::Track => Self::Track,
        }
    }
}

/// The producer's process: a plan on a line of standard input and then the grids; what became of them on a line of standard output.
pub fn producer() -> Result<(), Failure> {
    let stop = stop::on_signal()?;
    let mut input = stdin().lock();
    let plan: ProducerPlan = plan("latency", &mut input)?;
    let voxels = beo_ipc::limits::voxel_count(plan.dims).ok_or_else(|| not_planned("latency", "dims outside the limits"))?;
    let grids = Grids::read(&mut input, voxels, plan.shapes)?;
    say!("{}", serde_json::to_string(&latency::produce(&plan, &grids, &stop)?)?);
    Ok(())
}

/// A reader's process: a plan on a line of standard input; a line when it has subscribed, and what it read on another once interrupted.
pub fn reader() -> Result<(), Failure> {
    let stop = stop::on_signal()?;
    let plan: ReaderPlan = plan("latency", &mut stdin().lock())?;
    let ready = || {
        use std::io::Write;
        writeln!(std::io::stdout(), "reading")
    };
    say!("{}", serde_json::to_string(&latency::read(&plan, &stop, ready)?)?);
    Ok(())
}
