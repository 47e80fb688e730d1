//! Description of a model in its file: JSON in the safetensors header.

use super::Component;
use crate::grid::{Dims, View};
use serde::{Deserialize, Serialize};

/// Version of the file format that this program writes and reads.
pub const FORMAT_VERSION: u32 = 4;

/// Description of a model.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Metadata {
    /// Version of the file format.
    pub format_version: u32,
    /// Version of the program that trained the model.
    pub beo_version: String,
    /// Terms of the data that the model was trained on, if the trainer stated any.
    pub licence: String,
    /// Size of the grids, [x, y, z].
    pub dims: Dims,
    /// Classes, sorted by name.
    pub classes: Vec<ClassInfo>,
    /// Variance of one voxel about the model, common to all classes.
    pub noise_variance: f64,
    /// Fitted on held-out objects.
    pub calibration: Calibration,
    /// Components of the mixtures that the classes are where cameras see them: kinds of true size, each in its resting poses; by class. Of models of
    /// version 0.1.0 there are none, and all objects of a class stand upright.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub camera_components: Vec<Component>,
    /// How the model was trained.
    pub settings: TrainingSettings,
}

/// One class.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ClassInfo {
    /// Name, at most 31 bytes.
    pub name: String,
    /// Training objects used.
    pub shapes: usize,
    /// Size k_s of VBPCA's basis W_s.
    pub basis_size: usize,
    /// Share of the class's variance that W_s carries.
    pub explained: f64,
    /// VBPCA's noise variance of this class alone.
    pub noise_variance: f64,
    /// Shrinkage intensity of the class covariance towards the two-parameter target (1 − λ of eq. 8).
    pub shrinkage: f64,
}

/// Settings of training that the model depends on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrainingSettings {
    /// Splits that were read.
    pub splits: Vec<String>,
    /// Views for which hull densities were learned.
    pub views: Vec<View>,
    /// Elevations of cameras whose views were learned, degrees above the horizontal, ascending; none if it was not.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub camera_elevations_deg: Vec<f64>,
    /// Whether the model has what poses, sizes and places are searched with.
    #[serde(default = "yes", skip_serializing_if = "is_yes")]
    pub poses: bool,
    /// Share of the variance that sizes a class basis.
    pub variance_share: f64,
    /// Least and most components of a class basis.
    pub basis_range: [usize; 2],
    /// Longest side of a mesh, in voxels.
    pub longest_side: usize,
    /// Seed of the cross-validation's folds.
    pub seed: u64,
    /// Number of folds.
    pub folds: usize,
}

/// Models were always searched before this was written down; those that are do not write it, so that older programs read them.
fn yes() -> bool {
    true
}

fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

fn is_yes(value: &bool) -> bool {
    *value
}

/// A blend of class scores: log posterior = Σ_j weight_j score_j + offset_s + log prior_s + constant.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Blend {
    /// Weight of the hull's log density.
    pub hull: f64,
    /// Weight of the log evidence.
    pub evidence: f64,
    /// Weight of the negative squared distance to the class mean.
    pub distance: f64,
    /// Weight of the logarithm of the forest's share.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub forest: f64,
    /// One offset per class.
    pub offsets: Vec<f64>,
}

/// How raw scores become probabilities. An object held out of the training was never scored by a model that had seen it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Calibration {
    /// Degrees of freedom ν of the hull's Student-t density.
    pub degrees_of_freedom: f64,
    /// Strength n₀ of the prior that pulls the hull covariance of a class to the one common to all, in objects.
    pub prior_strength: f64,
    /// Blend of the default method.
    pub auto: Blend,
    /// Hull density alone.
    pub hull: Blend,
    /// Evidence alone.
    pub evidence: Blend,
    /// Distance to the class means alone.
    pub mean: Blend,
    /// Factor on the noise variance: voxels are binary and correlated, so that σ² as estimated makes evidence too sure.
    pub noise_inflation: f64,
    /// Completion.
    pub completion: CompletionCalibration,
    /// Views of cameras, if they were learned.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub camera: Option<CameraCalibration>,
    /// Held-out objects that the fit used.
    pub objects: usize,
    /// Accuracy of the default method on them, classes weighted alike; a little optimistic, as the blend was fitted to them.
    pub accuracy: f64,
    /// Mean negative log posterior of the true class on them, in nats.
    pub log_loss: f64,
}

