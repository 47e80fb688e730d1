//! `beo camera`: a producer that carves the frames of a folder into grids, for a daemon or as files.
//!
//! | file | what |
//! | --- | --- |
//! | `arguments` | the arguments, and the options of grids and observations that they stand for |
//! | `poses` | where the camera was, from a file |
//! | `replay` | plays the frames and counts |
//! | `sink` | where grids go |
//! | `daemon`, `files` | grids into shared memory, and into a folder |
//! | `pictures`, `live` | a picture of each frame, in a folder and for the live view |

mod arguments;
mod daemon;
mod files;
mod live;
mod pictures;
mod poses;
mod replay;
mod sink;

use crate::cli::connecting::Connecting;
use crate::cli::failure::Failure;
use crate::cli::observe::seconds;
use crate::cli::stop;
use crate::frames::{FrameFolder, question_known_side};
use beo_core::grid::Dims;
use beo_ipc::{Producer, Subscriber, SubscriberOptions};

pub use arguments::Camera;
use daemon::Daemon;
use files::Files;
use live::LivePictures;
use pictures::Pictures;
use poses::read_trajectory;
use replay::Replay;

/// Voxels along each side of grids that are written.
const RESOLUTION: usize = 30;

impl Camera {
    /// Runs the command.
    pub fn run(self) -> Result<(), Failure> {
        self.check()?;
        if let Some(question) = self.known_side.and_then(question_known_side) {
            warn!("warning: {question}");
        }
        let frames = FrameFolder::open(&self.folder, self.folder_options()?)?;
        let poses = match &self.trajectory {
            Some(path) => Some(read_trajectory(path, frames.count())?),
            None => None,
        };
        let pictures = self.png.as_deref().map(|folder| Pictures::new(folder, &self.folder)).transpose()?;
        let stop = stop::on_signal()?;
        match &self.out {
            Some(folder) => {
                let dims = Dims::cube(self.resolution.unwrap_or(RESOLUTION)).map_err(|error| Failure::Usage(error.to_string()))?;
                let mut files = Files::new(folder, dims)?;
                let mut replay = Replay::new(&self, &frames, poses, pictures, self.grid_options(dims)?);
                replay.play(&stop, &mut files)?;
                say!("{}, {}", replay.summary(), files.summary());
                replay.outcome(files.written())
            }
            None => {
                let wait = seconds(self.wait)?;
                let connecting = Connecting::within(wait, &self.instance, &stop);
                let subscriber = connecting.open(|| Subscriber::open(&self.instance, &SubscriberOptions::default()))?;
                let status = connecting.status(&subscriber)?;
                let [x, y, z] = status.dims.map(|side| side as usize);
                let dims = Dims::new(x, y, z)?;
                let producer = connecting.open(|| Producer::open(&self.instance, &self.template(status.dims)))?;
                let mut replay = Replay::new(&self, &frames, poses, pictures, self.grid_options(dims)?);
                let pictures = LivePictures::new(&self.instance, producer.id());
                let mut daemon = Daemon::new(producer, subscriber, pictures, stop.clone(), self.rate.is_none(), self.known_side);
                replay.play(&stop, &mut daemon)?;
                let answers = daemon.finish()?;
                say!("{}, {answers}", replay.summary());
                replay.outcome(answers.answered)
            }
        }
    }
}
