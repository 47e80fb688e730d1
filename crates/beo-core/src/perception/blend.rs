//! From class scores to a posterior.

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

impl Blend {
    /// Writes the posterior (eq. 9 in log space); `log_prior` is empty for a uniform prior.
    pub fn posterior(&self, scores: &Scores, log_prior: &[f64], out: &mut Vec<f64>) {
        out.clear();
        out.extend(self.offsets.iter().enumerate().map(|(s, offset)| {
            let mut sum = offset + log_prior.get(s).copied().unwrap_or(0.0);
            for (weight, values) in [(self.hull, &scores.hull), (self.evidence, &scores.evidence), (self.distance, &scores.distance)] {
                if weight != 0.0 {
                    sum += weight * values[s];
                }
            }
            sum
        }));
        softmax(out);
    }
}

/// exp(x) / Σ exp(x) in place; all-equal if no value is finite.
pub fn softmax(values: &mut [f64]) {
    let peak = values.iter().copied().filter(|v| v.is_finite()).fold(f64::NEG_INFINITY, f64::max);
    let count = values.len() as f64;
    for value in values.iter_mut() {
        *value = if value.is_finite() { (*value - peak).exp() } else { 0.0 };
    }
    let sum: f64 = values.iter().sum();
    values.iter_mut().for_each(|value| *value = if sum > 0.0 { *value / sum } else { 1.0 / count });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn posterior_weighs_scores_offsets_and_prior() {
        let blend = Blend { hull: 0.5, evidence: 0.0, distance: 0.0, offsets: vec![0.0, 1.0] };
        let scores = Scores { hull: vec![-1000.0, -1004.0], ..Scores::default() };
        let mut out = Vec::new();
        blend.posterior(&scores, &[], &mut out);
        assert!((out[0] - 1.0 / (1.0 + (-1.0_f64).exp())).abs() < 1e-12);
        blend.posterior(&scores, &[0.0, 1.0], &mut out);
        assert!((out[0] - 0.5).abs() < 1e-12);
    }

    #[test]
    fn softmax_survives_what_is_not_finite() {
        let mut values = [f64::NEG_INFINITY, f64::NAN];
        softmax(&mut values);
        assert_eq!(values, [0.5, 0.5]);
        let mut values = [-1e6, f64::NEG_INFINITY];
        softmax(&mut values);
        assert_eq!(values, [1.0, 0.0]);
    }
}
