//! Depth frames from files and from the synthetic camera. The geometry, from a frame to the grids of its objects, is the crate
//! `beo_camera`'s.
//!
//! | file | what |
//! | --- | --- |
//! | `folder`, `captured` | the frames of a folder |
//! | `images` | images of depth, labels and masks |
//! | `camera_files` | cameras by ROS, Kalibr, Open3D, librealsense |
//! | `scene_camera`, `trajectory` | what else is known of the camera: BOP, TUM |
//! | `drawing` | a depth image with the objects in it |
//! | `plausibility` | depths and sizes that no household scene has |
//! | `synthetic` | a camera that renders depth of meshes and voxels, with a sensor's faults |
//!
//! Every `parse_*` function takes untrusted bytes: it neither panics nor allocates more than a small multiple of their number and of the
//! image that they hold.

mod camera_files;
mod captured;
mod drawing;
mod folder;
mod images;
mod plausibility;
mod scene_camera;
pub mod synthetic;
mod trajectory;

pub use camera_files::{CameraChoice, CameraInfo, parse_camera_info};
pub use captured::{CapturedFrame, SizeError};
pub use drawing::draw_depth;
pub use folder::{FolderError, FolderOptions, FrameFolder};
pub use images::{ColourLabels, DepthAlong, DepthUnit, Image, MILLIMETRE, MOST_PIXELS, Raster, VoidLabels, farthest_m};
pub use images::{parse_jpeg_image, parse_npy_image, parse_png_image, parse_tiff_image};
pub use plausibility::{question_depth, question_known_side, question_size};
pub use scene_camera::{SceneCamera, parse_scene_camera};
pub use trajectory::{StampedPose, parse_trajectory};
