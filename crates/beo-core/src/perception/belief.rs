//! What is believed of an object that is seen in several frames: its class, by Bayes' rule with forgetting, and whether it has one.
//!
//! Let b be the belief after the last frame, m the number of classes, and L(s) the likelihood of the new frame. An object may have been
//! exchanged for another between two frames, with probability ε, so the prediction is b'(s) = (1 − ε) b(s) + ε / m. Frames of one object are
//! not independent (the same side is seen by the same sensor), so each counts with the power τ < 1:
//!
//! ```text
//! b(s) ∝ b'(s) L(s)^τ
//! ```
//!
//! Perception is asked with the log prior ln b'(s) / τ; it answers p(s) ∝ b'(s)^(1/τ) L(s), and p(s)^τ is the new belief. The class, pose and
//! completion that perception answers are thus those of the filtered class, and unlikely classes are not searched again in each frame.

use crate::model::MOST_CLASSES;

/// Probability that the object was exchanged between two frames.
const EXCHANGED: f64 = 0.02;
/// Weight τ of one frame: half of what it would be if frames were independent.
const WEIGHT: f64 = 0.5;

/// Probability of each class, given all frames of an object so far. Held in place, so that a query allocates nothing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClassBelief {
    probabilities: [f64; MOST_CLASSES],
    classes: usize,
}

impl ClassBelief {
    /// The belief after the first frame: the posterior as it was answered.
    pub fn first(posterior: &[f64]) -> Self {
        let mut belief = Self { probabilities: [0.0; MOST_CLASSES], classes: posterior.len().min(MOST_CLASSES) };
        belief.probabilities[..belief.classes].copy_from_slice(&posterior[..belief.classes]);
        belief
    }

    /// ln b'(s) / τ of each class: the log prior with which the next frame is perceived.
    pub fn log_prior(&self, out: &mut Vec<f64>) {
        let classes = self.classes as f64;
        out.clear();
        out.extend(self.probabilities[..self.classes].iter().map(|p| ((1.0 - EXCHANGED) * p + EXCHANGED / classes).ln() / WEIGHT));
    }

    /// Takes in the posterior that was answered with [`Self::log_prior`], and writes the filtered one in its place.
    pub fn update(&mut self, posterior: &mut [f64]) {
        posterior.iter_mut().for_each(|p| *p = p.powf(WEIGHT));
        let sum: f64 = posterior.iter().sum();
        posterior.iter_mut().for_each(|p| *p /= sum);
        *self = Self::first(posterior);
    }
}

/// Weight α of a new frame in the logarithm of the odds that an object is of none of the classes. Frames of a still object err alike, so the
/// logarithms are averaged (a logarithmic opinion pool with forgetting) and not added: many frames that are not sure make no sure answer.
const NONE_WEIGHT: f64 = 0.35;
/// No frame is surer than this in either direction, so that an object that was exchanged is noticed within three.
const SUREST_NONE: f64 = 0.99;

/// Logarithm of the odds that an object is of none of the classes, given all frames so far: f ← (1 − α) f + α ln(p / (1 − p)).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NoneBelief {
    log_odds: f64,
}

impl NoneBelief {
    fn log_odds(probability: f64) -> f64 {
        let p = probability.clamp(1.0 - SUREST_NONE, SUREST_NONE);
        (p / (1.0 - p)).ln()
    }

    /// The belief after the first frame.
    pub fn first(probability: f64) -> Self {
        Self { log_odds: Self::log_odds(probability) }
    }

    /// The belief after another frame.
    pub fn after(self, probability: f64) -> Self {
        Self { log_odds: (1.0 - NONE_WEIGHT) * self.log_odds + NONE_WEIGHT * Self::log_odds(probability) }
    }

    /// The probability that is believed.
    pub fn probability(self) -> f64 {
        (1.0 + (-self.log_odds).exp()).recip()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One frame with these likelihoods, as perception answers it: prior times likelihood, normalised.
    fn see(belief: &mut ClassBelief, likelihood: &[f64]) -> Vec<f64> {
        let mut prior = Vec::new();
        belief.log_prior(&mut prior);
        let mut posterior: Vec<f64> = prior.iter().zip(likelihood).map(|(log, l)| log.exp() * l).collect();
        let sum: f64 = posterior.iter().sum();
        posterior.iter_mut().for_each(|p| *p /= sum);
        belief.update(&mut posterior);
        posterior
    }

    fn class(posterior: &[f64]) -> usize {
        (0..posterior.len()).max_by(|a, b| posterior[*a].total_cmp(&posterior[*b])).unwrap()
    }

    #[test]
    fn it_is_bayes_rule_with_forgetting_and_tempered_likelihoods() {
        let mut belief = ClassBelief::first(&[0.7, 0.2, 0.1]);
        let likelihood = [0.3_f64, 0.9, 0.02];
        let found = see(&mut belief, &likelihood);
        let predicted = [0.7, 0.2, 0.1].map(|p| 0.98 * p + 0.02 / 3.0);
        let product: Vec<f64> = predicted.iter().zip(likelihood).map(|(p, l)| p * l.sqrt()).collect();
        let sum: f64 = product.iter().sum();
        found.iter().zip(product).for_each(|(f, p)| assert!((f - p / sum).abs() < 1e-12, "{f} {}", p / sum));
    }

    #[test]
    fn a_still_object_does_not_flip_however_sure_one_frame_in_four_is_of_another_class() {
        let mut belief = ClassBelief::first(&[0.9, 0.05, 0.05]);
        for frame in 0..40 {
            let likelihood = if frame % 4 == 3 { [0.04, 0.95, 0.01] } else { [0.9, 0.07, 0.03] };
            assert_eq!(class(&see(&mut belief, &likelihood)), 0, "frame {frame}");
        }
    }

    #[test]
    fn an_exchanged_object_is_noticed_within_three_frames() {
        let mut belief = ClassBelief::first(&[0.9, 0.05, 0.05]);
        (0..100).for_each(|_| drop(see(&mut belief, &[0.97, 0.02, 0.01])));
        let after: Vec<usize> = (0..3).map(|_| class(&see(&mut belief, &[0.02, 0.01, 0.97]))).collect();
        assert_eq!(after[2], 2, "{after:?}");
    }

    #[test]
    fn of_frames_that_are_not_sure_no_sure_belief_comes_and_a_change_is_noticed_within_three() {
        let after = |start: NoneBelief, frames: &[f64]| frames.iter().fold(start, |belief, p| belief.after(*p));
        let unsure = after(NoneBelief::first(0.6), &[0.6; 50]);
        assert!((unsure.probability() - 0.6).abs() < 1e-9);
        // One frame in four that is sure of the opposite does not turn it.
        let frames: Vec<f64> = (0..40).map(|n| if n % 4 == 3 { 0.9 } else { 0.1 }).collect();
        let steps = (0..frames.len()).map(|n| after(NoneBelief::first(0.1), &frames[..n]).probability());
        assert!(steps.into_iter().all(|p| p < 0.5));
        assert!(after(NoneBelief::first(0.0), &[1.0; 3]).probability() > 0.5);
        // By hand: ln(0.2 / 0.8) (1 − α) + ln(0.7 / 0.3) α.
        let by_hand = 0.65 * 0.25_f64.ln() + 0.35 * (7.0_f64 / 3.0).ln();
        assert!((NoneBelief::first(0.2).after(0.7).probability() - 1.0 / (1.0 + (-by_hand).exp())).abs() < 1e-12);
    }
}
