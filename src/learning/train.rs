//! The training driver: one fit on all shapes, and fits on folds from whose held-out objects the calibration is learned.

use super::basis::{ClassBasis, shared_basis};
use super::calibration::{Fitted, FittedVoxels, fit_blend, fit_voxels};
use super::camera_density::{LeftOut, camera_densities};
use super::gram::overlaps;
use super::hull_density::HullMoments;
use super::shrinkage::{centre, shrunk_covariance};
use super::view_density::view_densities;
use crate::grid::{Dims, Occupancy, View};
use crate::linear::LinearError;
use crate::model::{
    Basis, Blend, Calibration, ClassInfo, ClassModel, CompletionCalibration, FORMAT_VERSION, HullDensity, Metadata, Model, Settings,
};
use crate::perception::completion::{Block, ForEachBlock, Part, Unknown};
use crate::perception::lanes::dispatch;
use crate::perception::{ClassSubspace, ColumnSums, Conditional, Density, Known};
use crate::shapes::library::Shapes;
use faer::{Mat, MatRef};
use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

/// Fewest shapes of a class.
pub const FEWEST_SHAPES: usize = 4;
/// Least noise variance, relative to a voxel's variance about the class mean: as many components as there are shapes leave none, and
/// unseen shapes then seem impossible. Classes with shapes enough are far above it.
const LEAST_NOISE: f64 = 0.05;

/// How to train.
#[derive(Clone, Debug)]
pub struct TrainOptions {
    /// Views to simulate.
    pub views: Vec<View>,
    /// Elevations of the cameras to be met, degrees above the horizontal, ascending: densities of what they see are learned; none for none.
    pub camera_elevations_deg: Vec<f64>,
    /// Share of the variance that sizes a class basis.
    pub variance_share: f64,
    /// Least and most components of a class basis.
    pub basis_range: [usize; 2],
    /// Seed of the folds.
    pub seed: u64,
    /// Number of folds, at least two.
    pub folds: usize,
    /// Splits that the shapes come from, for the record.
    pub splits: Vec<String>,
    /// Longest side of a mesh in voxels, for the record.
    pub longest_side: usize,
    /// Terms of the data, for the record.
    pub licence: String,
}

impl Default for TrainOptions {
    /// The paper's basis sizes, top views, three folds.
    fn default() -> Self {
        Self {
            views: vec![View::Top],
            camera_elevations_deg: Vec::new(),
            variance_share: 0.6,
            basis_range: [30, 70],
            seed: 0,
            folds: 3,
            splits: vec!["train".into()],
            longest_side: 24,
            licence: String::new(),
        }
    }
}

/// Training failed.
#[derive(Debug, thiserror::Error)]
pub enum TrainError {
    /// A class has too few shapes.
    #[error("class `{class}` has {found} shapes, at least {FEWEST_SHAPES} are needed: add shapes or remove its folder")]
    TooFew {
        /// The class.
        class: String,
        /// Its shapes.
        found: usize,
    },
    /// There is no class, or no view.
    #[error("nothing to learn: no class of shapes, or no view to simulate")]
    Nothing,
    /// Shapes have different dims.
    #[error("{file} is a grid of {found}, others are of {expected}: give all shapes one resolution")]
    Dims {
        /// The shape.
        file: String,
        /// Its size.
        found: Dims,
        /// The size of the first shape.
        expected: Dims,
    },
    /// A matrix could not be factorised.
    #[error(transparent)]
    Linear(#[from] LinearError),
}

/// A step of the training, for progress reports.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Step {
    /// What is being done.
    pub name: &'static str,
    /// Steps done before this one.
    pub done: usize,
    /// All steps.
    pub total: usize,
}

/// Strengths of the prior, in objects, and degrees of freedom, among which held-out objects choose.
const STRENGTHS: [f64; 4] = [100.0, 300.0, 900.0, 2700.0];
const FREEDOMS: [f64; 4] = [60.0, 200.0, 600.0, 2000.0];
/// Factors on the noise variance, among which held-out objects choose.
const INFLATIONS: [f64; 3] = [4.0, 16.0, 64.0];
/// Held-out objects per model whose evidence is computed; the cheap scores use all.
const EVIDENCE_OBJECTS: usize = 900;
/// Of these, objects whose hidden voxels calibrate the completion, and voxels of each.
const COMPLETED_OBJECTS: usize = 300;
const COMPLETED_VOXELS: usize = 400;

