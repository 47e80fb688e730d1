//! Learns forests of decision trees by gradient boosting (Friedman, "Greedy function approximation: a gradient boosting machine", Annals of
//! Statistics 29, 2001), with second derivatives and histograms of the inputs as in Chen & Guestrin, "XGBoost" (KDD 2016).
//!
//! Every tree is fitted to what the trees before it leave of the multinomial log likelihood. A leaf holds a vector: for each outcome a Newton
//! step −η Σ g / (Σ h + λ) of its log odds, where g = p − y and h = p (1 − p). A node is split where Σ (Σ g)² / (Σ h + λ) over outcomes and both
//! children rises most.

use crate::model::{Forest, LEAF};
use half::f16;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

/// A training set: one row of inputs for each sample, and its outcome.
pub struct Samples<'a> {
    /// Rows of inputs, one after the other. Missing values are not numbers.
    pub inputs: &'a [f32],
    /// Inputs of a row.
    pub width: usize,
    /// The outcome of each row.
    pub outcomes: &'a [usize],
    /// Number of outcomes.
    pub count: usize,
}

/// How trees are grown.
#[derive(Clone, Copy, Debug)]
pub struct Growth {
    /// Number of trees.
    pub trees: usize,
    /// η: the share of each Newton step that is taken.
    pub rate: f32,
    /// Most leaves of a tree.
    pub leaves: usize,
    /// Fewest samples of a leaf.
    pub least_leaf: usize,
    /// λ, added to the sum of second derivatives.
    pub ridge: f32,
    /// Share of the inputs, drawn anew for each tree, that it may ask for.
    pub inputs: f64,
    /// Seed.
    pub seed: u64,
}

/// Values of an input are sorted into at most so many classes of about as many samples each.
const LEVELS: usize = 64;

/// Grows a forest. The same samples and seed give the same forest, whatever the number of threads.
pub fn grow(samples: &Samples<'_>, growth: &Growth) -> Forest {
    let m = samples.count;
    let levels: Vec<Levels> = (0..samples.width).into_par_iter().map(|input| Levels::of(samples, input)).collect();
    let mut forest = Forest { inputs: samples.width, outcomes: m, ..Forest::default() };
    let mut rng = ChaCha8Rng::seed_from_u64(growth.seed);
    let mut inputs: Vec<usize> = (0..samples.width).collect();
    let tried = ((growth.inputs * samples.width as f64).ceil() as usize).clamp(1, samples.width);
    let mut log_odds = vec![0.0_f32; samples.outcomes.len() * m];
    let mut slopes = vec![0.0_f32; samples.outcomes.len() * 2 * m];
    for _ in 0..growth.trees {
        for n in 0..tried {
            inputs.swap(n, rng.random_range(n..samples.width));
        }
        let rows = log_odds.par_chunks_exact(m).zip(slopes.par_chunks_exact_mut(2 * m)).zip(samples.outcomes);
        rows.for_each(|((log_odds, slopes), outcome)| differentiate(log_odds, *outcome, slopes));
        let growing = Growing { levels: &levels, inputs: &inputs[..tried], slopes: &slopes, outcomes: m, growth };
        growing.tree(&mut forest);
        let root = forest.roots[forest.roots.len() - 1] as usize;
        let rows = log_odds.par_chunks_exact_mut(m).zip(samples.inputs.par_chunks_exact(samples.width));
        rows.for_each(|(log_odds, inputs)| {
            let leaf = &forest.scores[forest.leaf(root, inputs) * m..][..m];
            log_odds.iter_mut().zip(leaf).for_each(|(sum, score)| *sum += score.to_f32());
        });
    }
    forest
}

/// First derivatives of a sample's −log p(outcome) by the log odds of all outcomes, then the second ones.
fn differentiate(log_odds: &[f32], outcome: usize, slopes: &mut [f32]) {
    let (first, second) = slopes.split_at_mut(log_odds.len());
    let peak = log_odds.iter().copied().fold(f32::NEG_INFINITY, f32::max);
    first.iter_mut().zip(log_odds).for_each(|(p, v)| *p = (v - peak).exp());
    let total: f32 = first.iter().sum();
    for (p, h) in first.iter_mut().zip(second) {
        *p /= total;
        *h = *p * (1.0 - *p);
    }
    first[outcome] -= 1.0;
}

/// An input's values in steps: sample i has level `of[i]`, and lies above `bounds[l − 1]` and at or below `bounds[l]`; missing values are
/// above all bounds.
struct Levels {
    bounds: Vec<f32>,
    of: Vec<u8>,
}

