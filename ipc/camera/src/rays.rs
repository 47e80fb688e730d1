//! The directions in which the pixels of a camera look, computed once per camera.

use crate::{Frame, Intrinsics, Lens};
use nalgebra::Vector3;

/// For every pixel the direction that it sees, with z = 1: a reading of z metres there is the point z times this.
#[derive(Clone, Debug)]
pub struct Rays {
    intrinsics: Intrinsics,
    x: Vec<f32>,
    y: Vec<f32>,
}

impl Rays {
    /// Of a camera. With lens distortion, one inversion of the lens per pixel: keep the result for later frames.
    pub fn new(intrinsics: &Intrinsics) -> Self {
        let (width, height) = (intrinsics.width() as usize, intrinsics.height() as usize);
        let (mut x, mut y) = (Vec::with_capacity(width * height), Vec::with_capacity(width * height));
        if intrinsics.lens() == Lens::Straight {
            let along = |pixel: [f64; 2]| intrinsics.unproject(pixel).map_or([f32::NAN; 2], |ray| [ray.x as f32, ray.y as f32]);
            let columns: Vec<f32> = (0..width).map(|u| along([u as f64, 0.0])[0]).collect();
            for v in 0..height {
                x.extend_from_slice(&columns);
                y.extend(std::iter::repeat_n(along([0.0, v as f64])[1], width));
            }
            return Self { intrinsics: *intrinsics, x, y };
        }
        for v in 0..height {
            for u in 0..width {
                // Pixels that the lens leaves dark show nothing.
                let ray = intrinsics.unproject([u as f64, v as f64]).map_or([f32::NAN; 2], |ray| [ray.x as f32, ray.y as f32]);
                x.push(ray[0]);
                y.push(ray[1]);
            }
        }
        Self { intrinsics: *intrinsics, x, y }
    }

    /// The camera.
    pub fn intrinsics(&self) -> &Intrinsics {
        &self.intrinsics
    }

    /// Pixels of a row.
    pub fn width(&self) -> usize {
        self.intrinsics.width() as usize
    }

    /// Rows.
    pub fn height(&self) -> usize {
        self.intrinsics.height() as usize
    }

    /// Horizontal components, row by row.
    pub fn x(&self) -> &[f32] {
        &self.x
    }

    /// Vertical components, row by row.
    pub fn y(&self) -> &[f32] {
        &self.y
    }

    /// Readings as they are looked at: 0 where there is none, and where the lens shows nothing.
    pub fn readings(&self, depth: &[f32]) -> Vec<f32> {
        let read = |(z, x): (&f32, &f32)| if Frame::is_reading(*z) && !x.is_nan() { *z } else { 0.0 };
        depth.iter().zip(&self.x).map(read).collect()
    }

    /// The point that is `depth` metres away along the optical axis at a pixel.
    #[inline]
    pub fn point(&self, pixel: usize, depth: f32) -> Vector3<f32> {
        Vector3::new(self.x[pixel] * depth, self.y[pixel] * depth, depth)
    }

    /// How far apart neighbouring pixels see at `depth`, metres: the larger of the two directions.
    #[inline]
    pub fn pitch(&self, depth: f32) -> f32 {
        let [fx, fy] = self.intrinsics.focal();
        depth / fx.min(fy) as f32
    }
}
