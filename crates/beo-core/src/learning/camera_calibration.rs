//! How sure the densities of what cameras see may be, fitted on views of shapes that they have not seen, through the same sensors.

use super::calibration::fit_blend;
use super::camera_forest::measured;
use super::camera_views::{AtRest, ComponentShapes, ViewSample, Views, are_plain, stream};
use super::drawing::draw_by;
use crate::grid::{Outside, yaw_of};
use crate::model::{Blend, CameraCalibration, CameraDensities, CameraSpread, YAWS};
use crate::perception::PerceiveError;
use crate::perception::camera::camera_search::{CameraScratch, CameraSearch};
use crate::perception::camera::mode_refiner::{ModeRefiner, ModeRefinerScratch};
use crate::perception::camera::{CameraScores, Cell, KnownPlacement, ViewWork};
use crate::perception::densities::log_sum::log_sum_exp;
use crate::perception::evidence::lattice::Codes;
use crate::perception::evidence::placed::{EvidenceModel, EvidenceScratch};
use crate::perception::scored::Scored as PerceptScores;
use crate::perception::timings::Clock;
use rand::RngExt;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use std::f64::consts::TAU;
use std::sync::Arc;

/// Views for the calibration: so many per shape that is left out, but no more in all.
const SEEN: usize = 4;
const MOST_SEEN: usize = 2400;
/// Views of which the evidence is weighed too.
const MOST_WEIGHED: usize = 700;
/// At most so many are answered as queries are, for the deviations of place and size; fewer than the second say too little.
const MOST_PLACED: usize = 300;
const FEWEST_PLACED: usize = 30;
/// No deviation is drawn in, or widened, by more than this.
const LEAST_SPREAD: f64 = 0.25;
const MOST_SPREAD: f64 = 100.0;
/// Classes whose evidence is computed: the likeliest ones.
const LIKELY: usize = 3;
/// Factors on the log density among which left-out shapes choose for the pose.
const WEIGHTS: [f64; 8] = [0.05, 0.1, 0.15, 0.2, 0.3, 0.45, 0.7, 1.0];
/// Factors on the log density of size among which they choose for the class.
const SIZE_WEIGHTS: [f64; 5] = [0.2, 0.35, 0.5, 0.75, 1.0];

/// Shapes that are left out at first, and what was learned without them.
pub struct LeftOut<'a> {
    /// Of each class, which of its shapes are left out.
    pub held: &'a [Vec<usize>],
    /// Classes learned from the others.
    pub evidence: EvidenceModel,
    /// Weight and offsets of their evidence alone.
    pub evidence_blend: &'a Blend,
    /// Longest side of the shapes, in voxels.
    pub longest_side: usize,
}

/// One view of a shape that was left out.
struct Scored {
    class: usize,
    /// The true component and step of yaw.
    truth: (usize, usize),
    cells: Vec<Cell>,
    /// Log density of each cell's true size; zeros where units are not known.
    log_sizes: Vec<f64>,
    /// Logarithms of the classes' shares of the forest.
    forest: Vec<f64>,
    sample: ViewSample,
}

impl Scored {
    /// F(s) = log Σ exp(weight · score + log prior + size weight · log size) / weight over the cells of each class.
    fn marginal(&self, classes: usize, weight: f64, size_weight: f64) -> Vec<f64> {
        let mut terms = vec![Vec::new(); classes];
        for (cell, size) in self.cells.iter().zip(&self.log_sizes) {
            terms[cell.class].push(value(cell, *size, weight, size_weight));
        }
        terms.iter().map(|of| log_sum_exp(of.iter().copied()) / weight).collect()
    }
}

fn value(cell: &Cell, log_size: f64, weight: f64, size_weight: f64) -> f64 {
    cell.log_weight(weight) + size_weight * log_size
}

