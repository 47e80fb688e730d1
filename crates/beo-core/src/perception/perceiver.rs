//! The road of one observation: read, score classes and poses, refine, decide, complete (figure 1 of the paper).
//!
//! Each stage is a type with scratch memory of its own, which hands a value to the next; this file is the only one that knows them all.

use super::camera::camera_search::{CameraScratch, CameraSearch, is_viewed};
use super::completion::completing::{Completion, CompletionScratch, Value};
use super::densities::log_sum::softmax;
use super::evidence::placed::{EvidenceModel, EvidenceScratch, ObjectFrame};
use super::known_pose::{ClassPosteriors, KnownPose, KnownPoseScratch, ProjectionScratch};
use super::needs::{derived_bytes, require, workspace_bytes};
use super::paper::pose::PaperSearch;
use super::pool::Pool;
use super::pose::full::{FullScratch, FullSearch};
use super::pose::levels::{LevelScratch, LevelSearch};
use super::pose::posterior::Modes;
use super::pose::yaw_search::{YawScratch, YawSearch};
use super::prepared::{Prepared, Search};
use super::scored::{Scored, decide};
use super::timings::Clock;
use super::{Method, PerceiveError, Percept, PoseSearch, Query};
use crate::grid::{Observation, Placed};
use crate::memory;
use crate::model::{Model, load, outline};
use std::path::Path;
use std::sync::Arc;

/// A model prepared for queries. Shared between threads; each brings its own [`Workspace`].
pub struct Perceiver {
    pub(super) prepared: Prepared,
    pub(super) search: Search,
}

