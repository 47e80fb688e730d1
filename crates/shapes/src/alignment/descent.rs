//! Coordinate descent: every shape in turn is moved along each of its seven numbers, by steps that shrink, wherever that lowers the
//! entropy of the stack (Learned-Miller 2006, section 3, with three rotations, scale and translation for the affine coordinates).
//!
//! - All shapes propose at once, each against all the others as they are; then the proposals are taken one after the other, those that still
//!   lower the entropy. So the outcome does not depend on the number of threads.
//! - The entropy of a stack falls when all shapes shrink. As in the paper the mean of the logarithms of the scales and the mean place stay what
//!   they are: a shape that grows by a factor makes the others shrink by its share of it. What that does to the entropy is felt by
//!   scaling the whole stack a little (`scale_exponent`).
//! - A round after which the entropy, at the same mean scale and place, is not lower is undone. After a round that gains next to nothing all steps
//!   are halved.

use super::objective::Stack;
use super::settings::AlignmentSettings;
use super::solid::{Level, Solid};
use super::transform::{Pose, ShapeSimilarity, Steps};
use nalgebra::Vector3;
use rayon::prelude::*;

/// Rounds after which a level ends in any case.
const MOST_ROUNDS: usize = 60;
/// A round that lowers the entropy by a smaller share is followed by smaller steps.
const LEAST_GAIN: f64 = 2e-4;
/// Which of the seven numbers is the scale.
const SCALE: usize = 3;
/// Largest change of a shape's scale, as a factor either way: bulky shapes that shrink while thin ones grow would lower the entropy too.
const MOST_SCALE: f64 = 1.5;

/// The shapes of one class and what they are given by.
pub(super) struct Stage<'a> {
    pub solids: &'a [Solid],
    pub settings: &'a AlignmentSettings,
    /// Scale of each shape at a logarithm of zero.
    pub units: Vec<f64>,
}

/// The numbers of all shapes and the entropy of their stack at one level.
#[derive(Clone)]
pub(super) struct State {
    pub poses: Vec<Pose>,
    pub entropy: f64,
}

