//! Which neighbouring readings lie on one surface, and the pieces that such readings form.

use crate::SensorModel;
use crate::rays::Rays;
use nalgebra::Vector3;

/// A step between neighbours is none below this, metres.
const LEAST_STEP_M: f32 = 0.004;
/// Nor below so many standard deviations of a reading.
const STEP_DEVIATIONS: f32 = 2.5;
/// Nor where a surface that is turned away by up to 79° explains it: tangent.
const STEEPEST: f32 = 5.0;

/// The largest difference of depth between neighbouring readings of one surface, by depth.
#[derive(Clone, Copy, Debug)]
pub struct Joint {
    constant: f32,
    quadratic: f32,
    slope: f32,
}

impl Joint {
    /// For a camera and a sensor.
    pub fn new(rays: &Rays, sensor: &SensorModel) -> Self {
        let deviations = STEP_DEVIATIONS;
        Self {
            constant: deviations * sensor.constant_m as f32,
            quadratic: deviations * sensor.quadratic_per_m as f32,
            slope: STEEPEST * rays.pitch(1.0),
        }
    }

    /// The largest difference at a depth, metres.
    #[inline]
    pub fn reach(&self, depth: f32) -> f32 {
        // By comparisons: `max` asks for what is not a number as well, and this is asked for every pixel.
        let (noise, slope) = (self.constant + self.quadratic * depth * depth, self.slope * depth);
        let reach = if noise > LEAST_STEP_M { noise } else { LEAST_STEP_M };
        if slope > reach { slope } else { reach }
    }

    /// How far apart neighbouring pixels see at a depth, metres.
    #[inline]
    pub fn pitch(&self, depth: f32) -> f32 {
        self.slope / STEEPEST * depth
    }

    /// Whether two neighbouring readings lie on one surface.
    #[inline]
    pub fn joins(&self, a: f32, b: f32) -> bool {
        (a - b).abs() <= self.reach(if a < b { a } else { b })
    }
}

/// Offsets of the eight neighbours: down, right.
pub const EIGHT: [[isize; 2]; 8] = [[-1, -1], [-1, 0], [-1, 1], [0, -1], [0, 1], [1, -1], [1, 0], [1, 1]];
/// Of the four nearest.
pub const FOUR: [[isize; 2]; 4] = [[-1, 0], [0, -1], [0, 1], [1, 0]];

/// The neighbours of a pixel that lie in the image.
#[inline]
pub fn neighbours<const N: usize>(offsets: [[isize; 2]; N], pixel: usize, width: usize, height: usize) -> impl Iterator<Item = usize> {
    let (u, v) = ((pixel % width) as isize, (pixel / width) as isize);
    offsets.into_iter().filter_map(move |[down, right]| {
        let (u, v) = (u + right, v + down);
        (u >= 0 && v >= 0 && u < width as isize && v < height as isize).then(|| v as usize * width + u as usize)
    })
}

/// Pixels that hang together.
#[derive(Clone, Debug, Default)]
pub struct Piece {
    /// Its pixels, in the order in which they were reached.
    pub pixels: Vec<u32>,
}

/// Points of a piece that distances are measured by, at most.
const SAMPLES: usize = 160;

/// Some points of a piece, with their pixels.
pub fn samples(rays: &Rays, depth: &[f32], pixels: &[u32]) -> Vec<(Vector3<f32>, u32)> {
    let step = pixels.len().div_ceil(SAMPLES).max(1);
    pixels.iter().step_by(step).map(|pixel| (rays.point(*pixel as usize, depth[*pixel as usize]), *pixel)).collect()
}

/// The nearest two of two sets of points: their distance, metres, and their pixels.
pub fn nearest(a: &[(Vector3<f32>, u32)], b: &[(Vector3<f32>, u32)]) -> Option<(f32, [u32; 2])> {
    let mut best: Option<(f32, [u32; 2])> = None;
    for (p, i) in a {
        for (q, j) in b {
            let d = (p - q).norm_squared();
            if best.is_none_or(|(least, _)| d < least) {
                best = Some((d, [*i, *j]));
            }
        }
    }
    best.map(|(d, pair)| (d.sqrt(), pair))
}