/// Learns a model. The same shapes and options give the same model, whatever the number of threads.
pub fn train(shapes: &Shapes, options: &TrainOptions, progress: &(dyn Fn(Step) + Sync)) -> Result<Model, TrainError> {
    let data = Data::new(shapes, options)?;
    let folds = data.folds(options);
    let cameras = !options.camera_elevations_deg.is_empty();
    let total = folds.len() + 3 + usize::from(cameras);
    let step = |name, done| progress(Step { name, done, total });

    let mut held_out = Vec::new();
    // What was learned without the first fold also scores what cameras see of it.
    let mut first: Option<(Vec<ClassSubspace>, f64)> = None;
    for (f, fold) in folds.iter().enumerate() {
        step("fitting without a fold, scoring it", f);
        let (measured, fit) = HeldOut::measure(&data, fold, options)?;
        held_out.push(measured);
        if f == 0 && cameras {
            first = Some(fit);
        }
    }
    step("calibrating on held-out objects", folds.len());
    let mut calibration = calibrate(&held_out, data.classes.len())?;
    drop(held_out);

    step("fitting on all shapes", folds.len() + 1);
    let everything: Vec<Vec<usize>> = data.classes.iter().map(|c| (0..c.len()).collect()).collect();
    let fit = Fit::new(&data, &everything, options)?;
    let hulls: Vec<HullMoments> = options
        .views
        .iter()
        .map(|view| {
            let projected = fit.project_hulls(&data, &everything, *view);
            HullMoments::new(&projected.iter().map(Mat::as_ref).collect::<Vec<_>>())
        })
        .collect();
    step("learning views from all sides", folds.len() + 2);
    let view_densities = view_densities(&data.classes, options.seed)?;
    let mut camera = None;
    if cameras {
        step("learning what cameras see", folds.len() + 3);
        let elevations: Vec<f64> = options.camera_elevations_deg.iter().map(|e| e.to_radians()).collect();
        let of = |chosen: &dyn Fn(usize) -> Vec<usize>| -> Vec<Vec<&Occupancy>> {
            (0..data.classes.len()).map(|s| chosen(s).into_iter().map(|i| data.classes[s][i]).collect()).collect()
        };
        let fold = &folds[0];
        let (subspaces, noise) = first.take().unwrap_or_default();
        let left_out = LeftOut {
            kept: of(&|s| fold.kept[s].clone()),
            held: of(&|s| fold.held.iter().filter(|(class, _)| *class == s).map(|(_, i)| *i).collect()),
            subspaces,
            noise: noise * calibration.noise_inflation,
        };
        let learned = camera_densities(&data.classes, &left_out, &elevations, options.seed)?;
        calibration.camera = Some(learned.calibration);
        camera = Some(learned.densities);
    }
    let (mut infos, mut classes) = (Vec::new(), Vec::new());
    for (s, class) in fit.classes.into_iter().enumerate() {
        let (_, centred) = centre(class.projected.as_ref());
        let shrunk = shrunk_covariance(&centred);
        let a = centred.ncols();
        infos.push(ClassInfo {
            name: shapes.classes[s].clone(),
            shapes: data.classes[s].len(),
            basis_size: class.model.variances.len(),
            explained: class.explained,
            noise_variance: class.noise_variance,
            shrinkage: shrunk.intensity,
        });
        let hull = |moments: &HullMoments| {
            let (mean, covariance) = moments.density(s, calibration.prior_strength);
            HullDensity { mean, covariance }
        };
        classes.push(ClassModel {
            covariance: (0..a * a).map(|v| shrunk.covariance[((v / a).max(v % a), (v / a).min(v % a))] as f32).collect(),
            hulls: hulls.iter().map(hull).collect(),
            ..class.model
        });
    }
    let metadata = Metadata {
        format_version: FORMAT_VERSION,
        beo_version: env!("CARGO_PKG_VERSION").into(),
        licence: options.licence.clone(),
        dims: data.dims,
        classes: infos,
        noise_variance: fit.noise,
        calibration,
        settings: Settings {
            splits: options.splits.clone(),
            views: options.views.clone(),
            camera_elevations_deg: options.camera_elevations_deg.clone(),
            variance_share: options.variance_share,
            basis_range: options.basis_range,
            longest_side: options.longest_side,
            seed: options.seed,
            folds: options.folds,
        },
    };
    Ok(Model { id: 0, metadata, basis: fit.basis, classes, view_densities, camera_densities: camera })
}

