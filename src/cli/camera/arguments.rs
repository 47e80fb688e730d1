//! Arguments of `beo camera`: what they are, which values they take, and the options of grids and observations that they stand for.

use crate::cli::arguments::PoseArgument;
use crate::cli::failure::Failure;
use crate::frames::{DepthAlong, FolderOptions, Unlabelled, VoidLabels, farthest_m};
use beo_camera::{BelowSupport, GridOptions, ObjectGrid, Placement, Segmentation, SensorModel};
use beo_core::grid::Dims;
use beo_ipc::limits::NAME_LEN;
use beo_ipc::{InstanceName, ObservationHeader, PoseSearch};
use clap::{Args, ValueEnum};
use nalgebra::{Unit, Vector3};
use std::path::PathBuf;

/// Carve depth images into a grid for each object, for a daemon or as files
#[derive(Args)]
#[command(after_help = "\
DIR holds NAME_depth.png with NAME_label.png (a number for each object) or NAME_mask.png (one object); or folders depth and label, mask or \
masks with files of equal names, as FoundationPose has them; or is a scene in BOP's format. Images are .png, .npy or .tif, masks also .jpg. \
The camera is camera_info.yaml, cam_K.txt, camera_intrinsic.json, intrinsics.json or camchain.yaml: ROS, Kalibr, Open3D, RealSense; \
docs/cameras.md shows each. Each object of each frame ends as an observation, or as a line that says why there is none. The exit code is 1 \
if there was no answer at all.")]
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
    /// Metres per unit of depth images of whatever type [default: 0.001 of whole numbers, 1 of floating-point ones, or what a BOP scene
    /// says]
    #[arg(long, value_name = "METRES")]
    pub(super) depth_scale: Option<f64>,
    /// The distance that depth images measure: along the optical axis, or the distance along each pixel's ray
    #[arg(long, value_enum, default_value_t = AlongArgument::Axis, value_name = "WHAT")]
    pub(super) depth_along: AlongArgument,
    /// Values of depth images, in their own units, that are no reading, besides 0, negative ones and the largest of a type of whole numbers
    #[arg(long, value_name = "VALUE", value_delimiter = ',', allow_hyphen_values = true)]
    pub(super) no_reading: Vec<f64>,
    /// Nearest depth that is a reading, metres
    #[arg(long, value_name = "METRES", default_value_t = 0.0)]
    pub(super) near: f64,
    /// Farthest one, metres [default: where a reading's deviation is 2 % of it, which for the default sensor is 10.5]
    #[arg(long, value_name = "METRES")]
    pub(super) far: Option<f64>,
    /// Camera of all frames, in place of the folder's own: the file of ROS, Kalibr, Open3D or RealSense, or a matrix of nine numbers
    #[arg(long, value_name = "FILE")]
    pub(super) camera_info: Option<PathBuf>,
    /// Which camera of a file that describes several, as cam1 of Kalibr's or Color of RealSense's
    #[arg(long, value_name = "NAME")]
    pub(super) camera_name: Option<String>,
    /// The images are rectified: the projection matrix P of camera_info holds, and there is no distortion
    #[arg(long)]
    pub(super) rectified: bool,
    /// Labels that mark no object but pixels nobody labelled, or `none` [default: 255 of 8 bits, 65535 of 16, where there are other labels]
    #[arg(long, value_name = "LABEL", value_delimiter = ',')]
    pub(super) ignore_label: Vec<IgnoreArgument>,
    /// Direction in which things fall, in the camera frame (x right, y down, z forward) [default: from the support plane]
    #[arg(long, value_name = "X,Y,Z", value_parser = direction, allow_hyphen_values = true)]
    pub(super) gravity: Option<Unit<Vector3<f64>>>,
    /// Label of the plane that objects stand on, which is no object; otherwise it is looked for where there is no label
    #[arg(long, value_name = "LABEL")]
    pub(super) support_label: Option<u16>,
    /// Where the objects come from: the label images or masks, or what stands on a plane of the depth images [default: labels where a
    /// frame of the folder has them, else table]
    #[arg(long, value_enum, value_name = "BY")]
    pub(super) segment: Option<SegmentArgument>,
    /// The assumption about voxels below the support plane
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
    /// The prior knowledge of the pose. By default objects rest on their support in any way that the model has learned, or stand upright
    /// if it has learned none
    #[arg(long, value_enum, default_value_t = PoseArgument::Rest)]
    pub(super) pose: PoseArgument,
    /// Name of the camera's frame [default: that of the camera_info's header, or `camera`]
    #[arg(long, value_name = "NAME")]
    pub(super) frame_id: Option<String>,
    /// Which object of the frame before an object continues: the daemon filters class, pose and size of one over its frames
    #[arg(
        long,
        value_enum,
        default_value_t = TrackArgument::Place,
        default_missing_value = "place",
        num_args = 0..=1,
        require_equals = true,
        value_name = "BY",
        conflicts_with = "out"
    )]
    pub(super) track: TrackArgument,
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
    /// Write a picture of each frame into this folder, FRAME.png: its depth, the readings that were taken and left, planes and grids
    #[arg(long, value_name = "DIR")]
    pub(super) png: Option<PathBuf>,
}

