//! Covariance estimators for few samples in many dimensions. Samples are rows of a centred n × a matrix.

use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, MatRef, Par};

/// A covariance by the paper's recipe (eqs. 7, 8), and how much of the target went in.
pub struct Shrunk {
    /// a × a.
    pub covariance: Mat<f64>,
    /// Weight of the two-parameter target, 1 − λ of eq. 8.
    pub intensity: f64,
}

/// Mean of the rows, and the rows less their mean.
pub fn centre(rows: MatRef<'_, f32>) -> (Vec<f64>, Mat<f64>) {
    let (n, a) = (rows.nrows(), rows.ncols());
    let mean: Vec<f64> = (0..a).map(|j| (0..n).map(|i| f64::from(rows[(i, j)])).sum::<f64>() / n as f64).collect();
    let centred = Mat::from_fn(n, a, |i, j| f64::from(rows[(i, j)]) - mean[j]);
    (mean, centred)
}

/// ZᵀZ / n.
pub fn sample_covariance(centred: &Mat<f64>) -> Mat<f64> {
    let a = centred.ncols();
    let mut covariance = Mat::zeros(a, a);
    matmul(covariance.as_mut(), Accum::Replace, centred.transpose(), centred.as_ref(), 1.0 / centred.nrows() as f64, Par::Seq);
    covariance
}

/// Eq. 8: the eigenvalues are first drawn to their mean with the intensity of Ledoit & Wolf (2004), then the matrix to the
/// two-parameter target (one variance, one covariance) with the analytic intensity of Schäfer & Strimmer (2005).
///
/// Both intensities minimise the expected squared error and are estimated from the samples' fourth moments. A tiny multiple
/// of the identity keeps the result positive definite when all samples are equal.
pub fn shrunk_covariance(centred: &Mat<f64>) -> Shrunk {
    let (n, a) = (centred.nrows() as f64, centred.ncols());
    let mut s = sample_covariance(centred);
    let squared = |m: &Mat<f64>| m.squared_norm_l2();
    let fourth: f64 = (0..centred.nrows()).map(|i| (0..a).map(|j| centred[(i, j)].powi(2)).sum::<f64>().powi(2)).sum();
    // Σ_ij Var(s_ij), by which s misses the true covariance.
    let sampling = ((fourth / n - squared(&s)) / n).max(0.0);

    let variance = (0..a).map(|i| s[(i, i)]).sum::<f64>() / a as f64;
    let distance = squared(&s) - a as f64 * variance * variance;
    let rho = if distance > 0.0 { (sampling / distance).min(1.0) } else { 1.0 };
    blend(&mut s, rho, variance, 0.0);

    let covariance = if a > 1 {
        let all: f64 = (0..a).map(|j| s.col_as_slice(j).iter().sum::<f64>()).sum();
        (all - a as f64 * variance) / (a * (a - 1)) as f64
    } else {
        0.0
    };
    let target = |i: usize, j: usize| if i == j { variance } else { covariance };
    let distance: f64 = (0..a).map(|j| (0..a).map(|i| (s[(i, j)] - target(i, j)).powi(2)).sum::<f64>()).sum();
    let remaining = sampling * (1.0 - rho).powi(2);
    let intensity = if distance > 0.0 { (remaining / distance).min(1.0) } else { 1.0 };
    blend(&mut s, intensity, variance, covariance);

    let floor = (variance * 1e-6).max(1e-12);
    (0..a).for_each(|i| s[(i, i)] += floor);
    Shrunk { covariance: s, intensity }
}

/// (1 − w) S + w T with the target's variance and covariance.
fn blend(s: &mut Mat<f64>, weight: f64, variance: f64, covariance: f64) {
    for j in 0..s.ncols() {
        for (i, value) in s.col_as_slice_mut(j).iter_mut().enumerate() {
            let target = if i == j { variance } else { covariance };
            *value += weight * (target - *value);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn samples() -> Mat<f64> {
        let rows = Mat::from_fn(40, 3, |i, j| {
            let t = i as f64;
            [t.sin(), t.sin() + 0.3 * (2.0 * t).cos(), 2.0 * t.cos()][j] as f32
        });
        centre(rows.as_ref()).1
    }

    #[test]
    fn shrinkage_is_that_of_an_independent_script() {
        let shrunk = shrunk_covariance(&samples());
        // NumPy, with explicit sums over all entries and samples of Var(s_ij).
        for (i, row) in EXPECTED.iter().enumerate() {
            for (j, value) in row.iter().enumerate() {
                assert!((shrunk.covariance[(i, j)] - value).abs() < 1e-5, "{} {value}", shrunk.covariance[(i, j)]);
            }
        }
        assert!((shrunk.intensity - INTENSITY).abs() < 1e-6, "{}", shrunk.intensity);
    }

    const EXPECTED: [[f64; 3]; 3] =
        [[0.561005853, 0.440616069, 0.028320058], [0.440616069, 0.591754467, 0.038882806], [0.028320058, 0.038882806, 1.880912536]];
    const INTENSITY: f64 = 0.068397658;

    #[test]
    fn equal_samples_give_a_positive_definite_matrix() {
        let shrunk = shrunk_covariance(&Mat::zeros(4, 3));
        let mut factor = shrunk.covariance;
        crate::linear::cholesky(&mut factor).unwrap();
    }
}
