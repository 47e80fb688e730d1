//! The camera's side: depth images in, partial grids out. The geometry is the crate `beo_camera`'s; here is what needs files, shapes and
//! threads.
//!
//! | file | what |
//! | --- | --- |
//! | `grids` | from a frame to the grids of its objects |
//! | `observation` | what an observation says of such a grid |
//! | `carving` | a grid carved by all threads |
//! | `simulation` | what a camera sees of a complete voxel object |
//! | `fused` | several views of objects that do not move |
//! | `folder`, `captured` | the frames of a folder |
//! | `image`, `png_image`, `npy_image`, `tiff_image` | images of depth and labels |
//! | `camera_info`, `scene_camera`, `trajectory` | what is known of the camera: ROS, BOP, TUM |
//! | `simulation` | what a camera sees of a complete voxel object |
//! | `synthetic` | a camera that renders depth of meshes and voxels, with a sensor's faults |
//!
//! Every `parse_*` function takes untrusted bytes: it neither panics nor allocates more than a small multiple of their number and of the
//! image that they hold.

mod camera_info;
mod captured;
mod carving;
mod folder;
mod fused;
mod grids;
mod image;
mod npy_image;
mod observation;
mod png_image;
mod scene_camera;
pub mod simulation;
pub mod synthetic;
mod tiff_image;
mod trajectory;

pub use camera_info::{CameraInfo, parse_camera_info};
pub use captured::{CapturedFrame, SizeError};
pub use carving::carve;
pub use folder::{FolderError, FolderOptions, FrameFolder, MILLIMETRE};
pub use fused::FusedObjects;
pub use grids::{BelowSupport, FrameGrids, GridOptions, NoGrid, ObjectGrid, lay_grids};
pub use image::{Image, MOST_PIXELS, Raster};
pub use npy_image::parse_npy_image;
pub use observation::observation_of;
pub use png_image::parse_png_image;
pub use scene_camera::{SceneCamera, parse_scene_camera};
pub use tiff_image::parse_tiff_image;
pub use trajectory::{StampedPose, parse_trajectory};
