//! `beo camera`: a producer that carves the frames of a folder into grids, for a daemon or as files.

use super::arguments::PoseArgument;
use super::failure::{Failure, cannot_write};
use super::observe::{first_status, seconds};
use super::stop;
use crate::frames::{CapturedFrame, FolderOptions, FrameFolder, StampedPose, parse_trajectory};
use beo_camera::{BelowSupport, Carver, FrameGrids, FusedObjects, Grid, GridOptions, NoGrid, Placement, SensorModel};
use beo_camera::{carve, lay_grids};
use beo_core::grid::{Dims, Observation};
use beo_ipc::clock::monotonic_ns;
use beo_ipc::limits::NAME_LEN;
use beo_ipc::text::{from_field, to_field};
use beo_ipc::{InstanceName, ObservationHeader, Outside, PerceptStatus, PoseSearch, Producer, ScaleSearch, Subscriber, SubscriberOptions};
use beo_ipc::{View, tasks};
use beo_shapes::{read_bytes, write_npy_observation};
use clap::{Args, ValueEnum};
use nalgebra::{Isometry3, Unit, Vector3};
use serde_json::json;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// Carve depth images with object masks into grids, for a daemon or as files
#[derive(Args)]
#[command(after_help = "\
DIR holds NAME_depth.png with NAME_label.png or NAME_mask.png (or .npy, .tif) and NAME_camera_info.yaml or camera_info.yaml; or \
folders depth and label or mask with files of equal names; or is a scene in BOP's format. Each object of each frame ends as an \
observation, or as a line that says why there is none.")]
pub struct Camera {
    /// Folder of frames
    folder: PathBuf,
    /// Instance of the daemon
    #[arg(long, default_value_t = InstanceName::default(), value_name = "NAME")]
    instance: InstanceName,
    /// Frames per second [default: the next one when all objects of the last are answered]
    #[arg(long, value_name = "HZ")]
    rate: Option<f64>,
    /// Frames in all, from the first again after the last [default: each once]
    #[arg(long, value_name = "N")]
    count: Option<u64>,
    /// Go on until interrupted, from the first frame again after the last
    #[arg(long = "loop", conflicts_with = "count")]
    without_end: bool,
    /// Seconds to wait for a daemon
    #[arg(long, default_value_t = 10.0, value_name = "SECONDS")]
    wait: f64,
    /// Metres per unit of depth images of whole numbers [default: 0.001, or what a BOP scene says]
    #[arg(long, value_name = "METRES")]
    depth_scale: Option<f64>,
    /// Camera of all frames, in place of the folder's own
    #[arg(long, value_name = "FILE")]
    camera_info: Option<PathBuf>,
    /// Direction in which things fall, in the camera frame (x right, y down, z forward) [default: from the support plane]
    #[arg(long, value_name = "X,Y,Z", value_parser = direction, allow_hyphen_values = true)]
    gravity: Option<Unit<Vector3<f64>>>,
    /// Label of the plane that objects stand on, which is no object; otherwise it is looked for where there is no label
    #[arg(long, value_name = "LABEL")]
    support_label: Option<u16>,
    /// What is known below the support plane
    #[arg(long, value_enum, default_value_t = BelowArgument::Empty, value_name = "WHAT")]
    below_support: BelowArgument,
    /// Longest side of the objects, if all have the same
    #[arg(long, value_name = "METRES")]
    known_side: Option<f64>,
    /// Standard deviation of a depth reading at depth 0, metres
    #[arg(long, value_name = "METRES", default_value_t = SensorModel::default().constant_m)]
    sensor_constant: f64,
    /// How it grows with the squared depth, 1/metres
    #[arg(long, value_name = "PER_METRE", default_value_t = SensorModel::default().quadratic_per_m)]
    sensor_quadratic: f64,
    /// Half the width of the band in which voxels count as filled, in standard deviations
    #[arg(long, value_name = "N", default_value_t = SensorModel::default().deviations)]
    sensor_deviations: f64,
    /// What is known of the pose
    #[arg(long, value_enum, default_value_t = PoseArgument::Yaw)]
    pose: PoseArgument,
    /// Name of the camera's frame [default: that of the camera_info's header, or `camera`]
    #[arg(long, value_name = "NAME")]
    frame_id: Option<String>,
    /// Objects do not move: each frame adds to what the ones before saw of them. Needs --trajectory or a BOP scene with poses
    #[arg(long, conflicts_with = "without_end")]
    fuse: bool,
    /// Where the camera was: a line `stamp tx ty tz qx qy qz qw` (camera to world) for each frame, in order
    #[arg(long, value_name = "FILE")]
    trajectory: Option<PathBuf>,
    /// Write each grid into this folder, as .npy (0 empty, 1 filled, 255 unknown) and .json, in place of a daemon
    #[arg(long, value_name = "DIR", conflicts_with_all = ["instance", "rate", "wait", "count", "without_end"])]
    out: Option<PathBuf>,
    /// Voxels along each side of the grids [default: 30]
    #[arg(long, value_name = "N", requires = "out")]
    resolution: Option<usize>,
}

