//! Poses on grids that are too large to be searched: class and pose are found on a small grid of the same space, and the rotation is
//! refined by the evidence on the larger ones, around the best only.

use super::perceiver::{PerceiveError, Perceiver, Workspace};
use super::percept::{Lay, ScaleSearch};
use super::subspace::Conditional;
use super::{Hypothesis, Method, Percept, PoseSearch, Query, Reading};
use crate::grid::{Rotation, yaw};
use crate::model::Damaged;
use nalgebra::{Unit, Vector3};

/// Hypotheses of at least this probability are refined, up to [`MOST_REFINED`].
const LEAST_REFINED: f64 = 0.05;
const MOST_REFINED: usize = 3;
/// Steps on a smaller grid, and on the grid itself, in degrees: half of what one voxel at the far end of an object is.
const SMALL_STEPS: [f64; 2] = [2.0, 0.7];
const FULL_STEPS: [f64; 2] = [0.5, 0.2];

impl Perceiver {
    /// Whether this question is answered on smaller grids first.
    pub(super) fn searches_levels(&self, query: &Query) -> bool {
        self.levels.first().is_some_and(|level| query.pose != PoseSearch::Known || level.perceiver.is_viewed(query))
    }

    /// Finds class and pose of the observation that `work` has read, and leaves it turned into the object's frame.
    pub(super) fn search_levels(&self, query: &Query, work: &mut Workspace, percept: &mut Percept) -> Result<(), PerceiveError> {
        for (level, small) in self.levels.iter().zip(&mut work.levels) {
            level.shrinking.observation(&work.seen, &mut small.counts, &mut small.seen);
        }
        let (level, small) = (&self.levels[0], &mut work.levels[0]);
        let factor = level.shrinking.factor();
        let scale = match query.scale {
            ScaleSearch::Search { side } => ScaleSearch::Search { side: side.map(|side| side / factor) },
            ScaleSearch::Known => ScaleSearch::Known,
        };
        let on_level = Query { camera: query.camera.map(|at| at / factor), scale, completion: false, ..query.clone() };
        let started = work.stopwatch.elapsed();
        level.perceiver.classify(&small.seen, &on_level, &mut small.work, percept)?;
        for stage in [&mut percept.timings.projected, &mut percept.timings.classified, &mut percept.timings.posed] {
            *stage += started;
        }
        percept.placed.shift *= factor;
        if let Some(Lay { extent, extent_deviation, position_deviation }) = &mut percept.lay {
            [extent, extent_deviation, position_deviation].into_iter().flatten().for_each(|length| *length *= factor);
        }
        if percept.informed && percept.placed.is_turned_only() && query.pose != PoseSearch::Known {
            self.weigh_hypotheses(query, work, percept)?;
            self.refine_hypotheses(query, work, percept)?;
        }
        work.turn.set_to_object(&percept.placed);
        work.turn.observation_into(&work.seen, query.outside, &mut work.turned);
        self.reading.take_apart(&work.turned, &mut work.known)?;
        work.forget();
        if query.method == Method::Paper && percept.informed {
            self.project_as_the_paper(query, work)?;
        }
        percept.timings.posed = work.stopwatch.elapsed();
        Ok(())
    }

    /// Weighs the hypotheses anew by the evidence on the largest of the smaller grids: it tells ends of an object apart that look alike on
    /// the smallest.
    fn weigh_hypotheses(&self, query: &Query, work: &Workspace, percept: &mut Percept) -> Result<(), PerceiveError> {
        let (Some(level), Some(small)) = (self.levels.last(), work.levels.last()) else { return Ok(()) };
        let perceiver = &level.perceiver;
        let weight = perceiver.model.metadata.calibration.evidence.evidence;
        let mut scores = Vec::with_capacity(percept.hypotheses.len());
        for hypothesis in &percept.hypotheses {
            let mut conditional = Conditional::new(perceiver.subspaces[hypothesis.class].size());
            let turned = perceiver.turned_back(&small.seen, &hypothesis.rotation, query);
            scores.push(weight * perceiver.condition_turned(&turned, hypothesis.class, &mut conditional)?);
        }
        // Within each class: what the classes are worth is not changed.
        for class in 0..percept.posterior.len() {
            let of_class = |hypotheses: &[Hypothesis]| hypotheses.iter().filter(|h| h.class == class).map(|h| h.probability).sum::<f64>();
            let before = of_class(&percept.hypotheses);
            let best = scores.iter().zip(&percept.hypotheses).filter(|(_, h)| h.class == class).map(|(score, _)| *score);
            let best = best.fold(f64::NEG_INFINITY, f64::max);
            for (hypothesis, score) in percept.hypotheses.iter_mut().zip(&scores).filter(|(h, _)| h.class == class) {
                hypothesis.probability *= (score - best).exp();
            }
            let after = of_class(&percept.hypotheses);
            if after > 0.0 {
                percept.hypotheses.iter_mut().filter(|h| h.class == class).for_each(|h| h.probability *= before / after);
            }
        }
        percept.hypotheses.sort_by(|a, b| b.probability.total_cmp(&a.probability));
        Ok(())
    }

