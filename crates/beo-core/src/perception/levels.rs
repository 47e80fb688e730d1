//! Poses on grids that are too large to be searched: class and pose are found on a small grid of the same space, and the rotation is
//! refined by the evidence on the larger ones, around the best only.

use super::error::PerceiveError;
use super::evidence::placed::{EvidenceModel, EvidenceScratch};
use super::one_grid::{OneGrid, OneGridScratch};
use super::percept::{Hypothesis, Percept};
use super::query::{PoseSearch, Query, ScaleSearch};
use super::search::climb::parabola;
use super::timings::Clock;
use crate::grid::{Counts, Dims, Observation, Rotation, Shrinking, yaw};
use crate::model::Model;
use nalgebra::{Unit, Vector3};
use std::sync::Arc;

/// Hypotheses of at least this probability are refined, up to [`MOST_REFINED`].
const LEAST_REFINED: f64 = 0.05;
const MOST_REFINED: usize = 3;
/// Steps on a smaller grid, and on the grid itself, in degrees: half of what one voxel at the far end of an object is.
const SMALL_STEPS: [f64; 2] = [2.0, 0.7];
const FULL_STEPS: [f64; 2] = [0.5, 0.2];

/// A smaller grid of the same space, which is searched on its own.
pub(super) struct Level {
    pub shrinking: Shrinking,
    pub grid: OneGrid,
}

impl Level {
    /// Derives what queries need of a model's `level`; the model has `dims`.
    pub fn new(dims: Dims, level: &Model) -> Result<Self, PerceiveError> {
        Ok(Self { shrinking: Shrinking::new(dims, level.dims()), grid: OneGrid::new(Arc::new(level.clone()))? })
    }
}

/// Scratch memory of a smaller grid.
pub(super) struct LevelScratch {
    work: OneGridScratch,
    seen: Observation,
    counts: Counts,
    evidence: EvidenceScratch,
    /// The query in voxels of this grid.
    query: Query,
    /// Log evidence of each hypothesis.
    scores: Vec<f64>,
}

impl LevelScratch {
    /// Room for the observations of a level.
    pub fn new(level: &Level) -> Self {
        let dims = level.shrinking.dims();
        let (work, seen) = (level.grid.scratch(), Observation::unknown(dims));
        let (counts, evidence) = (Counts::default(), EvidenceScratch::new(dims));
        Self { work, seen, counts, evidence, query: Query::default(), scores: Vec::new() }
    }
}

/// The search on smaller grids.
pub(super) struct LevelSearch<'a> {
    /// Of the large grid.
    pub evidence: &'a EvidenceModel,
    pub levels: &'a [Level],
    pub query: &'a Query,
}

