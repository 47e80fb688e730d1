//! Prediction of unknown voxels by a class that was conditioned: mean and variance of their latent occupancy, a block of voxels of
//! one column at a time.
//!
//! The variance of a voxel with row b is ‖S b‖² with a lower triangular S: L⁻¹Λ^½ in the class's own basis, and the factor of the same
//! form in W' where that is read instead. One value of S serves a whole block of voxels.

use crate::lanes::{LANES, Lanes, multiply_add};

/// Rows of S that are multiplied together: enough sums at once to hide the latency of an addition.
const GROUP: usize = 4;

/// The posterior of a class as prediction reads it.
#[derive(Clone, Debug, Default)]
pub struct Posterior {
    /// Components of a voxel.
    size: usize,
    /// S, and below it the coefficients, for values in the units of the rows; by groups of [`GROUP`] rows: for each of their
    /// columns the values of these rows.
    factors: Vec<[f32; GROUP]>,
}

/// Of a block of voxels.
#[derive(Clone, Copy, Debug)]
pub struct Predicted {
    /// Posterior means, not clamped.
    pub mean: Lanes,
    /// Their variances, without the noise.
    pub variance: Lanes,
    /// Class means, not clamped.
    pub class_mean: Lanes,
}

/// Columns that are not zero in the group of rows from `first` on. The row of coefficients, after the last of S, is full.
fn columns_of(first: usize, size: usize) -> usize {
    if first + GROUP > size { size } else { first + GROUP }
}

impl Posterior {
    /// Room for voxels of `size` components.
    pub fn new(size: usize) -> Self {
        let mut posterior = Self::default();
        posterior.resize(size);
        posterior
    }

    /// Makes room for voxels of `size` components.
    pub fn resize(&mut self, size: usize) {
        let factors = (0..=size).step_by(GROUP).map(|first| columns_of(first, size)).sum();
        self.size = size;
        self.factors.resize(factors, [0.0; GROUP]);
    }

    /// Takes in the mean of the coefficients, S by its entries (i, j), j ≤ i, and the units of each component of the rows.
    pub fn prepare(&mut self, units: &[f32], coefficients: &[f32], mut entry: impl FnMut(usize, usize) -> f32) {
        let size = self.size;
        let mut out = self.factors.iter_mut();
        for first in (0..=size).step_by(GROUP) {
            for (j, out) in (0..columns_of(first, size)).zip(&mut out) {
                for (i, out) in (first..).zip(out) {
                    *out = match i {
                        _ if i == size => coefficients[j] * units[j],
                        _ if j <= i && i < size => entry(i, j) * units[j],
                        _ => 0.0,
                    };
                }
            }
        }
    }
}

impl Posterior {
    /// Mean and variance of a block of voxels, given their components and class means.
    #[inline(always)]
    pub fn predict<const FUSED: bool>(&self, block: &[Lanes], class_mean: Lanes) -> Predicted {
        let size = block.len();
        let (mut mean, mut variance) = (class_mean, [0.0; LANES]);
        let mut factors = &self.factors[..];
        for first in (0..=size).step_by(GROUP) {
            let (group, rest) = factors.split_at(columns_of(first, size));
            factors = rest;
            let mut sums = [[0.0_f32; LANES]; GROUP];
            for (b, factors) in block.iter().zip(group) {
                for g in 0..GROUP {
                    for l in 0..LANES {
                        sums[g][l] = multiply_add::<FUSED>(factors[g], b[l], sums[g][l]);
                    }
                }
            }
            for (g, sums) in sums.iter().enumerate() {
                // After the row of coefficients there is nothing but zeros.
                let (squared, added) = if first + g == size { (0.0, 1.0) } else { (1.0, 0.0) };
                for l in 0..LANES {
                    variance[l] = multiply_add::<FUSED>(squared * sums[l], sums[l], variance[l]);
                    mean[l] = multiply_add::<FUSED>(added, sums[l], mean[l]);
                }
            }
        }
        Predicted { mean, variance, class_mean }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::Dims;
    use crate::perception::basis::columns::{BlockScratch, Columns};
    use crate::perception::basis::rows::Rows;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(40))]
        #[test]
        fn a_block_is_predicted_as_its_voxels_are_one_by_one(size in 0..19_usize, z in 8..40_usize, seed in 0..1000_usize) {
            let dims = Dims::new(8, 8, z).unwrap();
            let value = |i: usize| ((i * 7919 + seed * 31) % 1009) as f32 / 1009.0 - 0.5;
            let stride = (size + 2).next_multiple_of(LANES);
            let rows = Rows::new(&(0..dims.voxels() * stride).map(value).collect::<Vec<_>>(), stride);
            let columns = Columns::new(dims, size, &rows);
            let mut posterior = Posterior::new(size);
            let s = |i: usize, j: usize| value(i * 17 + j + 5);
            let coefficients: Vec<f32> = (0..size).map(|h| value(h + 99)).collect();
            posterior.prepare(rows.scales(), &coefficients, s);
            for column in [0, 37, 63] {
                for at in (0..z).step_by(LANES) {
                    let mut scratch = BlockScratch::default();
                    let (block, class_mean) = columns.load(column, at, &mut scratch);
                    let found = posterior.predict::<false>(block, class_mean);
                    for l in 0..LANES.min(z - at) {
                        let row: Vec<f32> = (0..=size).map(|h| rows.value(column * z + at + l, h)).collect();
                        let mean = row[size] + (0..size).map(|h| row[h] * value(h + 99)).sum::<f32>();
                        let variance: f32 = (0..size).map(|i| (0..=i).map(|j| s(i, j) * row[j]).sum::<f32>().powi(2)).sum();
                        prop_assert_eq!(found.class_mean[l], row[size]);
                        prop_assert!((found.mean[l] - mean).abs() < 1e-5, "{} {}", found.mean[l], mean);
                        prop_assert!((found.variance[l] - variance).abs() < 1e-5 * (1.0 + variance), "{} {}", found.variance[l], variance);
                    }
                }
            }
        }
    }
}
