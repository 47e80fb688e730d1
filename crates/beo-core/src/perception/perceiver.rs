//! The road of one observation: read, score classes and poses, refine, decide, complete (figure 1 of the paper).
//!
//! Each stage is a type with scratch memory of its own, which hands a value to the next; this file is the only one that knows them all.

use super::camera::camera_search::is_viewed;
use super::completion::completing::{Completion, CompletionScratch, OutputValue};
use super::error::PerceiveError;
#[cfg(test)]
use super::evidence::placed::EvidenceModel;
use super::evidence::placed::EvidenceScratch;
use super::levels::{Level, LevelScratch, LevelSearch};
use super::needs::{derived_bytes, require, workspace_bytes};
use super::one_grid::{OneGrid, OneGridScratch};
use super::percept::Percept;
use super::query::{Method, PoseSearch, Query};
use crate::grid::Observation;
use crate::memory;
use crate::model::{Model, load, outline};
use std::path::Path;
use std::sync::Arc;

/// A model prepared for queries. Shared between threads; each brings its own [`Workspace`].
pub struct Perceiver {
    pub(super) grid: OneGrid,
    /// Smaller grids on which poses are searched instead, from the smallest on.
    levels: Vec<Level>,
}

/// Scratch memory of one thread: of each stage of the road.
pub struct Workspace {
    grid: OneGridScratch,
    levels: Vec<LevelScratch>,
    /// Of a model with smaller grids: evidence on its own.
    fine: Option<EvidenceScratch>,
    completion: CompletionScratch,
}

/// An observation that was classified: what its completion needs. The percept says class and pose already.
pub struct Classified<'a> {
    perceiver: &'a Perceiver,
    query: &'a Query,
    work: &'a mut Workspace,
    percept: &'a mut Percept,
}

impl Perceiver {
    /// Derives what queries need: prefix sums of W', Cholesky factors, class bases over voxels. A model with smaller grids is read where
    /// it lies instead, and they are searched.
    ///
    /// # Errors
    /// [`PerceiveError::Model`] if a covariance of the model cannot be factorised.
    pub fn new(model: Arc<Model>) -> Result<Self, PerceiveError> {
        let levels = model.levels().iter().map(|level| Level::new(model.dims(), level)).collect::<Result<_, _>>()?;
        Ok(Self { grid: OneGrid::new(model)?, levels })
    }

    /// Loads a model file and prepares it for queries, after asking whether there is memory for both: without it, the system would
    /// end some process, perhaps this one, in the middle.
    ///
    /// # Errors
    /// [`PerceiveError::File`], [`PerceiveError::Memory`], and as [`Self::new`].
    pub fn open(path: &Path) -> Result<Self, PerceiveError> {
        Self::open_within(path, None)
    }

    /// As [`Self::open`], within `most` bytes of memory: of a file that is read in place, pages beyond that are given back to the system.
    ///
    /// # Errors
    /// [`PerceiveError::File`], [`PerceiveError::Memory`], [`PerceiveError::Bound`], and as [`Self::new`].
    pub fn open_within(path: &Path, most: Option<u64>) -> Result<Self, PerceiveError> {
        let outline = outline(path)?;
        let derived = (derived_bytes(&outline) + workspace_bytes(&outline)) as u64;
        // Pages of a file that is mapped can be given back at any time.
        let in_place = if outline.is_mapped() { outline.basis_bytes } else { 0 };
        let needed = outline.bytes().saturating_sub(in_place).saturating_add(derived);
        require(path, needed, memory::available())?;
        if let Some(most) = most
            && most < needed
        {
            return Err(PerceiveError::Bound { path: path.to_owned(), needed, most });
        }
        let model = load(path)?;
        if let Some(most) = most {
            model.basis.bound((most - needed) as usize);
        }
        Self::new(Arc::new(model))
    }

    /// The model.
    pub fn model(&self) -> &Arc<Model> {
        &self.grid.prepared.model
    }

    /// The mean of a class at one voxel, as learned: not clamped to \[0, 1\].
    pub fn class_mean(&self, class: usize, voxel: usize) -> f32 {
        self.grid.prepared.evidence.subspaces[class].mean(voxel)
    }

