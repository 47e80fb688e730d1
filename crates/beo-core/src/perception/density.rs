//! Multivariate densities in W', evaluated through the inverse Cholesky factor of their scale matrix, in log space.

use super::whitening::Whitening;
use crate::linear::{LinearError, log_determinant};
use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, MatRef, Par};

/// A multivariate Student-t density, or its limit, the Gaussian (eq. 10), up to a constant that is common to all classes.
pub struct Density {
    mean: Vec<f32>,
    whitening: Whitening,
    /// −½ log |Σ|.
    log_volume: f64,
}

impl Density {
    /// A density with this mean (a values) and scale matrix (a × a, symmetric, positive definite).
    pub fn new(mean: &[f32], scale: &[f32]) -> Result<Self, LinearError> {
        let a = mean.len();
        let mut factor = Mat::from_fn(a, a, |i, j| f64::from(scale[i * a + j]));
        let whitening = Whitening::new(&mut factor)?;
        Ok(Self { mean: mean.to_vec(), whitening, log_volume: -0.5 * log_determinant(factor.as_ref()) })
    }

    /// Bytes that scoring a vector of `rank` values reads.
    pub fn bytes(rank: usize) -> usize {
        rank * size_of::<f32>() + Whitening::bytes(rank)
    }

    /// Squared Mahalanobis distance of `z` from the mean; `centred` is scratch of a values.
    pub fn distance2(&self, z: &[f32], centred: &mut [f32]) -> f64 {
        for ((out, z), mean) in centred.iter_mut().zip(z).zip(&self.mean) {
            *out = z - mean;
        }
        self.whitening.norm2(centred)
    }

    /// Squared Mahalanobis distances of many points, one per row of `points` (n × a), by one matrix product.
    pub fn distances2(&self, points: MatRef<'_, f32>) -> Vec<f64> {
        let a = self.mean.len();
        let whitening = Mat::from_fn(a, a, |i, j| self.whitening.entry(i, j));
        let centred = Mat::from_fn(a, points.nrows(), |j, i| points[(i, j)] - self.mean[j]);
        let mut whitened = Mat::<f32>::zeros(a, points.nrows());
        matmul(whitened.as_mut(), Accum::Replace, whitening.as_ref(), centred.as_ref(), 1.0, Par::Seq);
        (0..points.nrows()).map(|i| whitened.col_as_slice(i).iter().map(|v| f64::from(*v).powi(2)).sum()).collect()
    }

    /// −½ log |Σ|.
    pub fn log_volume(&self) -> f64 {
        self.log_volume
    }

    /// log N(z; mean, Σ) + (a/2) log 2π (eq. 10).
    pub fn log_gaussian(&self, z: &[f32], centred: &mut [f32]) -> f64 {
        self.log_volume - 0.5 * self.distance2(z, centred)
    }

    /// log t_ν(z; mean, Σ) up to a constant of a and ν: −½ log|Σ| − ½ (ν + a) log(1 + m/ν).
    pub fn log_student(&self, z: &[f32], degrees_of_freedom: f64, centred: &mut [f32]) -> f64 {
        let m = self.distance2(z, centred);
        self.log_volume - 0.5 * (degrees_of_freedom + self.mean.len() as f64) * (m / degrees_of_freedom).ln_1p()
    }
}

/// Inner product over the shorter length, in partial sums that vectorise. The order of the sums is fixed, whatever the CPU.
#[inline(always)]
pub(super) fn dot(a: &[f32], b: &[f32]) -> f32 {
    let n = a.len().min(b.len());
    let long = n - n % 32;
    let short = n - n % 8;
    let tail: f32 = a[short..n].iter().zip(&b[short..n]).map(|(x, y)| x * y).sum();
    lanes::<32>(&a[..long], &b[..long]) + lanes::<8>(&a[long..short], &b[long..short]) + tail
}

/// Inner product of whole chunks of `N` values.
#[inline(always)]
fn lanes<const N: usize>(a: &[f32], b: &[f32]) -> f32 {
    let mut sums = [0.0_f32; N];
    for (x, y) in a.chunks_exact(N).zip(b.chunks_exact(N)) {
        for i in 0..N {
            sums[i] += x[i] * y[i];
        }
    }
    sums.iter().sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn densities_are_those_of_scipy() {
        let density = Density::new(&[1.0, -0.5, 0.25], &[2.0, 0.5, 0.2, 0.5, 1.0, -0.3, 0.2, -0.3, 0.8]).unwrap();
        let z = [0.2, 0.4, -1.0];
        let mut scratch = [0.0; 3];
        let both = density.distances2(MatRef::from_row_major_slice(&[1.0, -0.5, 0.25, 0.2, 0.4, -1.0], 2, 3));
        assert!(both[0].abs() < 1e-6 && (both[1] - density.distance2(&z, &mut scratch)).abs() < 1e-5, "{both:?}");
        // scipy.stats.multivariate_normal.logpdf(z, mean, cov) and multivariate_t.logpdf(z, loc, shape, df=5); L⁻¹ is kept in 16 bits.
        let gaussian = density.log_gaussian(&z, &mut scratch) - 1.5 * std::f64::consts::TAU.ln();
        assert!((gaussian + 4.081236639).abs() < 5e-5, "{gaussian}");
        let constant = -2.624175099;
        let student = density.log_student(&z, 5.0, &mut scratch) + constant;
        assert!((student + 4.321595648).abs() < 5e-5, "{student}");
    }
}
