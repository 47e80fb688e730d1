//! Learns forests of decision trees (Breiman, "Random forests", Machine Learning 45, 2001): each tree from a bootstrap sample, each node
//! split where Gini's impurity falls most among the square root of the inputs, drawn anew.

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
    /// Fewest samples of a leaf.
    pub least_leaf: usize,
    /// Seed.
    pub seed: u64,
}

/// Values of an input are sorted into at most so many classes of about as many samples each.
const LEVELS: usize = 255;

/// Grows a forest. The same samples and seed give the same forest, whatever the number of threads.
pub fn grow(samples: &Samples<'_>, growth: &Growth) -> Forest {
    let levels: Vec<Levels> = (0..samples.width).into_par_iter().map(|input| Levels::of(samples, input)).collect();
    let trees: Vec<Tree> = (0..growth.trees).into_par_iter().map(|n| Tree::grow(samples, &levels, growth, n as u64)).collect();
    let mut forest = Forest { inputs: samples.width, outcomes: samples.count, ..Forest::default() };
    for tree in trees {
        let (nodes, leaves) = (forest.asks.len() as u32, (forest.shares.len() / samples.count) as u32);
        forest.roots.push(nodes);
        forest.next.extend(tree.asks.iter().zip(&tree.next).map(|(ask, next)| next + if *ask == LEAF { leaves } else { nodes }));
        forest.asks.extend(tree.asks);
        forest.thresholds.extend(tree.thresholds);
        forest.shares.extend(tree.shares);
    }
    forest
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

#[derive(Default)]
struct Tree {
    asks: Vec<u8>,
    thresholds: Vec<f32>,
    next: Vec<u32>,
    shares: Vec<f16>,
}

/// The best split of a node.
struct Split {
    input: usize,
    /// The last level that goes to the first child.
    level: usize,
    /// Sum over the children of Σ n_c² / n: the larger, the purer.
    purity: f64,
}

impl Tree {
    fn grow(samples: &Samples<'_>, levels: &[Levels], growth: &Growth, n: u64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(growth.seed);
        rng.set_stream(n);
        let count = samples.outcomes.len();
        let mut rows: Vec<u32> = (0..count).map(|_| rng.random_range(0..count.max(1)) as u32).collect();
        let mut tree = Self::default();
        // A node and its rows; children are appended together, so that one follows the other.
        let mut open = vec![(tree.push(), 0..rows.len())];
        let tried = (samples.width as f64).sqrt().ceil() as usize;
        let mut inputs: Vec<usize> = (0..samples.width).collect();
        let mut counts = vec![0u32; (LEVELS + 1) * samples.count];
        while let Some((node, range)) = open.pop() {
            let own = &mut rows[range.clone()];
            let mut totals = vec![0u32; samples.count];
            own.iter().for_each(|row| totals[samples.outcomes[*row as usize]] += 1);
            let is_pure = totals.iter().filter(|n| **n > 0).count() <= 1;
            let mut best: Option<Split> = None;
            if !is_pure && own.len() >= 2 * growth.least_leaf {
                for k in 0..tried.min(samples.width) {
                    inputs.swap(k, rng.random_range(k..samples.width));
                    let found = split(samples, &levels[inputs[k]], inputs[k], own, &totals, growth.least_leaf, &mut counts);
                    best = match (best, found) {
                        (Some(best), Some(found)) if best.purity >= found.purity => Some(best),
                        (best, found) => found.or(best),
                    };
                }
            }
            let Some(split) = best else {
                let total = own.len().max(1) as f32;
                tree.next[node] = (tree.shares.len() / samples.count) as u32;
                tree.shares.extend(totals.iter().map(|n| f16::from_f32(*n as f32 / total)));
                continue;
            };
            let of = &levels[split.input].of;
            let middle = partition(own, |row| usize::from(of[row as usize]) <= split.level);
            let first = tree.push();
            tree.push();
            tree.asks[node] = split.input as u8;
            tree.thresholds[node] = levels[split.input].bounds[split.level];
            tree.next[node] = first as u32;
            open.push((first + 1, range.start + middle..range.end));
            open.push((first, range.start..range.start + middle));
        }
        tree
    }

    /// A leaf without rows yet.
    fn push(&mut self) -> usize {
        self.asks.push(LEAF);
        self.thresholds.push(0.0);
        self.next.push(0);
        self.asks.len() - 1
    }
}

/// The purest split by one input; `None` if all of its splits leave a child too small.
fn split(
    samples: &Samples<'_>,
    levels: &Levels,
    input: usize,
    rows: &[u32],
    totals: &[u32],
    least_leaf: usize,
    counts: &mut [u32],
) -> Option<Split> {
    let (m, used) = (samples.count, levels.bounds.len() + 1);
    let counts = &mut counts[..used * m];
    counts.fill(0);
    rows.iter().for_each(|row| counts[usize::from(levels.of[*row as usize]) * m + samples.outcomes[*row as usize]] += 1);
    let (mut below, mut best) = (vec![0u32; m], None::<Split>);
    for level in 0..used - 1 {
        let own = &counts[level * m..][..m];
        if own.iter().all(|n| *n == 0) {
            continue;
        }
        below.iter_mut().zip(own).for_each(|(sum, n)| *sum += n);
        let first: u32 = below.iter().sum();
        let second = rows.len() as u32 - first;
        if (first as usize) < least_leaf || (second as usize) < least_leaf {
            continue;
        }
        let squares = |of: &mut dyn Iterator<Item = u32>| of.map(|n| f64::from(n).powi(2)).sum::<f64>();
        let purity = squares(&mut below.iter().copied()) / f64::from(first)
            + squares(&mut totals.iter().zip(&below).map(|(all, n)| all - n)) / f64::from(second);
        if best.as_ref().is_none_or(|best| purity > best.purity) {
            best = Some(Split { input, level, purity });
        }
    }
    best
}

/// Moves the rows that are first to the front, in their order, and says how many they are.
fn partition(rows: &mut [u32], is_first: impl Fn(u32) -> bool) -> usize {
    let (first, second): (Vec<u32>, Vec<u32>) = rows.iter().partition(|row| is_first(**row));
    rows[..first.len()].copy_from_slice(&first);
    rows[first.len()..].copy_from_slice(&second);
    first.len()
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

    const GROWTH: Growth = Growth { trees: 30, least_leaf: 2, seed: 7 };

    #[test]
    fn a_forest_finds_the_borders_between_outcomes() {
        let (inputs, outcomes) = plane(2000, 1);
        let forest = grow(&Samples { inputs: &inputs, width: 3, outcomes: &outcomes, count: 3 }, &GROWTH);
        assert_eq!(forest.fault(), None);
        let (inputs, outcomes) = plane(1000, 2);
        let mut shares = Vec::new();
        let right = inputs.chunks_exact(3).zip(&outcomes).filter(|(row, outcome)| {
            forest.shares(row, &mut shares);
            assert!((shares.iter().sum::<f64>() - 1.0).abs() < 1e-2);
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
    fn one_outcome_alone_is_a_leaf() {
        let forest = grow(&Samples { inputs: &[1.0, 2.0, 3.0], width: 1, outcomes: &[1, 1, 1], count: 2 }, &GROWTH);
        assert!(forest.asks.iter().all(|ask| *ask == LEAF));
    }
}
