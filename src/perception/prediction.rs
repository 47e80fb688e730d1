//! What a class that was conditioned says of unknown voxels: mean and variance of their latent occupancy, a block of voxels of
//! one column at a time.
//!
//! The variance of a voxel with row b is ‖S b‖² with the lower triangular S = L⁻¹Λ^½. Voxels of a column lie side by side in
//! memory, component by component, so that one value of S serves a whole block of them, and nothing is gathered.

use super::lanes::{LANES, Lanes, load, multiply_add};
use crate::grid::Dims;

/// Rows of S that are multiplied together: enough sums at once to hide the latency of an addition.
const GROUP: usize = 4;

/// A class basis and mean over voxels, column by column.
pub struct Columns {
    /// k, the number of directions.
    size: usize,
    /// Voxels of a column, padded to whole blocks.
    height: usize,
    /// `[column][component][z]`; the last component is the mean.
    values: Vec<f32>,
}

/// The posterior of a class as prediction reads it.
#[derive(Clone, Debug, Default)]
pub struct Posterior {
    /// Mean of the coefficients, k values.
    pub coefficients: Vec<f32>,
    /// S by groups of [`GROUP`] rows: for each of its columns the values of these rows.
    spread: Vec<f32>,
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

impl Posterior {
    /// Room for a class with `size` directions.
    pub fn new(size: usize) -> Self {
        let spread = (0..size).step_by(GROUP).map(|first| GROUP * (first + GROUP).min(size)).sum();
        Self { coefficients: vec![0.0; size], spread: vec![0.0; spread] }
    }

    /// Takes in S, k × k, given by its entries (i, j), j ≤ i.
    pub fn set_spread(&mut self, mut entry: impl FnMut(usize, usize) -> f32) {
        let size = self.coefficients.len();
        let mut out = self.spread.iter_mut();
        for first in (0..size).step_by(GROUP) {
            for j in 0..(first + GROUP).min(size) {
                for i in first..first + GROUP {
                    if let Some(out) = out.next() {
                        *out = if j <= i && i < size { entry(i, j) } else { 0.0 };
                    }
                }
            }
        }
    }
}

impl Columns {
    /// Rearranges `rows`: `width` values per voxel, of which the first are the k components and the mean.
    pub fn new(dims: Dims, size: usize, rows: &[f32], width: usize) -> Self {
        let height = dims.z().next_multiple_of(LANES);
        let mut values = vec![0.0; Self::values(dims, size)];
        for (column, values) in values.chunks_exact_mut((size + 1) * height).enumerate() {
            for (z, row) in rows[column * dims.z() * width..(column + 1) * dims.z() * width].chunks_exact(width).enumerate() {
                row[..=size].iter().enumerate().for_each(|(component, value)| values[component * height + z] = *value);
            }
        }
        Self { size, height, values }
    }

    /// Numbers that are kept of a class with `size` directions.
    pub fn values(dims: Dims, size: usize) -> usize {
        dims.columns() * (size + 1) * dims.z().next_multiple_of(LANES)
    }

    /// Mean and variance of the voxels of a column from `z` on, a multiple of [`LANES`].
    #[inline(always)]
    pub fn predict<const FUSED: bool>(&self, posterior: &Posterior, column: usize, z: usize) -> Predicted {
        let stride = (self.size + 1) * self.height;
        let values = &self.values[column * stride + z..(column + 1) * stride];
        let class_mean = *load(&values[self.size * self.height..]);
        let mut mean = class_mean;
        for (component, coefficient) in values.chunks(self.height).zip(&posterior.coefficients) {
            let b = load(component);
            for l in 0..LANES {
                mean[l] = multiply_add::<FUSED>(*coefficient, b[l], mean[l]);
            }
        }
        let mut variance = [0.0; LANES];
        let mut spread = &posterior.spread[..];
        for first in (0..self.size).step_by(GROUP) {
            let (group, rest) = spread.split_at(GROUP * (first + GROUP).min(self.size));
            spread = rest;
            let mut sums = [[0.0_f32; LANES]; GROUP];
            for (component, s) in values.chunks(self.height).zip(group.as_chunks::<GROUP>().0) {
                let b = load(component);
                for g in 0..GROUP {
                    for l in 0..LANES {
                        sums[g][l] = multiply_add::<FUSED>(s[g], b[l], sums[g][l]);
                    }
                }
            }
            for sums in &sums {
                for l in 0..LANES {
                    variance[l] = multiply_add::<FUSED>(sums[l], sums[l], variance[l]);
                }
            }
        }
        Predicted { mean, variance, class_mean }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(40))]
        #[test]
        fn a_block_is_predicted_as_its_voxels_are_one_by_one(size in 0..11_usize, z in 8..40_usize, seed in 0..1000_usize) {
            let dims = Dims::new(8, 8, z).unwrap();
            let value = |i: usize| ((i * 7919 + seed * 31) % 1009) as f32 / 1009.0 - 0.5;
            let width = size + 2;
            let rows: Vec<f32> = (0..dims.voxels() * width).map(value).collect();
            let columns = Columns::new(dims, size, &rows, width);
            let mut posterior = Posterior::new(size);
            let s = |i: usize, j: usize| value(i * 17 + j + 5);
            (0..size).for_each(|h| posterior.coefficients[h] = value(h + 99));
            posterior.set_spread(s);
            for column in [0, 37, 63] {
                for at in (0..z).step_by(LANES) {
                    let found = columns.predict::<false>(&posterior, column, at);
                    for l in 0..LANES.min(z - at) {
                        let row = &rows[(column * z + at + l) * width..];
                        let mean = row[size] + (0..size).map(|h| row[h] * value(h + 99)).sum::<f32>();
                        let variance: f32 = (0..size).map(|i| (0..=i).map(|j| s(i, j) * row[j]).sum::<f32>().powi(2)).sum();
                        prop_assert_eq!(found.class_mean[l], row[size]);
                        prop_assert!((found.mean[l] - mean).abs() < 1e-5, "{} {}", found.mean[l], mean);
                        prop_assert!((found.variance[l] - variance).abs() < 1e-5, "{} {}", found.variance[l], variance);
                    }
                }
            }
        }
    }
}
