//! How much of what was seen a class explains: the share of the seen surface that lies within a voxel of the class's reconstruction.

use super::conditional::Conditional;
use super::subspace::{ClassSubspace, Reconstruction};
use crate::grid::Dims;
use crate::lanes::{Kernel, dispatch};

/// Filled voxels that are looked at, at most, evenly among all: enough for the share to be right within two hundredths.
const MOST: usize = 512;
/// A voxel belongs to the reconstruction from this posterior mean of its occupancy on.
const FILLED: f32 = 0.5;

/// Share of the `filled` voxels that are voxels of the class's reconstruction or touch one by a face; `conditional` is the class conditioned on
/// the observation that they are of. `None` where nothing is filled, and of classes whose rows are read in place, which would cost too much.
pub fn share_explained(class: &ClassSubspace, conditional: &Conditional, dims: Dims, filled: &[usize]) -> Option<f64> {
    let step = filled.len().div_ceil(MOST).max(1);
    let reconstruction = class.reconstruction(conditional)?;
    let looked_at = filled.len().div_ceil(step);
    let explained = dispatch(Explained { reconstruction, dims, filled, step });
    (looked_at > 0).then(|| explained as f64 / looked_at as f64)
}

/// Counts the voxels that are explained, among one of `step`.
struct Explained<'a> {
    reconstruction: Reconstruction<'a>,
    dims: Dims,
    filled: &'a [usize],
    step: usize,
}

impl Kernel for Explained<'_> {
    type Output = usize;

    #[inline(always)]
    fn run<const FUSED: bool>(self) -> usize {
        let sides = <[usize; 3]>::from(self.dims);
        let strides = [sides[1] * sides[2], sides[2], 1];
        let mut count = 0;
        for voxel in self.filled.iter().copied().step_by(self.step) {
            let at = self.dims.coordinates(voxel);
            let mut is_explained = self.reconstruction.mean::<FUSED>(voxel) >= FILLED;
            // Along z first: these neighbours lie beside it in memory.
            for axis in [2, 1, 0] {
                if !is_explained && at[axis] > 0 {
                    is_explained = self.reconstruction.mean::<FUSED>(voxel - strides[axis]) >= FILLED;
                }
                if !is_explained && at[axis] + 1 < sides[axis] {
                    is_explained = self.reconstruction.mean::<FUSED>(voxel + strides[axis]) >= FILLED;
                }
            }
            count += usize::from(is_explained);
        }
        count
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::{Basis, ClassModel};
    use half::f16;
    use proptest::prelude::*;

    /// A class with two directions on a grid of three different sides, conditioned on nothing but with the given coefficients.
    fn class(dims: Dims, coefficients: [f32; 2], seed: usize) -> (ClassSubspace, Conditional) {
        let a = 3;
        let rows = (0..dims.voxels() * a).map(|i| f16::from_f32(((i * 7919 + seed) % 1009) as f32 / 1009.0 - 0.4)).collect();
        let directions = vec![0.8, 0.6, 0.0, 0.0, 0.0, 1.0];
        let class = ClassModel { mean: vec![0.9, -0.2, 0.4], covariance: vec![], directions, variances: vec![4.0, 0.7], hulls: vec![] };
        let mut conditional = Conditional::new(2);
        conditional.coefficients.copy_from_slice(&coefficients);
        (ClassSubspace::new(dims, &Basis::new(a, rows), &class), conditional)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]
        /// By the reconstruction of every voxel, and a look at all pairs of voxels.
        #[test]
        fn the_share_is_that_of_the_whole_reconstruction(
            coefficients in [-1.5_f32..1.5, -1.5_f32..1.5],
            seed in 0..1000_usize,
            filled in proptest::collection::btree_set(0..8 * 9 * 10_usize, 1..700),
        ) {
            let dims = Dims::new(8, 9, 10).unwrap();
            let (class, conditional) = class(dims, coefficients, seed);
            let mut means = Vec::new();
            class.reconstruct(&conditional, |mean| means.push(mean));
            let filled: Vec<usize> = filled.into_iter().collect();
            let at = |voxel: usize| dims.coordinates(voxel).map(|v| v as isize);
            let touches = |a: usize, b: usize| (0..3).map(|axis| at(a)[axis].abs_diff(at(b)[axis])).sum::<usize>() <= 1;
            let is_explained = |voxel: usize| (0..dims.voxels()).any(|other| touches(voxel, other) && means[other] >= 0.5);
            let looked_at: Vec<usize> = filled.iter().copied().step_by(if filled.len() > MOST { 2 } else { 1 }).collect();
            let expected = looked_at.iter().filter(|voxel| is_explained(**voxel)).count() as f64 / looked_at.len() as f64;
            prop_assert_eq!(share_explained(&class, &conditional, dims, &filled), Some(expected));
        }
    }

    #[test]
    fn of_nothing_there_is_no_share() {
        let dims = Dims::cube(8).unwrap();
        let (class, conditional) = class(dims, [1.0, 0.0], 5);
        assert_eq!(share_explained(&class, &conditional, dims, &[]), None);
    }
}
