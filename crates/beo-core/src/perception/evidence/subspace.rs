//! A class as a Gaussian over voxels in its own basis: o ~ N(μ_s, W_s Λ_s W_sᵀ + σ² I).
//!
//! Given the known voxels, one k × k factorisation gives the class's log evidence, the posterior of its coefficients, and so
//! the mean and the deviation of every unknown voxel. It is the conditional of the model of eq. 1, exact, and about ten times
//! cheaper than the same in the shared basis. Of the voxels it needs the Gram matrix of [W_s, μ_s, 1] over the unknown ones
//! (subtracted from that over all voxels: eq. 16 with V_qᵀV_q = I − unknown) and a sum over the filled ones (eq. 17).

use super::conditional::{BLOCK, ClassGram, Conditional, SharedScratch, add_gram, stride};
use super::prediction::{Posterior, Predicted};
use crate::grid::Dims;
use crate::lanes::{Kernel, LANES, Lanes, dispatch, multiply_add, widen};
use crate::linear::{LinearError, dot64};
use crate::model::{Basis, ClassModel, MOST_COMPONENTS};
use crate::perception::basis::columns::{BlockScratch, Columns};
use crate::perception::basis::known::Known;
use crate::perception::basis::reading::BasisRows;
use crate::perception::basis::rows::Rows;
use crate::perception::basis::shared_rows::SharedRows;
use crate::perception::basis::shared_sums::SharedSums;
use crate::perception::basis::tiles::{TileGrams, Tiling};
use crate::perception::kernels::row_gram::{AddGram, packed, packed_len};
use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, MatMut, MatRef, Par};
use rayon::prelude::*;
use std::sync::Arc;

/// One class, ready for queries.
pub struct ClassSubspace {
    /// The prior, and the Gram matrix over all voxels.
    prior: ClassGram,
    /// d rows of [W_s, μ_s, 1].
    rows: ClassRows,
}

/// A class's rows over the voxels.
enum ClassRows {
    /// Derived from W' once and kept: the fastest, at some 200 bytes per voxel and class.
    Derived {
        rows: Rows,
        /// The same without the ones, column by column.
        columns: Columns,
        /// Gram matrices over stacks of voxels.
        tiles: TileGrams,
    },
    /// Combinations of the columns of W', which is read where it lies. Its sums over an observation serve all classes.
    Shared {
        rows: Arc<SharedRows>,
        /// a × (k + 1): directions and mean in coordinates of W'.
        transform: Mat<f64>,
    },
}

impl ClassSubspace {
    /// Derives the class's voxel-space basis and mean from the shared basis.
    pub fn new(dims: Dims, basis: &Basis, class: &ClassModel) -> Self {
        let (a, k) = (basis.rank(), class.variances.len());
        let (width, stride) = (k + 2, stride(k));
        let transform = Mat::from_fn(a, k + 1, |i, h| if h < k { class.directions[h * a + i] } else { class.mean[i] });
        let mut wide = vec![0.0_f32; dims.voxels() * stride];
        wide.par_chunks_mut(BLOCK * stride).enumerate().for_each(|(block, rows)| {
            let count = rows.len() / stride;
            let mut shared = vec![0.0_f32; count * a];
            basis.widen(block * BLOCK..block * BLOCK + count, &mut shared);
            let shared = MatRef::from_column_major_slice(&shared, a, count);
            let mut product = Mat::<f32>::zeros(k + 1, count);
            matmul(product.as_mut(), Accum::Replace, transform.transpose(), shared, 1.0, Par::Seq);
            for (v, row) in rows.chunks_exact_mut(stride).enumerate() {
                row[..=k].copy_from_slice(product.col_as_slice(v));
                row[k + 1] = 1.0;
            }
        });
        let rows = Rows::new(&wide, stride);
        // From here on as they were rounded: sums over parts of the voxels then fit to those over all.
        rows.widen(&[(0, dims.voxels())], &mut wide);
        let grams: Vec<Vec<f64>> = wide
            .par_chunks(BLOCK * stride)
            .map(|rows| {
                let mut gram = vec![0.0; packed_len(width)];
                dispatch(AddGram::of_all(rows, rows.len() / stride, stride, width, &mut gram));
                gram
            })
            .collect();
        let mut gram = vec![0.0; packed_len(width)];
        for part in &grams {
            gram.iter_mut().zip(part).for_each(|(sum, part)| *sum += part);
        }
        let tiles = TileGrams::new(Tiling::new(dims), &wide, stride, width);
        let columns = Columns::new(dims, k, &rows);
        Self { prior: ClassGram { size: k, scales: roots(&class.variances), gram }, rows: ClassRows::Derived { rows, columns, tiles } }
    }