impl Levels {
    fn of(samples: &Samples<'_>, input: usize) -> Self {
        let values: Vec<f32> = samples.inputs.chunks_exact(samples.width).map(|row| row[input]).collect();
        let mut sorted: Vec<f32> = values.iter().copied().filter(|v| v.is_finite()).collect();
        sorted.sort_unstable_by(f32::total_cmp);
        let mut distinct = sorted.clone();
        distinct.dedup();
        let mut bounds: Vec<f32> = if distinct.len() < LEVELS {
            distinct.windows(2).map(|pair| middle(pair[0], pair[1])).collect()
        } else {
            let quantile = |n: usize| {
                let at = n * (sorted.len() - 1) / LEVELS;
                middle(sorted[at], sorted[at + 1])
            };
            (1..LEVELS - 1).map(quantile).collect()
        };
        // What is missing is told from the largest value.
        bounds.extend(distinct.last().copied().filter(|_| sorted.len() < values.len()));
        bounds.dedup();
        bounds.truncate(LEVELS - 1);
        let of = values.iter().map(|v| if v.is_nan() { bounds.len() } else { bounds.partition_point(|b| b < v) } as u8).collect();
        Self { bounds, of }
    }
}

/// Halfway between, but never above `high`.
fn middle(low: f32, high: f32) -> f32 {
    let middle = low + (high - low) / 2.0;
    if middle < high { middle } else { low }
}

/// What one tree is grown from.
struct Growing<'a> {
    levels: &'a [Levels],
    /// The inputs that it may ask for.
    inputs: &'a [usize],
    /// First and second derivatives of each sample, by each outcome.
    slopes: &'a [f32],
    outcomes: usize,
    growth: &'a Growth,
}

/// The best split of a node.
#[derive(Clone, Copy)]
struct Split {
    input: usize,
    /// The last level that goes to the first child.
    level: usize,
    /// By how much twice the log likelihood rises, to second order.
    gain: f32,
}

/// A node that may still be split.
struct Open {
    node: usize,
    rows: Vec<u32>,
    /// For each input that is tried and each of its levels: sums of the derivatives, then the number of samples.
    sums: Vec<f32>,
    split: Option<Split>,
}

