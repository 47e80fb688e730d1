//! Class scores of an observation in the pose in which it stands, by every method.

use super::blend::{Scores, softmax};
use super::known::Known;
use super::perceiver::{PerceiveError, Perceiver, Workspace};
use super::{ClassSubspace, Conditional, Density, Method, Percept, Query, paper};
use crate::grid::ALONE;
use crate::linear::LinearError;
use crate::model::Blend;
use rayon::prelude::*;

/// Classes whose posterior by the hull is below this share of the best one's are not worth computing their evidence, which
/// weighs little in the blend: on objects held out of ModelNet10's `train`, no answer and no log loss changed.
const HOPELESS: f64 = 1e-2;

impl Perceiver {
    /// Scores and posterior of the observation that `work` has read.
    pub(super) fn classify_here(&self, query: &Query, work: &mut Workspace, percept: &mut Percept) -> Result<(), PerceiveError> {
        let calibration = &self.model.metadata.calibration;
        let prior = &query.log_prior;
        let view = self.view_of(query, work);
        let (blend, raw): (&Blend, fn(&Scores) -> &Vec<f64>) = match (query.method, view) {
            (Method::Auto, Some(v)) => {
                self.score_hull(v, work, percept);
                if calibration.auto.evidence != 0.0 {
                    calibration.hull.posterior(&work.scores, prior, &mut percept.posterior);
                    let least = percept.posterior.iter().copied().fold(0.0, f64::max) * HOPELESS;
                    work.wanted.iter_mut().zip(&percept.posterior).for_each(|(wanted, p)| *wanted = *p >= least);
                    self.score_evidence(work, percept)?;
                }
                (&calibration.auto, |s| &s.hull)
            }
            (Method::Hull, v) => {
                self.score_hull(v.unwrap_or(0), work, percept);
                (&calibration.hull, |s| &s.hull)
            }
            // Hull densities belong to a view; where none fits, the evidence does not depend on it.
            (Method::Auto, None) | (Method::Evidence, _) => {
                work.wanted.fill(true);
                self.score_evidence(work, percept)?;
                (&calibration.evidence, |s| &s.evidence)
            }
            (Method::Mean, _) => {
                work.wanted.fill(true);
                self.score_evidence(work, percept)?;
                (&calibration.mean, |s| &s.distance)
            }
            (Method::Paper, _) => return self.classify_as_the_paper(query, work, percept),
        };
        percept.scores.extend_from_slice(raw(&work.scores));
        blend.posterior(&work.scores, prior, &mut percept.posterior);
        Ok(())
    }

    /// The place among the model's views of the one that the observation was taken from, if it is one of them.
    pub(super) fn view_of(&self, query: &Query, work: &Workspace) -> Option<usize> {
        let view = query.view.or_else(|| self.model.views().iter().copied().find(|v| v.matches(&work.seen)));
        view.and_then(|view| self.model.views().iter().position(|v| *v == view))
    }

    fn score_hull(&self, view: usize, work: &mut Workspace, percept: &mut Percept) {
        self.reading.project_hull(&work.known, &mut work.projected);
        percept.timings.projected = work.stopwatch.elapsed();
        let dof = self.model.metadata.calibration.degrees_of_freedom;
        let scores = self.hulls[view].iter().map(|d| d.log_student(&work.projected, dof, &mut work.centred));
        work.scores.hull.clear();
        work.scores.hull.extend(scores);
    }

    /// Evidence of the classes that are `wanted`. The others get that of the best of these: it then says nothing about them.
    fn score_evidence(&self, work: &mut Workspace, percept: &mut Percept) -> Result<(), LinearError> {
        let condition = |((class, conditional), wanted): ((&ClassSubspace, &mut Conditional), &bool)| match wanted {
            true => class.condition(&work.known, self.noise, conditional),
            false => Ok(()),
        };
        if self.model.dims().voxels() <= ALONE {
            self.subspaces.iter().zip(&mut work.conditionals).zip(&work.wanted).try_for_each(condition)?;
        } else {
            self.subspaces.par_iter().zip(&mut work.conditionals).zip(&work.wanted).try_for_each(condition)?;
        }
        // Without a hull this is the projection: each class conditioned on the known voxels.
        if percept.timings.projected.is_zero() {
            percept.timings.projected = work.stopwatch.elapsed();
        }
        let scores = &mut work.scores;
        let computed = || work.conditionals.iter().zip(&work.wanted).filter(|(_, wanted)| **wanted).map(|(c, _)| c);
        let best = computed().map(|c| c.log_evidence).fold(f64::NEG_INFINITY, f64::max);
        for (s, conditional) in work.conditionals.iter().enumerate() {
            let wanted = work.wanted[s];
            scores.evidence.push(if wanted { conditional.log_evidence } else { best });
            scores.distance.push(-conditional.distance2);
            percept.log_evidence[s] = if wanted { conditional.log_evidence } else { 0.0 };
        }
        Ok(())
    }

    fn classify_as_the_paper(&self, query: &Query, work: &mut Workspace, percept: &mut Percept) -> Result<(), PerceiveError> {
        self.project_as_the_paper(query, work)?;
        percept.timings.projected = work.stopwatch.elapsed();
        let densities = self.complete_densities()?;
        percept.scores.extend(densities.iter().map(|d| d.log_gaussian(&work.projected, &mut work.centred)));
        percept.posterior.clear();
        percept.posterior.extend(percept.scores.iter().enumerate().map(|(s, v)| v + query.log_prior(s)));
        softmax(&mut percept.posterior);
        Ok(())
    }

    /// o'_q (eq. 18), into `work.projected`.
    pub(super) fn project_as_the_paper(&self, query: &Query, work: &mut Workspace) -> Result<(), LinearError> {
        let (gram, b) = self.normal_equations(&work.known);
        let solution = paper::solve(&gram, &b, query.projection)?;
        work.projected.iter_mut().zip(solution).for_each(|(out, v)| *out = v as f32);
        Ok(())
    }

    /// Gram and right-hand side of eqs. 16 and 17.
    pub(super) fn normal_equations(&self, known: &Known) -> (faer::Mat<f64>, Vec<f64>) {
        paper::normal_equations(&self.model.basis, self.gram.get_or_init(|| paper::full_gram(&self.model.basis)), known)
    }

    /// The paper's densities of complete objects.
    pub(super) fn complete_densities(&self) -> Result<&[Density], LinearError> {
        if let Some(densities) = self.complete.get() {
            return Ok(densities);
        }
        let made = self.model.classes.par_iter().map(|c| Density::new(&c.mean, &c.covariance)).collect::<Result<Vec<_>, _>>()?;
        Ok(self.complete.get_or_init(|| made))
    }
}
