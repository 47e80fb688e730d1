//! Class bases and the shared basis W' (text after eq. 9).
//!
//! Every basis vector is a linear combination of training shapes, so a class basis is kept as its n × k combination, and the
//! d-dimensional vectors exist only block by block of voxels: two passes over the bit-packed shapes, whatever d is.

use super::gram::centred;
use super::progress::Pass;
use super::vbpca::{self, Priors, Spectrum, Vbpca};
use crate::grid::{Dims, Occupancy};
use crate::linear::{LinearError, symmetric_eigen};
use crate::model::Basis;
use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, MatMut, MatRef, Par};
use half::f16;
use half::slice::HalfFloatSliceExt;
use rayon::prelude::*;
use std::ops::{Range, RangeInclusive};

/// Rows of a block of voxels: large enough for matrix products at full speed, small enough for the cache.
const BLOCK: usize = 2048;
/// Blocks whose Gram matrices are held at once.
const GROUP: usize = 8;

/// VBPCA of one class.
pub(super) struct ClassBasis {
    /// n × (k + 1): the k orthonormal basis vectors and the mean (scaled to unit length) as combinations of the shapes.
    combination: Mat<f32>,
    /// The analytic solution; what it prunes of the components that the share of variance asks for is not in the basis.
    pub vbpca: Vbpca,
    /// Share of the variance that the k vectors carry.
    pub explained: f64,
    /// Variance of a voxel about the class mean, mean over the voxels.
    pub voxel_variance: f64,
}

impl ClassBasis {
    /// Learns the basis of a class from its shapes' overlaps (n × n), sized by `share` of the variance within `range`.
    pub fn new(overlaps: &Mat<f64>, voxels: usize, share: f64, range: RangeInclusive<usize>) -> Result<Self, LinearError> {
        let n = overlaps.nrows();
        let gram = centred(overlaps);
        let eigen = symmetric_eigen(gram.as_ref())?;
        let trace: f64 = (0..n).map(|i| gram[(i, i)]).sum();
        let eigenvalues = &eigen.values[..n.saturating_sub(1)];
        let most = vbpca::basis_size(eigenvalues, share, range);
        let spectrum = Spectrum { eigenvalues: &eigenvalues[..most], trace, voxels, objects: n };
        let vbpca = vbpca::solve(&spectrum, Priors::default());
        let size = vbpca.components.len();
        let total: f64 = (0..n).map(|i| overlaps.col_as_slice(i).iter().sum::<f64>()).sum();
        let mean_scale = if total > 0.0 { 1.0 / total.sqrt() } else { 0.0 };
        let combination = Mat::from_fn(n, size + 1, |i, h| {
            if h == size {
                return mean_scale as f32;
            }
            // Exactly centred, so that the mean of the shapes drops out of the product.
            let column = eigen.vectors.col_as_slice(h);
            let mean = column.iter().sum::<f64>() / n as f64;
            ((column[i] - mean) / eigen.values[h].sqrt()) as f32
        });
        let explained = if trace > 0.0 { eigen.values[..size].iter().sum::<f64>() / trace } else { 0.0 };
        Ok(Self { combination, vbpca, explained, voxel_variance: trace / (voxels * n) as f64 })
    }

    /// The k basis vectors in the coordinates of a linear projection (a × k), given those of the shapes (n × a).
    pub fn directions(&self, projected: MatRef<'_, f32>) -> Mat<f32> {
        projected.transpose() * self.combination.as_ref().subcols(0, self.size())
    }

    /// Number of basis vectors, k.
    pub fn size(&self) -> usize {
        self.combination.ncols() - 1
    }
}

/// The orthonormal basis W' of the span of all class bases and means, from `classes` of (shapes, basis).
///
/// Directions whose share is below rounding are left out: the rank of the concatenated bases (the paper's rank(W)).
/// `pass` is told when a pass over the voxels begins. Blocks that no shape touches are rows of zeros, and passed over.
pub(super) fn shared_basis(dims: Dims, classes: &[(&[&Occupancy], &ClassBasis)], pass: &dyn Fn(Pass)) -> Result<Basis, LinearError> {
    const RANK_TOLERANCE: f64 = 1e-6;
    let width: usize = classes.iter().map(|(_, basis)| basis.combination.ncols()).sum();
    let blocks: Vec<Range<usize>> = (0..dims.voxels()).step_by(BLOCK).map(|start| start..(start + BLOCK).min(dims.voxels())).collect();

    let touched = |block: &Range<usize>| classes.iter().any(|(shapes, _)| shapes.iter().any(|shape| any(shape, block)));

    pass(Pass::Gram);
    let mut gram = Mat::<f64>::zeros(width, width);
    for group in blocks.chunks(GROUP) {
        let parts: Vec<Mat<f32>> = group
            .par_iter()
            .filter(|block| touched(block))
            .map(|block| {
                let rows = concatenated(classes, width, block.clone());
                let mut part = Mat::zeros(width, width);
                matmul(part.as_mut(), Accum::Replace, rows.transpose(), rows.as_ref(), 1.0, Par::Seq);
                part
            })
            .collect();
        for part in parts {
            for j in 0..width {
                gram.col_as_slice_mut(j).iter_mut().zip(part.col_as_slice(j)).for_each(|(sum, v)| *sum += f64::from(*v));
            }
        }
    }
    let eigen = symmetric_eigen(gram.as_ref())?;
    let rank = eigen.values.iter().filter(|v| **v > RANK_TOLERANCE * eigen.values[0]).count().max(1);
    let transform = Mat::from_fn(width, rank, |i, h| (eigen.vectors[(i, h)] / eigen.values[h].max(1e-30).sqrt()) as f32);

    pass(Pass::Basis);
    // Zeros that the system gives without memory until something else is written.
    let mut rows: Vec<f16> = bytemuck::allocation::zeroed_vec(dims.voxels() * rank);
    rows.par_chunks_mut(BLOCK * rank).zip(&blocks).filter(|(_, block)| touched(block)).for_each(|(out, block)| {
        let block = concatenated(classes, width, block.clone());
        let mut product = Mat::<f32>::zeros(rank, block.nrows());
        matmul(product.as_mut(), Accum::Replace, transform.transpose(), block.transpose(), 1.0, Par::Seq);
        for (v, row) in out.chunks_exact_mut(rank).enumerate() {
            row.convert_from_f32_slice(product.col_as_slice(v));
        }
    });
    Ok(Basis::new(rank, rows))
}

