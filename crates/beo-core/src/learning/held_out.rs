//! Objects that a fold holds out, scored as queries are; what the calibration is fitted to.

use super::calibration::{Fitted, FittedVoxels, fit_blend, fit_voxels};
use super::error::TrainError;
use super::fit::{Data, Fit, Fold, project};
use super::hull_density::HullMoments;
use super::options::TrainOptions;
use super::progress::Pass;
use crate::lanes::dispatch;
use crate::linear::LinearError;
use crate::model::{Blend, Calibration, CompletionCalibration};
use crate::perception::basis::columns::BlockScratch;
use crate::perception::completion::voxels::{Block, ForEachBlock, Part, Unknown};
use crate::perception::densities::gaussian::log_student;
use crate::perception::evidence::placed::EvidenceModel;
use crate::perception::{ClassSubspace, Conditional, Gaussian, Known};
use faer::{Mat, MatRef};
use rayon::prelude::*;

/// Strengths of the prior, in objects, and degrees of freedom, among which held-out objects choose.
const STRENGTHS: [f64; 4] = [100.0, 300.0, 900.0, 2700.0];
const FREEDOMS: [f64; 4] = [60.0, 200.0, 600.0, 2000.0];
/// Factors on the noise variance, among which held-out objects choose.
const INFLATIONS: [f64; 3] = [4.0, 16.0, 64.0];
/// Weights of hull density, evidence and distance in a model of one class, which has nothing to tell apart: poses are weighed by them too.
/// Those of models of several classes lie about here.
const OF_ONE_CLASS: [f64; 3] = [0.05, 0.02, 3e-3];
/// Held-out objects per model whose evidence is computed; the cheap scores use all.
const EVIDENCE_OBJECTS: usize = 900;
/// Of these, objects whose hidden voxels calibrate the completion, and voxels of each.
const COMPLETED_OBJECTS: usize = 300;
const COMPLETED_VOXELS: usize = 400;

/// Raw scores of the objects that one fold holds out.
pub(super) struct HeldOut {
    labels: Vec<usize>,
    /// For each strength: squared distances and log volumes from which any degrees of freedom follow, by \[object\]\[class\].
    hull: Vec<Vec<Vec<(f64, f64)>>>,
    rank: usize,
    /// Objects (positions in `labels`) whose evidence was computed …
    sampled: Vec<usize>,
    /// … for each inflation, by \[object\]\[class\] …
    evidence: Vec<Vec<Vec<f64>>>,
    /// … and the distance to the class means.
    distance: Vec<Vec<f64>>,
    /// For each inflation: regressors, weight and truth of hidden voxels.
    voxels: Vec<Vec<Voxel>>,
}

/// Regressors, weight and truth of one hidden voxel.
type Voxel = ([f32; 5], f32, bool);

