//! Variational Bayesian PCA (eqs. 1–4) by its global analytic solution.
//!
//! The centred data X (d × n) is modelled as W C + noise with W (d × K), C (K × n), every entry of W and C Gaussian with mean
//! zero and a fixed variance, and isotropic noise σ². The posterior is factorised into q(W) q(C). Nakajima, Sugiyama, Babacan
//! & Tomioka, "Global analytic solution of fully-observed variational Bayesian matrix factorization", JMLR 14 (2013) show
//! that the best factorised posterior keeps the singular directions of X: every singular value is shrunk by a closed form,
//! and is zero below a threshold. Only σ² needs a search, in one dimension. All that is read of X is the spectrum of its
//! n × n Gram matrix.
//!
//! The sample mean is held fixed; a Gaussian prior on it, as in the paper, changes nothing measurable (μ is pinned by d × n
//! voxels). The iterative EM of Bishop (1999) and Ilin & Raiko (JMLR 2010) is the oracle of the tests: it reaches the same
//! free energy.

/// Prior variances of the entries of the basis and of the coefficients. The paper uses one for both.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Priors {
    /// Variance of an entry of W.
    pub basis: f64,
    /// Variance of a coefficient.
    pub coefficient: f64,
}

impl Default for Priors {
    fn default() -> Self {
        Self { basis: 1.0, coefficient: 1.0 }
    }
}

/// A component that the data supports.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PrincipalComponent {
    /// Singular value of the centred data, γ.
    pub singular_value: f64,
    /// Singular value of the posterior mean of W C, γ̂ < γ.
    pub shrunk: f64,
    /// Variance of an object along this direction of unit length: ‖E w‖² times the mean of E c² over the objects,
    /// γ̂²/n + γ̂σ²/γ. Unlike ‖E w‖² alone it does not depend on how the priors share the scale between W and C.
    pub variance: f64,
}

/// The best factorised posterior.
#[derive(Clone, Debug, PartialEq)]
pub struct Vbpca {
    /// Kept components, largest singular value first; the others are pruned to zero.
    pub components: Vec<PrincipalComponent>,
    /// Noise variance σ² of one voxel.
    pub noise_variance: f64,
    /// Variational free energy at the solution (a bound on −log evidence), in nats.
    pub free_energy: f64,
}

/// The problem: what VBPCA needs to know of the data.
#[derive(Clone, Debug)]
pub struct Spectrum<'a> {
    /// Eigenvalues γ² of the centred Gram matrix, descending; at most min(d, n) of them, the rest of the trace is noise.
    pub eigenvalues: &'a [f64],
    /// Trace of the Gram matrix, ‖X‖².
    pub trace: f64,
    /// Number of voxels, d.
    pub voxels: usize,
    /// Number of objects, n.
    pub objects: usize,
}

/// Solves VBPCA with as many components as there are eigenvalues; σ² is searched for.
///
/// A spectrum without energy (all objects equal) gives no component and the smallest noise that the search allows.
pub fn solve(spectrum: &Spectrum<'_>, priors: Priors) -> Vbpca {
    const STEPS: usize = 96;
    let entries = spectrum.voxels as f64 * spectrum.objects as f64;
    let upper = (spectrum.trace / entries).max(1e-12);
    let at = |log: f64| solve_with_noise(spectrum, priors, log.exp());
    let (low, high) = (upper.ln() - 14.0, upper.ln() + 0.01);
    let step = (high - low) / STEPS as f64;
    // The free energy may have several minima in σ²: look everywhere first, then narrow down around the best.
    let best = (0..=STEPS)
        .map(|i| low + step * i as f64)
        .min_by(|a, b| at(*a).free_energy.total_cmp(&at(*b).free_energy))
        .expect("the grid is not empty");
    at(golden_section(best - step, best + step, |log| at(log).free_energy))
}

