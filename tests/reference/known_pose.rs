//! The query of method `auto` in known pose: class posterior, then the hidden voxels.

use crate::class::Reference;
use beo_core::grid::{FILLED, Observation, UNKNOWN};
use nalgebra::{DMatrix, DVector};

/// Classes whose posterior by the hull is less than this share of the best one's count with the best evidence of the others.
const HOPELESS: f64 = 1e-2;
/// Classes that are less probable take no part in a completion, and at most `PARTS` do.
const LEAST_SHARE: f64 = 0.05;
const PARTS: usize = 3;
/// Means are clipped before their logit is taken.
const CLIP: f64 = 0.02;

/// Probability that each voxel is filled, and its deviation.
pub struct Completion {
    pub occupancy: Vec<f64>,
    pub deviation: Vec<f64>,
}

impl Reference {
    /// P(class | observation). `log_prior` has one value per class, or is empty.
    pub fn posterior(&self, observation: &Observation, log_prior: &[f64]) -> Vec<f64> {
        let calibration = &self.model.metadata.calibration;
        let prior = |s: usize| log_prior.get(s).copied().unwrap_or(0.0);
        let classes = 0..self.classes.len();
        if observation.filled().is_clear() {
            return softmax(classes.map(prior));
        }
        let (known, values) = known_voxels(observation);
        let evidence = |s: usize| self.classes[s].condition(&known, &values, self.noise).log_evidence;
        if !self.model.views().iter().any(|view| view.matches(observation)) {
            let blend = &calibration.evidence;
            return softmax(classes.map(|s| blend.evidence * evidence(s) + blend.offsets[s] + prior(s)));
        }
        let z = &self.basis * DMatrix::from_columns(&[hull(observation)]);
        let hull: Vec<f64> = self.classes.iter().map(|class| class.hull.log_densities(&z)[0]).collect();
        let by_hull = softmax(classes.clone().map(|s| calibration.hull.hull * hull[s] + calibration.hull.offsets[s] + prior(s)));
        let least = HOPELESS * by_hull.iter().copied().fold(0.0, f64::max);
        let evidence: Vec<Option<f64>> = classes.clone().map(|s| (by_hull[s] >= least).then(|| evidence(s))).collect();
        let best = evidence.iter().flatten().copied().fold(f64::NEG_INFINITY, f64::max);
        let blend = &calibration.auto;
        softmax(classes.map(|s| blend.hull * hull[s] + blend.evidence * evidence[s].unwrap_or(best) + blend.offsets[s] + prior(s)))
    }

    /// Completes an observation that stands as the training shapes do, whose classes have this posterior. Of an observation
    /// without a filled voxel all classes take part.
    pub fn complete(&self, observation: &Observation, posterior: &[f64]) -> Completion {
        let (known, values) = known_voxels(observation);
        let mut classes: Vec<usize> = (0..posterior.len()).collect();
        classes.sort_by(|a, b| posterior[*b].total_cmp(&posterior[*a]));
        if !observation.filled().is_clear() {
            let likely = posterior.iter().filter(|p| **p > LEAST_SHARE).count();
            classes.truncate(likely.clamp(1, PARTS));
        }
        let total: f64 = classes.iter().map(|s| posterior[*s]).sum();
        let c = &self.model.metadata.calibration.completion;

        let voxels = observation.dims().voxels();
        let unknown: Vec<usize> = (0..voxels).filter(|v| observation.code(*v) == UNKNOWN).collect();
        // Sums over the classes of the mean, of the second moment, and of the class mean.
        let mut sums = vec![[0.0; 3]; unknown.len()];
        for s in classes {
            let (share, class) = (posterior[s] / total, &self.classes[s]);
            let predicted = class.predict(&class.condition(&known, &values, self.noise), &unknown);
            for ((sums, (mean, variance)), voxel) in sums.iter_mut().zip(predicted).zip(&unknown) {
                let mean = mean.clamp(0.0, 1.0);
                sums[0] += share * mean;
                sums[1] += share * (variance + mean * mean);
                sums[2] += share * class.mean[*voxel];
            }
        }
        let occupancy = (0..voxels).map(|v| f64::from(u8::from(observation.code(v) == FILLED))).collect();
        let mut completion = Completion { occupancy, deviation: vec![0.0; voxels] };
        for (voxel, [mean, square, class_mean]) in unknown.into_iter().zip(sums) {
            let depth = depth(observation, voxel);
            let surface = if depth == 1 { c.surface } else { 0.0 };
            let log_odds =
                c.constant + c.mean * logit(mean) + c.class_mean * logit(class_mean) + c.log_depth * (depth as f64).ln() + surface;
            let p = 1.0 / (1.0 + (-log_odds).exp());
            // The delta method: dp/dm = p (1 − p) · c.mean · d logit(m)/dm.
            let m = mean.clamp(CLIP, 1.0 - CLIP);
            let slope = c.mean.abs() * p * (1.0 - p) / (m * (1.0 - m));
            completion.occupancy[voxel] = p;
            completion.deviation[voxel] = (slope * (square - mean * mean).max(0.0).sqrt()).min(0.5);
        }
        completion
    }
}

/// The known voxels, and 1 for those that are filled, else 0.
fn known_voxels(observation: &Observation) -> (Vec<usize>, DVector<f64>) {
    let known: Vec<usize> = (0..observation.dims().voxels()).filter(|v| observation.code(*v) != UNKNOWN).collect();
    let values = known.iter().map(|v| f64::from(u8::from(observation.code(*v) == FILLED)));
    let values = DVector::from_iterator(known.len(), values);
    (known, values)
}

/// The visual hull: 1 for voxels that are filled or unknown, else 0.
pub fn hull(observation: &Observation) -> DVector<f64> {
    let voxels = observation.dims().voxels();
    DVector::from_iterator(voxels, (0..voxels).map(|v| f64::from(u8::from(matches!(observation.code(v), FILLED | UNKNOWN)))))
}

/// Unknown voxels from the top of the run of this one down to it.
fn depth(observation: &Observation, voxel: usize) -> usize {
    let end = (voxel / observation.dims().z() + 1) * observation.dims().z();
    (voxel..end).take_while(|v| observation.code(*v) == UNKNOWN).count()
}

fn logit(value: f64) -> f64 {
    let value = value.clamp(CLIP, 1.0 - CLIP);
    (value / (1.0 - value)).ln()
}

pub fn softmax(log_weights: impl Iterator<Item = f64>) -> Vec<f64> {
    let log_weights: Vec<f64> = log_weights.collect();
    let peak = log_weights.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let weights: Vec<f64> = log_weights.iter().map(|w| (w - peak).exp()).collect();
    let total: f64 = weights.iter().sum();
    weights.into_iter().map(|w| w / total).collect()
}