/// What is known of voxels below the support plane.
#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum BelowArgument {
    /// Nothing of the object is there
    Empty,
    /// What the image says
    Unknown,
}

/// A daemon that runs and has not answered for so long has nothing more to answer.
const SILENCE: Duration = Duration::from_secs(30);
/// Observations that may wait to be answered where the answers set the pace: no more than the shortest queue of a daemon holds.
const IN_FLIGHT: usize = 2;
/// Voxels along each side of grids that are written.
const RESOLUTION: usize = 30;

fn direction(text: &str) -> Result<Unit<Vector3<f64>>, String> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|number| number.trim().parse()).collect();
    match numbers.as_deref() {
        Ok(&[x, y, z]) if [x, y, z].iter().all(|n| f64::is_finite(*n)) => {
            Unit::try_new(Vector3::new(x, y, z), 1e-9).ok_or("a direction has a length".into())
        }
        _ => Err("use three numbers: X,Y,Z".into()),
    }
}

impl Camera {
    /// Runs the command.
    pub fn run(self) -> Result<(), Failure> {
        self.check()?;
        let options = FolderOptions { metres_per_unit: self.depth_scale, camera_info: self.camera_info.clone() };
        let frames = FrameFolder::open(&self.folder, options)?;
        let poses = match &self.trajectory {
            Some(path) => Some(read_trajectory(path, frames.count())?),
            None => None,
        };
        let stop = stop::on_signal()?;
        match &self.out {
            Some(folder) => {
                std::fs::create_dir_all(folder).map_err(cannot_write(folder))?;
                let dims = Dims::cube(self.resolution.unwrap_or(RESOLUTION)).map_err(|error| Failure::Usage(error.to_string()))?;
                let mut replay = Replay::new(&self, &frames, poses, self.grid_options(dims)?);
                let mut files = Files { folder: folder.clone(), written: 0, voxels: vec![0; dims.voxels()] };
                replay.play(&stop, &mut files)?;
                say!("{}, {} grids written to {}", replay.summary(), files.written, folder.display());
                replay.readable()
            }
            None => {
                let wait = seconds(self.wait)?;
                let deadline = Instant::now() + wait;
                let subscriber = Subscriber::open_within(&self.instance, &SubscriberOptions::default(), wait)?;
                let status = first_status(&subscriber, deadline)?;
                let [x, y, z] = status.dims.map(|side| side as usize);
                let dims = Dims::new(x, y, z)?;
                let producer = Producer::open_within(&self.instance, &self.template(status.dims), wait)?;
                let mut replay = Replay::new(&self, &frames, poses, self.grid_options(dims)?);
                let (in_step, stop_too) = (self.rate.is_none(), stop.clone());
                let mut daemon = Daemon { producer, subscriber, stop: stop_too, in_step, pending: BTreeMap::new(), counts: [0; 4] };
                replay.play(&stop, &mut daemon)?;
                daemon.settle(0)?;
                daemon.give_up(|_, _| true)?;
                let [sent, answered, refused, unanswered] = daemon.counts;
                let missing = if unanswered > 0 { format!(", {unanswered} not answered") } else { String::new() };
                say!("{}, {sent} observations sent, {answered} answered, {refused} refused{missing}", replay.summary());
                replay.readable()
            }
        }
    }

    fn check(&self) -> Result<(), Failure> {
        if let Some(rate) = self.rate.filter(|rate| !(*rate > 0.0 && *rate <= 1000.0)) {
            return Err(Failure::Usage(format!("--rate {rate}: use a number above 0, at most 1000")));
        }
        for (flag, metres) in [("--depth-scale", self.depth_scale), ("--known-side", self.known_side)] {
            if let Some(metres) = metres.filter(|metres| !(*metres > 0.0 && *metres <= 1000.0)) {
                return Err(Failure::Usage(format!("{flag} {metres}: use metres above 0, at most 1000")));
            }
        }
        if let Some(name) = self.frame_id.as_ref().filter(|name| name.len() > NAME_LEN) {
            return Err(Failure::Usage(format!("--frame-id {name}: use at most {NAME_LEN} bytes")));
        }
        if self.count == Some(0) {
            return Err(Failure::Usage("--count 0: use at least 1".into()));
        }
        Ok(())
    }

