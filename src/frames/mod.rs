//! Depth frames from files and from the synthetic camera. The geometry, from a frame to the grids of its objects, is the crate
//! `beo_camera`'s.
//!
//! | file | what |
//! | --- | --- |
//! | `folder`, `captured` | the frames of a folder |
//! | `image`, `png_image`, `npy_image`, `tiff_image` | images of depth and labels |
//! | `camera_info`, `scene_camera`, `trajectory` | what is known of the camera: ROS, BOP, TUM |
//! | `drawing` | a depth image with the objects in it |
//! | `synthetic` | a camera that renders depth of meshes and voxels, with a sensor's faults |
//!
//! Every `parse_*` function takes untrusted bytes: it neither panics nor allocates more than a small multiple of their number and of the
//! image that they hold.

mod camera_info;
mod captured;
mod drawing;
mod folder;
mod image;
mod npy_image;
mod png_image;
mod scene_camera;
pub mod synthetic;
mod tiff_image;
mod trajectory;

pub use camera_info::{CameraInfo, parse_camera_info};
pub use captured::{CapturedFrame, SizeError};
pub use drawing::draw_depth;
pub use folder::{FolderError, FolderOptions, FrameFolder, MILLIMETRE};
pub use image::{Image, MOST_PIXELS, Raster};
pub use npy_image::parse_npy_image;
pub use png_image::parse_png_image;
pub use scene_camera::{SceneCamera, parse_scene_camera};
pub use tiff_image::parse_tiff_image;
pub use trajectory::{StampedPose, parse_trajectory};