    /// A class, ready for queries that are taken apart by [`BasisRows::take_apart`].
    pub fn of(rows: &BasisRows, class: &ClassModel) -> Self {
        match rows {
            BasisRows::Derived { dims, basis, .. } => Self::new(*dims, basis, class),
            BasisRows::InPlace(rows) => Self::shared(rows, class),
        }
    }

    /// A class without anything derived over voxels: observations are summed by [`SharedRows::sum`] before.
    pub fn shared(rows: &Arc<SharedRows>, class: &ClassModel) -> Self {
        let (a, k) = (rows.rank(), class.variances.len());
        let entry = |i: usize, h: usize| f64::from(if h < k { class.directions[h * a + i] } else { class.mean[i] });
        let transform = Mat::from_fn(a, k + 1, entry);
        let mut gram = vec![0.0; packed_len(k + 2)];
        transform_gram(rows.gram(), &transform, &mut Vec::new(), &mut gram);
        Self {
            prior: ClassGram { size: k, scales: roots(&class.variances), gram },
            rows: ClassRows::Shared { rows: rows.clone(), transform },
        }
    }

    /// Bytes that [`Self::new`] keeps for a class with `size` directions.
    pub fn bytes(dims: Dims, size: usize) -> usize {
        2 * (dims.voxels() * stride(size) + Columns::values(dims, size)) + 4 * Tiling::new(dims).cells() * packed_len(size + 2)
    }

    /// Bytes that conditioning a class with `size` directions reads: sums of whole levels, rows of the other unknown voxels and of the
    /// filled ones, the Gram matrix over all voxels.
    pub fn bytes_to_condition(size: usize, known: &Known) -> usize {
        let rest: usize = known.division.rest.iter().map(|(start, end)| end - start).sum();
        let rows = (rest + known.filled.len()) * stride(size);
        packed_len(size + 2) * (known.division.levels.len() * size_of::<f32>() + size_of::<f64>()) + rows * size_of::<i16>()
    }

    /// Blocks of voxels that completing with a class computes, and the bytes that it reads of one with `size` directions.
    pub fn read_to_complete(dims: Dims, size: usize, known: &Known) -> (usize, usize) {
        let block = |voxel: usize| voxel / dims.z() * dims.z().div_ceil(LANES) + voxel % dims.z() / LANES;
        let (mut blocks, mut next) = (0, 0);
        for &(start, end) in &known.unknown {
            let (first, last) = (block(start).max(next), block(end - 1) + 1);
            blocks += last.saturating_sub(first);
            next = next.max(last);
        }
        (blocks, blocks * (size + 1) * LANES * size_of::<i16>())
    }

    /// Number of directions, k.
    pub fn size(&self) -> usize {
        self.prior.size
    }

    /// The class mean of one voxel, as learned (not clamped).
    pub fn mean(&self, voxel: usize) -> f32 {
        match &self.rows {
            ClassRows::Derived { rows, .. } => rows.value(voxel, self.prior.size),
            ClassRows::Shared { rows, .. } if !rows.reaches(voxel) => 0.0,
            ClassRows::Shared { rows, transform } => {
                let mut row = vec![0.0; rows.rank()];
                rows.row(voxel, &mut row);
                row.iter().zip(transform.col_as_slice(self.prior.size)).map(|(v, m)| v * *m as f32).sum()
            }
        }
    }

    /// Prediction by the posterior for the voxels of a column from `z` on, a multiple of [`LANES`].
    #[inline(always)]
    pub(in crate::perception) fn predict<const FUSED: bool>(
        &self,
        posterior: &Posterior,
        column: usize,
        z: usize,
        scratch: &mut BlockScratch,
    ) -> Predicted {
        match &self.rows {
            ClassRows::Derived { columns, .. } => {
                let (block, class_mean) = columns.load(column, z, scratch);
                posterior.predict::<FUSED>(block, class_mean)
            }
            ClassRows::Shared { rows, transform } => {
                let mut class_mean: Lanes = [0.0; LANES];
                if !rows.load(column, z, scratch) {
                    return Predicted { mean: class_mean, variance: class_mean, class_mean };
                }
                for (values, weight) in scratch.shared.iter().zip(transform.col_as_slice(self.prior.size)) {
                    for l in 0..LANES {
                        class_mean[l] = multiply_add::<FUSED>(*weight as f32, values[l], class_mean[l]);
                    }
                }
                posterior.predict::<FUSED>(&scratch.shared, class_mean)
            }
        }
    }