/// Solves VBPCA for a given noise variance.
pub fn solve_with_noise(spectrum: &Spectrum<'_>, priors: Priors, noise_variance: f64) -> Vbpca {
    let (d, n, s2) = (spectrum.voxels as f64, spectrum.objects as f64, noise_variance);
    let product = priors.basis * priors.coefficient;
    let half = (d + n) / 2.0 + s2 / (2.0 * product);
    let threshold = (s2 * (half + (half * half - d * n).max(0.0).sqrt())).sqrt();
    let mut energy = d * n * (std::f64::consts::TAU * s2).ln() + spectrum.trace / s2;
    let mut components = Vec::new();
    let null = null_factors(d, n, s2, priors);
    for &eigenvalue in spectrum.eigenvalues {
        let singular = eigenvalue.max(0.0).sqrt();
        if singular <= threshold {
            energy += factor_energy(&null, 0.0, d, n, s2, priors);
            continue;
        }
        let gap = (d - n).powi(2) + 4.0 * singular.powi(2) / product;
        let shrunk = singular - s2 / (2.0 * singular) * (d + n + gap.sqrt());
        let delta = priors.coefficient / s2 * (singular - shrunk - d * s2 / singular);
        let factors = Factors {
            coefficient_norm2: shrunk * delta,
            coefficient_variance: s2 * delta / singular,
            basis_norm2: shrunk / delta,
            basis_variance: s2 / (singular * delta),
        };
        energy += factor_energy(&factors, singular * shrunk, d, n, s2, priors);
        let second_moment = factors.coefficient_norm2 / n + factors.coefficient_variance;
        components.push(PrincipalComponent { singular_value: singular, shrunk, variance: factors.basis_norm2 * second_moment });
    }
    Vbpca { components, noise_variance, free_energy: energy / 2.0 }
}

/// Posterior of one component: squared norms of the means, and the variance of each entry.
struct Factors {
    coefficient_norm2: f64,
    coefficient_variance: f64,
    basis_norm2: f64,
    basis_variance: f64,
}

/// The posterior of a pruned component: zero means, variances from the two stationary equations
/// q (n p + s2/c_w) = s2 and p (d q + s2/c_c) = s2, of which the smaller root of a quadratic in p q is meant.
fn null_factors(d: f64, n: f64, s2: f64, priors: Priors) -> Factors {
    let (tc, tw) = (s2 / priors.coefficient, s2 / priors.basis);
    let linear = (d + n) * s2 + tc * tw;
    let root = (linear * linear - 4.0 * d * n * s2 * s2).max(0.0).sqrt();
    let product = 2.0 * s2 * s2 / (linear + root);
    // One of the two differences cancels badly (that of the longer side): take the other, and divide.
    let (coefficient_variance, basis_variance) = if d >= n {
        let basis = (s2 - n * product) / tw;
        (product / basis, basis)
    } else {
        let coefficient = (s2 - d * product) / tc;
        (coefficient, product / coefficient)
    };
    Factors { coefficient_norm2: 0.0, coefficient_variance, basis_norm2: 0.0, basis_variance }
}

/// Contribution of one component to twice the free energy; `explained` is γ γ̂.
fn factor_energy(f: &Factors, explained: f64, d: f64, n: f64, s2: f64, priors: Priors) -> f64 {
    let coefficient = f.coefficient_norm2 + n * f.coefficient_variance;
    let basis = f.basis_norm2 + d * f.basis_variance;
    n * (priors.coefficient / f.coefficient_variance).ln()
        + d * (priors.basis / f.basis_variance).ln()
        + coefficient / priors.coefficient
        + basis / priors.basis
        - (d + n)
        + (coefficient * basis - 2.0 * explained) / s2
}

/// Minimum of a function that is unimodal on `low..high`.
fn golden_section(mut low: f64, mut high: f64, function: impl Fn(f64) -> f64) -> f64 {
    let ratio = (5.0_f64.sqrt() - 1.0) / 2.0;
    let (mut a, mut b) = (high - ratio * (high - low), low + ratio * (high - low));
    let (mut fa, mut fb) = (function(a), function(b));
    while high - low > 1e-9 {
        if fa < fb {
            (high, b, fb) = (b, a, fa);
            a = high - ratio * (high - low);
            fa = function(a);
        } else {
            (low, a, fa) = (a, b, fb);
            b = low + ratio * (high - low);
            fb = function(b);
        }
    }
    (low + high) / 2.0
}

