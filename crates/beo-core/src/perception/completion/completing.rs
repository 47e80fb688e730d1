//! Completion of an observation whose class and pose were found, by every method, in the frame that was asked for.

use super::voxels::{self, Complete, Part, Unknown};
use crate::grid::{ALONE, Observation, Similarity, Turn};
use crate::lanes::{dispatch, dot};
use crate::perception::basis::columns::BlockScratch;
use crate::perception::basis::known::Known;
use crate::perception::basis::reading::BasisRows;
use crate::perception::evidence::placed::ObjectFrame;
use crate::perception::known_pose::ClassPosteriors;
use crate::perception::pool::Pool;
use crate::perception::prepared::Prepared;
use crate::perception::query::CompletionFrame;
use crate::perception::{Method, PerceiveError, Percept, PoseSearch, Query};
use rayon::prelude::*;
use std::ops::Range;

/// Classes below this posterior take no part in a completion …
pub const LEAST_SHARE: f64 = 0.05;
/// … and no more than this many do.
pub const MOST_PARTS: usize = 3;

/// Layers of constant x that one task completes.
const SLAB: usize = 4;

/// Least deviation of a voxel that was not observed: in turning, its value may come from an observed neighbour.
const UNSEEN_DEVIATION: f32 = 0.01;

/// Scratch memory of this stage.
#[derive(Default)]
pub struct CompletionScratch {
    /// Classes that take part, and their shares.
    shares: Vec<(usize, f64)>,
    moved: TurnScratch,
    blocks: Pool<BlockScratch>,
}

/// Completes what was classified.
pub(in crate::perception) struct Completion<'a> {
    pub prepared: &'a Prepared,
    pub query: &'a Query,
    /// The observation as it came.
    pub seen: &'a Observation,
    /// The same in the frame of the object that was decided for.
    pub frame: &'a mut ObjectFrame,
    /// Classes that were conditioned on it before.
    pub posteriors: &'a mut ClassPosteriors,
    /// o'_q of the paper's method.
    pub projected: &'a [f32],
    pub scratch: &'a mut CompletionScratch,
}

impl Completion<'_> {
    /// Writes probability and deviation of every voxel.
    pub fn write<V: OutputValue>(mut self, percept: &mut Percept, occupancy: &mut [V], deviation: &mut [V]) -> Result<(), PerceiveError> {
        assert_eq!([occupancy.len(), deviation.len()], [self.prepared.model.dims().voxels(); 2], "one value per voxel");
        let moved = self.query.pose != PoseSearch::Known || percept.placed != Similarity::default();
        if !moved || self.query.frame == CompletionFrame::Object {
            return self.write_in_object_frame(percept, occupancy, deviation);
        }
        let [mut p, mut sd] = std::mem::take(V::scratch(&mut self.scratch.moved));
        p.resize(occupancy.len(), V::default());
        sd.resize(deviation.len(), V::default());
        let outcome = self.write_in_object_frame(percept, &mut p, &mut sd);
        turn_into_grid(self.seen, self.frame.way_back(&percept.placed), [&p, &sd], occupancy, deviation);
        *V::scratch(&mut self.scratch.moved) = [p, sd];
        outcome
    }

    /// In the frame in which the observation was completed: as it came, or the object's where that was found.
    fn write_in_object_frame<V: OutputValue>(
        &mut self,
        percept: &mut Percept,
        occupancy: &mut [V],
        deviation: &mut [V],
    ) -> Result<(), PerceiveError> {
        let known = self.frame.known();
        match self.query.method {
            Method::Paper => {
                let basis = &self.prepared.model.basis;
                let mut row = vec![0.0; basis.rank()];
                complete_plainly(known, occupancy, deviation, |voxel| {
                    basis.widen(voxel..voxel + 1, &mut row);
                    dot(&row, self.projected)
                });
            }
            Method::Mean => {
                let class = &self.prepared.evidence.subspaces[percept.class];
                complete_plainly(known, occupancy, deviation, |voxel| class.mean(voxel));
            }
            Method::Auto | Method::Hull | Method::Evidence => self.write_by_evidence(percept, occupancy, deviation)?,
        }
        Ok(())
    }

    fn write_by_evidence<V: OutputValue>(
        &mut self,
        percept: &mut Percept,
        occupancy: &mut [V],
        deviation: &mut [V],
    ) -> Result<(), PerceiveError> {
        let CompletionScratch { shares, blocks, .. } = &mut *self.scratch;
        shares.clear();
        shares.extend(percept.posterior.iter().copied().enumerate());
        shares.sort_unstable_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
        if percept.informed {
            let likely = shares.iter().filter(|(_, p)| *p > LEAST_SHARE).count().clamp(1, MOST_PARTS);
            shares.truncate(likely);
        }
        let total: f64 = shares.iter().map(|(_, p)| p).sum();
        let (evidence, known) = (&self.prepared.evidence, self.frame.known());
        let posteriors = &mut *self.posteriors;
        for &(s, _) in shares.iter() {
            let (class, conditional) = (&evidence.subspaces[s], &mut posteriors.conditionals[s]);
            if !posteriors.computed[s] {
                class.condition(known, evidence.noise_variance, conditional)?;
                posteriors.computed[s] = true;
                percept.log_evidence[s] = conditional.log_evidence;
            }
            class.prepare(conditional);
        }
        percept.fit = percept.fit.or_else(|| posteriors.share_explained(evidence, percept.class, known));
        let weights = voxels::weights(&self.prepared.model.metadata.calibration.completion);
        let dims = self.prepared.model.dims();
        let part = |&(s, p): &(usize, f64)| Part {
            weight: (p / total) as f32,
            class: &evidence.subspaces[s],
            posterior: &posteriors.conditionals[s].posterior,
        };
        let complete = |voxels: Range<usize>, occupancy: &mut [V], deviation: &mut [V]| {
            // A slab stays in the cache until it is complete: memory is written once.
            write_known(known, voxels.start, occupancy, deviation);
            let runs = &known.unknown;
            let within = runs.partition_point(|run| run.0 < voxels.start)..runs.partition_point(|run| run.0 < voxels.end);
            blocks.with(BlockScratch::default, |scratch| {
                let unknown = Unknown { height: dims.z(), runs: &runs[within], parts: shares.iter().map(part), scratch };
                dispatch(Complete { unknown, weights, first: voxels.start, occupancy, deviation });
            });
        };
        if dims.voxels() <= ALONE {
            complete(0..dims.voxels(), occupancy, deviation);
            return Ok(());
        }
        // One slab of columns per task: which thread takes it does not change the result.
        let slab = dims.y() * dims.z() * SLAB;
        let slabs = occupancy.par_chunks_mut(slab).zip(deviation.par_chunks_mut(slab));
        slabs.enumerate().try_for_each(|(i, (occupancy, deviation))| {
            let voxels = i * slab..i * slab + occupancy.len();
            if let BasisRows::InPlace(rows) = &evidence.rows {
                rows.touch_unknown(known, voxels.start / dims.z()..voxels.end / dims.z())?;
            }
            complete(voxels, occupancy, deviation);
            Ok(())
        })
    }
}