    /// Conditions the class on the known voxels, with noise variance `noise`.
    pub fn condition(&self, known: &Known, noise: f64, out: &mut Conditional) -> Result<(), LinearError> {
        self.gather(known, out);
        self.prior.solve(noise, out)
    }

    /// Conditions the class on what [`Self::gather`] has read, with noise variance `noise`.
    pub fn solve(&self, noise: f64, out: &mut Conditional) -> Result<(), LinearError> {
        self.prior.solve(noise, out)
    }

    /// The prior, and the rows [W_s, μ_s, 1] of all voxels; none where nothing is derived over voxels.
    pub(super) fn derived(&self) -> Option<(&ClassGram, &Rows)> {
        match &self.rows {
            ClassRows::Derived { rows, .. } => Some((&self.prior, rows)),
            ClassRows::Shared { .. } => None,
        }
    }

    /// All that conditioning reads of the voxels, whatever the noise.
    pub fn gather(&self, known: &Known, out: &mut Conditional) {
        out.make_room(self.prior.size);
        match &self.rows {
            ClassRows::Derived { rows, tiles, .. } => {
                unknown_gram(rows, tiles, self.prior.size, known, out);
                rows.add(&known.filled, &mut out.filled);
            }
            ClassRows::Shared { transform, .. } => gather_shared(transform, self.prior.size, &known.sums, out),
        }
    }

    /// The posterior means of single voxels; `conditional` was conditioned before. None where nothing is derived over voxels.
    pub fn reconstruction(&self, conditional: &Conditional) -> Option<Reconstruction<'_>> {
        self.derived().map(|(_, rows)| Reconstruction::new(rows, &conditional.coefficients))
    }

    /// Posterior mean of the latent occupancy of every voxel, in their order, not clamped; `conditional` was conditioned before.
    pub fn reconstruct(&self, conditional: &Conditional, mut each: impl FnMut(f32)) {
        match &self.rows {
            ClassRows::Derived { rows, .. } => {
                dispatch(Reconstruct { reconstruction: Reconstruction::new(rows, &conditional.coefficients), each });
            }
            ClassRows::Shared { rows, transform } => {
                let mut weights = Vec::new();
                in_shared(transform, conditional.coefficients.iter().copied().chain([1.0]), &mut weights);
                let mut row = vec![0.0; weights.len()];
                for voxel in 0..rows.voxels() {
                    rows.row(voxel, &mut row);
                    each(row.iter().zip(&weights).map(|(v, w)| v * *w as f32).sum());
                }
            }
        }
    }

    /// Prepares `conditional` for prediction: S = L⁻¹ Λ^½, which gives variances.
    pub fn prepare(&self, conditional: &mut Conditional) {
        let k = self.prior.size;
        let l = &mut conditional.factor;
        // L⁻¹ in the unused upper half, transposed; its diagonal is that of L, inverted. Column j by forward substitution.
        for j in 0..k {
            let mut column = [0.0_f64; MOST_COMPONENTS];
            column[j] = 1.0 / l[j * k + j];
            for i in j + 1..k {
                column[i] = -dot64(&l[i * k + j..i * k + i], &column[j..i]) / l[i * k + i];
                l[j * k + i] = column[i];
            }
        }
        let entry = |i: usize, j: usize| self.prior.scales[j] * if i == j { 1.0 / l[i * k + i] } else { l[j * k + i] };
        match &self.rows {
            ClassRows::Derived { rows, .. } => {
                conditional.posterior.prepare(rows.scales(), &conditional.coefficients, |i, j| entry(i, j) as f32);
            }
            ClassRows::Shared { transform, .. } => {
                // ‖S Tᵀ w‖² = ‖F w‖² with F lower triangular, as the same kernel takes it.
                let a = transform.nrows();
                let SharedScratch { spread, square, factor, coefficients, single, units, .. } = &mut conditional.shared;
                spread.clear();
                for h in 0..a {
                    spread.extend((0..k).map(|i| (0..=i).map(|j| entry(i, j) * transform[(h, j)]).sum::<f64>()));
                }
                square.resize(a * a, 0.0);
                let s = MatRef::from_column_major_slice(spread, k, a);
                matmul(MatMut::from_column_major_slice_mut(square, a, a), Accum::Replace, s.transpose(), s, 1.0, Par::Seq);
                lower_factor(square, a, factor);
                in_shared(transform, conditional.coefficients.iter().copied(), coefficients);
                single.clear();
                single.extend(coefficients.iter().map(|v| *v as f32));
                units.resize(a, 1.0);
                conditional.posterior.resize(a);
                conditional.posterior.prepare(units, single, |i, j| factor[j * a + i] as f32);
            }
        }
    }
}