/// Fits all of it.
pub fn calibrate(
    densities: CameraDensities,
    parts: &[ComponentShapes],
    left_out: &LeftOut<'_>,
    classes: usize,
    views: &Views<'_>,
) -> Result<CameraCalibration, PerceiveError> {
    let [lowest, highest] = [densities.elevations[0], densities.elevations[densities.elevations.len() - 1]];
    let scores = CameraScores::new(Arc::new(densities));
    let components = scores.components();
    let seed = views.seed;
    let mut chosen: Vec<(usize, usize, usize)> =
        (0..classes).flat_map(|s| (0..left_out.held[s].len()).flat_map(move |i| (0..SEEN).map(move |n| (s, i, n)))).collect();
    chosen.shuffle(&mut stream(seed, 1 << 23, 0));
    chosen.truncate(MOST_SEEN);
    let score = |(class, place, view): &(usize, usize, usize)| -> Option<Scored> {
        let mut rng = stream(seed, 1 << 22 | *class as u64, (*place * SEEN + *view) as u64);
        let (component, at_rest) = rests(parts, *class, left_out.held[*class][*place], &mut rng)?;
        let elevation = lowest + (highest - lowest) * rng.random_range(0.0..1.0);
        let sample = at_rest.see_finely(rng.random_range(0.0..TAU), elevation, views.sensing, &mut rng)?;
        let mut work = ViewWork::default();
        scores.score(&sample.frame, &sample.observation, &KnownPlacement::default(), &vec![true; classes], None, &mut work);
        let cells = std::mem::take(&mut work.cells);
        let log_size = |cell: &Cell| -> f64 {
            let size = components[cell.component].size;
            size.zip(sample.unit_m()).map_or(0.0, |(size, unit)| cell.log_size(&size, unit))
        };
        let log_sizes = cells.iter().map(log_size).collect();
        let angle = sample.yaw(&parts[component].component.rotation());
        let step = (angle.rem_euclid(TAU) / TAU * YAWS as f64).round() as usize % YAWS;
        let mut forest = Vec::new();
        scores.ask_forest(&measured(&sample), &mut forest);
        Some(Scored { class: *class, truth: (component, step), cells, log_sizes, forest, sample })
    };
    let scored: Vec<Scored> = chosen.par_iter().filter_map(score).collect();
    let labels: Vec<usize> = scored.iter().map(|view| view.class).collect();
    let pose_loss = |weight: f64| -> f64 {
        let loss = |view: &Scored| {
            let of_class = || view.cells.iter().zip(&view.log_sizes).filter(|(cell, _)| cell.class == view.class);
            let all: Vec<f64> = of_class().map(|(cell, size)| value(cell, *size, weight, 0.0)).collect();
            let truth = of_class().position(|(cell, _)| (cell.component, cell.step) == view.truth);
            truth.map_or(0.0, |truth| log_sum_exp(all.iter().copied()) - all[truth])
        };
        scored.iter().map(loss).sum::<f64>() / scored.len().max(1) as f64
    };
    let losses = WEIGHTS.map(pose_loss);
    let best = (0..WEIGHTS.len()).min_by(|a, b| losses[*a].total_cmp(&losses[*b])).unwrap_or(0);
    let pose_weight = WEIGHTS[best];
    let sized = components.iter().any(|component| component.size.is_some());
    let size_weights: &[f64] = if sized { &SIZE_WEIGHTS } else { &[0.0] };
    let fits = size_weights.iter().map(|size_weight| {
        let marginals: Vec<Vec<f64>> = scored.iter().map(|view| view.marginal(classes, pose_weight, *size_weight)).collect();
        let fitted = fit_blend(std::slice::from_ref(&marginals), &labels, classes, true)?;
        tracing::debug!(size_weight, log_loss = fitted.log_loss, accuracy = fitted.accuracy, "sizes on shapes that were left out");
        Ok((*size_weight, marginals, fitted))
    });
    let fits: Vec<_> = fits.collect::<Result<_, PerceiveError>>()?;
    let (size_weight, marginals, fitted) =
        fits.into_iter().min_by(|a, b| a.2.log_loss.total_cmp(&b.2.log_loss)).expect("there are weights");
    tracing::debug!(
        pose_weight,
        pose_loss = losses[best],
        log_loss = fitted.log_loss,
        accuracy = fitted.accuracy,
        weight = fitted.weights[0],
        size_weight,
        components = components.len(),
        views = labels.len(),
        "camera densities on shapes that were left out"
    );
    let together = match are_plain(parts) {
        true => weigh_as_they_lie(&scored, &scores, left_out, classes, pose_weight)?,
        false => weigh(&scored, &marginals, left_out, classes, pose_weight, size_weight)?,
    };
    let forests: Vec<Vec<f64>> = scored.iter().map(|view| view.forest.clone()).collect();
    let with_forest = fit_blend(&[marginals, forests], &labels, classes, true)?;
    tracing::debug!(log_loss = with_forest.log_loss, accuracy = with_forest.accuracy, weights = ?with_forest.weights, "with the forest");
    let [hull, forest] = [with_forest.weights[0], with_forest.weights[1]];
    let mut calibration = CameraCalibration {
        pose_weight,
        size_weight: sized.then_some(size_weight),
        blend: Blend { hull: fitted.weights[0], offsets: fitted.offsets, ..Blend::default() },
        with_forest: Some(Blend { hull, forest, offsets: with_forest.offsets, ..Blend::default() }),
        none: None,
        together,
        spread: Some(CameraSpread::ONE),
        views: labels.len(),
        accuracy: with_forest.accuracy,
        log_loss: with_forest.log_loss,
    };
    let samples: Vec<ViewSample> = scored.into_iter().take(MOST_PLACED).map(|view| view.sample).collect();
    calibration.spread = spread(left_out, classes, views.lying, (scores, calibration.clone()), &samples)?;
    tracing::debug!(spread = ?calibration.spread, "deviations of place and size on shapes that were left out");
    Ok(calibration)
}

