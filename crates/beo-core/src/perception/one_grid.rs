//! An observation answered on one grid: read, classes and poses scored and refined, decided.

use super::camera::camera_search::{CameraScratch, CameraSearch, is_viewed};
use super::decision::decide;
use super::densities::log_sum::softmax;
use super::error::PerceiveError;
use super::evidence::placed::ObjectFrame;
use super::known_pose::{ClassPosteriors, KnownPose, KnownPoseScratch, ProjectionScratch};
use super::paper::pose::PaperSearch;
use super::percept::Percept;
use super::pool::Pool;
use super::pose::full::{FullScratch, FullSearch};
use super::pose::posterior::Modes;
use super::pose::yaw_search::{YawScratch, YawSearch};
use super::prepared::{Here, Prepared};
use super::query::{Method, PoseSearch, Query};
use super::scored::Scored;
use super::timings::Clock;
use crate::grid::{Observation, Similarity};
use crate::model::Model;
use std::sync::Arc;

/// A model on its own grid, without the smaller grids that it may have.
pub(super) struct OneGrid {
    pub prepared: Prepared,
    /// Tables of the searches; none where poses are not searched on this grid.
    pub here: Option<Box<Here>>,
}

/// Scratch memory of one thread.
pub(super) struct OneGridScratch {
    pub clock: Clock,
    /// Read: the observation as it came, and taken apart in the frame that is looked at; in the object's once that is decided.
    pub seen: Observation,
    pub frame: ObjectFrame,
    /// Score: which classes take part, the scores, and memory of each kind of search.
    wanted: Vec<bool>,
    scored: Scored,
    pub projection: ProjectionScratch,
    pub posteriors: ClassPosteriors,
    known_pose: KnownPoseScratch,
    yaw: YawScratch,
    full: FullScratch,
    camera: CameraScratch,
    paper: Pool<ObjectFrame>,
    /// Decide.
    modes: Modes,
}

impl OneGrid {
    /// Derives what queries need.
    pub fn new(model: Arc<Model>) -> Result<Self, PerceiveError> {
        let (prepared, here) = Prepared::new(model)?;
        Ok(Self { prepared, here: here.map(Box::new) })
    }

    /// Whether there are densities of camera views.
    pub fn has_cameras(&self) -> bool {
        self.here.as_ref().is_some_and(|here| here.cameras.is_some())
    }

    /// Scratch memory for queries.
    pub fn scratch(&self) -> OneGridScratch {
        let dims = self.prepared.model.dims();
        OneGridScratch {
            clock: Clock::start(),
            seen: Observation::unknown(dims),
            frame: ObjectFrame::new(dims),
            wanted: vec![false; self.prepared.classes()],
            scored: Scored::default(),
            projection: ProjectionScratch::new(self.prepared.model.rank()),
            posteriors: ClassPosteriors::new(&self.prepared.evidence),
            known_pose: KnownPoseScratch::default(),
            yaw: YawScratch::default(),
            full: FullScratch::new(dims),
            camera: CameraScratch::default(),
            paper: Pool::default(),
            modes: Modes::default(),
        }
    }

    /// Class and pose of the observation that `work` was started with; it is then taken apart in the object's frame.
    pub fn answer(&self, query: &Query, work: &mut OneGridScratch, percept: &mut Percept) -> Result<(), PerceiveError> {
        if self.here.is_none() && (query.pose != PoseSearch::Known || is_viewed(query, false)) {
            return Err(PerceiveError::KnownPoseOnly);
        }
        let rows = &self.prepared.evidence.rows;
        work.camera.take_back(&mut work.frame);
        work.frame.take_as_it_came(rows, &work.seen)?;
        self.score(query, work)?;
        decide(query, &work.scored, &mut work.modes, percept);
        if query.pose != PoseSearch::Known || percept.placed != Similarity::default() {
            let OneGridScratch { seen, scored, frame, posteriors, camera, .. } = work;
            posteriors.forget();
            let class = percept.class;
            let is_at_hand = scored.placement.is_some() && camera.lend(class, &percept.placed, frame, &mut posteriors.conditionals[class]);
            if is_at_hand {
                posteriors.computed[class] = true;
                percept.log_evidence[class] = posteriors.conditionals[class].log_evidence;
            } else {
                frame.take_moved(rows, seen, &percept.placed, query.outside)?;
            }
        }
        percept.fit = work.posteriors.share_explained(&self.prepared.evidence, percept.class, work.frame.known());
        Ok(())
    }

    /// Scores classes and poses of what was read, and refines them.
    fn score(&self, query: &Query, work: &mut OneGridScratch) -> Result<(), PerceiveError> {
        let OneGridScratch { clock, seen, frame, wanted, scored: out, projection, posteriors, .. } = work;
        let prepared = &self.prepared;
        out.start(prepared.classes(), !frame.known().filled.is_empty());
        if let (Some(here), true) = (&self.here, out.informed)
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
        match (query.pose, &self.here) {
            (PoseSearch::Known, _) if out.informed => {
                let stage = KnownPose { prepared, query, view };
                stage.score(frame.known(), &mut work.known_pose, projection, posteriors, clock, out)?;
            }
            (PoseSearch::Yaw { .. } | PoseSearch::Full, Some(_)) if query.method == Method::Paper && out.informed => {
                let (model, rows) = (&prepared.paper, &prepared.evidence.rows);
                PaperSearch { model, rows, query, wanted, pool: &work.paper }.score(seen, clock, out)?;
            }
            (PoseSearch::Yaw { span }, Some(here)) => {
                let search = YawSearch { prepared, here, query, wanted, view, span };
                search.score(seen, frame, &mut work.yaw, projection, posteriors, clock, out)?;
            }
            (PoseSearch::Full, Some(here)) => {
                FullSearch { prepared, here, query, wanted, view }.score(seen, frame.known(), &mut work.full, clock, out)?;
            }
            (_, _) => {}
        }
        clock.classified();
        Ok(())
    }
}

impl OneGridScratch {
    /// Takes in an observation, and forgets what was known of the one before.
    pub fn start(&mut self, observation: &Observation, query: &Query) {
        self.clock = Clock::start();
        self.seen.clone_from(observation);
        self.posteriors.forget();
        self.wanted.iter_mut().enumerate().for_each(|(class, wanted)| *wanted = query.log_prior(class) > f64::NEG_INFINITY);
    }
}
