//! The classic failure of congealing: a shape that lies the wrong way round stays there, since every small step leads up. So after the descent
//! every shape tries all other ways round, each settled for some sweeps, and takes what lowers the entropy, unless it then agrees less
//! with those that are most like it; then all descend again.

use super::descent::{Stage, State};
use super::solid::Level;
use super::start::ways;
use super::transform::Pose;

/// Ways that are settled for each shape: the best of all as they are.
const SETTLED: usize = 6;
/// Sweeps that a way is given to settle.
const SWEEPS: usize = 8;
/// How often all ways are tried at one level.
const MOST_ROUNDS: usize = 6;
/// Least fall of the logarithm of the entropy that is worth a new way.
const LEAST_FALL: f64 = 3e-4;

impl Stage<'_> {
    /// Descends at a level, trying all ways round until no shape wants another one. Returns how many took one.
    pub fn descend_with_flips(&self, level: Level, state: &mut State, neighbours: &[Vec<usize>], history: &mut Vec<f64>) -> usize {
        self.descend(level, state, history);
        let ways = ways(self.settings.keep_up);
        let mut flipped = 0;
        for _ in 0..MOST_ROUNDS {
            let exponent = self.scale_exponent(level, state);
            let proposals = self.propose(level, state, exponent, |shape, stack, rest, now| {
                let start = state.poses[shape];
                let mut others: Vec<(Pose, f64)> = ways[1..]
                    .iter()
                    .map(|way| {
                        let pose = start.turned(way);
                        (pose, self.cost(stack, rest, shape, &pose, exponent))
                    })
                    .collect();
                others.sort_by(|a, b| a.1.total_cmp(&b.1));
                let settled = others.iter().take(SETTLED).map(|(pose, _)| self.settle(stack, rest, shape, *pose, exponent, SWEEPS));
                let best = settled.min_by(|a, b| a.1.total_cmp(&b.1));
                let disagreement = |pose: &Pose| self.disagreement(level, &state.poses, &neighbours[shape], shape, pose);
                best.filter(|(pose, cost)| *cost < now - LEAST_FALL && disagreement(pose) <= disagreement(&start))
                    .map(|(pose, cost)| (shape, pose, now - cost))
            });
            let mut proposals: Vec<(usize, Pose, f64)> = proposals.into_iter().flatten().collect();
            // Those first that gain most: the others may then not want to any more.
            proposals.sort_by(|a, b| b.2.total_cmp(&a.2).then(a.0.cmp(&b.0)));
            let mut next = state.clone();
            let taken = self.take(level, &mut next, exponent, proposals.into_iter().map(|(shape, pose, _)| (shape, pose)));
            if taken == 0 {
                break;
            }
            let mut next = self.state(level, &next.poses);
            let mut tried = Vec::new();
            self.descend(level, &mut next, &mut tried);
            if next.entropy >= state.entropy {
                break;
            }
            tracing::debug!(?level, taken, from = state.entropy, to = next.entropy, "other ways round");
            *state = next;
            history.push(state.entropy);
            flipped += taken;
        }
        flipped
    }
}
