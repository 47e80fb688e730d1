//! A class conditioned on sums over the known voxels: its evidence, and the posterior of its coefficients.

use super::prediction::Posterior;
use crate::lanes::{LANES, dispatch};
use crate::linear::{LinearError, cholesky_rows, dot64, symmetric_eigen};
use crate::model::MOST_COMPONENTS;
use crate::perception::basis::rows::Rows;
use crate::perception::kernels::row_gram::{AddGram, packed, packed_len};
use faer::Mat;

/// Voxels whose products are formed at once.
pub(super) const BLOCK: usize = 1024;

/// The posterior of one class given one query; reused from query to query.
pub struct Conditional {
    /// log p(known voxels | class).
    pub log_evidence: f64,
    /// Log density of the known voxels without a class: noise of the same variance about zero.
    pub(super) log_background: f64,
    /// Squared distance of the class mean to the known voxels, ‖w − V μ_s‖².
    pub distance2: f64,
    /// Posterior mean of the coefficients, k values.
    pub coefficients: Vec<f32>,
    /// The posterior in the form in which prediction reads it, after [`ClassSubspace::prepare`](super::subspace::ClassSubspace::prepare).
    pub posterior: Posterior,
    pub(super) gathered: Vec<f32>,
    /// Gram matrix over the unknown voxels, packed lower triangle.
    pub(super) unknown: Vec<f64>,
    /// Sum of the rows of filled voxels.
    pub(super) filled: Vec<f64>,
    /// L, k × k row-major, lower triangle.
    pub(super) factor: Vec<f64>,
    pub(super) shared: SharedScratch,
}

/// Memory for a class whose rows are combinations of those of W', which is read in place; column-major.
#[derive(Default)]
pub(super) struct SharedScratch {
    /// The Gram matrix of W' times T, a × k.
    pub(super) product: Vec<f64>,
    /// S Tᵀ, k × a.
    pub(super) spread: Vec<f64>,
    /// T Sᵀ S Tᵀ, a × a, and its factor.
    pub(super) square: Vec<f64>,
    pub(super) factor: Vec<f64>,
    /// Coefficients in W', a values, and the units of its rows.
    pub(super) coefficients: Vec<f64>,
    pub(super) single: Vec<f32>,
    pub(super) units: Vec<f32>,
}

impl Conditional {
    /// Room for a class with `size` directions.
    pub fn new(size: usize) -> Self {
        let mut conditional = Self {
            log_evidence: 0.0,
            log_background: 0.0,
            distance2: 0.0,
            coefficients: Vec::new(),
            posterior: Posterior::new(0),
            gathered: Vec::new(),
            unknown: Vec::new(),
            filled: Vec::new(),
            factor: Vec::new(),
            shared: SharedScratch::default(),
        };
        conditional.make_room(size);
        conditional
    }

    /// Makes room for a class with `size` directions; allocates nothing if there was room before.
    pub(super) fn make_room(&mut self, size: usize) {
        if self.coefficients.len() == size && !self.filled.is_empty() {
            return;
        }
        let stride = stride(size);
        if self.gathered.len() < BLOCK * stride {
            self.gathered.resize(BLOCK * stride, 0.0);
        }
        self.coefficients.resize(size, 0.0);
        self.posterior.resize(size);
        self.unknown.resize(packed_len(size + 2), 0.0);
        self.filled.resize(stride, 0.0);
        self.factor.resize(size * size, 0.0);
    }

    /// Becomes the posterior of `other`, up to what [`ClassSubspace::prepare`](super::subspace::ClassSubspace::prepare) derives of it, in the memory
    /// that this one has.
    pub(in crate::perception) fn set(&mut self, other: &Self) {
        self.make_room(other.coefficients.len());
        (self.log_evidence, self.log_background, self.distance2) = (other.log_evidence, other.log_background, other.distance2);
        self.coefficients.clone_from(&other.coefficients);
        self.factor.clone_from(&other.factor);
    }

    /// THE log evidence of an observation: log p(known voxels | class) less that of a background without a class.
    ///
    /// The background is noise of the same variance about zero. A known empty voxel far from the object, of which moving the observation adds or
    /// removes some, then says nothing, so that observations in different poses can be compared.
    pub fn log_evidence_ratio(&self) -> f64 {
        self.log_evidence - self.log_background
    }
}

/// A class's prior, and the Gram matrix of its rows [W_s, μ_s, 1] over all voxels: what conditioning needs besides sums over an observation.
pub struct ClassGram {
    /// k, the number of directions.
    pub(super) size: usize,
    /// Square roots of the prior variances.
    pub(super) scales: Vec<f64>,
    /// Packed lower triangle.
    pub(super) gram: Vec<f64>,
}