/// Rows `block` of W = [W_1, μ_1, …, W_m, μ_m].
fn concatenated(classes: &[(&[&Occupancy], &ClassBasis)], width: usize, block: Range<usize>) -> Mat<f32> {
    let mut out = Mat::zeros(block.len(), width);
    let mut first = 0;
    let mut unpacked = Vec::new();
    for (shapes, basis) in classes {
        unpack(shapes, block.clone(), &mut unpacked);
        let data = MatRef::from_column_major_slice(&unpacked, block.len(), shapes.len());
        let columns = basis.combination.ncols();
        let part: MatMut<'_, f32> = out.as_mut().subcols_mut(first, columns);
        matmul(part, Accum::Replace, data, basis.combination.as_ref(), 1.0, Par::Seq);
        first += columns;
    }
    out
}

/// Whether a shape fills any voxel of a block, which starts at a whole word.
fn any(shape: &Occupancy, block: &Range<usize>) -> bool {
    shape.bits().as_slice()[block.start / 64..block.end.div_ceil(64)].iter().any(|word| *word != 0)
}

/// The voxels `block` of each shape as numbers, one column per shape.
fn unpack(shapes: &[&Occupancy], block: Range<usize>, out: &mut Vec<f32>) {
    out.clear();
    out.reserve(shapes.len() * block.len());
    for shape in shapes {
        let words = shape.bits().as_slice();
        out.extend(block.clone().map(|v| (words[v / 64] >> (v % 64) & 1) as f32));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::learning::gram::overlaps;

    fn shapes(dims: Dims, count: usize, kind: usize) -> Vec<Occupancy> {
        (0..count)
            .map(|s| {
                Occupancy::from_fn(dims, |i, j, k| i + kind * j < 6 + s % 4 && !(k * (s + 3) + j * kind + s).is_multiple_of(3 + s % 3))
            })
            .collect()
    }

    #[test]
    fn the_shared_basis_is_orthonormal_and_spans_class_bases_and_means() {
        let dims = Dims::new(8, 10, 9).unwrap();
        let data = [shapes(dims, 7, 1), shapes(dims, 9, 2)];
        let views: Vec<Vec<&Occupancy>> = data.iter().map(|s| s.iter().collect()).collect();
        let bases: Vec<ClassBasis> = views.iter().map(|v| ClassBasis::new(&overlaps(v), dims.voxels(), 0.8, 2..=6).unwrap()).collect();
        let classes: Vec<_> = views.iter().map(Vec::as_slice).zip(&bases).collect();
        let basis = shared_basis(dims, &classes, &|_| {}).unwrap();
        let rows = Mat::from_fn(basis.voxels(), basis.rank(), |v, h| f64::from(basis.row(v)[h].to_f32()));
        let gram = rows.transpose() * &rows;
        for i in 0..basis.rank() {
            for j in 0..basis.rank() {
                assert!((gram[(i, j)] - f64::from(u8::from(i == j))).abs() < 1e-3);
            }
        }
        // Every column of [W_1, μ_1, W_2, μ_2] is reproduced by projection onto W'.
        let width = bases.iter().map(|b| b.size() + 1).sum();
        let w = concatenated(&classes, width, 0..dims.voxels());
        let w = Mat::from_fn(w.nrows(), w.ncols(), |i, j| f64::from(w[(i, j)]));
        let again = &rows * (rows.transpose() * &w);
        for j in 0..width {
            assert!(((0..w.nrows()).map(|i| w[(i, j)].powi(2)).sum::<f64>() - 1.0).abs() < 1e-5, "unit columns");
            for i in 0..w.nrows() {
                assert!((w[(i, j)] - again[(i, j)]).abs() < 2e-3);
            }
        }
    }
}