/// The shapes by class, and their inner products.
struct Data<'a> {
    dims: Dims,
    classes: Vec<Vec<&'a Occupancy>>,
    overlaps: Vec<Mat<f64>>,
}

/// Which shapes of each class a fold trains on, and which it holds out.
struct Fold {
    kept: Vec<Vec<usize>>,
    held: Vec<(usize, usize)>,
}

impl<'a> Data<'a> {
    fn new(shapes: &'a Shapes, options: &TrainOptions) -> Result<Self, TrainError> {
        let Some(first) = shapes.shapes.first() else { return Err(TrainError::Nothing) };
        if options.views.is_empty() {
            return Err(TrainError::Nothing);
        }
        let dims = first.object.dims();
        let mut classes = vec![Vec::new(); shapes.classes.len()];
        for shape in &shapes.shapes {
            let found = shape.object.dims();
            if found != dims {
                return Err(TrainError::Dims { file: shape.file.clone(), found, expected: dims });
            }
            classes[shape.class].push(&shape.object);
        }
        if let Some(s) = classes.iter().position(|c| c.len() < FEWEST_SHAPES) {
            return Err(TrainError::TooFew { class: shapes.classes[s].clone(), found: classes[s].len() });
        }
        let overlaps = classes.iter().map(|c| overlaps(c)).collect();
        Ok(Self { dims, classes, overlaps })
    }

    /// Stratified folds by a seeded shuffle of each class.
    fn folds(&self, options: &TrainOptions) -> Vec<Fold> {
        let count = options.folds.clamp(2, FEWEST_SHAPES);
        let mut rng = ChaCha8Rng::seed_from_u64(options.seed);
        let mut folds: Vec<Fold> = (0..count).map(|_| Fold { kept: vec![Vec::new(); self.classes.len()], held: Vec::new() }).collect();
        for (s, class) in self.classes.iter().enumerate() {
            let mut order: Vec<usize> = (0..class.len()).collect();
            order.shuffle(&mut rng);
            for (position, &i) in order.iter().enumerate() {
                for (f, fold) in folds.iter_mut().enumerate() {
                    if position % count == f { fold.held.push((s, i)) } else { fold.kept[s].push(i) }
                }
            }
        }
        for fold in &mut folds {
            fold.kept.iter_mut().for_each(|kept| kept.sort_unstable());
        }
        folds
    }
}

/// Bases and classes learned from some of the shapes.
struct Fit {
    basis: Basis,
    sums: ColumnSums,
    classes: Vec<ClassFit>,
    noise: f64,
}

struct ClassFit {
    /// Without covariance and hulls.
    model: ClassModel,
    /// The class's objects in W', n_s × a.
    projected: Mat<f32>,
    explained: f64,
    noise_variance: f64,
}

impl Fit {
    fn new(data: &Data<'_>, kept: &[Vec<usize>], options: &TrainOptions) -> Result<Self, TrainError> {
        let range = options.basis_range[0]..=options.basis_range[1];
        let bases: Vec<ClassBasis> = (0..kept.len())
            .into_par_iter()
            .map(|s| {
                let rows = &kept[s];
                let overlaps = Mat::from_fn(rows.len(), rows.len(), |i, j| data.overlaps[s][(rows[i], rows[j])]);
                ClassBasis::new(&overlaps, data.dims.voxels(), options.variance_share, range.clone())
            })
            .collect::<Result<_, _>>()?;
        let shapes: Vec<Vec<&Occupancy>> =
            kept.iter().enumerate().map(|(s, rows)| rows.iter().map(|i| data.classes[s][*i]).collect()).collect();
        let parts: Vec<_> = shapes.iter().map(Vec::as_slice).zip(&bases).collect();
        let basis = shared_basis(data.dims, &parts)?;
        let sums = ColumnSums::new(data.dims, &basis);
        let objects: f64 = kept.iter().map(|rows| rows.len() as f64).sum();
        let mean = |of: fn(&ClassBasis) -> f64| bases.iter().zip(kept).map(|(b, rows)| of(b) * rows.len() as f64).sum::<f64>() / objects;
        let noise = mean(|b| b.vbpca.noise_variance).max(LEAST_NOISE * mean(|b| b.voxel_variance));
        let classes = bases
            .iter()
            .zip(&shapes)
            .map(|(class, shapes)| {
                let projected = project(&sums, basis.rank(), shapes.len(), |i| shapes[i].bits().clone());
                let directions = class.directions(projected.as_ref());
                let (mean, _) = centre(projected.as_ref());
                ClassFit {
                    model: ClassModel {
                        mean: mean.iter().map(|v| *v as f32).collect(),
                        covariance: Vec::new(),
                        directions: (0..directions.ncols()).flat_map(|h| directions.col_as_slice(h).to_vec()).collect(),
                        variances: class.vbpca.components.iter().map(|c| c.variance).collect(),
                        hulls: Vec::new(),
                    },
                    projected,
                    explained: class.explained,
                    noise_variance: class.vbpca.noise_variance,
                }
            })
            .collect();
        Ok(Self { basis, sums, classes, noise })
    }