impl ClassGram {
    /// Conditions the class on the sums over unknown and over filled voxels in `out`, with noise variance `noise`.
    pub fn solve(&self, noise: f64, out: &mut Conditional) -> Result<(), LinearError> {
        let k = self.size;
        let gram = |i: usize, j: usize| self.gram[packed(i, j)] - out.unknown[packed(i, j)];
        let voxels = gram(k + 1, k + 1);

        let filled = &out.filled;
        let residual = filled[k + 1] - 2.0 * filled[k] + gram(k, k);

        out.distance2 = residual;

        self.fill_factor(noise, gram, &mut out.factor);
        let mut half = [0.0_f64; MOST_COMPONENTS];
        for i in 0..k {
            half[i] = self.scales[i] * (filled[i] - gram(k, i)) / noise;
        }
        if cholesky_rows(&mut out.factor, k).is_err() {
            // A is a difference of two sums, and rounding may leave it eigenvalues below zero, which matters where the noise is small.
            let possible = nearest_semidefinite(k, gram)?;
            self.fill_factor(noise, |i, j| possible[(i, j)], &mut out.factor);
            cholesky_rows(&mut out.factor, k)?;
        }
        let l = &out.factor;
        let mut log_det = 0.0;
        for i in 0..k {
            half[i] = (half[i] - dot64(&l[i * k..i * k + i], &half[..i])) / l[i * k + i];
            log_det += 2.0 * l[i * k + i].ln();
        }
        let quadratic: f64 = half[..k].iter().map(|v| v * v).sum();
        let log_unit = (std::f64::consts::TAU * noise).ln();
        out.log_background = -0.5 * (voxels * log_unit + filled[k + 1] / noise);
        out.log_evidence = -0.5 * (voxels * log_unit + log_det + residual / noise - quadratic);

        for i in (0..k).rev() {
            half[i] /= l[i * k + i];
            let value = half[i];
            half[..i].iter_mut().zip(&l[i * k..]).for_each(|(half, l)| *half -= l * value);
            out.coefficients[i] = (self.scales[i] * value) as f32;
        }
        Ok(())
    }

    /// M = I + Λ^½ A Λ^½ / σ², lower half row after row, of the known voxels' Gram matrix A.
    fn fill_factor(&self, noise: f64, gram: impl Fn(usize, usize) -> f64, factor: &mut [f64]) {
        for (i, row) in factor.chunks_exact_mut(self.size.max(1)).enumerate() {
            for (j, entry) in row[..=i].iter_mut().enumerate() {
                let identity = if i == j { 1.0 } else { 0.0 };
                *entry = identity + self.scales[i] * gram(i, j) * self.scales[j] / noise;
            }
        }
    }
}

/// Adds the Gram matrix of some rows of a class, given as runs (start, end) of voxels, to `out`, a packed lower triangle; `gathered` is scratch
/// memory for a block of rows.
pub(super) fn add_gram(rows: &Rows, width: usize, runs: &[(usize, usize)], gathered: &mut [f32], out: &mut [f64]) {
    let stride = rows.stride();
    let mut rest = runs;
    while !rest.is_empty() {
        // As many runs as fit; one has at most 256 voxels.
        let mut voxels = 0;
        let mut fits = |(start, end): &(usize, usize)| {
            voxels += end - start;
            voxels <= BLOCK
        };
        let (runs, later) = rest.split_at(rest.iter().take_while(|run| fits(run)).count());
        rest = later;
        let values = rows.widen(runs, gathered);
        dispatch(AddGram::of_all(gathered, values / stride, stride, width, out));
    }
}

/// The positive semidefinite matrix that is nearest to a symmetric one (k × k), given by the entries of its lower half.
fn nearest_semidefinite(k: usize, entry: impl Fn(usize, usize) -> f64) -> Result<Mat<f64>, LinearError> {
    let matrix = Mat::from_fn(k, k, |i, j| entry(i.max(j), i.min(j)));
    let eigen = symmetric_eigen(matrix.as_ref())?;
    let scaled = Mat::from_fn(k, k, |i, h| eigen.vectors[(i, h)] * eigen.values[h].max(0.0));
    Ok(scaled * eigen.vectors.transpose())
}

/// Values from row to row of a class with `size` directions.
pub(super) fn stride(size: usize) -> usize {
    (size + 2).next_multiple_of(LANES)
}
