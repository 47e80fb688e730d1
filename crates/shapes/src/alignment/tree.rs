//! Which way round every shape is meant, told by its neighbours: shapes of one kind differ continuously (a plier opens), and two that
//! differ little tell reliably how they lie to each other where two that differ much do not. The entropy of the whole stack does not know
//! that: it gladly lays the jaws of a closed plier over a handle of a wide open one. So pairs are aligned first, and every shape is laid to
//! the one beside it in the minimum spanning tree of what tells the pairs apart. The descent starts there.

use super::descent::{Stage, State};
use super::objective::Stack;
use super::solid::Level;
use super::start::ways;
use super::transform::Pose;
use beo_core::grid::{Rotation, yaw};
use rand::SeedableRng;
use rand::seq::SliceRandom;
use rayon::prelude::*;

/// Ways round that are settled for each pair: the best of all as they are.
const SETTLED: usize = 8;
/// Sweeps that a way is given to settle.
const SWEEPS: usize = 8;
/// Shapes that the tree is made of, chosen by the seed where there are more. A further one is laid to one of these, among the few that are
/// most like it before they are settled.
const MOST_INNER: usize = 24;
const MOST_LIKE: usize = 3;

/// Shapes that are alone in a stack: their entropy, which is that of their blurred surface, and their filled cells.
struct Alone {
    entropy: f64,
    volume: f64,
}

/// A start, and for each shape those beside it in the tree.
pub(super) struct Tree {
    pub state: State,
    pub neighbours: Vec<Vec<usize>>,
}

