//! Completion: from the posteriors of the likely classes to one probability and one deviation per voxel (eq. 6 and the
//! evidence's posterior mean).

use super::subspace::{ClassSubspace, Conditional, Prediction};
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

/// Scratch memory for completing; one per task.
#[derive(Default)]
pub struct Scratch {
    voxels: Vec<usize>,
    depths: Vec<usize>,
    predicted: Vec<(f32, f32)>,
    features: Vec<VoxelFeatures>,
    prediction: Prediction,
}

/// Calls `voxel(index, features)` for every unknown voxel. The runs are vertical stretches of unknown voxels.
pub fn for_each_unknown(parts: &[Part<'_>], runs: &[(usize, usize)], scratch: &mut Scratch, mut voxel: impl FnMut(usize, &VoxelFeatures)) {
    let Scratch { voxels, depths, predicted, features, prediction } = scratch;
    voxels.clear();
    depths.clear();
    for &(start, end) in runs {
        voxels.extend(start..end);
        depths.extend((start..end).map(|index| end - index));
    }
    features.clear();
    features.extend(depths.iter().map(|depth| VoxelFeatures { mean: 0.0, variance: 0.0, class_mean: 0.0, depth: *depth }));
    for part in parts {
        part.class.predict(part.conditional, voxels, prediction, predicted);
        for ((feature, (mean, variance)), index) in features.iter_mut().zip(predicted.iter()).zip(voxels.iter()) {
            let mean = mean.clamp(0.0, 1.0);
            feature.mean += part.weight * mean;
            // Second moment for now: the spread between the classes is what remains of it.
            feature.variance += part.weight * (variance + mean * mean);
            feature.class_mean += part.weight * part.class.mean(*index);
        }
    }
    for (feature, index) in features.iter_mut().zip(voxels.iter()) {
        feature.variance = (feature.variance - feature.mean * feature.mean).max(0.0);
        voxel(*index, feature);
    }
}

/// The weights of a calibration in the order of [`VoxelFeatures::regressors`].
pub fn weights(c: &CompletionCalibration) -> [f32; 5] {
    [c.constant, c.mean, c.class_mean, c.log_depth, c.surface].map(|w| w as f32)
}
