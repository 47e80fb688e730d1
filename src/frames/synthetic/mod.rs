//! A synthetic depth camera: depth and label images of scenes of meshes and of voxels, from any viewpoint, with a sensor's faults.
//!
//! | file | what |
//! | --- | --- |
//! | `viewpoint` | where the camera stands and what it looks at |
//! | `image` | depth and labels of one view |
//! | `raster` | scenes of meshes |
//! | `voxels` | objects of voxels |
//! | `noise` | what a real sensor adds and misses |
//! | `mask` | what the masks of people and detectors do |
//! | `circle` | a camera that circles an object on a table |
//! | `files` | views as files |
//!
//! Everything is deterministic, whatever the number of threads. A view of 640 × 480 pixels with a handful of objects of some thousand
//! triangles takes a few milliseconds.

mod circle;
mod files;
mod image;
mod mask;
mod noise;
mod raster;
mod viewpoint;
mod voxels;

pub use circle::{Circle, CircleView};
pub use files::{FrameWriter, WriteError};
pub use image::DepthImage;
pub use mask::MaskFaults;
pub use noise::{NoiseModel, NoiseModelError};
pub use raster::{Scene, SyntheticCamera};
pub use viewpoint::{look_at, orbit};
pub use voxels::depth_of_occupancy;