impl Stage<'_> {
    /// Lays all shapes along the tree.
    pub fn along_tree(&self, normalised: &[Pose]) -> Tree {
        let level = Level::Coarse;
        let count = self.solids.len();
        let mut order: Vec<usize> = (0..count).collect();
        if count > MOST_INNER {
            order.shuffle(&mut rand_chacha::ChaCha8Rng::seed_from_u64(self.settings.seed));
        }
        let (inner, outer) = order.split_at(count.min(MOST_INNER));
        let alone: Vec<Alone> = (0..count).into_par_iter().map(|shape| self.alone(level, shape, &normalised[shape])).collect();
        let ways = self.fine_ways();
        let apart = |to: usize, shape: usize| self.apart(normalised, &alone, &ways, to, shape);

        let pairs: Vec<(usize, usize)> = (0..inner.len()).flat_map(|b| (0..b).map(move |a| (a, b))).collect();
        let of_pairs: Vec<f64> = pairs.par_iter().map(|(a, b)| apart(inner[*a], inner[*b])).collect();
        let apart_of = |a: usize, b: usize| of_pairs[a.max(b) * (a.max(b) - 1) / 2 + a.min(b)];

        // Prim: what is least apart from any shape in the tree comes next. Edges: to which shape, and which.
        let mut edges: Vec<(usize, usize)> = Vec::new();
        let (mut placed, mut open) = (vec![0], (1..inner.len()).collect::<Vec<_>>());
        while !open.is_empty() {
            let candidates = open.iter().flat_map(|next| placed.iter().map(move |to| (*to, *next)));
            let Some((to, next)) = candidates.min_by(|x, y| apart_of(x.0, x.1).total_cmp(&apart_of(y.0, y.1))) else { break };
            edges.push((inner[to], inner[next]));
            placed.push(next);
            open.retain(|n| *n != next);
        }
        let join = |shape: &usize| {
            let mut like: Vec<(usize, f64)> = inner
                .iter()
                .map(|to| {
                    let stack = self.pair_stack(level, *to, &normalised[*to]);
                    let rises = ways.iter().map(|way| self.rise(&stack, *shape, &normalised[*shape].turned(way)));
                    let best = rises.fold(f64::INFINITY, f64::min);
                    (*to, (best + alone[*to].entropy) / (alone[*to].volume + alone[*shape].volume))
                })
                .collect();
            like.sort_by(|a, b| a.1.total_cmp(&b.1));
            let settled = like.iter().take(MOST_LIKE).map(|(to, _)| (*to, apart(*to, *shape)));
            settled.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(to, _)| (to, *shape))
        };
        edges.extend(outer.par_iter().filter_map(join).collect::<Vec<_>>());

        let laid: Vec<Pose> = edges.par_iter().map(|(to, shape)| self.laid(normalised, &ways, *to, *shape)).collect();
        let mut poses = normalised.to_vec();
        let mut neighbours = vec![Vec::new(); count];
        for ((to, shape), laid) in edges.into_iter().zip(laid) {
            poses[shape] = poses[to].carrying(&laid.seen_from(&normalised[to]));
            neighbours[shape].push(to);
            neighbours[to].push(shape);
        }
        Tree { state: self.state(level, &poses), neighbours }
    }

    /// The ways round, and halfway between them: principal axes are uncertain where two are nearly as long.
    fn fine_ways(&self) -> Vec<Rotation> {
        let ways = ways(self.settings.keep_up);
        let between = if self.settings.keep_up { 0.0 } else { std::f64::consts::FRAC_PI_4 };
        let halfway: Vec<Rotation> = ways.iter().map(|way| yaw(between) * way).collect();
        if self.settings.keep_up { ways } else { [ways, halfway].concat() }
    }

    fn alone(&self, level: Level, shape: usize, pose: &Pose) -> Alone {
        let mut stack = Stack::new(level, self.settings.resolution, 1);
        stack.add(&self.solids[shape], &self.similarity(shape, pose));
        Alone { entropy: stack.entropy(), volume: stack.volume() }
    }

    /// A stack for two with one of them.
    fn pair_stack(&self, level: Level, shape: usize, pose: &Pose) -> Stack {
        let mut stack = Stack::new(level, self.settings.resolution, 2);
        stack.add(&self.solids[shape], &self.similarity(shape, pose));
        stack
    }

    fn rise(&self, stack: &Stack, shape: usize, pose: &Pose) -> f64 {
        stack.rise(&self.solids[shape], &self.similarity(shape, pose))
    }

    /// How a shape may lie to another one that lies as it was normalised, settled from some starts, the best first, each with its cost. Sizes are not
    /// changed: of two shapes the one that is moved would always shrink.
    fn settled(&self, level: Level, normalised: &[Pose], to: usize, shape: usize, starts: impl Iterator<Item = Pose>) -> Vec<(Pose, f64)> {
        let stack = self.pair_stack(level, to, &normalised[to]);
        let rest = stack.entropy();
        let mut poses: Vec<(Pose, f64)> = starts.map(|pose| (pose, self.cost(&stack, rest, shape, &pose, None))).collect();
        poses.sort_by(|a, b| a.1.total_cmp(&b.1));
        poses.truncate(SETTLED);
        poses.iter_mut().for_each(|pose| *pose = self.settle(&stack, rest, shape, pose.0, None, SWEEPS));
        poses.sort_by(|a, b| a.1.total_cmp(&b.1));
        poses
    }

    /// How much more entropy there is in two shapes laid to each other than if both were the same, in bits per filled cell.
    fn apart(&self, normalised: &[Pose], alone: &[Alone], ways: &[Rotation], to: usize, shape: usize) -> f64 {
        let starts = ways.iter().map(|way| normalised[shape].turned(way));
        let Some((_, cost)) = self.settled(Level::Coarse, normalised, to, shape, starts).first().copied() else { return f64::INFINITY };
        let (a, b) = (&alone[to], &alone[shape]);
        (cost.exp() - 0.5 * (a.entropy + b.entropy)) / (a.volume + b.volume)
    }

    /// How a shape lies best to another one that lies as it was normalised. What tells one way from another may be too small for the coarse
    /// level.
    fn laid(&self, normalised: &[Pose], ways: &[Rotation], to: usize, shape: usize) -> Pose {
        let starts = ways.iter().map(|way| normalised[shape].turned(way));
        let coarse = self.settled(Level::Coarse, normalised, to, shape, starts);
        let finer = self.settled(Level::Middle, normalised, to, shape, coarse.into_iter().map(|(pose, _)| pose));
        finer.first().map_or(normalised[shape], |(pose, _)| *pose)
    }

    /// How badly a shape agrees with some others, each on its own: bits of the pairs.
    pub fn disagreement(&self, level: Level, poses: &[Pose], others: &[usize], shape: usize, pose: &Pose) -> f64 {
        others.iter().map(|other| self.rise(&self.pair_stack(level, *other, &poses[*other]), shape, pose)).sum()
    }
}
