//! Completion of the observation that was last classified, by every method, in the frame that was asked for.

use super::completion::{self, Complete, Part, Unknown};
use super::density;
use super::known::Known;
use super::lanes::dispatch;
use super::perceiver::{PerceiveError, Perceiver, Workspace};
use super::percept::Frame;
use super::{Method, Percept, PoseSearch, Query, Reading};
use crate::grid::{ALONE, Placed};
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

impl Perceiver {
    /// Completes the observation that was last classified with `work`, into `percept`.
    pub fn complete(&self, query: &Query, work: &mut Workspace, percept: &mut Percept) -> Result<(), PerceiveError> {
        let (mut occupancy, mut deviation) = (std::mem::take(&mut percept.occupancy), std::mem::take(&mut percept.deviation));
        for values in [&mut occupancy, &mut deviation] {
            values.resize(self.model.dims().voxels(), 0.0);
        }
        let outcome = self.complete_into(query, work, percept, &mut occupancy, &mut deviation);
        (percept.occupancy, percept.deviation) = (occupancy, deviation);
        outcome
    }

    /// The same, into the caller's memory: one value per voxel each, as numbers or as bytes (× 255); all are written.
    pub fn complete_into<V: Value>(
        &self,
        query: &Query,
        work: &mut Workspace,
        percept: &mut Percept,
        occupancy: &mut [V],
        deviation: &mut [V],
    ) -> Result<(), PerceiveError> {
        assert_eq!([occupancy.len(), deviation.len()], [self.model.dims().voxels(); 2], "one value per voxel");
        let moved = query.pose != PoseSearch::Known || percept.placed != Placed::default();
        if !moved || query.frame == Frame::Object {
            return self.complete_here(query, work, percept, occupancy, deviation);
        }
        let [mut p, mut sd] = std::mem::take(V::scratch(&mut work.moved));
        p.resize(occupancy.len(), V::default());
        sd.resize(deviation.len(), V::default());
        let outcome = self.complete_here(query, work, percept, &mut p, &mut sd);
        turn_into_grid(work, percept, [&p, &sd], occupancy, deviation);
        *V::scratch(&mut work.moved) = [p, sd];
        outcome
    }

    /// In the frame in which the observation was completed: as it came, or the object's where that was found.
    fn complete_here<V: Value>(
        &self,
        query: &Query,
        work: &mut Workspace,
        percept: &mut Percept,
        occupancy: &mut [V],
        deviation: &mut [V],
    ) -> Result<(), PerceiveError> {
        match query.method {
            Method::Paper => {
                if !percept.informed {
                    self.project_as_the_paper(query, work)?;
                }
                let basis = &self.model.basis;
                let mut row = vec![0.0; basis.rank()];
                let projected = &work.projected;
                complete_plainly(&work.known, occupancy, deviation, |voxel| {
                    basis.widen(voxel..voxel + 1, &mut row);
                    density::dot(&row, projected)
                });
            }
            Method::Mean => {
                let class = &self.subspaces[percept.class];
                complete_plainly(&work.known, occupancy, deviation, |voxel| class.mean(voxel));
            }
            _ => self.complete_by_evidence(work, percept, occupancy, deviation)?,
        }
        Ok(())
    }

    fn complete_by_evidence<V: Value>(
        &self,
        work: &mut Workspace,
        percept: &mut Percept,
        occupancy: &mut [V],
        deviation: &mut [V],
    ) -> Result<(), PerceiveError> {
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
        let (conditionals, known) = (&work.conditionals, &work.known);
        let part =
            |&(s, p): &(usize, f64)| Part { weight: (p / total) as f32, class: &self.subspaces[s], posterior: &conditionals[s].posterior };
        let complete = |voxels: Range<usize>, occupancy: &mut [V], deviation: &mut [V]| {
            // A slab stays in the cache until it is complete: memory is written once.
            write_known(known, voxels.start, occupancy, deviation);
            let runs = &known.unknown;
            let within = runs.partition_point(|run| run.0 < voxels.start)..runs.partition_point(|run| run.0 < voxels.end);
            let unknown = Unknown { height: dims.z(), runs: &runs[within], parts: shares.iter().map(part) };
            dispatch(Complete { unknown, weights, first: voxels.start, occupancy, deviation });
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
            if let Reading::InPlace(rows) = &self.reading {
                rows.touch_unknown(known, voxels.start / dims.z()..voxels.end / dims.z())?;
            }
            complete(voxels, occupancy, deviation);
            Ok(())
        })
    }
}

/// Memory for completions that are computed in another frame than the one that was asked for.
#[derive(Default)]
pub struct Moved {
    floats: [Vec<f32>; 2],
    bytes: [Vec<u8>; 2],
}

/// How a completion is written.
pub trait Value: completion::Value {
    /// Memory for two grids of it.
    fn scratch(moved: &mut Moved) -> &mut [Vec<Self>; 2];
}

impl Value for f32 {
    fn scratch(moved: &mut Moved) -> &mut [Vec<Self>; 2] {
        &mut moved.floats
    }
}

impl Value for u8 {
    fn scratch(moved: &mut Moved) -> &mut [Vec<Self>; 2] {
        &mut moved.bytes
    }
}

/// Writes what was observed of the voxels from `first` on, and that it is certain.
fn write_known<V: Value>(known: &Known, first: usize, occupancy: &mut [V], deviation: &mut [V]) {
    occupancy.fill(V::default());
    deviation.fill(V::default());
    let within = known.filled.partition_point(|v| *v < first)..known.filled.partition_point(|v| *v < first + occupancy.len());
    known.filled[within].iter().for_each(|voxel| occupancy[voxel - first] = V::ONE);
}

/// Turns a completion from the object's frame into the observation's grid. What was observed there stays as observed.
fn turn_into_grid<V: Value>(work: &mut Workspace, percept: &Percept, [p, sd]: [&[V]; 2], occupancy: &mut [V], deviation: &mut [V]) {
    let Workspace { seen, turn, .. } = work;
    turn.set_to_grid(&percept.placed);
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
fn complete_plainly<V: Value>(known: &Known, occupancy: &mut [V], deviation: &mut [V], mut value: impl FnMut(usize) -> f32) {
    write_known(known, 0, occupancy, deviation);
    for voxel in known.unknown.iter().flat_map(|(start, end)| *start..*end) {
        let p = value(voxel).clamp(0.0, 1.0);
        occupancy[voxel] = V::from_unit(p);
        deviation[voxel] = V::from_unit((p * (1.0 - p)).sqrt());
    }
}
