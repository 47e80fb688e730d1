//! Small squares of the depth image in which the surface is flat: their centres are far less noisy than single readings, and their normals
//! tell a table from what stands on it.
//!
//! In a square, the inverse depth 1/z = A x + B y + C is fitted to the directions (x, y, 1) by least squares: this is the plane
//! (A, B, C) · p = 1, and the errors of stereo and structured light are alike in inverse depth at all distances.

use crate::SensorModel;
use crate::rays::Rays;
use nalgebra::{Matrix3, Vector3};

/// A square with a flat surface.
#[derive(Clone, Copy, Debug)]
pub struct Block {
    /// Middle of the surface, camera frame, metres.
    pub centre: Vector3<f64>,
    /// Unit normal towards the camera.
    pub normal: Vector3<f64>,
    /// Scatter of the readings about the fit, along the optical axis, in standard deviations of the sensor model.
    pub scatter: f64,
    /// Readings over σ², relative to the sensor's deviation at 1 m.
    pub weight: f64,
}

/// From this side on, pixels, a square is looked at in every other row.
const LARGE_SIDE: usize = 8;
/// Share of a square's pixels that must have a reading.
const LEAST_FILLED: f64 = 0.5;
/// A square with more scatter than so many standard deviations of the sensor shows no flat surface.
const MOST_SCATTER: f64 = 3.0;

/// Pixels along the side of a square: about 80 squares across the image.
pub fn side(width: usize) -> usize {
    (width / 80).clamp(4, 32)
}

/// The flat squares of the pixels that are `wanted`.
pub fn flat_blocks(rays: &Rays, depth: &[f32], sensor: &SensorModel, wanted: impl Fn(usize) -> bool) -> Vec<Block> {
    let (width, height) = (rays.width(), rays.height());
    let side = side(width);
    let reference = sensor.deviation(1.0);
    // Of large squares every other row is enough.
    let step = if side >= LARGE_SIDE { 2 } else { 1 };
    let mut blocks = Vec::new();
    for top in (0..height).step_by(side) {
        for left in (0..width).step_by(side) {
            let middle = (top + side / 2).min(height - 1) * width + (left + side / 2).min(width - 1);
            let (x0, y0) = (rays.x()[middle], rays.y()[middle]);
            // 1, x, y, w, xx, xy, yy, xw, yw, ww about the middle of the square.
            let mut sums = [0.0_f32; 10];
            let (mut low, mut high) = (f32::INFINITY, 0.0_f32);
            let mut origin = 0.0;
            for v in (top..(top + side).min(height)).step_by(step) {
                #[allow(clippy::needless_range_loop)] // the pixel indexes the rays too, and is asked about
                for pixel in v * width + left..v * width + (left + side).min(width) {
                    let z = depth[pixel];
                    if z <= 0.0 || !wanted(pixel) {
                        continue;
                    }
                    if origin == 0.0 {
                        origin = 1.0 / z;
                    }
                    (low, high) = (low.min(z), high.max(z));
                    let (x, y, w) = (rays.x()[pixel] - x0, rays.y()[pixel] - y0, 1.0 / z - origin);
                    let terms = [1.0, x, y, w, x * x, x * y, y * y, x * w, y * w, w * w];
                    sums.iter_mut().zip(terms).for_each(|(sum, term)| *sum += term);
                }
            }
            if f64::from(sums[0]) < LEAST_FILLED * (side * side.div_ceil(step)) as f64 || high > 1.25 * low {
                continue;
            }
            let fitted = fit(&sums.map(f64::from), [x0, y0].map(f64::from), f64::from(origin), sensor, reference);
            blocks.extend(fitted.map(|block| Block { weight: step as f64 * block.weight, ..block }));
        }
    }
    blocks
}