    /// Projections of the hulls of some shapes of each class, n_s × a.
    fn project_hulls(&self, data: &Data<'_>, chosen: &[Vec<usize>], view: View) -> Vec<Mat<f32>> {
        let hull = |s: usize, i: usize| view.of(data.classes[s][chosen[s][i]]).hull().bits().clone();
        (0..chosen.len()).map(|s| project(&self.sums, self.basis.rank(), chosen[s].len(), |i| hull(s, i))).collect()
    }
}

/// Projects `count` binary vectors, one per row.
fn project(sums: &ColumnSums, rank: usize, count: usize, bits: impl Fn(usize) -> fixedbitset::FixedBitSet + Sync) -> Mat<f32> {
    let rows: Vec<Vec<f32>> = (0..count)
        .into_par_iter()
        .map(|i| {
            let mut row = vec![0.0; rank];
            sums.project(&bits(i), &mut row);
            row
        })
        .collect();
    Mat::from_fn(count, rank, |i, j| rows[i][j])
}

/// Raw scores of the objects that one fold holds out.
struct HeldOut {
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
    /// Also gives the class subspaces that were learned without the fold, and the noise variance.
    fn measure(data: &Data<'_>, fold: &Fold, options: &TrainOptions) -> Result<(Self, (Vec<ClassSubspace>, f64)), TrainError> {
        let fit = Fit::new(data, &fold.kept, options)?;
        let rank = fit.basis.rank();
        let view = options.views[0];
        let moments = {
            let projected = fit.project_hulls(data, &fold.kept, view);
            HullMoments::new(&projected.iter().map(Mat::as_ref).collect::<Vec<MatRef<'_, f32>>>())
        };
        let object = |position: usize| data.classes[fold.held[position].0][fold.held[position].1];
        let labels: Vec<usize> = fold.held.iter().map(|(s, _)| *s).collect();
        let projected = project(&fit.sums, rank, labels.len(), |i| view.of(object(i)).hull().bits().clone());
        let mut hull = Vec::new();
        for strength in STRENGTHS {
            let by_class: Vec<(Vec<f64>, f64)> = (0..data.classes.len())
                .into_par_iter()
                .map(|s| {
                    let (mean, scale) = moments.density(s, strength);
                    let density = Density::new(&mean, &scale)?;
                    Ok((density.distances2(projected.as_ref()), density.log_volume()))
                })
                .collect::<Result<_, LinearError>>()?;
            hull.push((0..labels.len()).map(|i| by_class.iter().map(|(distances, volume)| (distances[i], *volume)).collect()).collect());
        }

        let subspaces: Vec<ClassSubspace> = fit.classes.iter().map(|c| ClassSubspace::new(data.dims, &fit.basis, &c.model)).collect();
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
            known.read(&observation);
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
                    let unknown = Unknown { height: data.dims.z(), runs: &known.unknown, parts: std::iter::once(part) };
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
        Ok((Self { labels, hull, rank, sampled, evidence, distance, voxels }, (subspaces, fit.noise)))
    }

    fn hull_scores(&self, strength: usize, freedom: f64) -> Vec<Vec<f64>> {
        let a = self.rank as f64;
        let score = |(m, volume): &(f64, f64)| volume - 0.5 * (freedom + a) * (m / freedom).ln_1p();
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
fn calibrate(held_out: &[HeldOut], classes: usize) -> Result<Calibration, TrainError> {
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

    let auto_blend = Blend {
        hull: auto.weights[0] * hull.weights[0],
        evidence: auto.weights[1],
        distance: 0.0,
        offsets: hull.offsets.iter().map(|offset| auto.weights[0] * offset).collect(),
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
