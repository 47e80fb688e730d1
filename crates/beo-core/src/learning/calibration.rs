//! Fitting what turns scores into probabilities, on objects that the scoring model has not seen.

use crate::linear::{LinearError, cholesky, solve_cholesky};
use faer::Mat;

/// A regularised logistic model fitted by Newton's method.
struct Newton {
    /// Ridge on each parameter.
    ridge: Vec<f64>,
}

impl Newton {
    /// Minimises `loss` (value, gradient, Hessian at a point) plus the ridge, from zero.
    fn minimise(&self, loss: impl Fn(&[f64]) -> (f64, Vec<f64>, Mat<f64>)) -> Result<Vec<f64>, LinearError> {
        let n = self.ridge.len();
        let penalty = |x: &[f64]| x.iter().zip(&self.ridge).map(|(x, r)| 0.5 * r * x * x).sum::<f64>();
        let mut x = vec![0.0; n];
        let (mut value, mut gradient, mut hessian) = loss(&x);
        value += penalty(&x);
        for _ in 0..100 {
            for i in 0..n {
                gradient[i] += self.ridge[i] * x[i];
                hessian[(i, i)] += self.ridge[i] + 1e-12;
            }
            cholesky(&mut hessian)?;
            let mut step = gradient.clone();
            solve_cholesky(&hessian, &mut step);
            let decrease: f64 = gradient.iter().zip(&step).map(|(g, s)| g * s).sum();
            if decrease < 1e-12 {
                break;
            }
            let mut length = 1.0;
            loop {
                let next: Vec<f64> = x.iter().zip(&step).map(|(x, s)| x - length * s).collect();
                let (next_value, next_gradient, next_hessian) = loss(&next);
                let next_value = next_value + penalty(&next);
                if next_value <= value - 1e-4 * length * decrease || length < 1e-6 {
                    (x, value, gradient, hessian) = (next, next_value, next_gradient, next_hessian);
                    break;
                }
                length /= 2.0;
            }
            if length < 1e-6 {
                break;
            }
        }
        Ok(x)
    }
}

/// Score weights and class offsets.
#[derive(Clone, Debug, PartialEq)]
pub struct Fitted {
    /// One weight per kind of score, none negative.
    pub weights: Vec<f64>,
    /// One offset per class.
    pub offsets: Vec<f64>,
    /// Mean negative log posterior of the true class, classes weighted alike.
    pub log_loss: f64,
    /// Share of objects whose most probable class is the true one, classes weighted alike.
    pub accuracy: f64,
}

/// Fits log posterior ∝ Σ_j weight_j score_j + offset by multinomial logistic regression, classes weighted alike (so the
/// posterior is for a uniform prior), with a light ridge on the offsets.
///
/// `scores[j][i][s]` is score j of object i for class s. A score that would get a negative weight gets none.
pub fn fit_blend(scores: &[Vec<Vec<f64>>], labels: &[usize], classes: usize, with_offsets: bool) -> Result<Fitted, LinearError> {
    let mut counts = vec![0.0_f64; classes];
    labels.iter().for_each(|l| counts[*l] += 1.0);
    let present = counts.iter().filter(|c| **c > 0.0).count().max(1) as f64;
    let importance: Vec<f64> = labels.iter().map(|l| 1.0 / (counts[*l] * present)).collect();
    // Only differences between classes matter: centred, and scaled to unit spread for the Newton steps.
    let centred: Vec<Vec<Vec<f64>>> = scores.iter().map(|s| s.iter().map(|row| centre(row)).collect()).collect();
    let spreads: Vec<f64> = centred
        .iter()
        .map(|s| (s.iter().flatten().map(|v| v * v).sum::<f64>() / (s.len() * classes).max(1) as f64).sqrt().max(1e-12))
        .collect();
    let mut used: Vec<usize> = (0..scores.len()).collect();
    loop {
        let (j, size) = (used.len(), used.len() + if with_offsets { classes } else { 0 });
        let mut ridge = vec![1e-9; j];
        ridge.resize(size, 2e-3);
        let value = |i: usize, c: usize, p: usize| -> f64 {
            if p < j { centred[used[p]][i][c] / spreads[used[p]] } else { f64::from(u8::from(p - j == c)) }
        };
        let solution = Newton { ridge }.minimise(|x| {
            let (mut loss, mut gradient, mut hessian) = (0.0, vec![0.0; size], Mat::<f64>::zeros(size, size));
            let mut features = vec![0.0; classes * size];
            for (i, (&label, &weight)) in labels.iter().zip(&importance).enumerate() {
                let mut p = vec![0.0; classes];
                for c in 0..classes {
                    for q in 0..size {
                        features[c * size + q] = value(i, c, q);
                        p[c] += x[q] * features[c * size + q];
                    }
                }
                let normaliser = crate::perception::densities::log_sum::log_sum_exp(p.iter().copied());
                loss += weight * (normaliser - p[label]);
                p.iter_mut().for_each(|v| *v = (*v - normaliser).exp());
                let mean: Vec<f64> = (0..size).map(|q| (0..classes).map(|c| p[c] * features[c * size + q]).sum()).collect();
                for q in 0..size {
                    gradient[q] += weight * (mean[q] - features[label * size + q]);
                    for r in 0..=q {
                        let second: f64 = (0..classes).map(|c| p[c] * features[c * size + q] * features[c * size + r]).sum();
                        hessian[(q, r)] += weight * (second - mean[q] * mean[r]);
                    }
                }
            }
            (loss, gradient, hessian)
        })?;
        if let Some(worst) = (0..j).find(|q| solution[*q] < 0.0) {
            used.remove(worst);
            continue;
        }
        let mut weights = vec![0.0; scores.len()];
        used.iter().enumerate().for_each(|(q, s)| weights[*s] = solution[q] / spreads[*s]);
        let offsets = if with_offsets { solution[j..].to_vec() } else { vec![0.0; classes] };
        let (mut log_loss, mut accuracy) = (0.0, 0.0);
        for (i, (label, weight)) in labels.iter().zip(&importance).enumerate() {
            let mut p: Vec<f64> =
                (0..classes).map(|c| offsets[c] + (0..scores.len()).map(|s| weights[s] * centred[s][i][c]).sum::<f64>()).collect();
            crate::perception::densities::log_sum::softmax(&mut p);
            log_loss -= weight * p[*label].max(1e-300).ln();
            accuracy += if p.iter().all(|other| *other <= p[*label]) { *weight } else { 0.0 };
        }
        return Ok(Fitted { weights, offsets, log_loss, accuracy });
    }
}