/// Scratch memory of one thread: of each stage of the road.
pub struct Workspace {
    clock: Clock,
    /// Read: the observation as it came, and taken apart in the frame that is looked at; in the object's once that is decided.
    seen: Observation,
    frame: ObjectFrame,
    /// Score: which classes take part, the scores, and memory of each kind of search.
    wanted: Vec<bool>,
    scored: Scored,
    projection: ProjectionScratch,
    posteriors: ClassPosteriors,
    known_pose: KnownPoseScratch,
    yaw: YawScratch,
    full: FullScratch,
    camera: CameraScratch,
    paper: Pool<ObjectFrame>,
    levels: Vec<LevelScratch>,
    /// Of a model with smaller grids: evidence on its own.
    fine: Option<EvidenceScratch>,
    /// Decide.
    modes: Modes,
    /// Complete.
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
        let (prepared, search) = Prepared::new(model)?;
        Ok(Self { prepared, search })
    }

    /// Loads a model file and prepares it for queries, after asking whether there is memory for both: without it, the system would
    /// end some process, perhaps this one, in the middle.
    ///
    /// # Errors
    /// [`PerceiveError::File`], [`PerceiveError::Memory`], and as [`Self::new`].
    pub fn open(path: &Path) -> Result<Self, PerceiveError> {
        Self::open_within(path, None)
    }

    /// The same within `most` bytes of memory: of a file that is read in place, pages beyond that are given back to the system.
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
        &self.prepared.model
    }

    /// The mean of a class at one voxel, as learned: not clamped to \[0, 1\].
    pub fn class_mean(&self, class: usize, voxel: usize) -> f32 {
        self.prepared.evidence.subspaces[class].mean(voxel)
    }

    /// The classes as Gaussians over voxels.
    pub(crate) fn evidence(&self) -> &EvidenceModel {
        &self.prepared.evidence
    }

    /// Scratch memory for queries.
    pub fn workspace(&self) -> Workspace {
        let (dims, levels) = (self.model().dims(), self.search.levels());
        Workspace {
            clock: Clock::start(),
            seen: Observation::unknown(dims),
            frame: ObjectFrame::new(dims),
            wanted: vec![false; self.prepared.classes()],
            scored: Scored::default(),
            projection: ProjectionScratch::new(self.model().rank()),
            posteriors: ClassPosteriors::new(&self.prepared.evidence),
            known_pose: KnownPoseScratch::default(),
            yaw: YawScratch::default(),
            full: FullScratch::default(),
            camera: CameraScratch::default(),
            paper: Pool::default(),
            levels: levels.iter().map(LevelScratch::new).collect(),
            fine: (!levels.is_empty()).then(|| EvidenceScratch::new(dims)),
            modes: Modes::default(),
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
        self.search.check(query)?;
        self.model().basis.check_unchanged()?;
        work.start(observation, query);
        if let (Search::OnLevels(levels), Some(fine)) = (&self.search, &mut work.fine)
            && (query.pose != PoseSearch::Known || is_viewed(query, self.search.has_cameras()))
        {
            let search = LevelSearch { prepared: &self.prepared, levels, query };
            search.answer(&work.seen, &mut work.levels, fine, &mut work.clock, percept)?;
            work.frame.take_moved(&self.prepared.evidence.rows, &work.seen, &percept.placed, query.outside)?;
        } else {
            work.frame.take_as_it_came(&self.prepared.evidence.rows, &work.seen)?;
            self.score(query, work)?;
            decide(query, &work.scored, &mut work.modes, percept);
            if query.pose != PoseSearch::Known || percept.placed != Placed::default() {
                work.frame.take_moved(&self.prepared.evidence.rows, &work.seen, &percept.placed, query.outside)?;
                work.posteriors.forget();
            }
        }
        if query.method == Method::Paper {
            self.prepared.paper.project(work.frame.known(), query.projection, &mut work.projection.projected)?;
        }
        work.clock.posed();
        percept.timings = work.clock.timings;
        self.model().basis.check_unchanged()?;
        Ok(Classified { perceiver: self, query, work, percept })
    }

    /// Scores classes and poses of what was read, and refines them.
    fn score(&self, query: &Query, work: &mut Workspace) -> Result<(), PerceiveError> {
        let Workspace { clock, seen, frame, wanted, scored: out, projection, posteriors, .. } = work;
        let prepared = &self.prepared;
        out.start(prepared.classes(), !frame.known().filled.is_empty());
        if let (Search::Here(here), true) = (&self.search, out.informed)
            && is_viewed(query, here.cameras.is_some())
        {
            let model = &prepared.model.metadata;
            let search = CameraSearch {
                evidence: &prepared.evidence,
                evidence_blend: &model.calibration.evidence,
                longest_side: model.settings.longest_side,
                cameras: here.cameras.as_ref(),
                query,
                wanted,
            };
            search.score(seen, &mut work.camera, clock, out)?;
            if out.informed {
                return Ok(());
            }
        }
        if !out.informed {
            out.scores.resize(prepared.classes(), 0.0);
            out.posterior.extend((0..prepared.classes()).map(|s| query.log_prior(s)));
            softmax(&mut out.posterior);
        }
        let view = prepared.view_of(query, seen);
        match (query.pose, &self.search) {
            (PoseSearch::Known, _) if out.informed => {
                let stage = KnownPose { prepared, query, view };
                stage.score(frame.known(), &mut work.known_pose, projection, posteriors, clock, out)?;
            }
            (PoseSearch::Yaw { .. } | PoseSearch::Full, Search::Here(_)) if query.method == Method::Paper && out.informed => {
                PaperSearch { prepared, query, wanted, pool: &work.paper }.score(seen, clock, out)?;
            }
            (PoseSearch::Yaw { span }, Search::Here(here)) => {
                let search = YawSearch { prepared, here, query, wanted, view, span };
                search.score(seen, frame, &mut work.yaw, projection, posteriors, clock, out)?;
            }
            (PoseSearch::Full, Search::Here(here)) => {
                FullSearch { prepared, here, query, wanted, view }.score(seen, frame.known(), &work.full, clock, out)?;
            }
            (_, _) => {}
        }
        clock.classified();
        Ok(())
    }
}

impl Workspace {
    /// Takes in an observation, and forgets what was known of the one before.
    fn start(&mut self, observation: &Observation, query: &Query) {
        self.clock = Clock::start();
        self.seen.clone_from(observation);
        self.posteriors.forget();
        self.wanted.iter_mut().enumerate().for_each(|(class, wanted)| *wanted = query.log_prior(class) > f64::NEG_INFINITY);
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
            values.resize(self.work.seen.dims().voxels(), 0.0);
        }
        let Self { perceiver, query, work, percept } = self;
        let outcome = Classified { perceiver, query, work, percept: &mut *percept }.complete_into(&mut occupancy, &mut deviation);
        (percept.occupancy, percept.deviation) = (occupancy, deviation);
        outcome
    }

    /// The same into the caller's memory: one value per voxel each, as numbers or as bytes (× 255); all are written.
    ///
    /// # Errors
    /// As [`Self::complete`].
    ///
    /// # Panics
    /// If there is not one value per voxel.
    pub fn complete_into<V: Value>(self, occupancy: &mut [V], deviation: &mut [V]) -> Result<(), PerceiveError> {
        let Workspace { seen, frame, projection, posteriors, completion, .. } = self.work;
        let completion = Completion {
            prepared: &self.perceiver.prepared,
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
