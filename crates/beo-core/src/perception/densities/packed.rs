//! A Gaussian whose square-root information lies in the model file as a packed lower triangle in half precision: one of many small ones, read
//! when it is needed.

use crate::lanes::{Kernel, LANES, dispatch, multiply_add, single, sum, widen_halves};
use half::f16;

/// Values on a diagonal whose product stays far from the ends of double precision, however near they are to those of half precision.
const MULTIPLIED: usize = 32;

/// N(mean, S), S = L Lᵀ, widened to single precision; memory for one of them at a time.
#[derive(Clone, Debug, Default)]
pub struct PackedGaussian {
    mean: Vec<f32>,
    /// Rows of L⁻¹, lower triangle: row i has i + 1 values; and room for a block of lanes.
    root: Vec<f32>,
    /// See [`log_volume`].
    log_volume: f64,
}

/// log |L⁻¹| = −½ log |S| of p features, from the p (p + 1) / 2 values of L⁻¹.
pub fn log_volume(features: usize, root: &[f16]) -> f64 {
    let (mut last, mut log_volume) = (0, 0.0);
    for start in (0..features).step_by(MULTIPLIED) {
        let mut product = 1.0;
        for i in start..(start + MULTIPLIED).min(features) {
            product *= f64::from(single(root[last]));
            last += i + 2;
        }
        log_volume += product.ln();
    }
    log_volume
}

impl PackedGaussian {
    /// Takes in a Gaussian of p features: its mean, p values, L⁻¹, p (p + 1) / 2 values, and its [`log_volume`].
    pub fn load(&mut self, mean: &[f16], root: &[f16], log_volume: f64) {
        self.mean.resize(mean.len(), 0.0);
        self.root.resize(root.len() + LANES, 0.0);
        widen_halves(mean, &mut self.mean);
        widen_halves(root, &mut self.root);
        self.log_volume = log_volume;
    }

    /// z − mean, into `centred` (p values each).
    pub fn centre(&self, z: &[f32], centred: &mut [f32]) {
        for ((out, z), mean) in centred.iter_mut().zip(z).zip(&self.mean) {
            *out = z - mean;
        }
    }

    /// log N(z; mean, S) of a centred point, without the constant of the number of features.
    ///
    /// `centred` has whole blocks of lanes, of which those beyond the features are not looked at.
    pub fn log_density(&self, centred: &[f32]) -> f64 {
        dispatch(LogDensity { gaussian: self, centred })
    }

    /// The same of `N` points side by side: `points` has a row per feature with the values of all points, not centred; `centred` is scratch.
    pub fn log_densities<const N: usize>(&self, points: &[[f32; N]], centred: &mut Vec<[f32; N]>) -> [f32; N] {
        centred.resize(self.mean.len(), [0.0; N]);
        dispatch(LogDensities { gaussian: self, points, centred })
    }
}

/// See [`PackedGaussian::log_density`].
struct LogDensity<'a> {
    gaussian: &'a PackedGaussian,
    centred: &'a [f32],
}

impl Kernel for LogDensity<'_> {
    type Output = f64;

    #[inline(always)]
    fn run<const FUSED: bool>(self) -> f64 {
        let PackedGaussian { mean, root, log_volume } = self.gaussian;
        let blocks = self.centred.as_chunks::<LANES>().0;
        let (mut squared_distance, mut rest) = (0.0, &root[..]);
        for i in 0..mean.len() {
            let (row, mut sums) = (rest.as_chunks::<LANES>().0, [0.0_f32; LANES]);
            let (whole, own) = (i / LANES, i % LANES);
            for (row, point) in row.iter().zip(blocks).take(whole) {
                for l in 0..LANES {
                    sums[l] = multiply_add::<FUSED>(row[l], point[l], sums[l]);
                }
            }
            // Beyond its own values a row's last block holds those of the next.
            let (row, point) = (&row[whole], &blocks[whole]);
            for l in 0..LANES {
                let value = if l <= own { row[l] } else { 0.0 };
                sums[l] = multiply_add::<FUSED>(value, point[l], sums[l]);
            }
            squared_distance += f64::from(sum(&sums)).powi(2);
            rest = &rest[i + 1..];
        }
        *log_volume - 0.5 * squared_distance
    }
}

/// See [`PackedGaussian::log_densities`].
struct LogDensities<'a, const N: usize> {
    gaussian: &'a PackedGaussian,
    points: &'a [[f32; N]],
    centred: &'a mut [[f32; N]],
}

impl<const N: usize> Kernel for LogDensities<'_, N> {
    type Output = [f32; N];

    #[inline(always)]
    fn run<const FUSED: bool>(self) -> [f32; N] {
        let Self { gaussian: PackedGaussian { mean, root, log_volume, .. }, points, centred } = self;
        for ((centred, z), mean) in centred.iter_mut().zip(points).zip(mean) {
            for (out, z) in centred.iter_mut().zip(z) {
                *out = z - mean;
            }
        }
        let mut sums = [0.0_f32; N];
        let mut rest = &root[..];
        for i in 0..centred.len() {
            let (row, tail) = rest.split_at(i + 1);
            rest = tail;
            let mut whitened = [0.0_f32; N];
            for (factor, centred) in row.iter().zip(&*centred) {
                for (sum, v) in whitened.iter_mut().zip(centred) {
                    *sum = multiply_add::<FUSED>(*factor, *v, *sum);
                }
            }
            for (sum, v) in sums.iter_mut().zip(whitened) {
                *sum = multiply_add::<FUSED>(v, v, *sum);
            }
        }
        let log_volume = *log_volume as f32;
        sums.map(|sum| log_volume - 0.5 * sum)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// log N by the textbook, for z = (0.3, −1): S = L Lᵀ with L = [[2, 0], [1, 1]], so L⁻¹ = [[0.5, 0], [−0.5, 1]].
    #[test]
    fn scores_are_log_densities_of_the_dense_gaussian() {
        let half = |values: &[f32]| -> Vec<f16> { values.iter().map(|v| f16::from_f32(*v)).collect() };
        let mut gaussian = PackedGaussian::default();
        gaussian.load(&half(&[9.0, 9.0, 9.0]), &half(&[1.0; 6]), 3.0);
        let root = half(&[0.5, -0.5, 1.0]);
        gaussian.load(&half(&[1.0, -0.5]), &root, log_volume(2, &root));
        // S = [[4, 2], [2, 2]], |S| = 4, S⁻¹ = [[0.5, −0.5], [−0.5, 1]], centred (−0.7, −0.5)
        let expected = -0.5 * (4.0_f64.ln() + 0.5 * 0.49 - 0.35 + 0.25);
        let mut centred = [9.0; LANES];
        gaussian.centre(&[0.3, -1.0], &mut centred);
        let found = gaussian.log_density(&centred);
        assert!((found - expected).abs() < 1e-6, "{found} {expected}");
        let mut points = vec![[0.0; 8]; 2];
        (points[0][5], points[1][5]) = (0.3, -1.0);
        let found = gaussian.log_densities(&points, &mut Vec::new())[5];
        assert!((f64::from(found) - expected).abs() < 1e-6, "{found} {expected}");
    }
}