fn centre(row: &[f64]) -> Vec<f64> {
    let mean = row.iter().sum::<f64>() / row.len() as f64;
    row.iter().map(|v| v - mean).collect()
}

/// A calibration of hidden voxels.
#[derive(Clone, Copy, Debug)]
pub struct FittedVoxels {
    /// Weight of each regressor.
    pub weights: [f64; 5],
    /// Weighted mean of the negative log probability of what is there.
    pub log_loss: f64,
}

/// Fits P(filled) = logistic(xᵀw) to voxels with regressors x, weight and truth.
pub fn fit_voxels(voxels: &[([f32; 5], f32, bool)]) -> Result<FittedVoxels, LinearError> {
    let loss = |w: &[f64]| {
        let (mut loss, mut gradient, mut hessian) = (0.0, vec![0.0; 5], Mat::<f64>::zeros(5, 5));
        for (x, weight, filled) in voxels {
            let x = x.map(f64::from);
            let weight = f64::from(*weight);
            let t: f64 = x.iter().zip(w).map(|(x, w)| x * w).sum();
            let p = 1.0 / (1.0 + (-t).exp());
            // log(1 + e^t) − y t, without overflow
            loss += weight * (t.max(0.0) + (-t.abs()).exp().ln_1p() - if *filled { t } else { 0.0 });
            for i in 0..5 {
                gradient[i] += weight * (p - f64::from(u8::from(*filled))) * x[i];
                for j in 0..=i {
                    hessian[(i, j)] += weight * p * (1.0 - p) * x[i] * x[j];
                }
            }
        }
        (loss, gradient, hessian)
    };
    let solution = Newton { ridge: vec![1e-6; 5] }.minimise(loss)?;
    Ok(FittedVoxels { weights: std::array::from_fn(|i| solution[i]), log_loss: loss(&solution).0 })
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    /// Scores drawn so that the true posterior is softmax(0.02 · score + offset): the fit must find both.
    #[test]
    fn the_temperature_and_offsets_of_a_known_posterior_are_found() {
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let (mut scores, mut noise, mut labels) = (Vec::new(), Vec::new(), Vec::new());
        let offsets = [0.5, -0.5, 0.0];
        for _ in 0..6000 {
            let row: Vec<f64> = (0..3).map(|_| rng.random_range(-200.0..200.0)).collect();
            let mut p: Vec<f64> = row.iter().zip(offsets).map(|(s, o)| 0.02 * s + o).collect();
            crate::perception::densities::log_sum::softmax(&mut p);
            let draw: f64 = rng.random_range(0.0..1.0);
            labels.push(if draw < p[0] {
                0
            } else if draw < p[0] + p[1] {
                1
            } else {
                2
            });
            scores.push(row);
            noise.push((0..3).map(|_| rng.random_range(-1.0..1.0)).collect());
        }
        let fitted = fit_blend(&[scores, noise], &labels, 3, true).unwrap();
        assert!((fitted.weights[0] - 0.02).abs() < 0.002, "{fitted:?}");
        assert!(fitted.weights[1] < 0.15, "{fitted:?}");
        // Classes are weighted alike, so offsets are those of a uniform prior: their order remains.
        assert!(fitted.log_loss < 0.8);
    }

    #[test]
    fn a_score_that_misleads_gets_no_weight() {
        let good: Vec<Vec<f64>> = (0..60).map(|i| (0..2).map(|c| if i % 2 == c || i % 5 == 0 { 1.0 } else { 0.0 }).collect()).collect();
        let bad: Vec<Vec<f64>> = (0..60).map(|i| (0..2).map(|c| if i % 2 == c { -1.0 } else { (i % 3) as f64 }).collect()).collect();
        let labels: Vec<usize> = (0..60).map(|i| i % 2).collect();
        let fitted = fit_blend(&[good, bad], &labels, 2, true).unwrap();
        assert!(fitted.weights[0] > 0.0 && fitted.weights[1] == 0.0, "{fitted:?}");
    }

    #[test]
    fn the_voxel_calibration_finds_its_weights() {
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let truth = [0.3, 0.7, -0.4, 0.2, 0.5];
        let voxels: Vec<_> = (0..40_000)
            .map(|_| {
                let x: [f32; 5] = std::array::from_fn(|i| if i == 0 { 1.0 } else { rng.random_range(-2.0..2.0) });
                let t: f64 = x.iter().zip(truth).map(|(x, w)| f64::from(*x) * w).sum();
                (x, 1.0 / 40_000.0, rng.random_range(0.0..1.0) < 1.0 / (1.0 + (-t).exp()))
            })
            .collect();
        let fitted = fit_voxels(&voxels).unwrap().weights;
        for (value, expected) in fitted.iter().zip(truth) {
            assert!((value - expected).abs() < 0.05, "{fitted:?}");
        }
    }
}
