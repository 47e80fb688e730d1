//! Depth and labels of one view.

use beo_camera::{Frame, Intrinsics};

/// A rendered view, row by row.
#[derive(Clone, Debug, PartialEq)]
pub struct DepthImage {
    intrinsics: Intrinsics,
    depth: Vec<f32>,
    labels: Vec<u16>,
}

impl DepthImage {
    /// An image without readings and labels.
    pub fn empty(intrinsics: Intrinsics) -> Self {
        let pixels = intrinsics.width() as usize * intrinsics.height() as usize;
        Self { intrinsics, depth: vec![0.0; pixels], labels: vec![0; pixels] }
    }

    /// The camera.
    pub fn intrinsics(&self) -> &Intrinsics {
        &self.intrinsics
    }

    /// Depth along the optical axis, metres; 0: no reading.
    pub fn depth(&self) -> &[f32] {
        &self.depth
    }

    /// Label of what each pixel shows; 0: nothing.
    pub fn labels(&self) -> &[u16] {
        &self.labels
    }

    /// Both, to be changed.
    pub(super) fn parts_mut(&mut self) -> (&mut [f32], &mut [u16]) {
        (&mut self.depth, &mut self.labels)
    }

    /// As what a camera delivers.
    pub fn frame(&self) -> Frame<'_> {
        Frame::new(&self.intrinsics, &self.depth, &self.labels).expect("as many pixels as the camera has")
    }

    /// Adds what another view by the same camera shows, where it is nearer: a scene composed of parts.
    ///
    /// # Panics
    /// If the cameras differ.
    pub fn merge(&mut self, other: &DepthImage) {
        assert_eq!(self.intrinsics, other.intrinsics, "views of the same camera");
        for (n, (depth, label)) in self.depth.iter_mut().zip(&mut self.labels).enumerate() {
            let nearer = other.depth[n];
            if nearer > 0.0 && (*depth <= 0.0 || nearer < *depth) {
                (*depth, *label) = (nearer, other.labels[n]);
            }
        }
    }
}