impl HeldOut {
    /// Also gives the classes that were learned without the fold, with the noise variance as it is.
    pub fn measure(data: &Data<'_>, fold: &Fold, options: &TrainOptions, pass: &dyn Fn(Pass)) -> Result<(Self, EvidenceModel), TrainError> {
        let fit = Fit::new(data, &fold.kept, options, pass)?;
        let rank = fit.basis.rank();
        let view = options.views[0];
        let moments = {
            let projected = fit.project_hulls(data, &fold.kept, view);
            HullMoments::new(&projected.iter().map(Mat::as_ref).collect::<Vec<MatRef<'_, f32>>>())
        };
        let object = |position: usize| data.classes[fold.held[position].0][fold.held[position].1];
        let labels: Vec<usize> = fold.held.iter().map(|(s, _)| *s).collect();
        let projected = project(&fit.reading, rank, labels.len(), |i| view.of(object(i)).hull().bits().clone());
        let mut hull = Vec::new();
        for strength in STRENGTHS {
            let by_class: Vec<(Vec<f64>, f64)> = (0..data.classes.len())
                .into_par_iter()
                .map(|s| {
                    let (mean, scale) = moments.density(s, strength);
                    let density = Gaussian::new(&mean, &scale)?;
                    Ok((density.squared_distances(projected.as_ref()), density.log_volume()))
                })
                .collect::<Result<_, LinearError>>()?;
            hull.push((0..labels.len()).map(|i| by_class.iter().map(|(distances, volume)| (distances[i], *volume)).collect()).collect());
        }

        let subspaces: Vec<ClassSubspace> = fit.classes.iter().map(|c| ClassSubspace::of(&fit.reading, &c.model)).collect();
        let share = (EVIDENCE_OBJECTS / options.folds.max(1)).max(1);
        let sampled = sample(&labels, data.classes.len(), share);
        let most_completed = (COMPLETED_OBJECTS / options.folds.max(1)).max(1);
        let completed: Vec<bool> = {
            let chosen = sample(&sampled.iter().map(|p| labels[*p]).collect::<Vec<_>>(), data.classes.len(), most_completed);
            (0..sampled.len()).map(|p| chosen.binary_search(&p).is_ok()).collect()
        };
        type Measured = (Vec<Vec<f64>>, Vec<f64>, Vec<Vec<Voxel>>);
        let measure = |(position, completed): (&usize, &bool)| -> Result<Measured, LinearError> {
            let truth = object(*position);
            let observation = view.of(truth);
            let mut known = Known::new(data.dims);
            fit.reading.take_apart(&observation, &mut known).expect("it is in memory");
            let (mut evidence, mut distance, mut voxels) =
                (vec![Vec::new(); INFLATIONS.len()], Vec::new(), vec![Vec::new(); INFLATIONS.len()]);
            let mut conditionals: Vec<Conditional> = subspaces.iter().map(|s| Conditional::new(s.size())).collect();
            for (class, conditional) in subspaces.iter().zip(&mut conditionals) {
                class.gather(&known, conditional);
                for (inflation, evidence) in INFLATIONS.iter().zip(&mut evidence) {
                    class.solve(fit.noise * inflation, conditional)?;
                    evidence.push(conditional.log_evidence);
                }
                distance.push(-conditional.distance2);
            }
            if *completed && !known.unknown.is_empty() {
                // The class is taken as known here: the calibration then speaks of the shape, not of the classifier.
                let s = labels[*position];
                let hidden: usize = known.unknown.iter().map(|(start, end)| end - start).sum();
                let stride = hidden.div_ceil(COMPLETED_VOXELS);
                let weight = 1.0 / (hidden.div_ceil(stride) * COMPLETED_OBJECTS) as f32;
                for (inflation, voxels) in INFLATIONS.iter().zip(&mut voxels) {
                    subspaces[s].solve(fit.noise * inflation, &mut conditionals[s])?;
                    subspaces[s].prepare(&mut conditionals[s]);
                    let part = Part { weight: 1.0, class: &subspaces[s], posterior: &conditionals[s].posterior };
                    let scratch = &mut BlockScratch::default();
                    let unknown = Unknown { height: data.dims.z(), runs: &known.unknown, parts: std::iter::once(part), scratch };
                    let mut seen = 0;
                    dispatch(ForEachBlock(unknown, |block: &Block| {
                        for lane in block.unknown() {
                            if seen % stride == 0 {
                                voxels.push((block.features(lane).regressors(), weight, truth.bits().contains(block.first + lane)));
                            }
                            seen += 1;
                        }
                    }));
                }
            }
            Ok((evidence, distance, voxels))
        };
        let measured: Vec<Measured> = sampled.par_iter().zip(&completed).map(measure).collect::<Result<_, _>>()?;
        let evidence = (0..INFLATIONS.len()).map(|i| measured.iter().map(|m| m.0[i].clone()).collect()).collect();
        let distance = measured.iter().map(|m| m.1.clone()).collect();
        let voxels = (0..INFLATIONS.len()).map(|i| measured.iter().flat_map(|m| m.2[i].iter().copied()).collect()).collect();
        let model = EvidenceModel::new(fit.reading, subspaces, fit.noise);
        Ok((Self { labels, hull, rank, sampled, evidence, distance, voxels }, model))
    }

    fn hull_scores(&self, strength: usize, freedom: f64) -> Vec<Vec<f64>> {
        let score = |(m, volume): &(f64, f64)| volume + log_student(*m, freedom, self.rank);
        self.hull[strength].iter().map(|row| row.iter().map(score).collect()).collect()
    }
}

/// At most `most` positions, spread evenly over each class (the order within a class is already random), ascending.
fn sample(labels: &[usize], classes: usize, most: usize) -> Vec<usize> {
    let share = most.div_ceil(classes);
    let mut taken = vec![0; classes];
    let keep = |&i: &usize| {
        taken[labels[i]] += 1;
        taken[labels[i]] <= share
    };
    (0..labels.len()).filter(keep).collect()
}

/// Chooses the settings and fits the blends on all held-out objects together.
pub(super) fn calibrate(held_out: &[HeldOut], classes: usize) -> Result<Calibration, TrainError> {
    let all_labels: Vec<usize> = held_out.iter().flat_map(|h| h.labels.iter().copied()).collect();
    let hull_scores =
        |strength: usize, freedom: f64| -> Vec<Vec<f64>> { held_out.iter().flat_map(|h| h.hull_scores(strength, freedom)).collect() };
    let candidates: Vec<(usize, f64)> = (0..STRENGTHS.len()).flat_map(|s| FREEDOMS.map(|f| (s, f))).collect();
    let fits: Vec<(usize, f64, Fitted)> = candidates
        .into_par_iter()
        .map(|(strength, freedom)| {
            let fitted = fit_blend(&[hull_scores(strength, freedom)], &all_labels, classes, true)?;
            Ok((strength, freedom, fitted))
        })
        .collect::<Result<_, LinearError>>()?;
    for (s, f, fitted) in &fits {
        tracing::debug!(
            strength = STRENGTHS[*s],
            freedom = f,
            log_loss = fitted.log_loss,
            accuracy = fitted.accuracy,
            "hull density on held-out objects"
        );
    }
    let (strength, freedom, hull) = fits.into_iter().min_by(|a, b| a.2.log_loss.total_cmp(&b.2.log_loss)).expect("there are candidates");

    let labels: Vec<usize> = held_out.iter().flat_map(|h| h.sampled.iter().map(|p| h.labels[*p])).collect();
    let of_sample = |scores: &dyn Fn(&HeldOut) -> Vec<Vec<f64>>| -> Vec<Vec<f64>> { held_out.iter().flat_map(scores).collect() };
    // What the hull says, calibrated on all held-out objects; the evidence, known for a sample of them, is blended into that.
    let sampled_hull = of_sample(&|h| {
        let scores = h.hull_scores(strength, freedom);
        let calibrated = |row: &Vec<f64>| row.iter().zip(&hull.offsets).map(|(v, o)| hull.weights[0] * v + o).collect();
        h.sampled.iter().map(|p| calibrated(&scores[*p])).collect()
    });
    // One inflation for class and completion, from one factorisation: the class hardly minds, the hidden voxels choose.
    let mut best: Option<(usize, FittedVoxels)> = None;
    for (inflation, factor) in INFLATIONS.iter().enumerate() {
        let voxels: Vec<Voxel> = held_out.iter().flat_map(|h| h.voxels[inflation].iter().copied()).collect();
        let fitted = fit_voxels(&voxels)?;
        tracing::debug!(inflation = factor, log_loss = fitted.log_loss, "hidden voxels of held-out objects");
        if best.as_ref().is_none_or(|(_, other)| fitted.log_loss < other.log_loss) {
            best = Some((inflation, fitted));
        }
    }
    let (inflation, completion) = best.expect("there are candidates");
    let w = completion.weights;
    let evidence = of_sample(&|h| h.evidence[inflation].clone());
    let auto = fit_blend(&[sampled_hull, evidence.clone()], &labels, classes, false)?;
    tracing::debug!(log_loss = auto.log_loss, accuracy = auto.accuracy, weights = ?auto.weights, "hull density and evidence");
    let alone = fit_blend(std::slice::from_ref(&evidence), &labels, classes, false)?;
    let distance = fit_blend(&[of_sample(&|h| h.distance.clone())], &labels, classes, false)?;

    let (mut hull, mut auto, mut alone, mut distance) = (hull, auto, alone, distance);
    if classes == 1 {
        let [of_hull, of_evidence, of_distance] = OF_ONE_CLASS.map(|weight| vec![weight]);
        (hull.weights, alone.weights, distance.weights) = (of_hull, of_evidence, of_distance);
        auto.weights = vec![1.0, 0.0];
    }
    let auto_blend = Blend {
        hull: auto.weights[0] * hull.weights[0],
        evidence: auto.weights[1],
        offsets: hull.offsets.iter().map(|offset| auto.weights[0] * offset).collect(),
        ..Blend::default()
    };
    Ok(Calibration {
        degrees_of_freedom: freedom,
        prior_strength: STRENGTHS[strength],
        hull: Blend { hull: hull.weights[0], offsets: hull.offsets, ..Blend::default() },
        evidence: Blend { evidence: alone.weights[0], offsets: alone.offsets, ..Blend::default() },
        mean: Blend { distance: distance.weights[0], offsets: distance.offsets, ..Blend::default() },
        noise_inflation: INFLATIONS[inflation],
        camera: None,
        completion: CompletionCalibration { constant: w[0], mean: w[1], class_mean: w[2], log_depth: w[3], surface: w[4] },
        objects: labels.len(),
        accuracy: auto.accuracy,
        log_loss: auto.log_loss,
        auto: auto_blend,
    })
}
