//! From class scores to a posterior (eq. 9 in log space): weight × score + offset + log prior, normalised over the classes.

use super::log_sum::softmax;
use crate::model::Blend;

/// Class scores of one query, one value per class each; empty when not computed.
#[derive(Clone, Debug, Default)]
pub struct Scores {
    /// log t density of the hull's projection.
    pub hull: Vec<f64>,
    /// log evidence.
    pub evidence: Vec<f64>,
    /// Negative squared distance to the class mean on the known voxels.
    pub distance: Vec<f64>,
}

impl Scores {
    /// Forgets them.
    pub fn clear(&mut self) {
        [&mut self.hull, &mut self.evidence, &mut self.distance].into_iter().for_each(Vec::clear);
    }

    /// Those of one class.
    fn of_class(&self, class: usize) -> ClassScores {
        let score = |values: &Vec<f64>| values.get(class).copied().unwrap_or(0.0);
        ClassScores { hull: score(&self.hull), evidence: score(&self.evidence), distance: score(&self.distance), forest: 0.0 }
    }
}

/// Scores of one class.
#[derive(Clone, Copy, Debug, Default)]
pub struct ClassScores {
    /// log density of the hull, or of what a camera sees.
    pub hull: f64,
    /// log evidence.
    pub evidence: f64,
    /// Negative squared distance to the class mean.
    pub distance: f64,
    /// Logarithm of the forest's share.
    pub forest: f64,
}

impl ClassScores {
    /// Of the hull alone.
    pub fn hull(score: f64) -> Self {
        Self { hull: score, ..Self::default() }
    }

    /// Of evidence alone.
    pub fn evidence(score: f64) -> Self {
        Self { evidence: score, ..Self::default() }
    }

    /// Of distance alone.
    pub fn distance(score: f64) -> Self {
        Self { distance: score, ..Self::default() }
    }
}

impl Blend {
    /// Log posterior of a class, up to a constant that is common to all. A score that has no weight does not count, even if it is −∞.
    pub(crate) fn log_posterior(&self, class: usize, scores: ClassScores, log_prior: f64) -> f64 {
        let mut sum = self.offsets.get(class).copied().unwrap_or(0.0) + log_prior;
        let weighed =
            [(self.hull, scores.hull), (self.evidence, scores.evidence), (self.distance, scores.distance), (self.forest, scores.forest)];
        for (weight, score) in weighed {
            if weight != 0.0 {
                sum += weight * score;
            }
        }
        sum
    }

    /// Writes the posterior; `log_prior` is empty for a uniform prior.
    pub(crate) fn posterior(&self, scores: &Scores, log_prior: &[f64], out: &mut Vec<f64>) {
        out.clear();
        let prior = |class: usize| log_prior.get(class).copied().unwrap_or(0.0);
        out.extend((0..self.offsets.len()).map(|class| self.log_posterior(class, scores.of_class(class), prior(class))));
        softmax(out);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn posterior_weighs_scores_offsets_and_prior() {
        let blend = Blend { hull: 0.5, offsets: vec![0.0, 1.0], ..Blend::default() };
        let scores = Scores { hull: vec![-1000.0, -1004.0], ..Scores::default() };
        let mut out = Vec::new();
        blend.posterior(&scores, &[], &mut out);
        assert!((out[0] - 1.0 / (1.0 + (-1.0_f64).exp())).abs() < 1e-12);
        blend.posterior(&scores, &[0.0, 1.0], &mut out);
        assert!((out[0] - 0.5).abs() < 1e-12);
    }

    #[test]
    fn a_score_without_weight_does_not_count_even_if_it_is_infinite() {
        let blend = Blend { evidence: 1.0, offsets: vec![0.25], ..Blend::default() };
        let scores = ClassScores { hull: f64::NEG_INFINITY, evidence: 2.0, ..ClassScores::default() };
        assert_eq!(blend.log_posterior(0, scores, -1.0), 1.25);
    }
}