impl Stage<'_> {
    pub fn similarity(&self, shape: usize, pose: &Pose) -> ShapeSimilarity {
        pose.similarity(&self.solids[shape].centre, self.units[shape])
    }

    /// The stack; `None` if a shape leaves its canvas.
    pub fn stack(&self, level: Level, poses: &[Pose]) -> Option<Stack> {
        let placements: Vec<ShapeSimilarity> = poses.iter().enumerate().map(|(i, pose)| self.similarity(i, pose)).collect();
        Stack::of(level, self.settings.resolution, self.solids, &placements)
    }

    pub fn entropy(&self, level: Level, poses: &[Pose]) -> f64 {
        self.stack(level, poses).map_or(f64::INFINITY, |stack| stack.entropy())
    }

    /// Which of the seven numbers may change.
    fn numbers(&self) -> &'static [usize] {
        if self.settings.keep_up { &[2, 3, 4, 5, 6] } else { &[0, 1, 2, 3, 4, 5, 6] }
    }

    /// First steps of a level: rotations, scale, and places in cells of that level.
    pub fn first_steps(&self, level: Level) -> Steps {
        let cell = 1.0 / level.cells(self.settings.resolution) as f64;
        let (degrees, scale, cells) = match level {
            Level::Coarse => (12.0_f64, 0.10, 1.0),
            Level::Middle => (5.0, 0.05, 0.8),
            Level::Fine => (2.5, 0.03, 0.5),
        };
        let turn = degrees.to_radians();
        [turn, turn, turn, scale, cells * cell, cells * cell, cells * cell]
    }

    /// How often the steps of a level are halved.
    fn halvings(level: Level) -> i32 {
        if level == Level::Fine { 4 } else { 3 }
    }

    /// The power of a common scale that the entropy goes with, felt by scaling all shapes.
    pub fn scale_exponent(&self, level: Level, state: &State) -> Option<f64> {
        let step = 0.02;
        let scaled = |by: f64| {
            let grown = |pose: &Pose| Pose { log_scale: pose.log_scale + by, centre: pose.centre * by.exp(), ..*pose };
            self.entropy(level, &state.poses.iter().map(grown).collect::<Vec<_>>())
        };
        let exponent = (scaled(step).ln() - scaled(-step).ln()) / (2.0 * step);
        // Between a surface's and a volume's, also where a shape would leave the canvas.
        Some(if exponent.is_finite() { exponent.clamp(1.0, 3.5) } else { 2.5 })
    }

    /// Objective of one shape: the logarithm of the entropy of the stack with it, less what its scale takes from the others. Infinite where it
    /// may not be. Without an exponent the scale is not to be changed.
    pub fn cost(&self, stack: &Stack, rest: f64, shape: usize, pose: &Pose, exponent: Option<f64>) -> f64 {
        if pose.log_scale.abs() > MOST_SCALE.ln() {
            return f64::INFINITY;
        }
        let entropy = rest + stack.rise(&self.solids[shape], &self.similarity(shape, pose));
        entropy.max(f64::MIN_POSITIVE).ln() - exponent.unwrap_or(0.0) / stack.shapes() as f64 * pose.log_scale
    }

    /// One sweep over the numbers of a shape that has been taken out of the stack, whose entropy is `rest`. Steps that lead nowhere are
    /// halved, those that lead on are kept.
    fn sweep(&self, stack: &Stack, rest: f64, shape: usize, mut pose: Pose, steps: &mut Steps, exponent: Option<f64>) -> (Pose, f64) {
        let mut best = self.cost(stack, rest, shape, &pose, exponent);
        for &number in self.numbers().iter().filter(|number| **number != SCALE || exponent.is_some()) {
            let mut is_better = false;
            for step in [steps[number], -steps[number]] {
                let mut moved = pose.moved(number, step);
                let mut cost = self.cost(stack, rest, shape, &moved, exponent);
                while cost < best {
                    (pose, best, is_better) = (moved, cost, true);
                    moved = pose.moved(number, step);
                    cost = self.cost(stack, rest, shape, &moved, exponent);
                }
                if is_better {
                    break;
                }
            }
            if !is_better {
                steps[number] *= 0.5;
            }
        }
        (pose, best)
    }

    /// The best place of one shape in the stack without it, from a start, and its cost.
    pub fn settle(&self, stack: &Stack, rest: f64, shape: usize, start: Pose, exponent: Option<f64>, sweeps: usize) -> (Pose, f64) {
        let mut steps = self.first_steps(stack.level);
        let mut found = (start, f64::INFINITY);
        for _ in 0..sweeps {
            found = self.sweep(stack, rest, shape, found.0, &mut steps, exponent);
        }
        found
    }

    /// For every shape, in parallel, what `propose` wants instead: it gets the stack without the shape, the entropy of that, and the cost of the
    /// shape as it is.
    pub fn propose<T: Send>(
        &self,
        level: Level,
        state: &State,
        exponent: Option<f64>,
        propose: impl Fn(usize, &Stack, f64, f64) -> T + Sync,
    ) -> Vec<T> {
        let Some(stack) = self.stack(level, &state.poses) else { return Vec::new() };
        let one = |stack: &mut Stack, shape: usize| {
            let (solid, placement) = (&self.solids[shape], self.similarity(shape, &state.poses[shape]));
            stack.remove(solid, &placement);
            let rest = state.entropy - stack.rise(solid, &placement);
            let now = self.cost(stack, rest, shape, &state.poses[shape], exponent);
            let proposed = propose(shape, stack, rest, now);
            stack.add(solid, &placement);
            proposed
        };
        (0..self.solids.len()).into_par_iter().map_init(|| stack.clone(), one).collect()
    }

    /// Takes proposals one after the other, those that lower the cost as the stack then is, and returns how many.
    pub fn take(
        &self,
        level: Level,
        state: &mut State,
        exponent: Option<f64>,
        proposals: impl IntoIterator<Item = (usize, Pose)>,
    ) -> usize {
        let Some(mut stack) = self.stack(level, &state.poses) else { return 0 };
        let mut taken = 0;
        for (shape, proposed) in proposals {
            let (solid, old) = (&self.solids[shape], self.similarity(shape, &state.poses[shape]));
            stack.remove(solid, &old);
            let own = stack.rise(solid, &old);
            let rest = state.entropy - own;
            let now = self.cost(&stack, rest, shape, &state.poses[shape], exponent);
            if self.cost(&stack, rest, shape, &proposed, exponent) < now {
                state.entropy = rest + stack.rise(solid, &self.similarity(shape, &proposed));
                state.poses[shape] = proposed;
                taken += 1;
            }
            stack.add(solid, &self.similarity(shape, &state.poses[shape]));
        }
        taken
    }

    /// The same relative poses with the mean of the logarithms of the scales and the mean place at zero.
    pub fn centred(&self, poses: &[Pose]) -> Vec<Pose> {
        let count = poses.len() as f64;
        let log_scale = poses.iter().map(|p| p.log_scale).sum::<f64>() / count;
        let centre = poses.iter().map(|p| p.centre).sum::<Vector3<f64>>() / count;
        let back = (-log_scale).exp();
        poses.iter().map(|p| Pose { log_scale: p.log_scale - log_scale, centre: (p.centre - centre) * back, ..*p }).collect()
    }

    /// A state at a level; its entropy is infinite where a scale is out of bounds, or a shape leaves the canvas.
    pub fn state(&self, level: Level, poses: &[Pose]) -> State {
        let poses = self.centred(poses);
        // Also after the others' scales have been made up for.
        let is_bounded = poses.iter().all(|pose| pose.log_scale.abs() <= MOST_SCALE.ln() + 1e-9);
        State { entropy: if is_bounded { self.entropy(level, &poses) } else { f64::INFINITY }, poses }
    }

    /// Descends at one level until nothing is gained any more. `history` gets the entropy after every round.
    pub fn descend(&self, level: Level, state: &mut State, history: &mut Vec<f64>) {
        let first = self.first_steps(level);
        let least = 0.5_f64.powi(Self::halvings(level));
        let mut steps = vec![first; self.solids.len()];
        history.push(state.entropy);
        for _ in 0..MOST_ROUNDS {
            let exponent = self.scale_exponent(level, state);
            let before = steps.clone();
            let proposals = self.propose(level, state, exponent, |shape, stack, rest, _| {
                let mut steps = before[shape];
                let (pose, _) = self.sweep(stack, rest, shape, state.poses[shape], &mut steps, exponent);
                (pose, steps)
            });
            steps = proposals.iter().map(|(_, steps)| *steps).collect();
            let mut next = state.clone();
            self.take(level, &mut next, exponent, proposals.iter().map(|(pose, _)| *pose).enumerate());
            let next = self.state(level, &next.poses);
            let gain = 1.0 - next.entropy / state.entropy;
            if gain > 0.0 {
                *state = next;
                history.push(state.entropy);
            }
            if gain < LEAST_GAIN {
                steps.iter_mut().flatten().for_each(|step| *step *= 0.5);
            }
            if steps.iter().all(|s| self.numbers().iter().all(|n| s[*n] < least * first[*n])) {
                break;
            }
        }
    }
}
