//! Multivariate Gaussians of projections onto W' (eq. 10), and the Student-t densities with the same mean and scale, in log space.

use super::whitening::Whitening;
use crate::lanes::{Kernel, LANES, dispatch, multiply_add};
use crate::linear::{LinearError, log_determinant};
use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, MatRef, Par};

/// Logarithm of the Student-t density with ν degrees of freedom of a point of `rank` values, from its squared Mahalanobis distance and up to
/// log |Σ| and a constant of ν and the rank: −½ (ν + a) log(1 + m/ν).
pub fn log_student(squared_distance: f64, degrees_of_freedom: f64, rank: usize) -> f64 {
    -0.5 * (degrees_of_freedom + rank as f64) * (squared_distance / degrees_of_freedom).ln_1p()
}

/// N(mean, Σ), or the Student-t density with this mean and scale matrix, up to a constant that is common to all classes.
pub struct Gaussian {
    mean: Vec<f32>,
    whitening: Whitening,
    /// −½ log |Σ|.
    log_volume: f64,
}

impl Gaussian {
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
    pub fn squared_distance(&self, z: &[f32], centred: &mut [f32]) -> f64 {
        for ((out, z), mean) in centred.iter_mut().zip(z).zip(&self.mean) {
            *out = z - mean;
        }
        self.whitening.norm2(centred)
    }

    /// Squared Mahalanobis distances of many points, one per row of `points` (n × a), by one matrix product.
    pub fn squared_distances(&self, points: MatRef<'_, f32>) -> Vec<f64> {
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
        self.log_volume - 0.5 * self.squared_distance(z, centred)
    }

    /// log t_ν(z; mean, Σ) up to a constant of a and ν: −½ log|Σ| − ½ (ν + a) log(1 + m/ν).
    pub fn log_student(&self, z: &[f32], degrees_of_freedom: f64, centred: &mut [f32]) -> f64 {
        self.log_volume + log_student(self.squared_distance(z, centred), degrees_of_freedom, self.mean.len())
    }
}

/// Student-t densities of all classes with one common scale matrix.
pub struct CommonDensity {
    /// L⁻¹ of the scale matrix.
    whitening: Whitening,
    /// L⁻¹ times the class means, a values per class.
    means: Vec<f32>,
    rank: usize,
    degrees_of_freedom: f64,
}

impl CommonDensity {
    /// Densities with these means (a values each) and the scale matrix `common` (a × a, lower half).
    pub fn new(means: &[&[f32]], common: &Mat<f64>, degrees_of_freedom: f64) -> Result<Self, LinearError> {
        let whitening = Whitening::new(&mut common.clone())?;
        let mut densities = Self { whitening, means: Vec::new(), rank: common.nrows(), degrees_of_freedom };
        for mean in means {
            let whitened = densities.whiten(mean);
            densities.means.extend(whitened);
        }
        Ok(densities)
    }

    fn whiten(&self, z: &[f32]) -> Vec<f32> {
        let mut out = vec![0.0; self.rank];
        self.whitening.whiten(&mut z.to_vec(), &mut out);
        out
    }

    /// The log density of `z` (a values) for each class, up to a common constant, into `scores`; −∞ for classes that are not
    /// `wanted`. Uses z and `whitened`, of as many values, as scratch.
    pub fn log_densities(&self, z: &mut [f32], wanted: &[bool], whitened: &mut [f32], scores: &mut [f64]) {
        self.whitening.whiten(z, whitened);
        for ((score, mean), wanted) in scores.iter_mut().zip(self.means.chunks_exact(self.rank)).zip(wanted) {
            *score = match wanted {
                true => log_student(f64::from(dispatch(Distance2(mean, whitened))), self.degrees_of_freedom, self.rank),
                false => f64::NEG_INFINITY,
            };
        }
    }
}

/// Squared distance of two vectors.
struct Distance2<'a>(&'a [f32], &'a [f32]);

impl Kernel for Distance2<'_> {
    type Output = f32;

    #[inline(always)]
    fn run<const FUSED: bool>(self) -> f32 {
        let (a, b) = (self.0.as_chunks::<LANES>(), self.1.as_chunks::<LANES>());
        let mut sums = [0.0; LANES];
        for (a, b) in a.0.iter().zip(b.0) {
            for l in 0..LANES {
                sums[l] = multiply_add::<FUSED>(a[l] - b[l], a[l] - b[l], sums[l]);
            }
        }
        let rest: f32 = a.1.iter().zip(b.1).map(|(a, b)| (a - b) * (a - b)).sum();
        sums.iter().sum::<f32>() + rest
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn densities_are_those_of_scipy() {
        let density = Gaussian::new(&[1.0, -0.5, 0.25], &[2.0, 0.5, 0.2, 0.5, 1.0, -0.3, 0.2, -0.3, 0.8]).unwrap();
        let z = [0.2, 0.4, -1.0];
        let mut scratch = [0.0; 3];
        let both = density.squared_distances(MatRef::from_row_major_slice(&[1.0, -0.5, 0.25, 0.2, 0.4, -1.0], 2, 3));
        assert!(both[0].abs() < 1e-6 && (both[1] - density.squared_distance(&z, &mut scratch)).abs() < 1e-5, "{both:?}");
        // scipy.stats.multivariate_normal.logpdf(z, mean, cov) and multivariate_t.logpdf(z, loc, shape, df=5); L⁻¹ is kept in 16 bits.
        let gaussian = density.log_gaussian(&z, &mut scratch) - 1.5 * std::f64::consts::TAU.ln();
        assert!((gaussian + 4.081236639).abs() < 5e-5, "{gaussian}");
        let constant = -2.624175099;
        let student = density.log_student(&z, 5.0, &mut scratch) + constant;
        assert!((student + 4.321595648).abs() < 5e-5, "{student}");
    }

    #[test]
    fn with_one_class_it_is_the_density_of_that_class() {
        let scale = [2.0_f32, 0.5, 0.5, 1.0];
        let common = Mat::from_fn(2, 2, |i, j| f64::from(scale[i * 2 + j]));
        let (one, two): (&[f32], &[f32]) = (&[1.0, -0.5], &[0.0, 2.0]);
        let densities = CommonDensity::new(&[one, two], &common, 7.0).unwrap();
        let z = [0.3, 0.4];
        for (s, mean) in [one, two].into_iter().enumerate() {
            let density = Gaussian::new(mean, &scale).unwrap();
            let expected = density.log_student(&z, 7.0, &mut [0.0; 2]) - density.log_volume();
            let mut found = [0.0; 2];
            densities.log_densities(&mut z.clone(), &[true; 2], &mut [0.0; 2], &mut found);
            assert!((found[s] - expected).abs() < 1e-5);
        }
        let mut found = [0.0; 2];
        densities.log_densities(&mut z.clone(), &[false, true], &mut [0.0; 2], &mut found);
        assert!(found[0] == f64::NEG_INFINITY && found[1].is_finite());
    }
}