/// All that conditioning reads of the voxels, from sums over W' that [`SharedRows`] has made.
fn gather_shared(transform: &Mat<f64>, size: usize, sums: &SharedSums, out: &mut Conditional) {
    transform_gram(&sums.unknown, transform, &mut out.shared.product, &mut out.unknown);
    let (rows, ones) = sums.filled.split_at(transform.nrows());
    for (h, sum) in out.filled[..=size].iter_mut().enumerate() {
        *sum = transform.col_as_slice(h).iter().zip(rows).map(|(t, v)| t * v).sum();
    }
    out.filled[size + 1] = ones[0];
}

fn roots(variances: &[f64]) -> Vec<f64> {
    variances.iter().map(|v| v.sqrt()).collect()
}

/// The Gram matrix of [W' T, 1], packed, from that of [W', 1], packed.
fn transform_gram(shared: &[f64], transform: &Mat<f64>, product: &mut Vec<f64>, out: &mut [f64]) {
    let (a, k) = (transform.nrows(), transform.ncols());
    let entry = |i: usize, j: usize| shared[packed(i.max(j), i.min(j))];
    // Gram matrix times T, and the sums of the rows times T.
    product.clear();
    for h in 0..k {
        product.extend((0..a).map(|i| (0..a).map(|j| entry(i, j) * transform[(j, h)]).sum::<f64>()));
    }
    for h in 0..k {
        for g in 0..=h {
            let column = &product[g * a..(g + 1) * a];
            out[packed(h, g)] = transform.col_as_slice(h).iter().zip(column).map(|(t, p)| t * p).sum();
        }
        out[packed(k, h)] = (0..a).map(|i| entry(a, i) * transform[(i, h)]).sum();
    }
    out[packed(k, k)] = entry(a, a);
}

/// Coordinates in W' of a combination of the first columns of `transform`.
fn in_shared(transform: &Mat<f64>, weights: impl Iterator<Item = f32>, out: &mut Vec<f64>) {
    out.clear();
    out.resize(transform.nrows(), 0.0);
    for (h, weight) in weights.enumerate() {
        out.iter_mut().zip(transform.col_as_slice(h)).for_each(|(out, t)| *out += f64::from(weight) * t);
    }
}

/// A lower triangular F with FᵀF = Q, of a positive semidefinite n × n matrix Q: Cholesky's recursion from the last row on. Directions without
/// spread get a row of zeros. Both are column-major.
fn lower_factor(q: &[f64], n: usize, factor: &mut Vec<f64>) {
    let largest = (0..n).map(|i| q[i * n + i]).fold(0.0, f64::max);
    factor.clear();
    factor.resize(n * n, 0.0);
    for i in (0..n).rev() {
        let above = |factor: &[f64], j: usize| (i + 1..n).map(|m| factor[i * n + m] * factor[j * n + m]).sum::<f64>();
        let pivot = q[i * n + i] - above(factor, i);
        if pivot <= 1e-12 * largest {
            continue;
        }
        let root = pivot.sqrt();
        for j in 0..i {
            factor[j * n + i] = (q[j * n + i] - above(factor, j)) / root;
        }
        factor[i * n + i] = root;
    }
}

/// The Gram matrix of a class's derived rows over the unknown voxels, into `out.unknown`.
fn unknown_gram(rows: &Rows, tiles: &TileGrams, size: usize, known: &Known, out: &mut Conditional) {
    out.unknown.fill(0.0);
    dispatch(tiles.add(&known.division.levels, &mut out.unknown));
    add_gram(rows, size + 2, &known.division.rest, &mut out.gathered, &mut out.unknown);
}

/// Posterior means of the latent occupancy of voxels, given the coefficients, for a class whose rows were derived.
#[derive(Clone, Copy)]
pub struct Reconstruction<'a> {
    rows: &'a Rows,
    /// By component, the coefficient in the units of the rows: of the class mean one, after it zeros.
    factors: [Lanes; MOST_COMPONENTS / LANES + 1],
}

