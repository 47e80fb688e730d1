//! Linear projection onto W' (eq. 5 without the mean, as W' spans the means): the sum of the rows of W' over a set of voxels.
//!
//! Voxels come in vertical runs, so prefix sums of W' along each column turn a run of any length into two rows.

use crate::grid::{Dims, for_each_run};
use crate::model::Basis;
use fixedbitset::FixedBitSet;
use rayon::prelude::*;

/// Prefix sums of a d × a matrix along the columns of the grid.
pub struct ColumnSums {
    dims: Dims,
    width: usize,
    /// Row `v` is the sum over the voxels of v's column from its bottom up to and including v.
    sums: Vec<f32>,
}

impl ColumnSums {
    /// Prefix sums of W'; d × a × 4 bytes.
    pub fn new(dims: Dims, basis: &Basis) -> Self {
        let width = basis.rank();
        let mut sums = vec![0.0; dims.voxels() * width];
        sums.par_chunks_mut(dims.z() * width).enumerate().for_each(|(column, sums)| {
            basis.widen(column * dims.z()..(column + 1) * dims.z(), sums);
            for k in 1..dims.z() {
                let (below, here) = sums.split_at_mut(k * width);
                let below = &below[(k - 1) * width..];
                here[..width].iter_mut().zip(below).for_each(|(here, below)| *here += below);
            }
        });
        Self { dims, width, sums }
    }

    /// W'ᵀx of the binary vector with these bits, into `out` (a values).
    pub fn project(&self, bits: &FixedBitSet, out: &mut [f32]) {
        out.fill(0.0);
        pulp::Arch::new().dispatch(|| for_each_run(bits, self.dims, 0..self.dims.columns(), |start, end| self.add(start, end, out)));
    }

    /// The same of the binary vector made of these runs (start, end), each inside one column.
    pub fn project_runs(&self, runs: impl Iterator<Item = (usize, usize)>, out: &mut [f32]) {
        out.fill(0.0);
        pulp::Arch::new().dispatch(|| runs.for_each(|(start, end)| self.add(start, end, out)));
    }

    #[inline(always)]
    fn add(&self, start: usize, end: usize, out: &mut [f32]) {
        out.iter_mut().zip(self.row(end - 1)).for_each(|(out, sum)| *out += sum);
        if !start.is_multiple_of(self.dims.z()) {
            out.iter_mut().zip(self.row(start - 1)).for_each(|(out, sum)| *out -= sum);
        }
    }

    #[inline(always)]
    fn row(&self, voxel: usize) -> &[f32] {
        &self.sums[voxel * self.width..(voxel + 1) * self.width]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use half::f16;

    #[test]
    fn projection_by_runs_is_the_sum_of_the_rows() {
        let dims = Dims::new(8, 9, 11).unwrap();
        let rows = (0..dims.voxels() * 3).map(|i| f16::from_f32(((i * 37 % 101) as f32 - 50.0) / 64.0)).collect();
        let basis = Basis::new(3, rows);
        let mut bits = FixedBitSet::with_capacity(dims.voxels());
        (0..dims.voxels()).filter(|v| v * v % 7 < 4).for_each(|v| bits.insert(v));
        let mut out = [f32::NAN; 3];
        ColumnSums::new(dims, &basis).project(&bits, &mut out);
        for (h, value) in out.iter().enumerate() {
            let expected: f64 = bits.ones().map(|v| f64::from(basis.row(v)[h].to_f32())).sum();
            assert!((f64::from(*value) - expected).abs() < 1e-3, "{value} {expected}");
        }
    }
}
