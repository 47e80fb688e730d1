//! True sizes of a class's shapes: a mixture of normal densities of the logarithms of their three lengths, by expectation and maximisation
//! (Dempster, Laird and Rubin 1977), each with a floor on its variance. Its parts are the kinds of the class: low cans and tall ones.

use crate::model::SizeDensity;
use nalgebra::{Matrix3, Vector3};

/// Most kinds of a class, and fewest shapes of one.
const MOST_KINDS: usize = 3;
const FEWEST_SHAPES: usize = 20;
/// Least standard deviation of the logarithm of a length: sizes that are sold elsewhere differ at least by so much.
const LEAST_DEVIATION: f64 = 0.06;
/// Rounds of the estimation.
const ROUNDS: usize = 60;
/// A further kind must raise the mean log density of a shape by so much, nats: what its parameters cost (BIC) and some more.
const WORTH: f64 = 0.04;

/// A mixture.
pub struct Kinds {
    /// Share and density of each kind.
    pub kinds: Vec<(f64, SizeDensity)>,
    /// The kind of each shape: the most probable one.
    pub of: Vec<usize>,
}

/// Learns the kinds of a class from the three lengths of each of its shapes, metres.
pub fn kinds(lengths: &[[f64; 3]]) -> Kinds {
    let logs: Vec<Vector3<f64>> = lengths.iter().map(|l| Vector3::from(l.map(|v| v.max(1e-6).ln()))).collect();
    let mut best = fitted(&logs, 1);
    for count in 2..=MOST_KINDS.min(logs.len() / FEWEST_SHAPES) {
        let next = fitted(&logs, count);
        let large_enough = (0..count).all(|k| next.1.of.iter().filter(|of| **of == k).count() >= FEWEST_SHAPES);
        if large_enough && next.0 > best.0 + WORTH {
            best = next;
        }
    }
    best.1
}

/// The mean log density of a shape, and the mixture.
fn fitted(logs: &[Vector3<f64>], count: usize) -> (f64, Kinds) {
    let n = logs.len();
    let mean = logs.iter().sum::<Vector3<f64>>() / n.max(1) as f64;
    // Starts from shapes far apart: each next one is the farthest from those before.
    let mut middles: Vec<Vector3<f64>> = vec![mean];
    if count > 1 {
        middles = vec![farthest(logs, &[mean])];
        while middles.len() < count {
            middles.push(farthest(logs, &middles));
        }
    }
    let nearest = |at: &Vector3<f64>, middles: &[Vector3<f64>]| {
        (0..middles.len()).min_by(|a, b| (at - middles[*a]).norm().total_cmp(&(at - middles[*b]).norm())).unwrap_or(0)
    };
    let mut shares: Vec<Vec<f64>> = logs
        .iter()
        .map(|at| {
            let own = nearest(at, &middles);
            (0..count).map(|k| f64::from(u8::from(k == own))).collect()
        })
        .collect();
    let (mut kinds, mut log_density) = (Vec::new(), f64::NEG_INFINITY);
    for _ in 0..if count == 1 { 1 } else { ROUNDS } {
        kinds = (0..count).map(|k| moments(logs, |i| shares[i][k])).collect::<Vec<_>>();
        let mut sum = 0.0;
        for (at, shares) in logs.iter().zip(&mut shares) {
            let lengths = std::array::from_fn(|i| at[i].exp());
            let terms: Vec<f64> =
                kinds.iter().map(|(p, d): &(f64, SizeDensity)| p.max(1e-9).ln() + d.log_density(lengths, [0.0; 3])).collect();
            let peak = terms.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            let total = peak + terms.iter().map(|t| (t - peak).exp()).sum::<f64>().ln();
            sum += total;
            shares.iter_mut().zip(terms).for_each(|(share, term)| *share = (term - total).exp());
        }
        log_density = sum / n.max(1) as f64;
    }
    let of = shares.iter().map(|s| (0..count).max_by(|a, b| s[*a].total_cmp(&s[*b]).then(b.cmp(a))).unwrap_or(0)).collect();
    (log_density, Kinds { kinds, of })
}

fn farthest(logs: &[Vector3<f64>], from: &[Vector3<f64>]) -> Vector3<f64> {
    let distance = |at: &Vector3<f64>| from.iter().map(|f| (at - f).norm()).fold(f64::INFINITY, f64::min);
    logs.iter().copied().max_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap_or_default()
}

/// Share and density of what is weighed by `weight`.
fn moments(logs: &[Vector3<f64>], weight: impl Fn(usize) -> f64) -> (f64, SizeDensity) {
    let total: f64 = (0..logs.len()).map(&weight).sum::<f64>().max(1e-9);
    let mean = logs.iter().enumerate().map(|(i, at)| at * weight(i)).sum::<Vector3<f64>>() / total;
    let scatter = logs.iter().enumerate().map(|(i, at)| (at - mean) * (at - mean).transpose() * weight(i)).sum::<Matrix3<f64>>() / total;
    let covariance = scatter + Matrix3::identity() * LEAST_DEVIATION.powi(2);
    let density = SizeDensity { mean: mean.into(), covariance: std::array::from_fn(|i| std::array::from_fn(|j| covariance[(i, j)])) };
    (total / logs.len().max(1) as f64, density)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_sizes_of_cans_are_two_kinds() {
        // Deterministic scatter of about 5 %.
        let scatter = |n: usize, axis: usize| 1.0 + 0.05 * ((n * (7 + 4 * axis)) as f64 * 0.618).sin();
        let lengths: Vec<[f64; 3]> = (0..120)
            .map(|n| {
                let [d, h] = if n % 3 == 0 { [0.085, 0.035] } else { [0.066, 0.12] };
                [d * scatter(n, 0), d * scatter(n, 0), h * scatter(n, 1)]
            })
            .collect();
        let found = kinds(&lengths);
        assert_eq!(found.kinds.len(), 2);
        let low = found.of[0];
        assert!((0..120).all(|n| (found.of[n] == low) == (n % 3 == 0)));
        let (share, density) = &found.kinds[low];
        assert!((share - 1.0 / 3.0).abs() < 0.01 && (density.mean[2].exp() - 0.035).abs() < 0.001);
        assert!(density.covariance[0][0] >= LEAST_DEVIATION.powi(2) && density.covariance[0][0] < 0.01);
    }

    #[test]
    fn shapes_of_one_size_are_one_kind_and_few_are_never_split() {
        assert_eq!(kinds(&vec![[0.1, 0.1, 0.2]; 200]).kinds.len(), 1);
        let few: Vec<[f64; 3]> = (0..20).map(|n| if n < 10 { [0.1; 3] } else { [0.3; 3] }).collect();
        assert_eq!(kinds(&few).kinds.len(), 1);
    }
}