    /// The classes as Gaussians over voxels.
    #[cfg(test)]
    pub(crate) fn evidence(&self) -> &EvidenceModel {
        &self.grid.prepared.evidence
    }

    /// Scratch memory for queries.
    pub fn workspace(&self) -> Workspace {
        Workspace {
            grid: self.grid.scratch(),
            levels: self.levels.iter().map(LevelScratch::new).collect(),
            fine: (!self.levels.is_empty()).then(|| EvidenceScratch::new(self.model().dims())),
            completion: CompletionScratch::default(),
        }
    }

    /// Classifies an observation into `percept`, and finds its pose if that is asked for; completion follows by what is returned.
    ///
    /// An observation without a filled voxel says nothing: the answer is the prior, and [`Percept::informed`] is false.
    ///
    /// # Errors
    /// [`PerceiveError::Dims`] for a grid of another size, [`PerceiveError::KnownPoseOnly`] if the model cannot be searched, and
    /// [`PerceiveError::Damaged`] or [`PerceiveError::Model`] if it turns out to be unusable.
    pub fn classify<'a>(
        &'a self,
        observation: &Observation,
        query: &'a Query,
        work: &'a mut Workspace,
        percept: &'a mut Percept,
    ) -> Result<Classified<'a>, PerceiveError> {
        let dims = self.model().dims();
        if observation.dims() != dims {
            return Err(PerceiveError::Dims { found: observation.dims(), expected: dims });
        }
        self.model().basis.check_unchanged()?;
        let Workspace { grid, levels, fine, .. } = work;
        grid.start(observation, query);
        let has_cameras = self.levels.first().map_or(self.grid.has_cameras(), |level| level.grid.has_cameras());
        match fine {
            Some(fine) if query.pose != PoseSearch::Known || is_viewed(query, has_cameras) => {
                let search = LevelSearch { evidence: &self.grid.prepared.evidence, levels: &self.levels, query };
                search.answer(&grid.seen, levels, fine, &mut grid.clock, percept)?;
                grid.frame.take_moved(&self.grid.prepared.evidence.rows, &grid.seen, &percept.placed, query.outside)?;
            }
            _ => self.grid.answer(query, grid, percept)?,
        }
        if query.method == Method::Paper {
            self.grid.prepared.paper.project(grid.frame.known(), query.projection, &mut grid.projection.projected)?;
        }
        grid.clock.posed();
        percept.timings = grid.clock.timings;
        self.model().basis.check_unchanged()?;
        Ok(Classified { perceiver: self, query, work, percept })
    }
}

impl Classified<'_> {
    /// Class and pose, as they were decided.
    pub fn percept(&self) -> &Percept {
        self.percept
    }

    /// Completes the observation into the percept.
    ///
    /// # Errors
    /// [`PerceiveError::Model`] or [`PerceiveError::Damaged`] if the model turns out to be unusable.
    pub fn complete(self) -> Result<(), PerceiveError> {
        let (mut occupancy, mut deviation) = (std::mem::take(&mut self.percept.occupancy), std::mem::take(&mut self.percept.deviation));
        for values in [&mut occupancy, &mut deviation] {
            values.resize(self.work.grid.seen.dims().voxels(), 0.0);
        }
        let Self { perceiver, query, work, percept } = self;
        let outcome = Classified { perceiver, query, work, percept: &mut *percept }.complete_into(&mut occupancy, &mut deviation);
        (percept.occupancy, percept.deviation) = (occupancy, deviation);
        outcome
    }

    /// Completes the observation into the caller's memory: one value per voxel each, as numbers or as bytes (× 255); all are written.
    ///
    /// # Errors
    /// As [`Self::complete`].
    ///
    /// # Panics
    /// If there is not one value per voxel.
    pub fn complete_into<V: OutputValue>(self, occupancy: &mut [V], deviation: &mut [V]) -> Result<(), PerceiveError> {
        let Workspace { grid, completion, .. } = self.work;
        let OneGridScratch { seen, frame, projection, posteriors, .. } = grid;
        let completion = Completion {
            prepared: &self.perceiver.grid.prepared,
            query: self.query,
            seen,
            frame,
            posteriors,
            projected: &projection.projected,
            scratch: completion,
        };
        completion.write(self.percept, occupancy, deviation)?;
        Ok(self.perceiver.model().basis.check_unchanged()?)
    }
}
