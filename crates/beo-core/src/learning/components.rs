//! Leading principal components of many samples of many values, by block power iteration (Halko, Martinsson & Tropp, "Finding structure
//! with randomness", SIAM Review 2011).

use crate::linear::{LinearError, symmetric_eigen};
use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, MatRef, Par};
use half::f16;
use rand::{Rng, RngExt};

/// Columns beyond the wanted ones in the power iteration, and its rounds.
const OVERSAMPLING: usize = 16;
const ROUNDS: usize = 4;

/// Principal components.
pub struct Components {
    /// As orthonormal columns, by falling variance.
    pub basis: Mat<f64>,
    /// The mean of their variances.
    pub variance: f64,
}

impl Components {
    /// The basis row by row.
    pub fn rows(&self) -> Vec<f16> {
        let size = self.basis.ncols();
        (0..self.basis.nrows()).flat_map(|i| (0..size).map(move |j| (i, j))).map(|at| f16::from_f64(self.basis[at])).collect()
    }
}

/// The `size` leading components of the `samples`, all of one length, less their mean.
pub fn principal_components(samples: Vec<Vec<f32>>, size: usize, rng: &mut impl Rng) -> Result<Components, LinearError> {
    let (count, length) = (samples.len(), samples[0].len());
    let mut mean = vec![0.0_f32; length];
    for sample in &samples {
        mean.iter_mut().zip(sample).for_each(|(sum, v)| *sum += v / count as f32);
    }
    // Columns are samples less their mean.
    let data = Mat::<f32>::from_fn(length, count, |i, j| samples[j][i] - mean[i]);
    drop(samples);
    let width = (size + OVERSAMPLING).min(length).min(count);
    let mut block = Mat::<f32>::from_fn(length, width, |_, _| rng.random_range(-1.0..1.0));
    orthonormalise(&mut block)?;
    let mut scores = Mat::<f32>::zeros(count, width);
    for _ in 0..ROUNDS {
        matmul(scores.as_mut(), Accum::Replace, data.transpose(), block.as_ref(), 1.0, Par::Seq);
        matmul(block.as_mut(), Accum::Replace, data.as_ref(), scores.as_ref(), 1.0, Par::Seq);
        orthonormalise(&mut block)?;
    }
    matmul(scores.as_mut(), Accum::Replace, data.transpose(), block.as_ref(), 1.0, Par::Seq);
    let eigen = symmetric_eigen(gram(scores.as_ref()).as_ref())?;
    let block = Mat::<f64>::from_fn(length, width, |i, j| f64::from(block[(i, j)]));
    let basis = product(block.as_ref(), eigen.vectors.subcols(0, size));
    let variance = eigen.values[..size].iter().sum::<f64>() / (size * count) as f64;
    Ok(Components { basis, variance })
}

/// Replaces the columns by orthonormal ones that span the same (as far as their rank goes): X V Λ^−½ of the eigenproblem XᵀX = V Λ Vᵀ.
fn orthonormalise(block: &mut Mat<f32>) -> Result<(), LinearError> {
    let eigen = symmetric_eigen(gram(block.as_ref()).as_ref())?;
    let least = (1e-10 * eigen.values[0]).max(f64::MIN_POSITIVE);
    let scaled = Mat::<f32>::from_fn(block.ncols(), block.ncols(), |i, j| {
        let value = eigen.values[j];
        if value > least { (eigen.vectors[(i, j)] / value.sqrt()) as f32 } else { 0.0 }
    });
    let mut out = Mat::zeros(block.nrows(), block.ncols());
    matmul(out.as_mut(), Accum::Replace, block.as_ref(), scaled.as_ref(), 1.0, Par::Seq);
    *block = out;
    Ok(())
}

/// A B.
pub fn product(a: MatRef<'_, f64>, b: MatRef<'_, f64>) -> Mat<f64> {
    let mut out = Mat::zeros(a.nrows(), b.ncols());
    matmul(out.as_mut(), Accum::Replace, a, b, 1.0, Par::Seq);
    out
}

/// XᵀX.
fn gram(block: MatRef<'_, f32>) -> Mat<f64> {
    let mut gram = Mat::<f32>::zeros(block.ncols(), block.ncols());
    matmul(gram.as_mut(), Accum::Replace, block.transpose(), block, 1.0, Par::Seq);
    Mat::from_fn(gram.nrows(), gram.ncols(), |i, j| f64::from(gram[(i, j)]))
}