    /// Refines the likely hypotheses on the smaller grids, and the one that is answered on this one.
    fn refine_hypotheses(&self, query: &Query, work: &mut Workspace, percept: &mut Percept) -> Result<(), PerceiveError> {
        let axes: &[usize] = if matches!(query.pose, PoseSearch::Yaw { .. }) { &[2] } else { &[0, 1, 2] };
        let answered = percept.hypotheses.iter().position(|h| h.class == percept.class);
        for (n, hypothesis) in percept.hypotheses.iter_mut().enumerate().take(MOST_REFINED) {
            if Some(n) != answered && hypothesis.probability < LEAST_REFINED {
                continue;
            }
            for (level, small) in self.levels.iter().zip(&work.levels).skip(1) {
                let perceiver = &level.perceiver;
                let mut conditional = Conditional::new(perceiver.subspaces[hypothesis.class].size());
                for step in SMALL_STEPS {
                    hypothesis.rotation = climb(&hypothesis.rotation, step, axes, |rotation| -> Result<f64, PerceiveError> {
                        let turned = perceiver.turned_back(&small.seen, rotation, query);
                        perceiver.condition_turned(&turned, hypothesis.class, &mut conditional)
                    })?;
                }
            }
            if Some(n) != answered {
                continue;
            }
            for step in FULL_STEPS {
                hypothesis.rotation =
                    climb(&hypothesis.rotation, step, axes, |rotation| self.score_in_place(rotation, hypothesis.class, query, work))?;
            }
            percept.rotation = hypothesis.rotation;
            percept.placed.rotation = hypothesis.rotation;
        }
        Ok(())
    }

    /// Log evidence of a class, relative to a background without a class, if the object is turned by `rotation`.
    fn score_in_place(&self, rotation: &Rotation, class: usize, query: &Query, work: &mut Workspace) -> Result<f64, PerceiveError> {
        let Reading::InPlace(rows) = &self.reading else {
            unreachable!("a model with smaller grids is read in place");
        };
        rows.sum_turned(&work.seen, rotation, query.outside, &mut work.sums).map_err(|damaged: Damaged| damaged)?;
        let (class, conditional) = (&self.subspaces[class], &mut work.conditionals[class]);
        class.gather_shared(&work.sums, conditional);
        class.solve(self.noise, conditional)?;
        Ok(conditional.log_evidence - class.background(self.noise, &work.sums))
    }
}

/// Moves a rotation about some of the grid's axes, one after the other, to where a parabola through three scores has its peak.
fn climb<E>(start: &Rotation, step_deg: f64, axes: &[usize], mut score: impl FnMut(&Rotation) -> Result<f64, E>) -> Result<Rotation, E> {
    let (mut at, step) = (*start, step_deg.to_radians());
    for axis in axes {
        let turned = |angle: f64| match axis {
            // A rotation about z stays exactly one.
            2 if at.i == 0.0 && at.j == 0.0 => yaw(crate::grid::yaw_of(&at) + angle),
            _ => Rotation::from_axis_angle(&Unit::new_unchecked(Vector3::ith(*axis, 1.0)), angle) * at,
        };
        let [low, middle, high] = [score(&turned(-step))?, score(&at)?, score(&turned(step))?];
        let bend = low - 2.0 * middle + high;
        let offset = if middle >= low.max(high) && bend < 0.0 {
            0.5 * (low - high) / bend
        } else if high >= low {
            1.0
        } else {
            -1.0
        };
        at = turned(offset * step);
    }
    Ok(at)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn climbing_finds_the_peak_of_a_parabola_and_moves_by_a_step_outside() {
        let peak = |about: f64| move |r: &Rotation| -> Result<f64, ()> { Ok(-(crate::grid::yaw_of(r) - about).powi(2)) };
        let found = climb(&yaw(1.0), 2.0, &[2], peak(1.01)).unwrap();
        assert!((crate::grid::yaw_of(&found) - 1.01).abs() < 1e-9);
        let found = climb(&yaw(1.0), 2.0, &[2], peak(1.3)).unwrap();
        assert!((crate::grid::yaw_of(&found) - 1.0 - 2_f64.to_radians()).abs() < 1e-9);
    }
}