impl LevelSearch<'_> {
    /// Finds class and pose of an observation on the smallest grid, and refines the rotation on the others and on its own, by `fine`.
    pub fn answer(
        &self,
        seen: &Observation,
        scratch: &mut [LevelScratch],
        fine: &mut EvidenceScratch,
        clock: &mut Clock,
        percept: &mut Percept,
    ) -> Result<(), PerceiveError> {
        for (level, small) in self.levels.iter().zip(&mut *scratch) {
            level.shrinking.observation(seen, &mut small.counts, &mut small.seen);
        }
        let (Some(level), Some(small)) = (self.levels.first(), scratch.first_mut()) else { return Ok(()) };
        let factor = level.shrinking.factor();
        let scale = match self.query.scale {
            ScaleSearch::Search { side } => ScaleSearch::Search { side: side.map(|side| side / factor) },
            ScaleSearch::Known => ScaleSearch::Known,
        };
        let LevelScratch { work, seen: small_seen, query: on_level, .. } = small;
        on_level.set(self.query);
        (on_level.camera, on_level.scale, on_level.completion) = (self.query.camera.map(|at| at / factor), scale, false);
        on_level.expected = self.query.expected.map(|expected| expected.on_level(factor));
        let started = clock.elapsed();
        work.start(small_seen, on_level);
        level.grid.answer(on_level, work, percept)?;
        work.clock.posed();
        clock.timings = work.clock.timings;
        for stage in [&mut clock.timings.projected, &mut clock.timings.classified, &mut clock.timings.posed] {
            *stage += started;
        }
        percept.placed.translation_voxels *= factor;
        percept.expected = percept.expected.map(|expected| expected.on_level(1.0 / factor));
        if let Some(found) = &mut percept.object_box {
            let lengths = [&mut found.extent_voxels, &mut found.extent_deviation_voxels, &mut found.position_deviation_voxels];
            lengths.into_iter().flatten().for_each(|length| *length *= factor);
        }
        if percept.informed && percept.placed.is_turned_only() && self.query.pose != PoseSearch::Known {
            self.weigh_hypotheses(scratch, percept)?;
            self.refine_hypotheses(seen, scratch, fine, percept)?;
        }
        Ok(())
    }

    /// Weighs the hypotheses anew by the evidence on the largest of the smaller grids: it tells ends of an object apart that look alike on
    /// the smallest.
    fn weigh_hypotheses(&self, scratch: &mut [LevelScratch], percept: &mut Percept) -> Result<(), PerceiveError> {
        let (Some(level), Some(small)) = (self.levels.last(), scratch.last_mut()) else { return Ok(()) };
        let evidence = &level.grid.prepared.evidence;
        let weight = level.grid.prepared.model.metadata.calibration.evidence.evidence;
        let LevelScratch { seen, evidence: scratch, scores, .. } = small;
        scores.clear();
        for Hypothesis { rotation, class, .. } in &percept.hypotheses {
            scores.push(weight * evidence.of_turned(seen, rotation, self.query.outside, *class, scratch)?.log_ratio);
        }
        // Within each class: what the classes are worth is not changed.
        for class in 0..percept.posterior.len() {
            let of_class = |hypotheses: &[Hypothesis]| hypotheses.iter().filter(|h| h.class == class).map(|h| h.probability).sum::<f64>();
            let before = of_class(&percept.hypotheses);
            let best = scores.iter().zip(&percept.hypotheses).filter(|(_, h)| h.class == class).map(|(score, _)| *score);
            let best = best.fold(f64::NEG_INFINITY, f64::max);
            for (hypothesis, score) in percept.hypotheses.iter_mut().zip(&*scores).filter(|(h, _)| h.class == class) {
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
    fn refine_hypotheses(
        &self,
        seen: &Observation,
        scratch: &mut [LevelScratch],
        fine: &mut EvidenceScratch,
        percept: &mut Percept,
    ) -> Result<(), PerceiveError> {
        let axes: &[usize] = if matches!(self.query.pose, PoseSearch::Yaw { .. }) { &[2] } else { &[0, 1, 2] };
        let answered = percept.hypotheses.iter().position(|h| h.class == percept.class);
        for (n, hypothesis) in percept.hypotheses.iter_mut().enumerate().take(MOST_REFINED) {
            if Some(n) != answered && hypothesis.probability < LEAST_REFINED {
                continue;
            }
            let class = hypothesis.class;
            let mut refine = |evidence: &EvidenceModel, seen: &Observation, scratch: &mut EvidenceScratch, steps: [f64; 2]| {
                for step in steps {
                    hypothesis.rotation = climb_by_parabolas(&hypothesis.rotation, step, axes, |rotation| {
                        Ok::<_, PerceiveError>(evidence.of_turned(seen, rotation, self.query.outside, class, scratch)?.log_ratio)
                    })?;
                }
                Ok::<_, PerceiveError>(())
            };
            for (level, small) in self.levels.iter().zip(&mut *scratch).skip(1) {
                refine(&level.grid.prepared.evidence, &small.seen, &mut small.evidence, SMALL_STEPS)?;
            }
            if Some(n) == answered {
                refine(self.evidence, seen, fine, FULL_STEPS)?;
                (percept.rotation_object_to_grid, percept.placed.rotation) = (hypothesis.rotation, hypothesis.rotation);
            }
        }
        Ok(())
    }
}

/// Moves a rotation about some of the grid's axes, one after the other, to where a parabola through three scores has its peak, and by a step
/// where that lies outside of the three.
fn climb_by_parabolas<E>(
    start: &Rotation,
    step_deg: f64,
    axes: &[usize],
    mut score: impl FnMut(&Rotation) -> Result<f64, E>,
) -> Result<Rotation, E> {
    let (mut at, step) = (*start, step_deg.to_radians());
    for axis in axes {
        let turned = |angle: f64| match axis {
            // A rotation about z stays exactly one.
            2 if at.i == 0.0 && at.j == 0.0 => yaw(crate::grid::yaw_of(&at) + angle),
            _ => Rotation::from_axis_angle(&Unit::new_unchecked(Vector3::ith(*axis, 1.0)), angle) * at,
        };
        let [low, middle, high] = [score(&turned(-step))?, score(&at)?, score(&turned(step))?];
        let offset = match parabola(low, middle, high) {
            Some((top, _)) if middle >= low.max(high) => top,
            _ if high >= low => 1.0,
            _ => -1.0,
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
        let found = climb_by_parabolas(&yaw(1.0), 2.0, &[2], peak(1.01)).unwrap();
        assert!((crate::grid::yaw_of(&found) - 1.01).abs() < 1e-9);
        let found = climb_by_parabolas(&yaw(1.0), 2.0, &[2], peak(1.3)).unwrap();
        assert!((crate::grid::yaw_of(&found) - 1.0 - 2_f64.to_radians()).abs() < 1e-9);
    }
}
