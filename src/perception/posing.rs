//! Class and pose jointly: the search over rotations, the posterior, and the observation turned back by the best of them.

use super::blend::softmax;
use super::known::Known;
use super::perceiver::{PerceiveError, Perceiver, Workspace, most_probable};
use super::pose::circle::{Angle, Circle};
use super::pose::posterior::hypotheses;
use super::pose::yaw::log_residual;
use super::subspace::Conditional;
use super::{Method, Percept, PoseSearch, Query};
use crate::grid::{Observation, Rotation, Turn, yaw, yaw_of};
use crate::linear::LinearError;

/// Rotations of a class within this of a mode belong to it.
const MODE_RADIUS: f64 = 15.0 / 180.0 * std::f64::consts::PI;

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
        percept.spread = hypotheses(&work.samples, &percept.posterior, MODE_RADIUS, averaged, &mut percept.hypotheses);
        percept.timings.posed = work.stopwatch.elapsed();
        let of_class = percept.hypotheses.iter().find(|h| h.class == percept.class);
        percept.rotation = of_class.map_or(Rotation::identity(), |h| h.rotation);
        let turned = self.turned_back(&work.seen, &percept.rotation, query);
        work.known.read(&turned);
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
    fn find_yaw(&self, span: f64, query: &Query, work: &mut Workspace, percept: &mut Percept) -> Result<(), LinearError> {
        let prior = query.rotation_prior.log_density(query.pose);
        let hints: Vec<f64> = query.rotation_prior.centres().map(yaw_of).collect();
        let calibration = &self.model.metadata.calibration;
        let m = self.model.classes.len();
        let wanted: Vec<bool> = (0..m).map(|s| query.log_prior(s) > f64::NEG_INFINITY).collect();
        let masked = |s: usize, score: f64| if wanted[s] { score } else { f64::NEG_INFINITY };
        let circle = |temperature: f64| Circle { span, temperature, prior: &prior, hints: &hints };
        if !percept.informed {
            let circle = circle(1.0);
            let angles = circle.search(|_| Ok::<_, LinearError>((0..m).map(|s| masked(s, 0.0)).collect()))?;
            circle.samples(&angles, &mut work.samples);
            return Ok(());
        }
        let view = self.view_of(query, work);
        match (query.method, view) {
            (Method::Auto, Some(view)) | (Method::Hull, Some(view)) => {
                let circle = circle(1.0 / calibration.hull.hull.max(1e-9));
                let angles = self.search_hull(view, &circle, &wanted, work)?;
                percept.timings.projected = work.stopwatch.elapsed();
                circle.samples(&angles, &mut work.samples);
                self.classify_angles(view, &circle, &angles, query, work, percept);
            }
            _ => {
                let (blend, by_distance) = match query.method {
                    Method::Mean => (&calibration.mean, true),
                    _ => (&calibration.evidence, false),
                };
                let weight = if by_distance { blend.distance } else { blend.evidence };
                let circle = circle(1.0 / weight.max(1e-9));
                let seen = &work.seen;
                let angles = circle.search(|angle| {
                    let (evidence, distance) = self.score_turned(&self.turned_back(seen, &yaw(angle), query), &wanted)?;
                    Ok::<_, LinearError>(if by_distance { distance } else { evidence })
                })?;
                percept.timings.projected = work.stopwatch.elapsed();
                circle.samples(&angles, &mut work.samples);
                let scores = (0..m).map(|s| circle.best(&angles, s).map_or(f64::NEG_INFINITY, |a| a.scores[s]));
                percept.scores.extend(scores);
                let joint = |s: usize| circle.best(&angles, s).map_or(f64::NEG_INFINITY, |a| weight * a.scores[s] + prior(&yaw(a.angle)));
                percept.posterior.extend((0..m).map(|s| joint(s) + blend.offsets[s] + query.log_prior(s)));
                softmax(&mut percept.posterior);
            }
        }
        Ok(())
    }

    /// Looks for the angles by the hull, all classes with one covariance. What enters counts as empty even where nothing is known
    /// of it: filled, as unknown voxels of a hull are, it would be a wall that no object has.
    fn search_hull(&self, view: usize, circle: &Circle<'_>, wanted: &[bool], work: &mut Workspace) -> Result<Vec<Angle>, LinearError> {
        work.columns.read(self.model.dims(), &work.known.hull);
        let columns = &work.columns;
        circle.search(|angle| {
            let mut projected = vec![0.0; self.model.rank()];
            let volume = columns.project(self.model.dims(), &self.sums, -angle, &mut projected);
            let residual = log_residual(volume, &projected);
            let mut scores = self.common[view].log_densities(&projected, wanted);
            scores.iter_mut().for_each(|score| *score += residual);
            Ok(scores)
        })
    }

    /// Class scores, each class with its own covariance, at the angles that are the best of some class; the posterior from
    /// them.
    fn classify_angles(
        &self,
        view: usize,
        circle: &Circle<'_>,
        angles: &[Angle],
        query: &Query,
        work: &mut Workspace,
        percept: &mut Percept,
    ) {
        let blend = &self.model.metadata.calibration.hull;
        let m = self.model.classes.len();
        let mut finals: Vec<f64> = (0..m).filter_map(|s| circle.best(angles, s)).map(|a| a.angle).collect();
        finals.sort_by(f64::total_cmp);
        finals.dedup();
        percept.scores.resize(m, f64::NEG_INFINITY);
        percept.posterior.resize(m, f64::NEG_INFINITY);
        for angle in finals {
            let prior = (circle.prior)(&yaw(angle));
            let scores = self.score_angle(view, angle, work);
            for (s, score) in scores.into_iter().enumerate().filter(|(s, _)| query.log_prior(*s) > f64::NEG_INFINITY) {
                percept.scores[s] = percept.scores[s].max(score);
                let joint = blend.hull * score + blend.offsets[s] + prior + query.log_prior(s);
                percept.posterior[s] = percept.posterior[s].max(joint);
            }
        }
        softmax(&mut percept.posterior);
    }

    /// Log density of the hull turned back by `angle`, for each class with its own covariance. `work.columns` holds the hull.
    fn score_angle(&self, view: usize, angle: f64, work: &mut Workspace) -> Vec<f64> {
        let volume = work.columns.project(self.model.dims(), &self.sums, -angle, &mut work.projected);
        let residual = log_residual(volume, &work.projected);
        let dof = self.model.metadata.calibration.degrees_of_freedom;
        self.hulls[view].iter().map(|d| residual + d.log_student(&work.projected, dof, &mut work.centred)).collect()
    }

    /// Log evidence relative to a background without a class, and negative squared distance to the mean, of each wanted class.
    ///
    /// The background is σ²-noise about zero: a known voxel far from the object, of which turning adds or removes some, then
    /// says nothing.
    pub(super) fn score_turned(&self, turned: &Observation, wanted: &[bool]) -> Result<(Vec<f64>, Vec<f64>), LinearError> {
        let mut known = Known::new(self.model.dims());
        known.read(turned);
        let background = self.background(turned, &known);
        let (mut evidence, mut distance) = (Vec::new(), Vec::new());
        for (class, wanted) in self.subspaces.iter().zip(wanted) {
            if !wanted {
                evidence.push(f64::NEG_INFINITY);
                distance.push(f64::NEG_INFINITY);
                continue;
            }
            let mut conditional = Conditional::new(class.size());
            class.condition(&known, self.noise, &mut conditional)?;
            evidence.push(conditional.log_evidence - background);
            distance.push(-conditional.distance2);
        }
        Ok((evidence, distance))
    }

    /// The same for one class, whose posterior given the turned observation is left in `conditional`.
    pub(super) fn condition_turned(&self, turned: &Observation, class: usize, conditional: &mut Conditional) -> Result<f64, LinearError> {
        let mut known = Known::new(self.model.dims());
        known.read(turned);
        self.subspaces[class].condition(&known, self.noise, conditional)?;
        Ok(conditional.log_evidence - self.background(turned, &known))
    }

    /// Log density of the known voxels without a class.
    fn background(&self, turned: &Observation, known: &Known) -> f64 {
        let voxels = turned.known().count_ones(..) as f64;
        -0.5 * (voxels * (std::f64::consts::TAU * self.noise).ln() + known.filled.len() as f64 / self.noise)
    }
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
