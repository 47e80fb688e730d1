//! Completion: from the posteriors of the likely classes to one probability and one deviation per voxel (eq. 6 and the
//! evidence's posterior mean).

use super::subspace::{ClassSubspace, Conditional};
use crate::grid::Dims;
use crate::model::CompletionCalibration;

/// A class that takes part in a completion.
pub struct Part<'a> {
    /// Its share; the shares sum to one.
    pub weight: f32,
    /// The class.
    pub class: &'a ClassSubspace,
    /// Its posterior, prepared for prediction.
    pub conditional: &'a Conditional,
}

/// Values outside are clipped before their logit is taken.
const CLIP: f32 = 0.02;

fn logit(value: f32) -> f32 {
    let value = value.clamp(CLIP, 1.0 - CLIP);
    (value / (1.0 - value)).ln()
}

/// What the calibration reads of one voxel; also used to fit it.
#[derive(Clone, Copy, Debug)]
pub struct VoxelFeatures {
    /// Posterior mean m of the occupancy, clamped to \[0, 1\].
    pub mean: f32,
    /// Its variance: within the classes and between them.
    pub variance: f32,
    /// Weighted class mean.
    pub class_mean: f32,
    /// Unknown voxels from the known one above down to this one, at least one.
    pub depth: usize,
}

impl VoxelFeatures {
    /// The features of an unknown voxel.
    pub fn of(parts: &[Part<'_>], voxel: usize, depth: usize) -> Self {
        let (mut mean, mut second, mut within, mut class_mean) = (0.0, 0.0, 0.0, 0.0);
        for part in parts {
            let (m, v) = part.class.predict(part.conditional, voxel);
            let m = m.clamp(0.0, 1.0);
            mean += part.weight * m;
            second += part.weight * m * m;
            within += part.weight * v;
            class_mean += part.weight * part.class.mean(voxel);
        }
        Self { mean, variance: within + (second - mean * mean).max(0.0), class_mean, depth }
    }

    /// The regressors of the calibration, in the order of [`weights`].
    pub fn regressors(&self) -> [f32; 5] {
        let depth = self.depth as f32;
        [1.0, logit(self.mean), logit(self.class_mean), depth.ln(), if self.depth == 1 { 1.0 } else { 0.0 }]
    }

    /// Probability that the voxel is filled, and the deviation of that probability by the delta method, at most ½.
    pub fn probability(&self, weights: &[f32; 5]) -> (f32, f32) {
        let x: f32 = self.regressors().iter().zip(weights).map(|(x, w)| x * w).sum();
        let p = 1.0 / (1.0 + (-x).exp());
        let m = self.mean.clamp(CLIP, 1.0 - CLIP);
        let slope = weights[1].abs() * p * (1.0 - p) / (m * (1.0 - m));
        (p, (slope * self.variance.max(0.0).sqrt()).min(0.5))
    }
}

/// The weights of a calibration in the order of [`VoxelFeatures::regressors`].
pub fn weights(c: &CompletionCalibration) -> [f32; 5] {
    [c.constant, c.mean, c.class_mean, c.log_depth, c.surface].map(|w| w as f32)
}

/// Calls `voxel(index, depth)` for every unknown voxel; the runs come bottom up.
pub fn for_each_unknown(dims: Dims, runs: &[(usize, usize)], mut voxel: impl FnMut(usize, usize)) {
    debug_assert!(runs.iter().all(|(s, e)| s / dims.z() == (e - 1) / dims.z()));
    for &(start, end) in runs {
        (start..end).for_each(|index| voxel(index, end - index));
    }
}