fn fit(sums: &[f64; 10], [x0, y0]: [f64; 2], origin: f64, sensor: &SensorModel, reference: f64) -> Option<Block> {
    let [n, x, y, w, xx, xy, yy, xw, yw, ww] = *sums;
    let matrix = Matrix3::new(xx, xy, x, xy, yy, y, x, y, n);
    let solved = matrix.try_inverse()? * Vector3::new(xw, yw, w);
    let (a, b) = (solved.x, solved.y);
    // About the square's middle: w = a (x − x0) + b (y − y0) + c.
    let c = solved.z + origin;
    let squares = (ww - (a * xw + b * yw + solved.z * w)).max(0.0) / (n - 3.0).max(1.0);
    let (mean_x, mean_y) = (x / n, y / n);
    let inverse = a * mean_x + b * mean_y + c;
    if inverse.is_nan() || inverse <= 1e-3 {
        return None;
    }
    let z = 1.0 / inverse;
    let scatter = squares.sqrt() * z * z / sensor.deviation(z).max(1e-6);
    let plane = Vector3::new(a, b, c - a * x0 - b * y0);
    let normal = -plane.try_normalize(1e-9)?;
    let centre = Vector3::new((mean_x + x0) * z, (mean_y + y0) * z, z);
    let weight = n * (reference / sensor.deviation(z)).powi(2);
    (scatter <= MOST_SCATTER && centre.iter().chain(normal.iter()).all(|v| v.is_finite())).then_some(Block {
        centre,
        normal,
        scatter,
        weight,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Intrinsics;
    use nalgebra::Vector2;

    /// Every square of a slanted plane, with sides of 4 (all rows are read) and of 8 (every other row is).
    #[test]
    fn squares_of_a_plane_have_its_normal_and_their_mean_directions_place_on_it() {
        let plane = Vector3::new(0.2, -0.3, 0.8);
        let sensor = SensorModel::default();
        for width in [320_u32, 640] {
            let height = 10;
            let camera = Intrinsics::new(width, height, [500.0; 2], [150.0, 3.0], [0.0; 5]).unwrap();
            let rays = Rays::new(&camera);
            let direction = |pixel: usize| Vector2::new(f64::from(rays.x()[pixel]), f64::from(rays.y()[pixel]));
            let depth: Vec<f32> = (0..rays.x().len()).map(|pixel| (1.0 / plane.dot(&direction(pixel).push(1.0))) as f32).collect();
            let found = flat_blocks(&rays, &depth, &sensor, |_| true);
            let (width, height, side) = (width as usize, height as usize, side(width as usize));
            assert_eq!(side, width / 80);
            let step = if side == 8 { 2 } else { 1 };
            // The last row of squares has two rows of pixels: half of a side of 4, too little of one of 8.
            let rows = if side == 8 { 1 } else { 3 };
            assert_eq!(found.len(), rows * 80);
            for (place, block) in found.iter().enumerate() {
                let (top, left) = (place / 80 * side, place % 80 * side);
                let pixels: Vec<usize> =
                    (top..(top + side).min(height)).step_by(step).flat_map(|v| (left..left + side).map(move |u| v * width + u)).collect();
                let mean = pixels.iter().map(|pixel| direction(*pixel)).sum::<Vector2<f64>>() / pixels.len() as f64;
                let z = 1.0 / plane.dot(&mean.push(1.0));
                assert!((block.centre - mean.push(1.0) * z).norm() < 1e-4, "{place}: {block:?}");
                assert!((block.normal + plane.normalize()).norm() < 2e-3, "{place}: {block:?}");
                assert!(block.scatter < 0.01, "{place}: {block:?}");
                let weight = (pixels.len() * step) as f64 * (sensor.deviation(1.0) / sensor.deviation(z)).powi(2);
                assert!((block.weight / weight - 1.0).abs() < 1e-3, "{place}: {} {weight}", block.weight);
            }
        }
    }

    #[test]
    fn squares_across_an_edge_without_readings_or_unwanted_are_none() {
        let camera = Intrinsics::new(320, 8, [500.0; 2], [160.0, 4.0], [0.0; 5]).unwrap();
        let rays = Rays::new(&camera);
        let mut depth = vec![1.0_f32; 320 * 8];
        // The first square has a step, the second 7 of 16 readings, the third 8.
        for (v, u) in (0..4).flat_map(|v| (0..12).map(move |u| (v, u))) {
            let pixel = v * 320 + u;
            depth[pixel] = match u / 4 {
                0 if u < 2 => 1.3,
                1 if v * 4 + u - 4 >= 7 => 0.0,
                2 if v >= 2 => 0.0,
                _ => 1.0,
            };
        }
        // Of the last square nothing is wanted.
        let found = flat_blocks(&rays, &depth, &SensorModel::default(), |pixel| pixel % 320 < 316);
        assert_eq!(found.len(), 2 * 80 - 2 - 2);
        let first = found[0].centre.x * 500.0 + 160.0;
        assert!((first - 9.5).abs() < 0.01, "{first}");
    }
}