    fn grid_options(&self, dims: Dims) -> Result<GridOptions, Failure> {
        let sensor = SensorModel::new(self.sensor_constant, self.sensor_quadratic, self.sensor_deviations)
            .map_err(|error| Failure::Usage(error.to_string()))?;
        Ok(GridOptions {
            sensor,
            placement: Placement { known_side_m: self.known_side, ..Placement::default() },
            support_label: self.support_label,
            gravity: self.gravity,
            below_support: match self.below_support {
                BelowArgument::Empty => BelowSupport::Empty,
                BelowArgument::Unknown => BelowSupport::Unknown,
            },
            ..GridOptions::new(dims.into())
        })
    }

    /// What all observations have in common.
    fn template(&self, dims: [u32; 3]) -> ObservationHeader {
        let pose = match self.pose {
            PoseArgument::Known => PoseSearch::Known,
            PoseArgument::Yaw => PoseSearch::Yaw,
            PoseArgument::Full => PoseSearch::Full,
        };
        ObservationHeader {
            pose_search: pose.code(),
            tasks: tasks::ALL,
            view: View::Camera.code(),
            outside: Outside::Unknown.code(),
            scale_search: ScaleSearch::Search.code(),
            known_side_m: self.known_side.unwrap_or(0.0) as f32,
            ..ObservationHeader::new(dims)
        }
    }
}

fn read_trajectory(path: &Path, frames: usize) -> Result<Vec<StampedPose>, Failure> {
    let failed = |error: &dyn std::fmt::Display| Failure::Failed(format!("{}: {error}", path.display()));
    let poses = parse_trajectory(&read_bytes(path)?).map_err(|error| failed(&error))?;
    if poses.len() < frames {
        return Err(failed(&format!(
            "{} poses for {frames} frames: one line is needed for each, in the order of their names",
            poses.len()
        )));
    }
    Ok(poses)
}

/// What happens to a grid that was laid.
trait Sink {
    /// Carves it into its place, lets `finish` change it, and passes it on.
    fn take(&mut self, of: &Shown<'_>, carver: &Carver<'_>, finish: &mut Finish<'_>) -> Result<(), Failure>;
    /// All objects of a frame were taken.
    fn frame_ended(&mut self) -> Result<(), Failure>;
}

/// Adds what other frames know of the object.
type Finish<'a> = dyn FnMut(&mut [u8]) -> Result<(), Failure> + 'a;

/// What is said of a frame besides its grids.
struct Shown<'a> {
    frame: &'a str,
    frame_id: &'a str,
    /// When it was at hand, CLOCK_MONOTONIC.
    captured_ns: u64,
    /// The sensor's own time.
    stamp_ns: u64,
    /// Several views are one grid.
    fused: bool,
}

/// Plays the frames and counts.
struct Replay<'a> {
    camera: &'a Camera,
    folder: &'a FrameFolder,
    poses: Option<Vec<StampedPose>>,
    options: GridOptions,
    fused: FusedObjects,
    frames: u64,
    unreadable: BTreeSet<usize>,
    without_grid: u64,
}

impl<'a> Replay<'a> {
    fn new(camera: &'a Camera, folder: &'a FrameFolder, poses: Option<Vec<StampedPose>>, options: GridOptions) -> Self {
        let (fused, unreadable) = (FusedObjects::default(), BTreeSet::new());
        Self { camera, folder, poses, options, fused, frames: 0, unreadable, without_grid: 0 }
    }

    fn play(&mut self, stop: &AtomicBool, sink: &mut impl Sink) -> Result<(), Failure> {
        let all = self.folder.count();
        let count = match (self.camera.without_end, self.camera.count) {
            (true, _) => u64::MAX,
            // A frame adds nothing to itself.
            (false, Some(count)) if !self.camera.fuse => count,
            (false, count) => count.unwrap_or(u64::MAX).min(all as u64),
        };
        let mut due = Instant::now();
        for number in 0..count {
            let index = (number % all as u64) as usize;
            if stop.load(Ordering::Relaxed) || self.unreadable.len() == all {
                break;
            }
            if self.unreadable.contains(&index) {
                continue;
            }
            let captured = match self.folder.read(index) {
                Ok(captured) => captured,
                Err(error) => {
                    say!("{}: skipped: {error}", self.folder.name(index));
                    self.unreadable.insert(index);
                    continue;
                }
            };
            if let Some(rate) = self.camera.rate {
                due = wait_until(due, stop) + Duration::from_secs_f64(1.0 / rate);
            }
            self.frame(&captured, index, sink)?;
            sink.frame_ended()?;
            self.frames += 1;
        }
        Ok(())
    }

