//! One frame in memory: depth, labels and camera, all of one size.

use super::Image;
use beo_camera::{Frame, Intrinsics};
use nalgebra::Isometry3;

/// A depth image with the label of the object of each pixel, and the camera that took it.
#[derive(Clone, Debug, PartialEq)]
pub struct CapturedFrame {
    name: String,
    intrinsics: Intrinsics,
    depth: Vec<f32>,
    labels: Vec<u16>,
    /// Takes the camera's frame to the world's, metres, where it is known.
    pub camera_to_world: Option<Isometry3<f64>>,
    /// Name of the camera's frame, where it is known.
    pub frame_id: Option<String>,
    /// Whether there is a label image or masks: where there are none, all labels are 0.
    pub is_labelled: bool,
    /// Labels of objects that have no pixel at all: their masks are empty, or nearer ones lie over them.
    pub hidden: Vec<u16>,
    /// Metres per unit of the depth image as its file had it.
    pub metres_per_unit: f64,
    /// Median depth of the labelled pixels, or of all where none has a label, metres; of the readings before any was left out as out of
    /// range.
    pub typical_depth_m: Option<f64>,
}

/// An image of another size than the camera's.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "the {what} image has {} × {} pixels, the camera {} × {}: give the camera_info of the depth images' own stream, with binning and roi if they were cut",
    found[0], found[1], camera[0], camera[1]
)]
pub struct SizeError {
    /// Which image.
    pub what: &'static str,
    /// Its width and height.
    pub found: [u32; 2],
    /// Those of the camera.
    pub camera: [u32; 2],
}

impl CapturedFrame {
    /// A frame of that name: `depth` in metres (0: no reading), `labels` 0 where there is no object.
    ///
    /// # Errors
    /// [`SizeError`] unless both images have the camera's size.
    pub fn new(name: String, intrinsics: Intrinsics, depth: Image<f32>, labels: Image<u16>) -> Result<Self, SizeError> {
        let camera = [intrinsics.width(), intrinsics.height()];
        for (what, found) in [("depth", depth.size()), ("label", labels.size())] {
            if found != camera {
                return Err(SizeError { what, found, camera });
            }
        }
        let (depth, labels) = (depth.into_values(), labels.into_values());
        Ok(Self {
            name,
            intrinsics,
            depth,
            labels,
            camera_to_world: None,
            frame_id: None,
            is_labelled: true,
            hidden: Vec::new(),
            metres_per_unit: 1.0,
            typical_depth_m: None,
        })
    }

    /// Its name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The images and the camera.
    pub fn frame(&self) -> Frame<'_> {
        Frame::new(&self.intrinsics, &self.depth, &self.labels).expect("sizes were checked")
    }
}