/// How sure the densities of what cameras see may be: log P(c, r) = `pose_weight` · score + log P(c | s) + `size_weight` · log size over
/// the components c of class s and the yaw r, and log P(s) = `blend`.hull · F(s) + `blend`.offsets\[s\] + log prior + constant, where F(s)
/// is the logarithm of the sum of the former, divided by `pose_weight`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CameraCalibration {
    /// Factor on the log density, for the yaw.
    pub pose_weight: f64,
    /// Factor on the log density of true sizes, if they were learned.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub size_weight: Option<f64>,
    /// Factor and offsets for the class.
    pub blend: Blend,
    /// F and the logarithm of the forest's share, weighed together; none where the model has no forest.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub with_forest: Option<Blend>,
    /// From the forest's share of none to a probability; none where the model has no forest.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub none: Option<NoneCalibration>,
    /// F, the forest's share where there is one, and the log evidence of the class as it lies best, relative to the background, weighed
    /// together; none where the grids were too big to fit it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub together: Option<Blend>,
    /// Factors on the standard deviations of place and size; none in models of version 0.1.0, which then use [`CameraSpread::default`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub spread: Option<CameraSpread>,
    /// Views of shapes that were left out, on which this was fitted.
    pub views: usize,
    /// Accuracy on them in unknown yaw, classes weighted alike.
    pub accuracy: f64,
    /// Mean negative log posterior of the true class on them, in nats.
    pub log_loss: f64,
}

impl CameraCalibration {
    /// Whether the model has a forest.
    pub fn has_forest(&self) -> bool {
        self.with_forest.is_some()
    }
}

/// P(none of the classes) = 1 / (1 + exp(−`constant` − `weight` · logit q)), where q is the forest's share of none.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct NoneCalibration {
    /// Added to the weighted logit.
    pub constant: f64,
    /// Factor on the logit.
    pub weight: f64,
}

impl NoneCalibration {
    /// Shares are not taken for smaller than this, nor for larger than 1 less this.
    const LEAST: f64 = 0.001;

    /// log q / (1 − q), q kept from 0 and 1.
    pub fn logit(share: f64) -> f64 {
        let share = share.clamp(Self::LEAST, 1.0 - Self::LEAST);
        (share / (1.0 - share)).ln()
    }

    /// The probability that the thing is of no class.
    pub fn probability(&self, share: f64) -> f64 {
        1.0 / (1.0 + (-self.constant - self.weight * Self::logit(share)).exp())
    }
}

/// By how much standard deviations of place and size, as the densities of views and the search about them give them, are multiplied, so that
/// of views of shapes that were left out as many errors are within one deviation as of a Gaussian.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct CameraSpread {
    /// Of the place of the object's centre along the axes of the view's frame: the direction of looking, to the side of it, and up.
    pub place: [f64; 3],
    /// Of the lengths of the object's box along its own axes.
    pub extent: [f64; 3],
}

impl CameraSpread {
    /// Deviations as they are.
    pub const ONE: Self = Self { place: [1.0; 3], extent: [1.0; 3] };
}

impl Default for CameraSpread {
    /// Of models that were learned before these were fitted: found on made-up household things that such models had not been trained on.
    fn default() -> Self {
        Self { place: [1.8; 3], extent: [1.8; 3] }
    }
}

/// How the posterior mean m of an unknown voxel becomes the probability p that it is filled:
///
/// logit p = constant + mean · L(m) + class_mean · L(μ) + log_depth · ln δ + surface · \[δ = 1\],
///
/// where L is the logit of a value clipped to \[0.02, 0.98\], μ the posterior-weighted class mean, and δ counts the unknown
/// voxels from the known one above down to this one.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct CompletionCalibration {
    /// Weight of one.
    pub constant: f64,
    /// Weight of the posterior mean's logit.
    pub mean: f64,
    /// Weight of the class mean's logit.
    pub class_mean: f64,
    /// Weight of the logarithm of the depth.
    pub log_depth: f64,
    /// Weight of being the first unknown voxel below a known one.
    pub surface: f64,
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A logistic regression on log odds, in closed form.
    #[test]
    fn none_is_the_logistic_function_of_weighted_log_odds() {
        let calibration = NoneCalibration { constant: 0.5, weight: 2.0 };
        assert!((NoneCalibration::logit(0.8) - 4.0_f64.ln()).abs() < 1e-12);
        // exp(0.5) · 4² to 1.
        let odds = 0.5_f64.exp() * 16.0;
        assert!((calibration.probability(0.8) - odds / (1.0 + odds)).abs() < 1e-12);
        assert!((calibration.probability(0.5) - 1.0 / (1.0 + (-0.5_f64).exp())).abs() < 1e-12);
        // Where the forest is certain, its odds are those of one in a thousand.
        assert!((NoneCalibration::logit(0.0) + NoneCalibration::logit(1.0)).abs() < 1e-9);
        assert!((NoneCalibration::logit(1.0) - 999.0_f64.ln()).abs() < 1e-9);
    }
}
