//! One depth image with its labels.

use crate::Intrinsics;
use nalgebra::Point3;

/// A depth image and which object each pixel belongs to, both row by row.
#[derive(Clone, Copy, Debug)]
pub struct Frame<'a> {
    intrinsics: &'a Intrinsics,
    depth: &'a [f32],
    labels: &'a [u16],
}

/// Images that do not fit the camera.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum FrameError {
    /// The number of values is not the number of pixels.
    #[error("the {what} image has {found} pixels, the camera {width} × {height}")]
    Size {
        /// Which image.
        what: &'static str,
        /// Its number of values.
        found: usize,
        /// Pixels of a row.
        width: u32,
        /// Rows.
        height: u32,
    },
}

impl<'a> Frame<'a> {
    /// `depth` along the optical axis in metres (0, negative or not finite: no reading) and the label of the object of each pixel
    /// (0: none).
    pub fn new(intrinsics: &'a Intrinsics, depth: &'a [f32], labels: &'a [u16]) -> Result<Self, FrameError> {
        let (width, height) = (intrinsics.width(), intrinsics.height());
        let pixels = width as usize * height as usize;
        for (what, found) in [("depth", depth.len()), ("label", labels.len())] {
            if found != pixels {
                return Err(FrameError::Size { what, found, width, height });
            }
        }
        Ok(Self { intrinsics, depth, labels })
    }

    /// The camera.
    pub fn intrinsics(&self) -> &'a Intrinsics {
        self.intrinsics
    }

    /// All labels, row by row.
    pub fn labels(&self) -> &'a [u16] {
        self.labels
    }

    /// All readings as they came, row by row.
    pub fn depths(&self) -> &'a [f32] {
        self.depth
    }

    /// The reading of a pixel, metres.
    #[inline]
    pub fn depth(&self, pixel: usize) -> Option<f64> {
        let depth = self.depth[pixel];
        Self::is_reading(depth).then(|| f64::from(depth))
    }

    /// Whether a value of the depth image is a reading.
    #[inline]
    pub(crate) fn is_reading(depth: f32) -> bool {
        depth > 0.0 && depth < f32::INFINITY
    }

    /// The label of a pixel.
    #[inline]
    pub fn label(&self, pixel: usize) -> u16 {
        self.labels[pixel]
    }

    /// The point that a pixel shows, in the camera frame; `None` without a reading, and where the lens shows nothing.
    pub fn point(&self, pixel: usize) -> Option<Point3<f64>> {
        let width = self.intrinsics.width() as usize;
        let depth = self.depth(pixel)?;
        Some(Point3::from(self.intrinsics.unproject([(pixel % width) as f64, (pixel / width) as f64])? * depth))
    }

    /// Labels of objects that have a pixel, ascending, without 0 and without `support`.
    pub fn objects(&self, support: Option<u16>) -> Vec<u16> {
        let mut present = vec![false; usize::from(u16::MAX) + 1];
        self.labels.iter().for_each(|label| present[usize::from(*label)] = true);
        (1..=u16::MAX).filter(|label| present[usize::from(*label)] && Some(*label) != support).collect()
    }
}
