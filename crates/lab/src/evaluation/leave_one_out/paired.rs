//! Means with their standard errors, and Wilcoxon's signed-rank test of paired differences.

use serde::Serialize;

/// A mean over shapes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Mean {
    /// The mean.
    pub mean: f64,
    /// Its standard error: the sample's standard deviation over √n; 0 of a single value.
    pub standard_error: f64,
}

impl Mean {
    /// Of some values; 0 without any.
    pub fn of(values: &[f64]) -> Self {
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n.max(1.0);
        let squares = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>();
        Self { mean, standard_error: (squares / (n - 1.0).max(1.0) / n.max(1.0)).sqrt() }
    }
}

/// One way compared with another, shape by shape.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Paired {
    /// Shapes of which the first way is better.
    pub better: usize,
    /// Shapes of which it is worse.
    pub worse: usize,
    /// Shapes of which both are equal.
    pub equal: usize,
    /// Two-sided p-value of Wilcoxon's signed-rank test, exact, ties with their mean rank; 1 where all are equal.
    pub p: f64,
}

impl Paired {
    /// Of the gains of the first way over the second.
    pub fn of(gains: &[f64]) -> Self {
        let count = |which: fn(&f64) -> bool| gains.iter().filter(|gain| which(gain)).count();
        let (better, worse) = (count(|g| *g > 0.0), count(|g| *g < 0.0));
        Self { better, worse, equal: gains.len() - better - worse, p: signed_rank(gains) }
    }
}

/// P of a sum of signed ranks as extreme as this one, if each sign is as likely as the other: by the distribution of the sum itself.
fn signed_rank(gains: &[f64]) -> f64 {
    let mut sorted: Vec<f64> = gains.iter().copied().filter(|gain| *gain != 0.0).collect();
    sorted.sort_by(|a, b| a.abs().total_cmp(&b.abs()));
    // Twice the rank is a whole number for ties too: first plus last place of those that are equal, counted from 1.
    let rank2 = |gain: &f64| {
        let below = sorted.partition_point(|v| v.abs() < gain.abs());
        let up_to = sorted.partition_point(|v| v.abs() <= gain.abs());
        below + 1 + up_to
    };
    let ranks: Vec<usize> = sorted.iter().map(rank2).collect();
    let positive: usize = sorted.iter().zip(&ranks).filter(|(gain, _)| **gain > 0.0).map(|(_, rank)| rank).sum();
    // Probability of each sum of the ranks of positive gains.
    let total: usize = ranks.iter().sum();
    let mut probability = vec![0.0; total + 1];
    probability[0] = 1.0;
    let mut reached = 0;
    for rank in ranks {
        reached += rank;
        for sum in (0..=reached).rev() {
            let with = if sum >= rank { probability[sum - rank] } else { 0.0 };
            probability[sum] = (probability[sum] + with) / 2.0;
        }
    }
    let (low, high): (f64, f64) = (probability[..=positive].iter().sum(), probability[positive..].iter().sum());
    (2.0 * low.min(high)).min(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_signed_rank_test_is_that_of_scipy() {
        // scipy.stats.wilcoxon(x, method="exact").pvalue
        for (gains, p) in [
            (&[1.1, -0.3, 2.2, 0.7, 3.1, -0.2, 0.9, 1.7, 0.05, 2.5][..], 0.01953125),
            (&[-1.0, -2.0, -3.0, -4.0, -5.0, -6.0], 0.03125),
            (&[0.4, -0.5, 0.6, -0.7], 0.875),
        ] {
            let found = Paired::of(gains).p;
            assert!((found - p).abs() < 1e-12, "{found} {p}");
        }
    }

    #[test]
    fn ties_share_their_rank_and_equal_pairs_say_nothing() {
        // By hand: ranks 1.5, 1.5, 3 and one zero; of the 8 signs, sums of 4.5 or more and of 1.5 or less are (+ − +), (− + +), (+ + +) and
        // their opposites.
        let paired = Paired::of(&[1.0, -1.0, 0.0, 2.0]);
        assert_eq!((paired.better, paired.worse, paired.equal), (2, 1, 1));
        assert!((paired.p - 6.0 / 8.0).abs() < 1e-12, "{}", paired.p);
        assert_eq!(Paired::of(&[0.0, 0.0]).p, 1.0);
        assert_eq!(Paired::of(&[]).p, 1.0);
    }

    #[test]
    fn the_standard_error_is_that_of_the_mean() {
        // numpy: std(ddof=1) / sqrt(n)
        let mean = Mean::of(&[1.0, 2.0, 4.0, 5.0]);
        assert!((mean.mean - 3.0).abs() < 1e-12 && (mean.standard_error - 0.912870929175277).abs() < 1e-12, "{mean:?}");
        assert_eq!((Mean::of(&[2.0]).standard_error, Mean::of(&[]).mean), (0.0, 0.0));
    }
}
