//! Completion of the observation that was last classified, by every method, in the frame that was asked for.

use super::completion::{self, Complete, Part, Unknown};
use super::density;
use super::lanes::dispatch;
use super::perceiver::{ALONE, PerceiveError, Perceiver, Workspace};
use super::percept::Frame;
use super::{Method, Percept, PoseSearch, Query};
use crate::grid::Placed;
use rayon::prelude::*;
use std::ops::Range;

/// Classes below this posterior take no part in a completion …
pub(crate) const LEAST_SHARE: f64 = 0.05;
/// … and no more than this many do.
pub(crate) const MOST_PARTS: usize = 3;

/// Layers of constant x that one task completes.
const SLAB: usize = 4;

/// Least deviation of a voxel that was not observed: in turning, its value may come from an observed neighbour.
const UNSEEN_DEVIATION: f32 = 0.01;

impl Perceiver {
    /// Completes the observation that was last classified with `work`, into `percept`.
    pub fn complete(&self, query: &Query, work: &mut Workspace, percept: &mut Percept) -> Result<(), PerceiveError> {
        let dims = self.model.dims();
        for values in [&mut percept.occupancy, &mut percept.deviation] {
            values.clear();
            values.resize(dims.voxels(), 0.0);
        }
        for &voxel in &work.known.filled {
            percept.occupancy[voxel] = 1.0;
        }
        match query.method {
            Method::Paper => self.complete_as_the_paper(query, work, percept)?,
            Method::Mean => {
                let class = &self.subspaces[percept.class];
                complete_plainly(&work.known.unknown, percept, |voxel| class.mean(voxel));
            }
            _ => self.complete_by_evidence(work, percept)?,
        }
        let moved = query.pose != PoseSearch::Known || percept.placed != Placed::default();
        if moved && query.frame == Frame::Grid {
            self.turn_into_grid(work, percept);
        }
        Ok(())
    }

    /// Turns a completion from the object's frame into the observation's grid. What was observed there stays as observed.
    fn turn_into_grid(&self, work: &mut Workspace, percept: &mut Percept) {
        let Workspace { seen, turn, values: turned, .. } = work;
        turn.set_to_grid(&percept.placed);
        let (known, filled) = (seen.known(), seen.filled());
        for values in [&mut percept.occupancy, &mut percept.deviation] {
            turn.values(values, 0.0, turned);
            std::mem::swap(values, turned);
        }
        for (voxel, (p, deviation)) in percept.occupancy.iter_mut().zip(&mut percept.deviation).enumerate() {
            if known.contains(voxel) {
                (*p, *deviation) = (f32::from(u8::from(filled.contains(voxel))), 0.0);
            } else {
                *deviation = deviation.max(UNSEEN_DEVIATION);
            }
        }
    }

    fn complete_as_the_paper(&self, query: &Query, work: &mut Workspace, percept: &mut Percept) -> Result<(), PerceiveError> {
        if !percept.informed {
            self.project_as_the_paper(query, work)?;
        }
        let basis = &self.model.basis;
        let mut row = vec![0.0; basis.rank()];
        let projected = &work.projected;
        complete_plainly(&work.known.unknown, percept, |voxel| {
            basis.widen(voxel..voxel + 1, &mut row);
            density::dot(&row, projected)
        });
        Ok(())
    }

    fn complete_by_evidence(&self, work: &mut Workspace, percept: &mut Percept) -> Result<(), PerceiveError> {
        let shares = &mut work.shares;
        shares.clear();
        shares.extend(percept.posterior.iter().copied().enumerate());
        shares.sort_unstable_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
        if percept.informed {
            let likely = shares.iter().filter(|(_, p)| *p > LEAST_SHARE).count().clamp(1, MOST_PARTS);
            shares.truncate(likely);
        }
        let total: f64 = shares.iter().map(|(_, p)| p).sum();
        let scored = !work.scores.evidence.is_empty();
        for &(s, _) in shares.iter() {
            let (class, conditional) = (&self.subspaces[s], &mut work.conditionals[s]);
            if !scored || !work.wanted[s] {
                class.condition(&work.known, self.noise, conditional)?;
                percept.log_evidence[s] = conditional.log_evidence;
            }
            class.prepare(conditional);
        }
        let weights = completion::weights(&self.model.metadata.calibration.completion);
        let dims = self.model.dims();
        let (conditionals, runs) = (&work.conditionals, &work.known.unknown);
        let part =
            |&(s, p): &(usize, f64)| Part { weight: (p / total) as f32, class: &self.subspaces[s], posterior: &conditionals[s].posterior };
        let complete = |voxels: Range<usize>, occupancy: &mut [f32], deviation: &mut [f32]| {
            let within = runs.partition_point(|run| run.0 < voxels.start)..runs.partition_point(|run| run.0 < voxels.end);
            let unknown = Unknown { height: dims.z(), runs: &runs[within], parts: shares.iter().map(part) };
            dispatch(Complete { unknown, weights, first: voxels.start, occupancy, deviation });
        };
        if dims.voxels() <= ALONE {
            complete(0..dims.voxels(), &mut percept.occupancy, &mut percept.deviation);
            return Ok(());
        }
        // One slab of columns per task: which thread takes it does not change the result.
        let slab = dims.y() * dims.z() * SLAB;
        let slabs = percept.occupancy.par_chunks_mut(slab).zip(percept.deviation.par_chunks_mut(slab));
        slabs.enumerate().for_each(|(i, (occupancy, deviation))| complete(i * slab..(i + 1) * slab, occupancy, deviation));
        Ok(())
    }
}

/// Completion without a model of uncertainty: the value clamped to \[0, 1\], and the deviation of a coin with that bias.
fn complete_plainly(runs: &[(usize, usize)], percept: &mut Percept, mut value: impl FnMut(usize) -> f32) {
    for voxel in runs.iter().flat_map(|(start, end)| *start..*end) {
        let p = value(voxel).clamp(0.0, 1.0);
        percept.occupancy[voxel] = p;
        percept.deviation[voxel] = (p * (1.0 - p)).sqrt();
    }
}
