//! Arguments of `beo camera`: what they are, which values they take, and the options of grids and observations that they stand for.

use crate::cli::arguments::PoseArgument;
use crate::cli::failure::Failure;
use beo_camera::{BelowSupport, GridOptions};
use beo_camera::{Placement, SensorModel};
use beo_core::grid::Dims;
use beo_ipc::limits::NAME_LEN;
use beo_ipc::{InstanceName, ObservationHeader, PoseSearch};
use clap::{Args, ValueEnum};
use nalgebra::{Unit, Vector3};
use std::path::PathBuf;

/// Carve depth images with object masks into grids, for a daemon or as files
#[derive(Args)]
#[command(after_help = "\
DIR holds NAME_depth.png with NAME_label.png or NAME_mask.png (or .npy, .tif) and NAME_camera_info.yaml or camera_info.yaml; or \
folders depth and label or mask with files of equal names; or is a scene in BOP's format. Each object of each frame ends as an \
observation, or as a line that says why there is none.")]
pub struct Camera {
    /// Folder of frames
    pub(super) folder: PathBuf,
    /// Instance of the daemon
    #[arg(long, default_value_t = InstanceName::default(), value_name = "NAME")]
    pub(super) instance: InstanceName,
    /// Frames per second [default: the next one when all objects of the last are answered]
    #[arg(long, value_name = "HZ")]
    pub(super) rate: Option<f64>,
    /// Frames in all, from the first again after the last [default: each once]
    #[arg(long, value_name = "N")]
    pub(super) count: Option<u64>,
    /// Go on until interrupted, from the first frame again after the last
    #[arg(long = "loop", conflicts_with = "count")]
    pub(super) without_end: bool,
    /// Seconds to wait for a daemon
    #[arg(long, default_value_t = 10.0, value_name = "SECONDS")]
    pub(super) wait: f64,
    /// Metres per unit of depth images of whole numbers [default: 0.001, or what a BOP scene says]
    #[arg(long, value_name = "METRES")]
    pub(super) depth_scale: Option<f64>,
    /// Camera of all frames, in place of the folder's own
    #[arg(long, value_name = "FILE")]
    pub(super) camera_info: Option<PathBuf>,
    /// Direction in which things fall, in the camera frame (x right, y down, z forward) [default: from the support plane]
    #[arg(long, value_name = "X,Y,Z", value_parser = direction, allow_hyphen_values = true)]
    pub(super) gravity: Option<Unit<Vector3<f64>>>,
    /// Label of the plane that objects stand on, which is no object; otherwise it is looked for where there is no label
    #[arg(long, value_name = "LABEL")]
    pub(super) support_label: Option<u16>,
    /// What is known below the support plane
    #[arg(long, value_enum, default_value_t = BelowArgument::Empty, value_name = "WHAT")]
    pub(super) below_support: BelowArgument,
    /// Longest side of the objects, if all have the same
    #[arg(long, value_name = "METRES")]
    pub(super) known_side: Option<f64>,
    /// Standard deviation of a depth reading at depth 0, metres
    #[arg(long, value_name = "METRES", default_value_t = SensorModel::default().constant_m)]
    pub(super) sensor_constant: f64,
    /// How it grows with the squared depth, 1/metres
    #[arg(long, value_name = "PER_METRE", default_value_t = SensorModel::default().quadratic_per_m)]
    pub(super) sensor_quadratic: f64,
    /// Half the width of the band in which voxels count as filled, in standard deviations
    #[arg(long, value_name = "N", default_value_t = SensorModel::default().deviations)]
    pub(super) sensor_deviations: f64,
    /// What is known of the pose
    #[arg(long, value_enum, default_value_t = PoseArgument::Rest)]
    pub(super) pose: PoseArgument,
    /// Name of the camera's frame [default: that of the camera_info's header, or `camera`]
    #[arg(long, value_name = "NAME")]
    pub(super) frame_id: Option<String>,
    /// Objects do not move: each frame adds to what the ones before saw of them. Needs --trajectory or a BOP scene with poses
    #[arg(long, conflicts_with = "without_end")]
    pub(super) fuse: bool,
    /// Where the camera was: a line `stamp tx ty tz qx qy qz qw` (camera to world) for each frame, in order
    #[arg(long, value_name = "FILE")]
    pub(super) trajectory: Option<PathBuf>,
    /// Write each grid into this folder, as .npy (0 empty, 1 filled, 255 unknown) and .json, in place of a daemon
    #[arg(long, value_name = "DIR", conflicts_with_all = ["instance", "rate", "wait", "count", "without_end"])]
    pub(super) out: Option<PathBuf>,
    /// Voxels along each side of the grids [default: 30]
    #[arg(long, value_name = "N", requires = "out")]
    pub(super) resolution: Option<usize>,
}

/// What is known of voxels below the support plane.
#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum BelowArgument {
    /// Nothing of the object is there
    Empty,
    /// What the image says
    Unknown,
}

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
    /// Refuses values out of range.
    pub(super) fn check(&self) -> Result<(), Failure> {
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

    /// How frames become grids of `dims`.
    pub(super) fn grid_options(&self, dims: Dims) -> Result<GridOptions, Failure> {
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
    pub(super) fn template(&self, dims: [u32; 3]) -> ObservationHeader {
        let pose = match self.pose {
            PoseArgument::Known => PoseSearch::Known,
            PoseArgument::Yaw => PoseSearch::Yaw,
            PoseArgument::Full => PoseSearch::Full,
            PoseArgument::Rest => PoseSearch::Rest,
        };
        ObservationHeader { pose_search: pose.code(), ..ObservationHeader::new(dims) }
    }
}