impl<'a> Reconstruction<'a> {
    fn new(rows: &'a Rows, coefficients: &[f32]) -> Self {
        let mut factors = [[0.0; LANES]; MOST_COMPONENTS / LANES + 1];
        let weights = coefficients.iter().copied().chain([1.0]).zip(rows.scales());
        factors.as_flattened_mut().iter_mut().zip(weights).for_each(|(factor, (weight, scale))| *factor = weight * scale);
        Self { rows, factors }
    }

    /// Of one voxel, not clamped.
    #[inline(always)]
    pub fn mean<const FUSED: bool>(&self, voxel: usize) -> f32 {
        self.of_row::<FUSED>(self.rows.row(voxel))
    }

    #[inline(always)]
    fn of_row<const FUSED: bool>(&self, row: &[i16]) -> f32 {
        let mut sums = [0.0; LANES];
        for (values, factors) in row.as_chunks::<LANES>().0.iter().zip(&self.factors) {
            let values = widen(values);
            for l in 0..LANES {
                sums[l] = multiply_add::<FUSED>(values[l], factors[l], sums[l]);
            }
        }
        sums.iter().sum()
    }
}

/// Calls `each` with the mean of every voxel.
struct Reconstruct<'a, F> {
    reconstruction: Reconstruction<'a>,
    each: F,
}