impl Growing<'_> {
    /// Adds a tree to a forest: of all leaves the one is split next where it gains most.
    fn tree(&self, forest: &mut Forest) {
        let root = push(forest);
        forest.roots.push(root as u32);
        let rows: Vec<u32> = (0..self.slopes.len() / (2 * self.outcomes)).map(|row| row as u32).collect();
        let sums = self.sums(&rows);
        let mut open = vec![self.open(root, rows, sums)];
        while open.len() < self.growth.leaves {
            let gains = open.iter().enumerate().filter_map(|(n, node)| Some((n, node.split?)));
            // Of equal ones the first.
            let Some((n, split)) = gains.max_by(|(a, x), (b, y)| x.gain.total_cmp(&y.gain).then(b.cmp(a))) else { break };
            let parent = open.swap_remove(n);
            let of = &self.levels[split.input].of;
            let (below, above): (Vec<u32>, Vec<u32>) = parent.rows.iter().partition(|row| usize::from(of[**row as usize]) <= split.level);
            let first = push(forest);
            push(forest);
            forest.asks[parent.node] = split.input as u8;
            forest.thresholds[parent.node] = self.levels[split.input].bounds[split.level];
            forest.next[parent.node] = first as u32;
            // The sums of the larger child are those of the parent less those of the smaller.
            let is_below_less = below.len() <= above.len();
            let less = self.sums(if is_below_less { &below } else { &above });
            let mut more = parent.sums;
            more.iter_mut().zip(&less).for_each(|(sum, less)| *sum -= less);
            let (of_below, of_above) = if is_below_less { (less, more) } else { (more, less) };
            open.push(self.open(first, below, of_below));
            open.push(self.open(first + 1, above, of_above));
        }
        for leaf in &open {
            forest.next[leaf.node] = (forest.scores.len() / self.outcomes) as u32;
            forest.scores.extend(self.step(&leaf.rows));
        }
    }

    fn open(&self, node: usize, rows: Vec<u32>, sums: Vec<f32>) -> Open {
        let split = if rows.len() >= 2 * self.growth.least_leaf { self.split(&sums) } else { None };
        Open { node, rows, sums, split }
    }

    /// The Newton step of a leaf's samples.
    fn step(&self, rows: &[u32]) -> Vec<f16> {
        let (m, Growth { rate, ridge, .. }) = (self.outcomes, self.growth);
        let sum = |of: usize| rows.iter().map(|row| self.slopes[*row as usize * 2 * m + of]).sum::<f32>();
        (0..m).map(|outcome| f16::from_f32(-rate * sum(outcome) / (sum(m + outcome) + ridge))).collect()
    }

    /// Values of an input's sums: for each level the sums of derivatives, then for each level the number of samples.
    fn width(&self) -> usize {
        LEVELS * (2 * self.outcomes + 1)
    }

    fn sums(&self, rows: &[u32]) -> Vec<f32> {
        let m = self.outcomes;
        let mut out = vec![0.0; self.inputs.len() * self.width()];
        out.par_chunks_exact_mut(self.width()).zip(self.inputs).for_each(|(out, input)| {
            let (sums, counts) = out.split_at_mut(LEVELS * 2 * m);
            let of = &self.levels[*input].of;
            for row in rows.iter().map(|row| *row as usize) {
                let level = usize::from(of[row]);
                let slopes = &self.slopes[row * 2 * m..][..2 * m];
                sums[level * 2 * m..][..2 * m].iter_mut().zip(slopes).for_each(|(sum, slope)| *sum += slope);
                counts[level] += 1.0;
            }
        });
        out
    }

    /// The split that gains most over all inputs; `None` if all leave a child too small or gain nothing.
    fn split(&self, sums: &[f32]) -> Option<Split> {
        let of_inputs: Vec<Option<Split>> =
            sums.par_chunks_exact(self.width()).zip(self.inputs).map(|(sums, input)| self.split_by(*input, sums)).collect();
        let better = |best: Option<Split>, found: Split| best.filter(|best| best.gain >= found.gain).or(Some(found));
        of_inputs.into_iter().flatten().fold(None, better).filter(|split| split.gain > 0.0)
    }

    fn split_by(&self, input: usize, sums: &[f32]) -> Option<Split> {
        let m = self.outcomes;
        let (sums, counts) = sums.split_at(LEVELS * 2 * m);
        let used = self.levels[input].bounds.len() + 1;
        let rises = |sums: &[f32]| -> f32 {
            let (first, second) = sums.split_at(m);
            first.iter().zip(second).map(|(g, h)| g * g / (h + self.growth.ridge)).sum()
        };
        let (mut below, mut above) = (vec![0.0; 2 * m], vec![0.0; 2 * m]);
        sums[..used * 2 * m].chunks_exact(2 * m).for_each(|level| above.iter_mut().zip(level).for_each(|(sum, v)| *sum += v));
        let (whole, least) = (rises(&above), self.growth.least_leaf as f32);
        let (mut first, mut second, mut best) = (0.0, counts[..used].iter().sum::<f32>(), None::<Split>);
        for level in 0..used - 1 {
            if counts[level] == 0.0 {
                continue;
            }
            let own = &sums[level * 2 * m..][..2 * m];
            below.iter_mut().zip(&mut above).zip(own).for_each(|((below, above), v)| (*below, *above) = (*below + v, *above - v));
            (first, second) = (first + counts[level], second - counts[level]);
            if first < least || second < least {
                continue;
            }
            let gain = rises(&below) + rises(&above) - whole;
            if best.is_none_or(|best| gain > best.gain) {
                best = Some(Split { input, level, gain });
            }
        }
        best
    }
}

