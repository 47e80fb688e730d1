//! Class scores of an observation in the pose in which it came, by every method.

use super::basis::known::Known;
use super::densities::blend::Scores;
use super::densities::gaussian::Gaussian;
use super::densities::log_sum::softmax;
use super::evidence::conditional::Conditional;
use super::evidence::explained::share_explained;
use super::evidence::placed::EvidenceModel;
use super::prepared::Prepared;
use super::scored::{ClassMask, Scored};
use super::settings::LEAST_SHARE_OF_BEST;
use super::timings::Clock;
use super::{Method, PerceiveError, Query};
use crate::grid::ALONE;
use crate::linear::LinearError;
use crate::model::Blend;

/// The classes conditioned on what is known in one frame, as far as they were: what completion takes over from the scores.
pub(super) struct ClassPosteriors {
    /// One per class.
    pub conditionals: Vec<Conditional>,
    /// Which of them hold for what is known now.
    pub computed: Vec<bool>,
}

impl ClassPosteriors {
    /// Room for the classes of a model.
    pub fn new(evidence: &EvidenceModel) -> Self {
        let conditionals: Vec<Conditional> = evidence.subspaces.iter().map(|s| Conditional::new(s.size())).collect();
        Self { computed: vec![false; conditionals.len()], conditionals }
    }

    /// How much of what is `known` the class explains, if it was conditioned on it.
    pub fn share_explained(&self, evidence: &EvidenceModel, class: usize, known: &Known) -> Option<f64> {
        self.computed[class]
            .then(|| share_explained(&evidence.subspaces[class], &self.conditionals[class], evidence.dims(), &known.filled))
            .flatten()
    }

    /// Another observation, or the same in another frame, is known from now on.
    pub fn forget(&mut self) {
        self.computed.fill(false);
    }
}

/// Scratch memory for scores by projections onto W'.
pub(super) struct ProjectionScratch {
    /// A projection, a values.
    pub projected: Vec<f32>,
    /// The same, centred or whitened.
    pub centred: Vec<f32>,
}

impl ProjectionScratch {
    /// Room for projections onto a basis of this rank.
    pub fn new(rank: usize) -> Self {
        Self { projected: vec![0.0; rank], centred: vec![0.0; rank] }
    }
}

/// Scratch memory of this stage.
#[derive(Default)]
pub(super) struct KnownPoseScratch {
    scores: Scores,
    likely: Vec<bool>,
}

/// Scores the classes of a model in known pose.
pub(super) struct KnownPose<'a> {
    pub prepared: &'a Prepared,
    pub query: &'a Query,
    /// Which view of the model's the observation was taken from, if one.
    pub view: Option<usize>,
}

impl KnownPose<'_> {
    /// Scores and posterior of what is `known`.
    pub fn score(
        &self,
        known: &Known,
        scratch: &mut KnownPoseScratch,
        projection: &mut ProjectionScratch,
        posteriors: &mut ClassPosteriors,
        clock: &mut Clock,
        out: &mut Scored,
    ) -> Result<(), PerceiveError> {
        let calibration = &self.prepared.model.metadata.calibration;
        let prior = &self.query.log_prior;
        let KnownPoseScratch { scores, likely } = scratch;
        scores.clear();
        likely.clear();
        likely.resize(self.prepared.classes(), true);
        let (blend, raw): (&Blend, fn(&Scores) -> &Vec<f64>) = match (self.query.method, self.view) {
            (Method::Auto, Some(view)) => {
                self.score_hull(view, known, projection, clock, scores);
                if calibration.auto.evidence != 0.0 {
                    calibration.hull.posterior(scores, prior, &mut out.posterior);
                    let least = out.posterior.iter().copied().fold(0.0, f64::max) * LEAST_SHARE_OF_BEST;
                    likely.iter_mut().zip(&out.posterior).for_each(|(likely, p)| *likely = *p >= least);
                    self.score_evidence(known, likely, posteriors, clock, scores, out)?;
                }
                (&calibration.auto, |s| &s.hull)
            }
            (Method::Hull, view) => {
                self.score_hull(view.unwrap_or(0), known, projection, clock, scores);
                (&calibration.hull, |s| &s.hull)
            }
            // Hull densities belong to a view; where none fits, the evidence does not depend on it.
            (Method::Auto, None) | (Method::Evidence, _) => {
                self.score_evidence(known, likely, posteriors, clock, scores, out)?;
                (&calibration.evidence, |s| &s.evidence)
            }
            (Method::Mean, _) => {
                self.score_evidence(known, likely, posteriors, clock, scores, out)?;
                (&calibration.mean, |s| &s.distance)
            }
            (Method::Paper, _) => return self.score_as_the_paper(known, projection, clock, out),
        };
        out.scores.clone_from(raw(scores));
        blend.posterior(scores, prior, &mut out.posterior);
        Ok(())
    }

    fn score_hull(&self, view: usize, known: &Known, projection: &mut ProjectionScratch, clock: &mut Clock, scores: &mut Scores) {
        let ProjectionScratch { projected, centred } = projection;
        self.prepared.evidence.rows.project_hull(known, projected);
        clock.projected();
        let dof = self.prepared.model.metadata.calibration.degrees_of_freedom;
        scores.hull.extend(self.prepared.hulls[view].iter().map(|density: &Gaussian| density.log_student(projected, dof, centred)));
    }

    /// Evidence of the `likely` classes. The others get that of the best of these: it then says nothing about them.
    fn score_evidence(
        &self,
        known: &Known,
        likely: &ClassMask,
        posteriors: &mut ClassPosteriors,
        clock: &mut Clock,
        scores: &mut Scores,
        out: &mut Scored,
    ) -> Result<(), LinearError> {
        let evidence = &self.prepared.evidence;
        evidence.condition(known, likely, &mut posteriors.conditionals, evidence.dims().voxels() <= ALONE)?;
        posteriors.computed.copy_from_slice(likely);
        // Without a hull this is the projection: each class conditioned on the known voxels.
        clock.projected_unless_before();
        let computed = posteriors.conditionals.iter().zip(likely).filter(|(_, likely)| **likely).map(|(c, _)| c.log_evidence);
        let best = computed.fold(f64::NEG_INFINITY, f64::max);
        for (s, (conditional, likely)) in posteriors.conditionals.iter().zip(likely).enumerate() {
            scores.evidence.push(if *likely { conditional.log_evidence } else { best });
            scores.distance.push(-conditional.distance2);
            out.log_evidence[s] = if *likely { conditional.log_evidence } else { 0.0 };
        }
        Ok(())
    }

    fn score_as_the_paper(
        &self,
        known: &Known,
        projection: &mut ProjectionScratch,
        clock: &mut Clock,
        out: &mut Scored,
    ) -> Result<(), PerceiveError> {
        let ProjectionScratch { projected, centred } = projection;
        self.prepared.paper.project(known, self.query.projection, projected)?;
        clock.projected();
        out.scores.clear();
        out.scores.extend(self.prepared.paper.densities()?.iter().map(|density| density.log_gaussian(projected, centred)));
        out.posterior.clear();
        out.posterior.extend(out.scores.iter().enumerate().map(|(s, score)| score + self.query.log_prior(s)));
        softmax(&mut out.posterior);
        Ok(())
    }
}