impl<F: FnMut(f32)> Kernel for Reconstruct<'_, F> {
    type Output = ();

    #[inline(always)]
    fn run<const FUSED: bool>(mut self) {
        for row in self.reconstruction.rows.all() {
            (self.each)(self.reconstruction.of_row::<FUSED>(row));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::Observation;
    use crate::linear::symmetric_eigen;
    use half::f16;

    #[test]
    fn what_is_read_is_counted() {
        let dims = Dims::new(8, 8, 20).unwrap();
        let mut codes = vec![0; dims.voxels()];
        // All of the first tile's column (tiles are one column wide, levels two voxels high); two runs within one block of the second
        // column; one across both blocks of the third; two filled voxels.
        codes[..20].fill(255);
        [22, 25, 26].into_iter().for_each(|voxel| codes[voxel] = 255);
        codes[54..58].fill(255);
        [90, 99].into_iter().for_each(|voxel| codes[voxel] = 1);
        let mut known = Known::new(dims);
        known.read(&Observation::from_bytes(dims, &codes).unwrap());
        assert_eq!((known.division.levels.len(), known.division.rest.len()), (1, 3));
        let (blocks, bytes) = ClassSubspace::read_to_complete(dims, 3, &known);
        assert_eq!((blocks, bytes), (2 + 1 + 2, 5 * 4 * LANES * 2));
        // Of 5 × 5 Gram matrices the lower half: a level in single, all voxels in double precision; rows of 7 unknown and 2 filled voxels.
        assert_eq!(ClassSubspace::bytes_to_condition(3, &known), 15 * 4 + 15 * 8 + (7 + 2) * LANES * 2);
    }

    /// With next to no noise, rounding leaves the Gram matrix of few known voxels eigenvalues below zero that the noise multiplies.
    #[test]
    fn rounding_does_not_make_a_class_impossible() {
        let dims = Dims::new(8, 8, 8).unwrap();
        let (a, k, d) = (12, 12, 512);
        let rows = (0..d * a).map(|i| f16::from_f32(((i * 7919 % 1009) as f32 / 1009.0 - 0.5) * 0.15)).collect();
        let directions = (0..k * a).map(|i| f32::from(i % (a + 1) == 0)).collect();
        let class = ClassModel { mean: vec![0.0; a], covariance: vec![], directions, variances: vec![1e3; k], hulls: vec![] };
        let subspace = ClassSubspace::new(dims, &Basis::new(a, rows), &class);
        let mut known = Known::new(dims);
        let mut codes = vec![255; d];
        codes[..3].copy_from_slice(&[1, 0, 1]);
        known.read(&Observation::from_bytes(dims, &codes).unwrap());
        let mut conditional = Conditional::new(k);
        subspace.gather(&known, &mut conditional);
        let gram = |i: usize, j: usize| subspace.prior.gram[packed(i, j)] - conditional.unknown[packed(i, j)];
        let lowest = symmetric_eigen(Mat::from_fn(k, k, |i, j| gram(i.max(j), i.min(j))).as_ref()).unwrap().values[k - 1];
        assert!(1e3 * lowest / 1e-12 < -1.0, "nothing is tested: {lowest}");
        for noise in [1e-3, 1e-6, 1e-9, 1e-12] {
            subspace.condition(&known, noise, &mut conditional).unwrap();
            assert!(conditional.log_evidence.is_finite(), "{noise}");
        }
    }

    /// Everything by the textbook: the joint Gaussian over voxels, its marginal and its conditional.
    #[test]
    fn evidence_and_posterior_are_those_of_the_dense_gaussian() {
        let dims = Dims::new(8, 8, 8).unwrap();
        let (a, k, d, noise) = (3, 2, 512, 0.05);
        let rows = (0..d * a).map(|i| f16::from_f32(((i * 7919 % 1009) as f32 / 1009.0 - 0.5) * 0.15)).collect();
        let basis = Basis::new(a, rows);
        let class = ClassModel {
            mean: vec![1.5, -0.5, 2.0],
            covariance: vec![],
            directions: vec![0.8, 0.6, 0.0, 0.0, 0.0, 1.0],
            variances: vec![4.0, 0.7],
            hulls: vec![],
        };
        let subspace = ClassSubspace::new(dims, &basis, &class);
        // 20 known voxels (the dense check inverts 20 × 20), 5 of them filled.
        let known: Vec<usize> = (0..20).map(|i| 3 + i * 11).collect();
        let filled: Vec<usize> = known.iter().copied().step_by(4).collect();
        let code = |v: usize| if filled.contains(&v) { 1 } else { u8::from(!known.contains(&v)) * 255 };
        let observation = Observation::from_bytes(dims, &(0..d).map(code).collect::<Vec<_>>()).unwrap();
        let mut read = Known::new(dims);
        read.read(&observation);
        let mut conditional = Conditional::new(k);
        subspace.condition(&read, noise, &mut conditional).unwrap();
        subspace.prepare(&mut conditional);

        let value = |v: usize, h: usize| f64::from(basis.row(v)[h].to_f32());
        let voxel_mean = |v: usize| (0..a).map(|h| value(v, h) * f64::from(class.mean[h])).sum::<f64>();
        let direction = |v: usize, s: usize| (0..a).map(|h| value(v, h) * f64::from(class.directions[s * a + h])).sum::<f64>();
        let covariance = |u: usize, v: usize| (0..k).map(|s| direction(u, s) * class.variances[s] * direction(v, s)).sum::<f64>();
        let n = known.len();
        let mut dense = Mat::from_fn(n, n, |i, j| covariance(known[i], known[j]) + if i == j { noise } else { 0.0 });
        crate::linear::cholesky(&mut dense).unwrap();
        let inverse_factor = crate::linear::invert_lower(dense.as_ref());
        let precision = inverse_factor.transpose() * &inverse_factor;
        let residual: Vec<f64> = known.iter().map(|v| f64::from(u8::from(filled.contains(v))) - voxel_mean(*v)).collect();
        let weighted: Vec<f64> = (0..n).map(|i| (0..n).map(|j| precision[(i, j)] * residual[j]).sum()).collect();
        let quadratic: f64 = residual.iter().zip(&weighted).map(|(r, w)| r * w).sum();
        let expected = -0.5 * (n as f64 * std::f64::consts::TAU.ln() + crate::linear::log_determinant(dense.as_ref()) + quadratic);
        assert!((conditional.log_evidence - expected).abs() < 0.02, "{} {expected}", conditional.log_evidence);

        for voxel in [0, 100, 511] {
            let cross: Vec<f64> = known.iter().map(|v| covariance(voxel, *v)).collect();
            let mean = voxel_mean(voxel) + cross.iter().zip(&weighted).map(|(c, w)| c * w).sum::<f64>();
            let explained: f64 = (0..n).map(|i| (0..n).map(|j| cross[i] * precision[(i, j)] * cross[j]).sum::<f64>()).sum();
            let predicted = subspace.predict::<false>(&conditional.posterior, voxel / 8, 0, &mut BlockScratch::default());
            let (m, v) = (predicted.mean[voxel % 8], predicted.variance[voxel % 8]);
            assert!((f64::from(m) - mean).abs() < 1e-3, "{m} {mean}");
            assert!((f64::from(v) - (covariance(voxel, voxel) - explained)).abs() < 1e-3, "{v}");
        }
    }
}