/// The distance that depth images measure.
#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum AlongArgument {
    /// The coordinate along the optical axis
    Axis,
    /// The distance from the camera
    Ray,
}

/// A label that is no object.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum IgnoreArgument {
    None,
    Label(u16),
}

impl std::str::FromStr for IgnoreArgument {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        match text {
            "none" => Ok(Self::None),
            label => label.parse().map(Self::Label).map_err(|_| "use a label from 0 to 65535, or none"),
        }
    }
}

/// Which object continues which.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum TrackArgument {
    /// The one that was in its place in the frame before, whatever its label
    Place,
    /// The one of its label, wherever it was and however long ago
    Label,
    /// None: each frame is answered alone
    None,
}

impl TrackArgument {
    /// The object that an object continues, if it does.
    pub(super) fn continued(self, laid: &ObjectGrid) -> Option<u16> {
        match self {
            Self::Place => laid.continues,
            Self::Label => Some(laid.object),
            Self::None => None,
        }
    }
}

/// Where objects come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum SegmentArgument {
    /// The objects that stand on a plane of the depth image
    Table,
    /// The label image or masks
    Labels,
}

impl SegmentArgument {
    pub(super) fn segmentation(self) -> Segmentation {
        match self {
            Self::Table => Segmentation::Table,
            Self::Labels => Segmentation::Labels,
        }
    }
}

