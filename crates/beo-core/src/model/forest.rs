//! A forest of boosted decision trees (Friedman 2001) on what a view of a camera measures: shares of the classes, and of none of them.

use half::f16;

/// The input of a node that is a leaf.
pub const LEAF: u8 = u8::MAX;

/// Decision trees, one after the other in the same arrays.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Forest {
    /// Number of inputs, at most 255.
    pub inputs: usize,
    /// Number of outcomes.
    pub outcomes: usize,
    /// The first node of each tree.
    pub roots: Vec<u32>,
    /// Which input each node asks for; [`LEAF`] for a leaf.
    pub asks: Vec<u8>,
    /// At most this value goes to the first child, more to the second; of a leaf 0.
    pub thresholds: Vec<f32>,
    /// The first child, which the second follows; of a leaf its row of `scores`. Children stand after their parents.
    pub next: Vec<u32>,
    /// What each leaf adds to the log odds of the outcomes, one row per leaf.
    pub scores: Vec<f16>,
}

impl Forest {
    /// Shares of the outcomes into `out`: exp(Σ score) over the trees, divided by their sum.
    pub fn shares(&self, inputs: &[f32], out: &mut Vec<f64>) {
        out.clear();
        out.resize(self.outcomes, 0.0);
        for root in &self.roots {
            let row = &self.scores[self.leaf(*root as usize, inputs) * self.outcomes..][..self.outcomes];
            out.iter_mut().zip(row).for_each(|(sum, score)| *sum += f64::from(score.to_f32()));
        }
        let peak = out.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        out.iter_mut().for_each(|sum| *sum = (*sum - peak).exp());
        let total: f64 = out.iter().sum();
        out.iter_mut().for_each(|share| *share /= total);
    }

    /// The row of `scores` of the leaf to which inputs come from a root. A missing input (not a number) goes to the second child.
    pub fn leaf(&self, root: usize, inputs: &[f32]) -> usize {
        let mut node = root;
        while self.asks[node] != LEAF {
            let goes_first = inputs[usize::from(self.asks[node])] <= self.thresholds[node];
            node = self.next[node] as usize + usize::from(!goes_first);
        }
        self.next[node] as usize
    }

    /// Why the forest cannot be used; `None` where it can. Walks of a sound forest end, within its arrays.
    pub fn fault(&self) -> Option<&'static str> {
        let nodes = self.asks.len();
        if self.inputs == 0 || self.inputs > usize::from(LEAF) || self.outcomes == 0 || self.roots.is_empty() {
            return Some("has no inputs, outcomes or trees");
        }
        if self.thresholds.len() != nodes || self.next.len() != nodes || !self.scores.len().is_multiple_of(self.outcomes) {
            return Some("has arrays of different lengths");
        }
        if self.roots.iter().any(|root| *root as usize >= nodes) {
            return Some("has a tree without nodes");
        }
        let leaves = self.scores.len() / self.outcomes;
        for node in 0..nodes {
            let (ask, next) = (self.asks[node], self.next[node] as usize);
            let sound = match ask {
                LEAF => next < leaves,
                ask => usize::from(ask) < self.inputs && next > node && next + 1 < nodes && self.thresholds[node].is_finite(),
            };
            if !sound {
                return Some("has a node that asks for or leads to what is not there");
            }
        }
        (!self.scores.iter().all(|score| score.is_finite())).then_some("has scores that are not finite")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two trees: a stump on input 1 at 0.5, and a single leaf.
    fn forest() -> Forest {
        Forest {
            inputs: 2,
            outcomes: 2,
            roots: vec![0, 3],
            asks: vec![1, LEAF, LEAF, LEAF],
            thresholds: vec![0.5, 0.0, 0.0, 0.0],
            next: vec![1, 0, 1, 2],
            scores: [1.0, 0.0, 0.0, 1.0, 0.5, 0.25].map(f16::from_f32).to_vec(),
        }
    }

    #[test]
    fn shares_are_odds_over_all_trees_and_what_is_missing_goes_to_the_second_child() {
        let mut out = Vec::new();
        for (value, log_odds) in [(0.5, 1.25), (0.51, -0.75), (f32::NAN, -0.75)] {
            forest().shares(&[9.0, value], &mut out);
            // Of two outcomes: the logistic function of the difference.
            let expected = 1.0 / (1.0 + f64::exp(-log_odds));
            assert!((out[0] - expected).abs() < 1e-12 && (out[1] - 1.0 + expected).abs() < 1e-12, "{out:?}");
        }
    }

    #[test]
    fn forests_that_would_be_left_or_never_be_left_are_not_sound() {
        assert_eq!(forest().fault(), None);
        let broken: [fn(&mut Forest); 7] = [
            |f| f.next[0] = 0,
            |f| f.next[0] = 3,
            |f| f.next[1] = 3,
            |f| f.asks[0] = 2,
            |f| f.roots[1] = 4,
            |f| f.scores[0] = f16::NAN,
            |f| f.thresholds[0] = f32::NAN,
        ];
        for break_it in broken {
            let mut forest = forest();
            break_it(&mut forest);
            assert!(forest.fault().is_some(), "{forest:?}");
        }
    }

    #[test]
    fn arrays_that_do_not_belong_together_are_told_apart() {
        type Case = (fn(&mut Forest), &'static str);
        let broken: [Case; 9] = [
            (|f| f.inputs = 0, "no inputs"),
            (|f| f.inputs = 256, "no inputs"),
            (|f| f.outcomes = 0, "no inputs"),
            (|f| f.roots.clear(), "no inputs"),
            (|f| f.thresholds.truncate(3), "different lengths"),
            (|f| f.next.push(0), "different lengths"),
            (|f| f.scores.truncate(5), "different lengths"),
            (|f| f.scores.truncate(4), "what is not there"),
            (|f| f.scores[5] = f16::INFINITY, "not finite"),
        ];
        for (break_it, part) in broken {
            let mut forest = forest();
            break_it(&mut forest);
            let fault = forest.fault().unwrap_or_else(|| panic!("{part}: {forest:?}"));
            assert!(fault.contains(part), "{fault}");
        }
        // As many inputs as a byte can ask for, beside the mark of a leaf.
        assert_eq!(Forest { inputs: 255, ..forest() }.fault(), None);
    }
}