/// Below which 68.3 % of the values lie, the share of a Gaussian within one deviation; the values are sorted on the way.
fn one_deviation(values: &mut [f64]) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    let at = 0.683 * values.len().saturating_sub(1) as f64;
    let (below, share) = (at.floor() as usize, at.fract());
    let value = |i: usize| values.get(i.min(values.len().saturating_sub(1))).copied().unwrap_or(1.0);
    value(below) + share * (value(below + 1) - value(below))
}

/// By how much deviations of place and size are too small: views are answered as queries are, everything unknown. None where the grids
/// differ in size.
fn spread(
    left_out: &LeftOut<'_>,
    classes: usize,
    lying: bool,
    cameras: (CameraScores, CameraCalibration),
    samples: &[ViewSample],
) -> Result<Option<CameraSpread>, PerceiveError> {
    let wanted = vec![true; classes];
    let answer = |sample: &ViewSample| -> Option<Result<[[f64; 3]; 2], PerceiveError>> {
        if left_out.evidence.dims() != sample.observation.dims() {
            return None;
        }
        let query = sample.query(lying);
        let search = CameraSearch {
            evidence: &left_out.evidence,
            evidence_blend: left_out.evidence_blend,
            longest_side: left_out.longest_side,
            cameras: Some(&cameras),
            query: &query,
            wanted: &wanted,
        };
        let (mut clock, mut out) = (Clock::start(), PerceptScores::default());
        out.start(wanted.len(), true);
        if let Err(error) = search.score(&sample.observation, &mut CameraScratch::default(), &mut clock, &mut out) {
            return Some(Err(error));
        }
        let (placed, found) = out.placement?;
        // The grid of a view lies along its frame.
        let away = placed.translation_voxels - sample.placed.translation_voxels;
        let length = |axis: usize| sample.lengths[axis] * sample.placed.scale;
        Some(Ok([
            std::array::from_fn(|axis| away[axis].abs() / found.position_deviation_voxels[axis].max(1e-6)),
            std::array::from_fn(|axis| (found.extent_voxels[axis] - length(axis)).abs() / found.extent_deviation_voxels[axis].max(1e-6)),
        ]))
    };
    let errors: Vec<[[f64; 3]; 2]> = samples.par_iter().filter_map(answer).collect::<Result<_, _>>()?;
    if errors.len() < FEWEST_PLACED {
        return Ok(None);
    }
    let factor = |which: usize, axis: usize| {
        let mut values: Vec<f64> = errors.iter().map(|error| error[which][axis]).collect();
        one_deviation(&mut values).clamp(LEAST_SPREAD, MOST_SPREAD)
    };
    let factors = |which: usize| std::array::from_fn(|axis| factor(which, axis));
    Ok(Some(CameraSpread { place: factors(0), extent: factors(1) }))
}

/// One of the ways in which a shape rests, drawn by its probability.
fn rests<'a>(parts: &'a [ComponentShapes], class: usize, shape: usize, rng: &mut ChaCha8Rng) -> Option<(usize, &'a AtRest)> {
    let ways: Vec<(usize, &AtRest)> = (0..parts.len())
        .filter(|n| parts[*n].component.class == class)
        .filter_map(|n| parts[n].shapes.iter().find(|at_rest| at_rest.shape == shape).map(|at_rest| (n, at_rest)))
        .collect();
    if let [only] = ways[..] {
        return Some(only);
    }
    draw_by(&ways, |(n, _)| parts[*n].component.probability, rng).copied()
}

