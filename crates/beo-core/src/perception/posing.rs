//! Class and pose jointly: the search over rotations, the posterior, and the observation turned back by the best of them.

use super::blend::softmax;
use super::known::Known;
use super::perceiver::{PerceiveError, Perceiver, Workspace, most_probable};
use super::pose::circle::{Circle, Looked};
use super::pose::yaw::log_residual;
use super::subspace::{ClassSubspace, Conditional, background_of};
use super::{Method, Percept, PoseSearch, Query};
use crate::grid::{Observation, Placed, Rotation, Turn, yaw, yaw_of};
use crate::linear::LinearError;
use rayon::prelude::*;

/// Rotations of a class within this of a mode belong to it.
pub(super) const MODE_RADIUS: f64 = 15.0 / 180.0 * std::f64::consts::PI;

impl Perceiver {
    /// Finds class and pose of the observation that `work` has read, and leaves it turned into the object's frame.
    pub(super) fn find_pose(&self, query: &Query, work: &mut Workspace, percept: &mut Percept) -> Result<(), PerceiveError> {
        match query.pose {
            PoseSearch::Known => return Ok(()),
            _ if query.method == Method::Paper && percept.informed => self.find_pose_as_the_paper(query, work, percept)?,
            PoseSearch::Yaw { span } => self.find_yaw(span, query, work, percept)?,
            PoseSearch::Full => self.find_full(query, work, percept)?,
        }
        if percept.informed {
            percept.timings.classified = work.stopwatch.elapsed();
        }
        // A class that was left out has no score: zero, not minus infinity.
        percept.scores.iter_mut().filter(|score| !score.is_finite()).for_each(|score| *score = 0.0);
        percept.class = most_probable(&percept.posterior);
        let averaged = matches!(query.pose, PoseSearch::Yaw { .. });
        percept.spread = work.merging.hypotheses(&work.samples, &percept.posterior, MODE_RADIUS, averaged, &mut percept.hypotheses);
        percept.timings.posed = work.stopwatch.elapsed();
        let of_class = percept.hypotheses.iter().find(|h| h.class == percept.class);
        percept.rotation = of_class.map_or(Rotation::identity(), |h| h.rotation);
        percept.placed = Placed::turned(percept.rotation);
        work.turn.set(&percept.rotation.inverse());
        work.turn.observation_into(&work.seen, query.outside, &mut work.turned);
        self.reading.take_apart(&work.turned, &mut work.known)?;
        work.forget();
        if query.method == Method::Paper && percept.informed {
            self.project_as_the_paper(query, work)?;
        }
        Ok(())
    }

    /// The observation in the object's frame, if the object is turned by `rotation`.
    pub(super) fn turned_back(&self, seen: &Observation, rotation: &Rotation, query: &Query) -> Observation {
        Turn::new(self.model.dims(), &rotation.inverse()).observation(seen, query.outside)
    }

    /// Class posterior and weighted angles.
    fn find_yaw(&self, span: f64, query: &Query, work: &mut Workspace, percept: &mut Percept) -> Result<(), PerceiveError> {
        let prior = query.rotation_prior.log_density(query.pose);
        let m = self.model.classes.len();
        work.wanted.iter_mut().enumerate().for_each(|(s, wanted)| *wanted = query.log_prior(s) > f64::NEG_INFINITY);
        let mut hints = std::mem::take(&mut work.hints);
        hints.clear();
        hints.extend(query.rotation_prior.centres().map(yaw_of));
        let mut looked = std::mem::take(&mut work.looked);
        let circle = |temperature: f64| Circle { span, temperature, prior: &prior, hints: &hints };
        let calibration = &self.model.metadata.calibration;
        let outcome = if !percept.informed {
            let circle = circle(1.0);
            let flat = |_: f64, scores: &mut [f64]| {
                scores.iter_mut().zip(&work.wanted).for_each(|(score, wanted)| *score = if *wanted { 0.0 } else { f64::NEG_INFINITY });
                Ok(())
            };
            let outcome = circle.search(m, &mut looked, flat);
            looked.samples(&circle, &mut work.samples);
            outcome
        } else {
            match (query.method, self.view_of(query, work)) {
                (Method::Auto, Some(view)) | (Method::Hull, Some(view)) => {
                    let circle = circle(1.0 / calibration.hull.hull.max(1e-9));
                    let outcome = self.search_hull(view, &circle, &mut looked, work);
                    percept.timings.projected = work.stopwatch.elapsed();
                    looked.samples(&circle, &mut work.samples);
                    self.classify_angles(view, &circle, &looked, query, work, percept);
                    outcome
                }
                _ => {
                    let by_distance = query.method == Method::Mean;
                    let blend = if by_distance { &calibration.mean } else { &calibration.evidence };
                    let weight = if by_distance { blend.distance } else { blend.evidence };
                    let circle = circle(1.0 / weight.max(1e-9));
                    let outcome = circle.search(m, &mut looked, |angle, scores| {
                        let (evidence, distance) = self.score_turned(&self.turned_back(&work.seen, &yaw(angle), query), &work.wanted)?;
                        scores.copy_from_slice(if by_distance { &distance } else { &evidence });
                        Ok(())
                    });
                    percept.timings.projected = work.stopwatch.elapsed();
                    looked.samples(&circle, &mut work.samples);
                    for s in 0..m {
                        let best = looked.best(&circle, s);
                        percept.scores.push(best.map_or(f64::NEG_INFINITY, |(_, score)| score));
                        let joint = best.map_or(f64::NEG_INFINITY, |(angle, score)| weight * score + prior(&yaw(angle)));
                        percept.posterior.push(joint + blend.offsets[s] + query.log_prior(s));
                    }
                    softmax(&mut percept.posterior);
                    outcome
                }
            }
        };
        (work.hints, work.looked) = (hints, looked);
        outcome
    }

