//! From an observation's time to its percept in a reader's hands, through real processes: producer, daemon and readers.
//!
//! | file | what |
//! | --- | --- |
//! | `load` | when observations are due, and sending them on time |
//! | `grids` | what is sent |
//! | `scene` | what is seen, where depth images are carved |
//! | `record` | the stamps of one observation |
//! | `producer`, `reader` | what the other processes do |
//! | `processes` | one run: all processes started, listened to, ended |
//! | `summary` | figures of a run, and of several |
//! | `report` | the figures as text |
//! | `figures` | the figures as pictures |
//! | `error` | what can go wrong |
//!
//! **Coordinated omission.** A producer that waits for a slow daemon would send less while it is slow, and measure the slowness once
//! instead of for everything that was due meanwhile. Here the paced loads have a schedule that nothing shifts, and times count from when
//! an observation was *due*, not from when it was written. A producer that goes flat out sends the next observation when it has the answer
//! to the last one: nothing is due, there is nothing to correct, and its percentiles are those of a single client in a loop.

mod error;
mod figures;
mod grids;
mod load;
mod processes;
mod producer;
mod reader;
mod record;
mod report;
mod scene;
mod summary;

pub use error::LatencyError;
pub use figures::save;
pub use grids::Grids;
pub use load::{CameraRate, Load};
pub use processes::measure;
pub use producer::{ProducerPlan, produce};
pub use reader::{ReaderPlan, read};
pub use record::Record;
pub use report::text;
pub use scene::{MOST_ON_TABLE, Scene, objects_on_table};
pub use summary::{LoadReport, Report};

pub use super::wake::Wake;

use beo_ipc::PoseSearch;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// The prior knowledge of the pose that observations carry.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Pose {
    /// Objects stand upright, and it is told so.
    Known,
    /// Turned about the vertical axis.
    Yaw,
    /// In any way in which its class can rest, turned about the vertical axis: of what cameras see.
    Rest,
    /// Turned in any way.
    Full,
    /// Turning about the vertical axis by three degrees from frame to frame; each observation continues the last.
    Track,
}

impl Pose {
    /// The tasks of the observations.
    pub fn search(self) -> PoseSearch {
        match self {
            Self::Known => PoseSearch::Known,
            Self::Yaw | Self::Track => PoseSearch::Yaw,
            Self::Rest => PoseSearch::Rest,
            Self::Full => PoseSearch::Full,
        }
    }
}

/// The measured quantity.
#[derive(Clone, Debug, Serialize)]
pub struct Settings {
    /// The model file that is served.
    pub model: PathBuf,
    /// The prior knowledge of the pose that observations carry.
    pub pose: Pose,
    /// Objects and frame rate of the load `camera`.
    pub camera: CameraRate,
    /// How daemon and readers wake up.
    pub wake: Wake,
    /// Processes that read.
    pub subscribers: usize,
    /// Length of each run, after a warm-up.
    pub seconds: f64,
    /// Runs of each load, each with fresh processes.
    pub repeat: usize,
}