/// F and the log evidence of all upright classes where yaw, size and place are told, weighed together; none where the grids differ in size.
fn weigh_as_they_lie(
    scored: &[Scored],
    scores: &CameraScores,
    left_out: &LeftOut<'_>,
    classes: usize,
    pose_weight: f64,
) -> Result<Option<Blend>, PerceiveError> {
    let dims = left_out.evidence.dims();
    if scored.is_empty() || scored.iter().any(|view| view.sample.observation.dims() != dims) {
        return Ok(None);
    }
    let weigh_one = |view: &Scored| -> Result<(Vec<f64>, Vec<f64>), PerceiveError> {
        let ViewSample { frame, observation, placed, .. } = &view.sample;
        let (rotation, scale, place) = frame.seen(placed);
        let told = KnownPlacement { upright: true, yaw: Some(yaw_of(&rotation)), scale: Some(scale), place: Some(place) };
        let mut work = ViewWork::default();
        scores.score(frame, observation, &told, &vec![true; classes], None, &mut work);
        let mut terms = vec![Vec::new(); classes];
        work.cells.iter().for_each(|cell| terms[cell.class].push(pose_weight * cell.score));
        let marginal = terms.iter().map(|of| log_sum_exp(of.iter().copied()) / pose_weight).collect();
        let mut scratch = EvidenceScratch::new(dims);
        left_out.evidence.place(observation, placed, Outside::Unknown, &mut scratch)?;
        let evidence = (0..classes).map(|class| Ok(left_out.evidence.of_class(class, &mut scratch)?.log_ratio));
        Ok((marginal, evidence.collect::<Result<_, PerceiveError>>()?))
    };
    let weighed: Vec<(Vec<f64>, Vec<f64>)> = scored.par_iter().map(weigh_one).collect::<Result<_, _>>()?;
    let (marginals, evidence) = weighed.into_iter().unzip();
    let labels: Vec<usize> = scored.iter().map(|view| view.class).collect();
    let forests = scored.iter().map(|view| view.forest.clone()).collect();
    let both = fit_blend(&[marginals, evidence, forests], &labels, classes, true)?;
    tracing::debug!(log_loss = both.log_loss, accuracy = both.accuracy, weights = ?both.weights, "with the evidence, as they truly lie");
    let [hull, evidence, forest] = [0, 1, 2].map(|n| both.weights[n]);
    Ok(Some(Blend { hull, evidence, forest, offsets: both.offsets, ..Blend::default() }))
}

/// F and the log evidence of the likely classes, each refined as a query's is, weighed together; none where the grids differ in size.
fn weigh(
    scored: &[Scored],
    marginals: &[Vec<f64>],
    left_out: &LeftOut<'_>,
    classes: usize,
    pose_weight: f64,
    size_weight: f64,
) -> Result<Option<Blend>, PerceiveError> {
    let dims = left_out.evidence.dims();
    if scored.is_empty() || scored.iter().any(|view| view.sample.observation.dims() != dims) {
        return Ok(None);
    }
    let weigh_one = |n: usize| -> Result<Vec<f64>, PerceiveError> {
        let view = &scored[n];
        let mut likely: Vec<usize> = (0..classes).collect();
        likely.sort_by(|a, b| marginals[n][*b].total_cmp(&marginals[n][*a]).then(a.cmp(b)));
        likely.truncate(LIKELY);
        let mut codes = Codes::default();
        codes.set(&view.sample.observation, Outside::Unknown);
        let refiner = ModeRefiner {
            evidence: &left_out.evidence,
            seen: &view.sample.observation,
            codes: &codes,
            weight: left_out.evidence_blend.evidence.max(1e-9),
            outside: Outside::Unknown,
            frame: &view.sample.frame,
            told: &KnownPlacement::default(),
            expectation: None,
        };
        let mut scratch = ModeRefinerScratch::new(dims);
        let mut evidence = vec![f64::INFINITY; classes];
        for class in likely {
            let of_class = view.cells.iter().zip(&view.log_sizes).filter(|(cell, _)| cell.class == class);
            let by_value = of_class.map(|(cell, size)| (cell, value(cell, *size, pose_weight, size_weight)));
            let Some((cell, _)) = by_value.max_by(|a, b| a.1.total_cmp(&b.1)) else { continue };
            evidence[class] = refiner.refine(cell, &mut scratch)?.log_evidence;
        }
        let least = evidence.iter().copied().fold(f64::INFINITY, f64::min);
        let least = if least.is_finite() { least } else { 0.0 };
        evidence.iter_mut().filter(|v| !v.is_finite()).for_each(|v| *v = least);
        Ok(evidence)
    };
    let count = scored.len().min(MOST_WEIGHED);
    let evidence: Vec<Vec<f64>> = (0..count).into_par_iter().map(weigh_one).collect::<Result<_, _>>()?;
    let labels: Vec<usize> = scored[..count].iter().map(|view| view.class).collect();
    let forests = scored[..count].iter().map(|view| view.forest.clone()).collect();
    let both = fit_blend(&[marginals[..count].to_vec(), evidence, forests], &labels, classes, true)?;
    tracing::debug!(log_loss = both.log_loss, accuracy = both.accuracy, weights = ?both.weights, "with the evidence, each class as it lies best");
    let [hull, evidence, forest] = [0, 1, 2].map(|n| both.weights[n]);
    Ok(Some(Blend { hull, evidence, forest, offsets: both.offsets, ..Blend::default() }))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// numpy.quantile([1, 2, ..., 11], 0.683)
    #[test]
    fn one_deviation_is_a_quantile() {
        let mut values: Vec<f64> = (1..=11).rev().map(f64::from).collect();
        assert!((one_deviation(&mut values) - 7.83).abs() < 1e-12);
        assert_eq!(one_deviation(&mut [3.0]), 3.0);
    }
}
