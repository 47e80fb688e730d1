//! `beo observe`: a camera-side producer that writes observations of shapes into shared memory.

use super::arguments::PoseArgument;
use super::connecting::Connecting;
use super::failure::Failure;
use super::shapes::{CameraArguments, MeshArguments, Source, ViewArgument};
use super::stop;
use beo_core::grid::Dims;
use beo_ipc::{InstanceName, ObservationHeader, PoseSearch, Producer, Subscriber, SubscriberOptions};
use clap::Args;
use std::path::PathBuf;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

/// Write observations of shapes into shared memory, as a camera would
#[derive(Args)]
pub struct Observe {
    /// Shapes, or with --view none grids of bytes
    #[arg(required = true)]
    files: Vec<PathBuf>,
    /// Instance of the daemon
    #[arg(long, default_value_t = InstanceName::default(), value_name = "NAME")]
    instance: InstanceName,
    /// The view of a file
    #[arg(long, value_enum, default_value_t = ViewArgument::Top)]
    view: ViewArgument,
    /// The prior knowledge of the pose
    #[arg(long, value_enum, default_value_t = PoseArgument::Known)]
    pose: PoseArgument,
    /// Turn the object by this much about the vertical axis from one of its observations to the next
    #[arg(long, default_value_t = 0.0, value_name = "DEGREES", allow_negative_numbers = true)]
    turn: f64,
    /// Say that each observation of an object continues the one before, so that its last pose narrows the search
    #[arg(long)]
    track: bool,
    /// Observations per second
    #[arg(long, default_value_t = 30.0, value_name = "HZ")]
    rate: f64,
    /// Observations in all, cycling through the files [default: each file once]
    #[arg(long, value_name = "N")]
    count: Option<u64>,
    /// Seconds to wait for a daemon
    #[arg(long, default_value_t = 10.0, value_name = "SECONDS")]
    wait: f64,
    #[command(flatten)]
    camera: CameraArguments,
    #[command(flatten)]
    mesh: MeshArguments,
}

/// A daemon that has not answered for so long has nothing more to answer.
const SILENCE: Duration = Duration::from_secs(2);

impl Observe {
    /// Runs the command.
    pub fn run(self) -> Result<(), Failure> {
        if !(self.rate > 0.0 && self.rate <= 1e6) {
            return Err(Failure::Usage(format!("--rate {}: use a number above 0, at most 1000000", self.rate)));
        }
        if !self.turn.is_finite() || self.turn != 0.0 && self.view == ViewArgument::None {
            return Err(Failure::Usage(format!("--turn {}: use a finite angle, and complete shapes (--view top or camera)", self.turn)));
        }
        let wait = seconds(self.wait)?;
        let stop = stop::on_signal()?;
        let connecting = Connecting::within(wait, &self.instance, &stop);
        let subscriber = connecting.open(|| Subscriber::open(&self.instance, &SubscriberOptions::default()))?;
        let status = connecting.status(&subscriber)?;
        let [x, y, z] = status.dims.map(|side| side as usize);
        let dims = Dims::new(x, y, z)?;
        let read = self.mesh.read_options_of(self.view, dims)?;
        let sources = self.files.iter().map(|file| self.view.source(file, &read, &self.camera)).collect::<Result<Vec<Source>, _>>()?;
        if let Some((file, found)) = self.files.iter().zip(&sources).find(|(_, source)| source.dims() != dims) {
            let found = found.dims();
            return Err(Failure::Failed(format!("{} is a grid of {found}, the daemon's model is for {dims}", file.display())));
        }
        let mut template = ObservationHeader::new(status.dims);
        template.pose_search = match self.pose {
            PoseArgument::Known => PoseSearch::Known.code(),
            PoseArgument::Yaw => PoseSearch::Yaw.code(),
            PoseArgument::Full => PoseSearch::Full.code(),
            PoseArgument::Rest => PoseSearch::Rest.code(),
        };
        match self.view {
            ViewArgument::Top => template.view = beo_ipc::View::TopDown.code(),
            ViewArgument::Camera => {
                template.view = beo_ipc::View::Camera.code();
                template.outside = beo_ipc::Outside::Unknown.code();
            }
            ViewArgument::None => (),
        }
        let producer = connecting.open(|| Producer::open(&self.instance, &template))?;
        let count = self.count.unwrap_or(self.files.len() as u64);
        let period = Duration::from_secs_f64(1.0 / self.rate);
        let mut next = Instant::now();
        let (mut sent, mut answered) = (0, 0);
        while sent < count && !stop.load(Ordering::Relaxed) {
            let (round, which) = (sent / sources.len() as u64, (sent % sources.len() as u64) as usize);
            let mut loan = producer.loan()?;
            sources[which].turned_by((self.turn * round as f64).to_radians()).write(loan.voxels_mut());
            // Each file is an object of its own: none replaces another while the daemon is busy.
            let header = loan.header_mut();
            header.object_id = which as u64 + 1;
            header.continued_object_id = header.object_id;
            header.continues = u32::from(self.track);
            if let Some(camera) = sources[which].camera() {
                // A voxel is a metre where the scale is not known.
                header.sensor_position_m = [camera.x, camera.y, camera.z].map(|v| v as f32);
            }
            loan.send()?;
            sent += 1;
            next += period;
            while let Some(rest) = next.checked_duration_since(Instant::now()).filter(|_| sent < count) {
                // Reads all the time: percepts of others come too, and no more than some are kept.
                subscriber.wait(rest.min(Duration::from_millis(50)))?;
                answered += drain(&subscriber, producer.id())?;
                if stop.load(Ordering::Relaxed) {
                    break;
                }
            }
            answered += drain(&subscriber, producer.id())?;
        }
        // The memory of what was sent goes with this process: stay until the daemon has answered, or has fallen silent because
        // newer observations of the same object replaced those that are missing.
        let mut quiet = Instant::now();
        while answered < sent && quiet.elapsed() < SILENCE && !stop.load(Ordering::Relaxed) {
            subscriber.wait(Duration::from_millis(50))?;
            let more = drain(&subscriber, producer.id())?;
            if more > 0 {
                (answered, quiet) = (answered + more, Instant::now());
            }
        }
        match subscriber.missed() {
            0 => say!("sent {sent} observations, {answered} answered"),
            missed => say!("sent {sent} observations, {answered} answered; {missed} percepts came faster than they were read"),
        }
        Ok(())
    }
}

/// Percepts of one producer that have arrived.
fn drain(subscriber: &Subscriber, producer: u64) -> Result<u64, Failure> {
    let mut count = 0;
    while let Some(percept) = subscriber.take_percept()? {
        count += u64::from(percept.producer_id == producer);
    }
    Ok(count)
}

/// A flag's seconds as a duration.
pub fn seconds(value: f64) -> Result<Duration, Failure> {
    Duration::try_from_secs_f64(value)
        .ok()
        .filter(|d| d.as_secs() <= 86_400)
        .ok_or_else(|| Failure::Usage(format!("--wait {value}: use 0 to 86400 seconds")))
}