    fn frame(&mut self, captured: &CapturedFrame, index: usize, sink: &mut impl Sink) -> Result<(), Failure> {
        let pose = self.poses.as_ref().map(|poses| poses[index]);
        let camera_to_world = pose.map(|pose| pose.camera_to_world).or(captured.camera_to_world);
        let now_ns = || SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_nanos() as u64);
        let shown = Shown {
            frame: captured.name(),
            frame_id: self.camera.frame_id.as_deref().or(captured.frame_id.as_deref()).unwrap_or("camera"),
            captured_ns: monotonic_ns(),
            stamp_ns: pose.map_or_else(now_ns, |pose| pose.stamp_ns),
            fused: self.camera.fuse,
        };
        let grids = self.lay(captured, camera_to_world)?;
        for laid in &grids.objects {
            match &laid.carver {
                Ok(carver) if self.camera.fuse => {
                    sink.take(&shown, carver, &mut |voxels| Ok(self.fused.fuse(carver.object, voxels)?))?;
                }
                Ok(carver) => sink.take(&shown, carver, &mut |_| Ok(()))?,
                Err(reason) => self.say_why_not(captured.name(), reason)?,
            }
        }
        Ok(())
    }

    fn lay<'f>(&mut self, captured: &'f CapturedFrame, camera_to_world: Option<Isometry3<f64>>) -> Result<FrameGrids<'f>, Failure> {
        if !self.camera.fuse {
            return Ok(lay_grids(captured.frame(), &self.options));
        }
        let place = camera_to_world.ok_or_else(|| {
            Failure::Failed(format!("--fuse: it is not known where the camera was in frame {}: give --trajectory", captured.name()))
        })?;
        Ok(self.fused.lay_grids(captured.frame(), &place, &self.options)?)
    }

    fn say_why_not(&mut self, frame: &str, reason: &NoGrid) -> Result<(), Failure> {
        self.without_grid += 1;
        say!("{frame}: no grid: {reason}");
        Ok(())
    }

    fn summary(&self) -> String {
        let unreadable = match self.unreadable.len() {
            0 => String::new(),
            n => format!(" ({n} skipped)"),
        };
        format!("{} frames{unreadable}, {} objects without a grid", self.frames, self.without_grid)
    }

    fn readable(&self) -> Result<(), Failure> {
        match self.frames {
            0 if !self.unreadable.is_empty() => Err(Failure::Failed(format!("no frame of {} can be read", self.camera.folder.display()))),
            _ => Ok(()),
        }
    }
}

/// Waits for a time; gives that time, or now if it was missed.
fn wait_until(due: Instant, stop: &AtomicBool) -> Instant {
    while let Some(rest) = due.checked_duration_since(Instant::now()) {
        if rest.is_zero() || stop.load(Ordering::Relaxed) {
            return due;
        }
        std::thread::sleep(rest.min(Duration::from_millis(50)));
    }
    Instant::now()
}

/// Grids into shared memory.
struct Daemon {
    producer: Producer,
    subscriber: Subscriber,
    stop: Arc<AtomicBool>,
    /// The answers set the pace.
    in_step: bool,
    /// What was sent and has no answer yet: frame and object.
    pending: BTreeMap<u64, (String, u64)>,
    /// Sent, answered, refused, without an answer.
    counts: [u64; 4],
}

impl Sink for Daemon {
    fn take(&mut self, of: &Shown<'_>, carver: &Carver<'_>, finish: &mut Finish<'_>) -> Result<(), Failure> {
        if self.in_step {
            self.settle(IN_FLIGHT - 1)?;
        }
        let mut loan = self.producer.loan()?;
        carve(carver, loan.voxels_mut())?;
        finish(loan.voxels_mut())?;
        let header = loan.header_mut();
        place(header, &carver.grid);
        (header.object_id, header.capture_ns, header.sensor_stamp_ns) = (carver.object.into(), of.captured_ns, of.stamp_ns);
        header.frame_id = to_field(of.frame_id);
        let sent = loan.send()?;
        self.pending.insert(sent.sequence, (of.frame.to_owned(), carver.object.into()));
        self.counts[0] += 1;
        self.drain()?;
        Ok(())
    }