    /// Looks for the angles by the hull, all classes with one covariance. What enters counts as empty even where nothing is known
    /// of it: filled, as unknown voxels of a hull are, it would be a wall that no object has.
    fn search_hull(&self, view: usize, circle: &Circle<'_>, looked: &mut Looked, work: &mut Workspace) -> Result<(), PerceiveError> {
        let Workspace { known, columns, projected, centred, wanted, .. } = work;
        columns.read(self.model.dims(), &known.hull);
        circle.search(wanted.len(), looked, |angle, scores| {
            let volume = columns.project(self.model.dims(), self.column_sums(), -angle, projected);
            let residual = log_residual(volume, projected);
            self.common[view].log_densities(projected, wanted, centred, scores);
            scores.iter_mut().for_each(|score| *score += residual);
            Ok(())
        })
    }

    /// Class scores, each class with its own covariance, at the angles that are the best of some class; the posterior from
    /// them.
    fn classify_angles(
        &self,
        view: usize,
        circle: &Circle<'_>,
        looked: &Looked,
        query: &Query,
        work: &mut Workspace,
        percept: &mut Percept,
    ) {
        let blend = &self.model.metadata.calibration.hull;
        let dof = self.model.metadata.calibration.degrees_of_freedom;
        let m = self.model.classes.len();
        let finals = &mut work.finals;
        finals.clear();
        finals.extend((0..m).filter_map(|s| looked.best(circle, s)).map(|(angle, _)| angle));
        finals.sort_unstable_by(f64::total_cmp);
        finals.dedup();
        percept.scores.resize(m, f64::NEG_INFINITY);
        percept.posterior.resize(m, f64::NEG_INFINITY);
        for &angle in finals.iter() {
            let prior = (circle.prior)(&yaw(angle));
            let volume = work.columns.project(self.model.dims(), self.column_sums(), -angle, &mut work.projected);
            let residual = log_residual(volume, &work.projected);
            for (s, density) in self.hulls[view].iter().enumerate().filter(|(s, _)| work.wanted[*s]) {
                let score = residual + density.log_student(&work.projected, dof, &mut work.centred);
                percept.scores[s] = percept.scores[s].max(score);
                let joint = blend.hull * score + blend.offsets[s] + prior + query.log_prior(s);
                percept.posterior[s] = percept.posterior[s].max(joint);
            }
        }
        softmax(&mut percept.posterior);
    }

    /// Log evidence relative to a background without a class, and negative squared distance to the mean, of each wanted class.
    ///
    /// The background is σ²-noise about zero: a known voxel far from the object, of which turning adds or removes some, then
    /// says nothing.
    pub(super) fn score_turned(&self, turned: &Observation, wanted: &[bool]) -> Result<(Vec<f64>, Vec<f64>), PerceiveError> {
        let mut known = Known::new(self.model.dims());
        self.reading.take_apart(turned, &mut known)?;
        let background = background(self.noise, turned, &known);
        let score = |(class, wanted): (&ClassSubspace, &bool)| {
            if !wanted {
                return Ok((f64::NEG_INFINITY, f64::NEG_INFINITY));
            }
            let mut conditional = Conditional::new(class.size());
            class.condition(&known, self.noise, &mut conditional)?;
            Ok((conditional.log_evidence - background, -conditional.distance2))
        };
        Ok(self.subspaces.par_iter().zip(wanted).map(score).collect::<Result<Vec<_>, LinearError>>()?.into_iter().unzip())
    }

    /// The same for one class, whose posterior given the turned observation is left in `conditional`.
    pub(super) fn condition_turned(&self, turned: &Observation, class: usize, conditional: &mut Conditional) -> Result<f64, PerceiveError> {
        let mut known = Known::new(self.model.dims());
        self.reading.take_apart(turned, &mut known)?;
        self.subspaces[class].condition(&known, self.noise, conditional)?;
        Ok(conditional.log_evidence - background(self.noise, turned, &known))
    }
}

/// Log density of the known voxels without a class.
pub(crate) fn background(noise: f64, turned: &Observation, known: &Known) -> f64 {
    background_of(noise, turned.known().count_ones(..) as f64, known.filled.len() as f64)
}

#[cfg(test)]
mod tests {
    use crate::grid::View;
    use crate::perception::pose::small::{model, perceiver, unseen};

    /// Border columns, where no training shape is: whether they are known to be empty must not tell poses apart. Against the plain
    /// density of the known voxels each of them would count with log(2πσ²) / 2.
    #[test]
    fn what_is_known_to_be_empty_far_from_the_object_says_nothing() {
        let seen = View::Top.of(&unseen("chair", 4));
        let dims = model().dims();
        let mut less = crate::grid::Observation::unknown(dims);
        let mut hidden = 0;
        for voxel in seen.known().ones() {
            let [i, j, _] = dims.coordinates(voxel);
            if [i, j].iter().any(|c| *c == 0 || *c == dims.x() - 1) {
                hidden += 1;
            } else {
                less.set(voxel, seen.filled().contains(voxel));
            }
        }
        let wanted = vec![true; model().classes.len()];
        let scores = [&seen, &less].map(|o| perceiver().score_turned(o, &wanted).unwrap().0);
        let plain = 0.5 * f64::from(hidden) * (std::f64::consts::TAU * perceiver().noise).ln().abs();
        for (a, b) in scores[0].iter().zip(&scores[1]) {
            assert!((a - b).abs() < 0.05 * plain, "{a} {b}, plain {plain}");
        }
    }
}