/// Adds a leaf without scores yet.
fn push(forest: &mut Forest) -> usize {
    forest.asks.push(LEAF);
    forest.thresholds.push(0.0);
    forest.next.push(0);
    forest.asks.len() - 1
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Three outcomes on a plane: right of 0.3; else above −0.2, or below; a third input says nothing.
    fn plane(count: usize, seed: u64) -> (Vec<f32>, Vec<usize>) {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let rows: Vec<[f32; 3]> = (0..count).map(|_| std::array::from_fn(|_| rng.random_range(-1.0..1.0))).collect();
        let outcomes = rows.iter().map(|[x, y, _]| if *x > 0.3 { 0 } else { 1 + usize::from(*y > -0.2) }).collect();
        (rows.concat(), outcomes)
    }

    const GROWTH: Growth = Growth { trees: 40, rate: 0.3, leaves: 6, least_leaf: 2, ridge: 1.0, inputs: 0.7, seed: 7 };

    #[test]
    fn a_forest_finds_the_borders_between_outcomes() {
        let (inputs, outcomes) = plane(2000, 1);
        let forest = grow(&Samples { inputs: &inputs, width: 3, outcomes: &outcomes, count: 3 }, &GROWTH);
        assert_eq!(forest.fault(), None);
        let (inputs, outcomes) = plane(1000, 2);
        let mut shares = Vec::new();
        let right = inputs.chunks_exact(3).zip(&outcomes).filter(|(row, outcome)| {
            forest.shares(row, &mut shares);
            assert!((shares.iter().sum::<f64>() - 1.0).abs() < 1e-9);
            (0..3).all(|other| shares[other] <= shares[**outcome])
        });
        assert!(right.count() > 980);
    }

    #[test]
    fn forests_are_the_same_with_any_number_of_threads() {
        let (inputs, outcomes) = plane(300, 3);
        let samples = Samples { inputs: &inputs, width: 3, outcomes: &outcomes, count: 3 };
        let grown = |threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(|| grow(&samples, &GROWTH));
        assert_eq!(grown(1), grown(3));
    }

    /// One tree of two leaves, in closed form: all outcomes are as probable at first, so that g is 1/2 − y and h is 1/4.
    #[test]
    fn a_first_tree_is_a_newton_step_from_even_odds() {
        let inputs: Vec<f32> = (0..10).map(|n| n as f32).collect();
        let outcomes = [0, 0, 0, 1, 0, 1, 1, 1, 1, 1];
        let growth = Growth { trees: 1, leaves: 2, inputs: 1.0, ..GROWTH };
        let forest = grow(&Samples { inputs: &inputs, width: 1, outcomes: &outcomes, count: 2 }, &growth);
        // Of all borders the one after 4 is best: g sums to 5/2 − 4 = −3/2 of outcome 0 on its left and 5/2 on its right, h to 5/4 on either.
        let gain = |at: usize| -> f64 {
            let of = |part: &[usize]| {
                let (ones, n) = (part.iter().sum::<usize>() as f64, part.len() as f64);
                2.0 * (n / 2.0 - ones).powi(2) / (n / 4.0 + 1.0)
            };
            of(&outcomes[..at]) + of(&outcomes[at..])
        };
        let best = (2..=8).max_by(|a, b| gain(*a).total_cmp(&gain(*b))).unwrap();
        assert_eq!((best, forest.thresholds[0]), (5, 4.5));
        let expected = [0.3 * 1.5 / 2.25, -0.3 * 1.5 / 2.25, -0.3 * 2.5 / 2.25, 0.3 * 2.5 / 2.25].map(f16::from_f32);
        assert_eq!(forest.scores, expected);
    }

    /// Derivatives by finite differences of −log softmax.
    #[test]
    fn derivatives_are_those_of_the_log_likelihood() {
        let at = [0.3_f64, -1.2, 0.8];
        let loss = |v: [f64; 3]| (v.iter().map(|v| v.exp()).sum::<f64>()).ln() - v[1];
        let mut slopes = [0.0; 6];
        differentiate(&at.map(|v| v as f32), 1, &mut slopes);
        for k in 0..3 {
            let moved = |by: f64| {
                let mut v = at;
                v[k] += by;
                loss(v)
            };
            let (first, second) = ((moved(1e-4) - moved(-1e-4)) / 2e-4, (moved(1e-4) - 2.0 * loss(at) + moved(-1e-4)) / 1e-8);
            assert!((f64::from(slopes[k]) - first).abs() < 1e-6 && (f64::from(slopes[3 + k]) - second).abs() < 1e-6, "{k}: {slopes:?}");
        }
    }

    #[test]
    fn missing_inputs_are_a_value_of_their_own() {
        let inputs: Vec<f32> = (0..400).map(|n| if n % 2 == 0 { f32::NAN } else { n as f32 }).collect();
        let outcomes: Vec<usize> = (0..400).map(|n| n % 2).collect();
        let forest = grow(&Samples { inputs: &inputs, width: 1, outcomes: &outcomes, count: 2 }, &GROWTH);
        let mut shares = Vec::new();
        forest.shares(&[f32::NAN], &mut shares);
        assert!(shares[0] > 0.99);
        forest.shares(&[200.0], &mut shares);
        assert!(shares[1] > 0.99);
    }

    #[test]
    fn one_outcome_alone_is_all_that_is_expected() {
        let forest = grow(&Samples { inputs: &[1.0, 2.0, 3.0], width: 1, outcomes: &[1, 1, 1], count: 2 }, &GROWTH);
        assert_eq!(forest.fault(), None);
        let mut shares = Vec::new();
        forest.shares(&[2.0], &mut shares);
        assert!(shares[1] > 0.95, "{shares:?}");
    }
}
