//! Class and angle about z, jointly: by the hull's projection for views from above that the model knows, by the evidence or the distance to the
//! class means for any other observation.

use super::circle::{AngleSearch, ScoredAngles};
use super::yaw::{HullColumns, log_residual};
use crate::grid::{Observation, Similarity, yaw, yaw_of};
use crate::perception::densities::blend::ClassScores;
use crate::perception::densities::log_sum::softmax;
use crate::perception::evidence::placed::ObjectFrame;
use crate::perception::known_pose::{ClassPosteriors, ProjectionScratch};
use crate::perception::prepared::{Here, Prepared};
use crate::perception::scored::{ClassMask, Scored};
use crate::perception::timings::Clock;
use crate::perception::{Method, PerceiveError, Query};

/// Scratch memory of this stage.
#[derive(Default)]
pub struct YawScratch {
    columns: HullColumns,
    looked: ScoredAngles,
    /// Angles that the prior points to.
    hints: Vec<f64>,
    /// Angles at which classes are scored.
    finals: Vec<f64>,
}

/// The search over angles about z.
pub struct YawSearch<'a> {
    pub prepared: &'a Prepared,
    pub here: &'a Here,
    pub query: &'a Query,
    pub wanted: &'a ClassMask,
    /// Which view of the model's the observation was taken from, if one.
    pub view: Option<usize>,
    /// Angles are in \[0, span), radians.
    pub span: f64,
}

impl YawSearch<'_> {
    /// Class posterior and weighted angles. Leaves `frame` in the pose that was looked at last.
    #[expect(clippy::too_many_arguments, reason = "each is scratch memory of another stage")]
    pub fn score(
        &self,
        seen: &Observation,
        frame: &mut ObjectFrame,
        scratch: &mut YawScratch,
        projection: &mut ProjectionScratch,
        posteriors: &mut ClassPosteriors,
        clock: &mut Clock,
        out: &mut Scored,
    ) -> Result<(), PerceiveError> {
        let prior = self.query.rotation_prior.log_density(self.query.pose);
        let m = self.prepared.classes();
        let YawScratch { columns, looked, hints, finals } = scratch;
        hints.clear();
        hints.extend(self.query.rotation_prior.centres().map(yaw_of));
        let circle = |temperature: f64| AngleSearch { span: self.span, temperature, prior: &prior, hints };
        let calibration = &self.prepared.model.metadata.calibration;
        if !out.informed {
            let circle = circle(1.0);
            circle.search(m, looked, |_, scores| {
                scores.iter_mut().zip(self.wanted).for_each(|(score, wanted)| *score = if *wanted { 0.0 } else { f64::NEG_INFINITY });
                Ok::<_, PerceiveError>(())
            })?;
            looked.samples(&circle, &mut out.samples);
            return Ok(());
        }
        if let (Method::Auto | Method::Hull, Some(view)) = (self.query.method, self.view) {
            let circle = circle(1.0 / calibration.hull.hull.max(1e-9));
            self.search_hull(view, &circle, looked, frame, columns, projection)?;
            clock.projected();
            looked.samples(&circle, &mut out.samples);
            self.classify_angles(view, &circle, looked, columns, finals, projection, out);
            return Ok(());
        }
        let by_distance = self.query.method == Method::Mean;
        let blend = if by_distance { &calibration.mean } else { &calibration.evidence };
        let weight = if by_distance { blend.distance } else { blend.evidence };
        let circle = circle(1.0 / weight.max(1e-9));
        let evidence = &self.prepared.evidence;
        circle.search(m, looked, |angle, scores| {
            frame.take_moved(&evidence.rows, seen, &Similarity::turned(yaw(angle)), self.query.outside)?;
            evidence.condition(frame.known(), self.wanted, &mut posteriors.conditionals, false)?;
            for ((score, conditional), wanted) in scores.iter_mut().zip(&posteriors.conditionals).zip(self.wanted) {
                let found = if by_distance { -conditional.distance2 } else { conditional.log_evidence_ratio() };
                *score = if *wanted { found } else { f64::NEG_INFINITY };
            }
            Ok::<_, PerceiveError>(())
        })?;
        clock.projected();
        looked.samples(&circle, &mut out.samples);
        for class in 0..m {
            let best = looked.best(&circle, class);
            out.scores.push(best.map_or(f64::NEG_INFINITY, |(_, score)| score));
            out.posterior.push(best.map_or(f64::NEG_INFINITY, |(angle, score)| {
                let scores = if by_distance { ClassScores::distance(score) } else { ClassScores::evidence(score) };
                blend.log_posterior(class, scores, self.query.log_prior(class)) + prior(&yaw(angle))
            }));
        }
        softmax(&mut out.posterior);
        Ok(())
    }

    /// Looks for the angles by the hull, all classes with one covariance. What enters counts as empty even where nothing is known
    /// of it: filled, as unknown voxels of a hull are, it would be a wall that no object has.
    fn search_hull(
        &self,
        view: usize,
        circle: &AngleSearch<'_>,
        looked: &mut ScoredAngles,
        frame: &ObjectFrame,
        columns: &mut HullColumns,
        projection: &mut ProjectionScratch,
    ) -> Result<(), PerceiveError> {
        let (dims, common) = (self.prepared.model.dims(), &self.here.common[view]);
        let ProjectionScratch { projected, centred } = projection;
        columns.read(dims, &frame.known().hull);
        circle.search(self.wanted.len(), looked, |angle, scores| {
            let volume = columns.project(dims, &self.here.sums, -angle, projected);
            let residual = log_residual(volume, projected);
            common.log_densities(projected, self.wanted, centred, scores);
            scores.iter_mut().for_each(|score| *score += residual);
            Ok(())
        })
    }

    /// Class scores, each class with its own covariance, at the angles that are the best of some class; the posterior from
    /// them.
    #[expect(clippy::too_many_arguments, reason = "each is scratch memory of its own")]
    fn classify_angles(
        &self,
        view: usize,
        circle: &AngleSearch<'_>,
        looked: &ScoredAngles,
        columns: &mut HullColumns,
        finals: &mut Vec<f64>,
        projection: &mut ProjectionScratch,
        out: &mut Scored,
    ) {
        let calibration = &self.prepared.model.metadata.calibration;
        let (blend, dof) = (&calibration.hull, calibration.degrees_of_freedom);
        let m = self.prepared.classes();
        let ProjectionScratch { projected, centred } = projection;
        finals.clear();
        finals.extend((0..m).filter_map(|s| looked.best(circle, s)).map(|(angle, _)| angle));
        finals.sort_unstable_by(f64::total_cmp);
        finals.dedup();
        out.scores.resize(m, f64::NEG_INFINITY);
        out.posterior.resize(m, f64::NEG_INFINITY);
        for &angle in finals.iter() {
            let prior = (circle.prior)(&yaw(angle));
            let volume = columns.project(self.prepared.model.dims(), &self.here.sums, -angle, projected);
            let residual = log_residual(volume, projected);
            for (s, density) in self.prepared.hulls[view].iter().enumerate().filter(|(s, _)| self.wanted[*s]) {
                let score = residual + density.log_student(projected, dof, centred);
                out.scores[s] = out.scores[s].max(score);
                let joint = blend.log_posterior(s, ClassScores::hull(score), self.query.log_prior(s)) + prior;
                out.posterior[s] = out.posterior[s].max(joint);
            }
        }
        softmax(&mut out.posterior);
    }
}