    fn frame_ended(&mut self) -> Result<(), Failure> {
        if self.in_step { self.settle(0) } else { self.drain().map(drop) }
    }
}

/// Says where the grid lies in the camera frame.
fn place(header: &mut ObservationHeader, grid: &Grid) {
    let motion = grid.grid_to_camera();
    header.position_m = motion.translation.vector.into();
    header.orientation = motion.rotation.coords.into();
    header.voxel_size_m = grid.voxel_size_m() as f32;
    header.sensor_position_m = grid.camera().coords.map(|metres| metres as f32).into();
}

impl Daemon {
    /// Takes the percepts that have come; how many were ours.
    fn drain(&mut self) -> Result<usize, Failure> {
        let mut count = 0;
        while let Some(percept) = self.subscriber.take_percept()? {
            if percept.producer_id != self.producer.id() {
                continue;
            }
            let Some((frame, object)) = self.pending.remove(&percept.sequence) else { continue };
            count += 1;
            let is_ok = percept.status == PerceptStatus::Ok.code();
            self.counts[if is_ok { 1 } else { 2 }] += 1;
            if !is_ok {
                say!("{frame}: object {object} was refused: {}", from_field(&percept.explanation));
            }
            // What was sent of this object before has been overtaken.
            self.give_up(|sequence, other| sequence < percept.sequence && other == object)?;
        }
        Ok(count)
    }

    /// Waits until no more than `left` observations have no answer. When the daemon has fallen silent, they will have none.
    fn settle(&mut self, left: usize) -> Result<(), Failure> {
        let mut quiet = Instant::now();
        while self.pending.len() > left && !self.stop.load(Ordering::Relaxed) {
            if self.drain()? > 0 {
                quiet = Instant::now();
            } else if quiet.elapsed() > SILENCE {
                return self.give_up(|_, _| true);
            } else if !self.producer.daemon_runs() {
                return Err(Failure::Failed(format!(
                    "the daemon has ended, and left {} observations without an answer",
                    self.pending.len()
                )));
            } else {
                self.subscriber.wait(Duration::from_millis(50))?;
            }
        }
        Ok(())
    }

    /// Says which of the observations that wait will have no answer: those of which `is_lost(sequence, object)`.
    fn give_up(&mut self, is_lost: impl Fn(u64, u64) -> bool) -> Result<(), Failure> {
        let lost: Vec<u64> = self.pending.iter().filter(|(sequence, (_, object))| is_lost(**sequence, *object)).map(|(s, _)| *s).collect();
        for (frame, object) in lost.iter().filter_map(|sequence| self.pending.remove(sequence)).collect::<Vec<_>>() {
            self.counts[3] += 1;
            say!(
                "{frame}: object {object} was not answered: a newer frame of it came first, or there was no time; use a lower --rate, or none"
            );
        }
        Ok(())
    }
}

/// Grids into a folder.
struct Files {
    folder: PathBuf,
    written: u64,
    voxels: Vec<u8>,
}

impl Sink for Files {
    fn take(&mut self, of: &Shown<'_>, carver: &Carver<'_>, finish: &mut Finish<'_>) -> Result<(), Failure> {
        carve(carver, &mut self.voxels)?;
        finish(&mut self.voxels)?;
        let grid = &carver.grid;
        let [x, y, z] = grid.dims();
        let observation = Observation::from_bytes(Dims::new(x, y, z)?, &self.voxels)?;
        let mut bytes = Vec::new();
        write_npy_observation(&mut bytes, &observation)?;
        let mut header = ObservationHeader::default();
        place(&mut header, grid);
        let beside = json!({
            "frame": of.frame,
            "object": carver.object,
            "dims": grid.dims(),
            "voxel_size_m": grid.voxel_size_m(),
            "frame_id": of.frame_id,
            "position_m": header.position_m,
            "orientation": header.orientation,
            "sensor_position_m": grid.camera().coords.as_slice(),
            "fused": of.fused,
        });
        let stem = format!("{}-{}", of.frame, carver.object);
        for (end, content) in [("npy", bytes), ("json", format!("{beside:#}\n").into_bytes())] {
            let path = self.folder.join(format!("{stem}.{end}"));
            std::fs::write(&path, content).map_err(cannot_write(&path))?;
        }
        self.written += 1;
        Ok(())
    }

    fn frame_ended(&mut self) -> Result<(), Failure> {
        Ok(())
    }
}