/// Number of leading components that carry a share of the variance (the paper's 60 %), clamped to `range` and to what exists.
pub fn basis_size(eigenvalues: &[f64], share: f64, range: std::ops::RangeInclusive<usize>) -> usize {
    let total: f64 = eigenvalues.iter().map(|v| v.max(0.0)).sum();
    let mut sum = 0.0;
    let by_share = 1 + eigenvalues
        .iter()
        .take_while(|v| {
            sum += v.max(0.0);
            sum < share * total
        })
        .count();
    let rank = eigenvalues.iter().filter(|v| **v > 1e-9 * total).count();
    by_share.clamp(*range.start(), *range.end()).min(rank)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::linear;
    use faer::Mat;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    /// Factorised posterior of the EM of Bishop (1999) and Ilin & Raiko (2010) with full K × K covariances.
    struct Em {
        coefficients: Mat<f64>,
        coefficient_covariance: Mat<f64>,
        basis: Mat<f64>,
        basis_covariance: Mat<f64>,
    }

    fn inverse(matrix: &Mat<f64>) -> Mat<f64> {
        let mut factor = matrix.clone();
        linear::cholesky(&mut factor).unwrap();
        let inverse = linear::invert_lower(factor.as_ref());
        inverse.transpose() * &inverse
    }

    fn log_det(matrix: &Mat<f64>) -> f64 {
        let mut factor = matrix.clone();
        linear::cholesky(&mut factor).unwrap();
        linear::log_determinant(factor.as_ref())
    }

    fn trace(matrix: &Mat<f64>) -> f64 {
        (0..matrix.nrows()).map(|i| matrix[(i, i)]).sum()
    }

    /// Runs EM on centred data `x` (d × n) with the given noise; returns the posterior and its free energy.
    fn em(x: &Mat<f64>, k: usize, s2: f64, priors: Priors, iterations: usize) -> (Em, f64) {
        let (d, n) = (x.nrows() as f64, x.ncols() as f64);
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut random = |rows: usize, columns: usize| Mat::from_fn(rows, columns, |_, _| rng.random_range(-1.0..1.0));
        let scaled = |v: f64| Mat::from_fn(k, k, |i, j| if i == j { v } else { 0.0 });
        let mut q = Em {
            coefficients: random(x.ncols(), k),
            coefficient_covariance: scaled(1.0),
            basis: random(x.nrows(), k),
            basis_covariance: scaled(1.0),
        };
        for _ in 0..iterations {
            let second = q.basis.transpose() * &q.basis + faer::Scale(d) * &q.basis_covariance;
            q.coefficient_covariance = faer::Scale(s2) * inverse(&(second + scaled(s2 / priors.coefficient)));
            q.coefficients = faer::Scale(1.0 / s2) * (x.transpose() * &q.basis * &q.coefficient_covariance);
            let second = q.coefficients.transpose() * &q.coefficients + faer::Scale(n) * &q.coefficient_covariance;
            q.basis_covariance = faer::Scale(s2) * inverse(&(second + scaled(s2 / priors.basis)));
            q.basis = faer::Scale(1.0 / s2) * (x * &q.coefficients * &q.basis_covariance);
        }
        let aa = q.coefficients.transpose() * &q.coefficients + faer::Scale(n) * &q.coefficient_covariance;
        let bb = q.basis.transpose() * &q.basis + faer::Scale(d) * &q.basis_covariance;
        let cross = trace(&(q.coefficients.transpose() * x.transpose() * &q.basis));
        let residual = x.squared_norm_l2() - 2.0 * cross + trace(&(&aa * &bb));
        let twice = d * n * (std::f64::consts::TAU * s2).ln()
            + residual / s2
            + n * (k as f64 * priors.coefficient.ln() - log_det(&q.coefficient_covariance))
            + d * (k as f64 * priors.basis.ln() - log_det(&q.basis_covariance))
            + trace(&aa) / priors.coefficient
            + trace(&bb) / priors.basis
            - (d + n) * k as f64;
        (q, twice / 2.0)
    }

    /// 40 × 12 data with three strong directions and noise, centred.
    fn data() -> Mat<f64> {
        let mut rng = ChaCha8Rng::seed_from_u64(7);
        let mut normal = || (0..12).map(|_| rng.random_range(-0.5..0.5)).sum::<f64>();
        let w = Mat::from_fn(40, 3, |_, h| normal() * [1.5, 1.0, 0.6][h]);
        let c = Mat::from_fn(3, 12, |_, _| normal());
        let noise = Mat::from_fn(40, 12, |_, _| 0.3 * normal());
        let x = &w * &c + noise;
        let means: Vec<f64> = (0..40).map(|v| (0..12).map(|i| x[(v, i)]).sum::<f64>() / 12.0).collect();
        Mat::from_fn(40, 12, |v, i| x[(v, i)] - means[v])
    }

    fn spectrum(x: &Mat<f64>) -> (Vec<f64>, f64) {
        let gram = x.transpose() * x;
        (linear::symmetric_eigen(gram.as_ref()).unwrap().values, trace(&gram))
    }

    #[test]
    fn em_reaches_the_free_energy_of_the_analytic_solution() {
        let x = data();
        let (eigenvalues, trace) = spectrum(&x);
        for (s2, priors) in [(0.09, Priors::default()), (0.3, Priors { basis: 0.5, coefficient: 2.0 }), (1.5, Priors::default())] {
            let k = 6;
            let problem = Spectrum { eigenvalues: &eigenvalues[..k], trace, voxels: 40, objects: 12 };
            let analytic = solve_with_noise(&problem, priors, s2);
            let (posterior, energy) = em(&x, k, s2, priors, 4000);
            assert!((analytic.free_energy - energy).abs() < 1e-6 * energy.abs(), "σ² {s2}: {} against {energy}", analytic.free_energy);
            let mean = &posterior.basis * posterior.coefficients.transpose();
            let (reached, _) = spectrum(&mean);
            for (h, value) in reached.iter().take(k).enumerate() {
                let expected = analytic.components.get(h).map_or(0.0, |c| c.shrunk);
                assert!((value.max(0.0).sqrt() - expected).abs() < 1e-3, "σ² {s2}, component {h}: {} against {expected}", value.sqrt());
            }
        }
    }

    #[test]
    fn the_noise_found_is_the_best_and_near_the_truth() {
        let x = data();
        let (eigenvalues, trace) = spectrum(&x);
        let problem = Spectrum { eigenvalues: &eigenvalues[..11], trace, voxels: 40, objects: 12 };
        let best = solve(&problem, Priors::default());
        for factor in [0.5, 0.9, 1.1, 2.0] {
            assert!(solve_with_noise(&problem, Priors::default(), best.noise_variance * factor).free_energy > best.free_energy);
        }
        assert_eq!(best.components.iter().filter(|c| c.variance > 0.1).count(), 3, "three directions stand out: {:?}", best.components);
        // The noise was 0.3 times a variable of variance 1.
        assert!((best.noise_variance / 0.09 - 1.0).abs() < 0.2, "{}", best.noise_variance);
    }

    #[test]
    fn equal_objects_have_no_component() {
        let problem = Spectrum { eigenvalues: &[0.0, 0.0], trace: 0.0, voxels: 100, objects: 3 };
        let solution = solve(&problem, Priors::default());
        assert!(solution.components.is_empty() && solution.noise_variance > 0.0 && solution.free_energy.is_finite());
    }

    #[test]
    fn basis_size_follows_the_share_within_its_limits() {
        let eigenvalues = [50.0, 20.0, 15.0, 10.0, 5.0];
        assert_eq!(basis_size(&eigenvalues, 0.6, 1..=5), 2);
        assert_eq!(basis_size(&eigenvalues, 0.7, 1..=5), 2);
        assert_eq!(basis_size(&eigenvalues, 0.71, 1..=5), 3);
        assert_eq!(basis_size(&eigenvalues, 0.6, 4..=5), 4);
        assert_eq!(basis_size(&eigenvalues, 0.6, 30..=70), 5);
    }
}