/// The assumption about voxels below the support plane.
#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum BelowArgument {
    /// Nothing of the object is there
    Empty,
    /// As the image says
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
        if !(self.near >= 0.0 && self.near.is_finite()) {
            return Err(Failure::Usage(format!("--near {}: use metres from 0", self.near)));
        }
        if let Some(far) = self.far.filter(|far| far.is_nan() || *far <= self.near) {
            return Err(Failure::Usage(format!("--far {far}: use metres above --near, which is {}", self.near)));
        }
        if let Some(value) = self.no_reading.iter().find(|value| !value.is_finite()) {
            return Err(Failure::Usage(format!("--no-reading {value}: use a number; what is not finite is no reading anyway")));
        }
        if self.segment == Some(SegmentArgument::Table) && (self.support_label.is_some() || !self.ignore_label.is_empty()) {
            return Err(Failure::Usage(
                "--segment table looks at no labels: leave out --support-label and --ignore-label, or use --segment labels".into(),
            ));
        }
        if self.count == Some(0) {
            return Err(Failure::Usage("--count 0: use at least 1".into()));
        }
        Ok(())
    }

    fn sensor(&self) -> Result<SensorModel, Failure> {
        SensorModel::new(self.sensor_constant, self.sensor_quadratic, self.sensor_deviations)
            .map_err(|error| Failure::Usage(error.to_string()))
    }

    /// How the files of the folder are read.
    pub(super) fn folder_options(&self) -> Result<FolderOptions, Failure> {
        let far = match self.far {
            Some(far) => far,
            None => farthest_m(&self.sensor()?),
        };
        let label = |argument: &IgnoreArgument| if let IgnoreArgument::Label(label) = argument { Some(*label) } else { None };
        Ok(FolderOptions {
            metres_per_unit: self.depth_scale,
            depth_along: match self.depth_along {
                AlongArgument::Axis => DepthAlong::Axis,
                AlongArgument::Ray => DepthAlong::Ray,
            },
            no_reading: self.no_reading.clone(),
            range_m: [self.near, far],
            camera_info: self.camera_info.clone(),
            camera_name: self.camera_name.clone(),
            is_rectified: self.rectified,
            unlabelled: match self.segment {
                None => Unlabelled::TakenIfAllAre,
                Some(SegmentArgument::Table) => Unlabelled::Taken,
                Some(SegmentArgument::Labels) => Unlabelled::Missing,
            },
            void_labels: match &self.ignore_label[..] {
                [] => VoidLabels::Customary,
                these => VoidLabels::These(these.iter().filter_map(label).collect()),
            },
        })
    }

    /// How frames become grids of `dims`.
    pub(super) fn grid_options(&self, dims: Dims) -> Result<GridOptions, Failure> {
        Ok(GridOptions {
            sensor: self.sensor()?,
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

    /// The part of the header that all observations have in common.
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

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[derive(Parser)]
    struct Program {
        #[command(flatten)]
        camera: Camera,
    }

    fn camera(arguments: &[&str]) -> Result<Camera, String> {
        let all = ["beo", "DIR"].iter().chain(arguments);
        Program::try_parse_from(all).map(|program| program.camera).map_err(|error| error.to_string())
    }

    fn usage(arguments: &[&str]) -> String {
        match camera(arguments).unwrap().check() {
            Err(Failure::Usage(line)) => line,
            other => panic!("{arguments:?}: {other:?}"),
        }
    }

    #[test]
    fn gravity_is_a_direction_of_whatever_length() {
        let down = camera(&["--gravity", "0, -3,4"]).unwrap().gravity.unwrap();
        assert!((down.into_inner() - Vector3::new(0.0, -0.6, 0.8)).norm() < 1e-12);
        for text in ["0,0,0", "1,2", "1,2,x", "nan,0,1"] {
            assert!(camera(&["--gravity", text]).is_err(), "{text}");
        }
    }

    #[test]
    fn values_out_of_range_are_wrong_usage() {
        assert!(usage(&["--rate", "0"]).contains("--rate 0: use a number above 0"));
        assert!(usage(&["--depth-scale=-1"]).contains("--depth-scale -1: use metres"));
        assert!(usage(&["--known-side", "nan"]).contains("--known-side NaN"));
        assert!(usage(&["--count", "0"]).contains("at least 1"));
        assert!(usage(&["--far", "0.5", "--near", "0.6"]).contains("above --near, which is 0.6"));
        assert!(usage(&["--near=-1"]).contains("from 0"));
        assert!(usage(&["--no-reading", "inf"]).contains("not finite is no reading anyway"));
        assert!(camera(&["--ignore-label", "70000"]).err().unwrap().contains("a label from 0 to 65535, or none"));
        assert!(camera(&[]).unwrap().check().is_ok());
    }

    #[test]
    fn flags_become_the_options_of_the_folder() {
        let options = |arguments: &[&str]| camera(arguments).unwrap().folder_options().unwrap();
        let usual = options(&[]);
        assert_eq!((usual.metres_per_unit, usual.depth_along, usual.void_labels), (None, DepthAlong::Axis, VoidLabels::Customary));
        assert!((usual.range_m[1] - 10.476).abs() < 1e-3 && usual.range_m[0] == 0.0);
        let other = options(&["--depth-along", "ray", "--no-reading", "9999,-1", "--near", "0.2", "--far", "3", "--ignore-label", "7,9"]);
        assert_eq!((other.depth_along, &other.no_reading[..], other.range_m), (DepthAlong::Ray, &[9999.0, -1.0][..], [0.2, 3.0]));
        assert_eq!(other.void_labels, VoidLabels::These(vec![7, 9]));
        assert_eq!(options(&["--ignore-label", "none"]).void_labels, VoidLabels::These(vec![]));
        assert_eq!(options(&["--sensor-quadratic", "0"]).range_m[1], f64::INFINITY);
    }
}
