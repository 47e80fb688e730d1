//! The camera's side: depth images in, partial grids out. The geometry is the crate `beo_camera`'s; here is what needs files, shapes and
//! threads.
//!
//! | file | what |
//! | --- | --- |
//! | `grids` | from a frame to the grids of its objects |
//! | `carving` | a grid carved by all threads |
//! | `simulation` | what a camera sees of a complete voxel object |
//! | `fused` | several views of objects that do not move |
//! | `folder`, `captured` | the frames of a folder |
//! | `images` | images of depth, labels and masks |
//! | `camera_files` | cameras by ROS, Kalibr, Open3D, librealsense |
//! | `scene_camera`, `trajectory` | what else is known of the camera: BOP, TUM |
//! | `plausibility` | depths and sizes that no household scene has |
//! | `synthetic` | a camera that renders depth of meshes and voxels, with a sensor's faults |
//!
//! Every `parse_*` function takes untrusted bytes: it neither panics nor allocates more than a small multiple of their number and of the
//! image that they hold.

mod camera_files;
mod captured;
mod carving;
mod folder;
mod fused;
mod grids;
mod images;
mod plausibility;
mod scene_camera;
pub mod simulation;
pub mod synthetic;
mod trajectory;

pub use camera_files::{CameraChoice, CameraInfo, parse_camera_info};
pub use captured::{CapturedFrame, SizeError};
pub use carving::carve;
pub use folder::{FolderError, FolderOptions, FrameFolder};
pub use fused::FusedObjects;
pub use grids::{BelowSupport, FrameGrids, GridOptions, NoGrid, ObjectGrid, lay_grids};
pub use images::{ColourLabels, DepthAlong, DepthUnit, Image, MILLIMETRE, MOST_PIXELS, Raster, VoidLabels, farthest_m};
pub use images::{parse_jpeg_image, parse_npy_image, parse_png_image, parse_tiff_image};
pub use plausibility::{question_depth, question_known_side, question_size};
pub use scene_camera::{SceneCamera, parse_scene_camera};
pub use trajectory::{StampedPose, parse_trajectory};