/// Memory for completions that are computed in another frame than the one that was asked for.
#[derive(Default)]
pub struct TurnScratch {
    floats: [Vec<f32>; 2],
    bytes: [Vec<u8>; 2],
}

/// How a completion is written.
pub trait OutputValue: voxels::Value {
    /// Memory for two grids of it.
    fn scratch(moved: &mut TurnScratch) -> &mut [Vec<Self>; 2];
}

impl OutputValue for f32 {
    fn scratch(moved: &mut TurnScratch) -> &mut [Vec<Self>; 2] {
        &mut moved.floats
    }
}

impl OutputValue for u8 {
    fn scratch(moved: &mut TurnScratch) -> &mut [Vec<Self>; 2] {
        &mut moved.bytes
    }
}

/// Writes what was observed of the voxels from `first` on, and that it is certain.
fn write_known<V: OutputValue>(known: &Known, first: usize, occupancy: &mut [V], deviation: &mut [V]) {
    occupancy.fill(V::default());
    deviation.fill(V::default());
    let within = known.filled.partition_point(|v| *v < first)..known.filled.partition_point(|v| *v < first + occupancy.len());
    known.filled[within].iter().for_each(|voxel| occupancy[voxel - first] = V::ONE);
}

/// Turns a completion from the object's frame into the observation's grid. What was observed there stays as observed.
fn turn_into_grid<V: OutputValue>(seen: &Observation, turn: &Turn, [p, sd]: [&[V]; 2], occupancy: &mut [V], deviation: &mut [V]) {
    turn.values(p, V::default(), occupancy);
    turn.values(sd, V::default(), deviation);
    let (known, filled, least) = (seen.known(), seen.filled(), V::from_unit(UNSEEN_DEVIATION));
    for (voxel, (p, deviation)) in occupancy.iter_mut().zip(deviation).enumerate() {
        if known.contains(voxel) {
            (*p, *deviation) = (if filled.contains(voxel) { V::ONE } else { V::default() }, V::default());
        } else if *deviation < least {
            *deviation = least;
        }
    }
}

/// Completion without a model of uncertainty: the value clamped to \[0, 1\], and the deviation of a coin with that bias.
fn complete_plainly<V: OutputValue>(known: &Known, occupancy: &mut [V], deviation: &mut [V], mut value: impl FnMut(usize) -> f32) {
    write_known(known, 0, occupancy, deviation);
    for voxel in known.unknown.iter().flat_map(|(start, end)| *start..*end) {
        let p = value(voxel).clamp(0.0, 1.0);
        occupancy[voxel] = V::from_unit(p);
        deviation[voxel] = V::from_unit((p * (1.0 - p)).sqrt());
    }
}
