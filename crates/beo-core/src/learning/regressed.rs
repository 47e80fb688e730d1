//! Gaussians of features z of the classes in one bin of views, with a linear regression of offsets δ (how the object lies exactly) on z.
//!
//! Each class's covariance is shrunk and takes a share of the mean over the bin's classes, for which a bin of one class is too few views.

use super::components::product;
use super::shrinkage::{centre, shrunk_covariance};
use crate::linear::{LinearError, cholesky, invert_lower};
use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, MatRef, Par};
use half::f16;

/// Share of the mean over the classes in a covariance. Held-out objects do not mind its value between 0.03 and 0.2.
const COMMON_SHARE: f64 = 0.05;

/// Moments of one class in one bin: p features, q offsets.
pub struct Moments {
    mean: Vec<f64>,
    covariance: Mat<f64>,
    offset_mean: Vec<f64>,
    offset_variance: Vec<f64>,
    /// Cov(δ, z), q × p.
    cross: Mat<f64>,
}

impl Moments {
    /// Of samples: features z (n × p) and offsets δ (n × q); `ridge` is added to each feature's variance.
    pub fn new(features: MatRef<'_, f32>, mut offsets: Mat<f64>, ridge: f64) -> Self {
        let (mean, centred) = centre(features);
        let mut covariance = shrunk_covariance(&centred).covariance;
        let (p, q, n) = (mean.len(), offsets.ncols(), offsets.nrows() as f64);
        (0..p).for_each(|i| covariance[(i, i)] += ridge);
        let (mut offset_mean, mut offset_variance) = (Vec::new(), Vec::new());
        for axis in 0..q {
            let column = offsets.col_as_slice_mut(axis);
            let middle = column.iter().sum::<f64>() / n;
            column.iter_mut().for_each(|v| *v -= middle);
            offset_variance.push(column.iter().map(|v| v * v).sum::<f64>() / n);
            offset_mean.push(middle);
        }
        let mut cross = Mat::zeros(q, p);
        matmul(cross.as_mut(), Accum::Replace, offsets.transpose(), centred.as_ref(), 1.0 / n, Par::Seq);
        Self { mean, covariance, offset_mean, offset_variance, cross }
    }
}

/// N(z; mean, S) with δ given z: offset_mean + regression · (z − mean), and what remains of its variance.
pub struct Regressed {
    /// p values.
    pub mean: Vec<f64>,
    /// L⁻¹ of S = L Lᵀ.
    pub whitening: Mat<f64>,
    /// q values.
    pub offset_mean: Vec<f64>,
    /// Cov(δ, z) S⁻¹, q × p.
    pub regression: Mat<f64>,
    /// Variance of each offset given z.
    pub remaining: Vec<f64>,
}

/// The Gaussians of all classes of one bin.
pub fn regressed(classes: &[&Moments]) -> Result<Vec<Regressed>, LinearError> {
    let (q, p) = (classes[0].cross.nrows(), classes[0].cross.ncols());
    let (mut covariance, mut cross) = (Mat::<f64>::zeros(p, p), Mat::<f64>::zeros(q, p));
    for class in classes {
        covariance += &class.covariance;
        cross += &class.cross;
    }
    let common = COMMON_SHARE / classes.len() as f64;
    let gaussian = |class: &&Moments| {
        let mut factor = faer::Scale(1.0 - COMMON_SHARE) * &class.covariance + faer::Scale(common) * &covariance;
        let cross = faer::Scale(1.0 - COMMON_SHARE) * &class.cross + faer::Scale(common) * &cross;
        cholesky(&mut factor)?;
        let whitening = invert_lower(factor.as_ref());
        // C S⁻¹ = (C L⁻ᵀ) L⁻¹
        let half = product(cross.as_ref(), whitening.transpose());
        let regression = product(half.as_ref(), whitening.as_ref());
        let explained = |axis: usize| (0..p).map(|j| half[(axis, j)].powi(2)).sum::<f64>();
        // Regressions from few samples explain more of these than of others: never less than a twentieth remains.
        let remaining = class.offset_variance.iter().enumerate().map(|(axis, v)| (v - explained(axis)).max(0.05 * v)).collect();
        Ok(Regressed { mean: class.mean.clone(), whitening, offset_mean: class.offset_mean.clone(), regression, remaining })
    };
    classes.iter().map(gaussian).collect()
}

impl Regressed {
    /// L⁻¹, its lower triangle row after row.
    pub fn packed_whitening(&self) -> impl Iterator<Item = f16> + '_ {
        (0..self.whitening.nrows()).flat_map(|i| (0..=i).map(move |j| (i, j))).map(|at| f16::from_f64(self.whitening[at]))
    }

    /// The regression, row after row.
    pub fn regression_rows(&self) -> impl Iterator<Item = f16> + '_ {
        let p = self.regression.ncols();
        (0..self.regression.nrows()).flat_map(move |i| (0..p).map(move |j| (i, j))).map(|at| f16::from_f64(self.regression[at]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    /// Many samples of a linear relation: δ = 2 + 3 z₀ − z₁ + noise of deviation 0.5.
    #[test]
    fn a_linear_relation_is_found_with_what_remains() {
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let mut noise = || rng.random_range(-0.5..0.5);
        let n = 5000;
        let z = Mat::<f32>::from_fn(n, 2, |_, _| noise() as f32);
        let delta =
            Mat::<f64>::from_fn(n, 1, |i, _| 2.0 + 3.0 * f64::from(z[(i, 0)]) - f64::from(z[(i, 1)]) + 0.5 * 12.0_f64.sqrt() * noise());
        let moments = Moments::new(z.as_ref(), delta, 0.0);
        let found = &regressed(&[&moments]).unwrap()[0];
        assert!((found.regression[(0, 0)] - 3.0).abs() < 0.1 && (found.regression[(0, 1)] + 1.0).abs() < 0.1);
        let at_origin = found.offset_mean[0] - found.regression[(0, 0)] * found.mean[0] - found.regression[(0, 1)] * found.mean[1];
        assert!((at_origin - 2.0).abs() < 0.02);
        // Shrinkage leaves a little more than the noise.
        assert!((found.remaining[0].sqrt() - 0.5).abs() < 0.03, "{}", found.remaining[0].sqrt());
    }
}
