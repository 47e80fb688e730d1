//! The paper's protocol, section IV: one query per object, seen from one view, in known or unknown pose.

use super::metrics::{self, CalibrationFigures, completion_errors};
pub use super::metrics::{Milliseconds, PlacementErrors, PlacementFigures, PoseErrors, PoseFigures};
use super::viewpoint::{Posed, Viewpoint};
use beo_core::grid::{Observation, Occupancy, Rotation, Similarity, Turn};
use beo_core::learning::{Shape, ShapeSet};
use beo_core::perception::{Method, PerceiveError, Perceiver, Percept, PoseSearch, Query, ScaleSearch};
use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;
use serde::Serialize;
use std::collections::BTreeMap;
use std::time::Instant;

/// Class, truth and posterior of one query.
#[derive(Clone, Debug, Serialize)]
pub struct Prediction {
    /// Path relative to the folder of shapes.
    pub file: String,
    /// True class.
    pub truth: String,
    /// Most probable class.
    pub class: String,
    /// Posterior of every class.
    pub posterior: BTreeMap<String, f64>,
    /// Angles between the true rotation and the answered one; null in known pose.
    pub pose_error: Option<PoseErrors>,
}

/// How queries are made.
#[derive(Clone, Copy, Debug)]
pub struct Protocol {
    /// From where objects are seen, after their rotation.
    pub viewpoint: Viewpoint,
    /// Seed of the rotations.
    pub seed: u64,
    /// Whether the true class is told.
    pub known_class: bool,
}

/// Queries and accuracy of one class.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct ClassFigures {
    /// Number of queries.
    pub queries: usize,
    /// Share answered rightly.
    pub accuracy: f64,
}

/// Means over the queries of how well the hidden part is predicted.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct CompletionFigures {
    /// Intersection over union over the unknown voxels.
    pub iou_unknown: f64,
    /// The same over all voxels, observed ones as observed.
    pub iou_all: f64,
    /// `iou_unknown` of the mean of the predicted class.
    pub iou_unknown_mean_baseline: f64,
    /// `iou_all` of the mean of the predicted class.
    pub iou_all_mean_baseline: f64,
    /// Euclidean distance to the truth over all voxels.
    pub l2: f64,
}

/// The outcome of one method on all queries.
#[derive(Clone, Debug, Serialize)]
pub struct Evaluation {
    /// How the pose was treated.
    pub pose: &'static str,
    /// From where objects were seen.
    #[serde(flatten)]
    pub viewpoint: Viewpoint,
    /// The method.
    pub method: Method,
    /// Number of queries.
    pub queries: usize,
    /// Share answered rightly.
    pub accuracy: f64,
    /// By true class.
    pub per_class: BTreeMap<String, ClassFigures>,
    /// Counts by true class, then answer.
    pub confusion: BTreeMap<String, BTreeMap<String, usize>>,
    /// Completion.
    pub completion: CompletionFigures,
    /// Rotation errors; null in known pose.
    pub pose_error_deg: Option<PoseFigures>,
    /// Errors of size and place; null where they were known.
    pub placement: Option<PlacementFigures>,
    /// Calibration of the posteriors.
    pub calibration: CalibrationFigures,
    /// Times.
    pub query_ms: Milliseconds,
    /// Every query, in path order.
    pub predictions: Vec<Prediction>,
    /// Euclidean completion error and time of each query, for the figures.
    #[serde(skip)]
    pub per_query: Vec<QueryFigures>,
}

/// The content of the figures for one query.
#[derive(Clone, Copy, Debug)]
pub struct QueryFigures {
    /// Index of the true class.
    pub truth: usize,
    /// Whether the answer was right.
    pub right: bool,
    /// Euclidean completion error.
    pub l2: f64,
    /// Milliseconds.
    pub ms: f64,
    /// Rotation errors, in unknown pose.
    pub pose_error: Option<PoseErrors>,
}

/// A seeded sample of `limit` shapes with classes in proportion, in path order.
pub fn sample(shapes: &ShapeSet, limit: Option<usize>, seed: u64) -> Vec<&Shape> {
    sample_places(shapes, limit, seed).into_iter().map(|place| &shapes.shapes[place]).collect()
}

/// The places of that sample among the shapes.
pub fn sample_places(shapes: &ShapeSet, limit: Option<usize>, seed: u64) -> Vec<usize> {
    let all = &shapes.shapes;
    let Some(limit) = limit.filter(|limit| *limit < all.len()) else { return (0..all.len()).collect() };
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    // Every shape gets the rank of its place within its shuffled class, as a share: the lowest shares are the sample.
    let mut ranked: Vec<(f64, usize)> = Vec::new();
    for class in 0..shapes.classes.len() {
        let mut members: Vec<usize> = (0..all.len()).filter(|i| all[*i].class == class).collect();
        members.shuffle(&mut rng);
        let count = members.len() as f64;
        ranked.extend(members.into_iter().enumerate().map(|(place, i)| ((place as f64 + 0.5) / count, i)));
    }
    ranked.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let mut chosen: Vec<usize> = ranked[..limit].iter().map(|(_, i)| *i).collect();
    chosen.sort_unstable();
    chosen
}

/// Answers all `shapes` with one method. `classes` maps a shape's class to the model's. `seen` is called after each query with
/// the object as it stood, its class, the observation and the percept.
pub fn evaluate(
    perceiver: &Perceiver,
    shapes: &[&Shape],
    classes: &[usize],
    query: &Query,
    protocol: &Protocol,
    mut seen: impl FnMut(&Occupancy, usize, &Observation, &Percept),
) -> Result<Evaluation, PerceiveError> {
    let names: Vec<String> = perceiver.model().class_names().map(str::to_owned).collect();
    let dims = perceiver.model().dims();
    let mut work = perceiver.workspace();
    let mut percept = Percept::default();
    let (mut posteriors, mut truths, mut times) = (Vec::new(), Vec::new(), Vec::new());
    let (mut predictions, mut per_query, mut pose_errors, mut placement) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    let mut turn = Turn::new(dims, &Rotation::identity());
    let mut sums = CompletionFigures::default();
    let mut query = Query { completion: true, ..query.clone() };
    protocol.viewpoint.ask(&mut query);
    let prior = query.log_prior.clone();
    // One unmeasured query first, so that no time includes the first touch of the model.
    if let Some(shape) = shapes.first() {
        let posed = Posed::new(shape, query.pose, protocol.viewpoint, protocol.seed, 0);
        query.camera = posed.camera;
        perceiver.classify(&posed.observation, &query, &mut work, &mut percept)?.complete()?;
    }
    for (place, shape) in shapes.iter().enumerate() {
        let truth = classes[shape.class];
        let posed = Posed::new(shape, query.pose, protocol.viewpoint, protocol.seed, place);
        let Posed { object, observation, .. } = &posed;
        query.camera = posed.camera;
        if protocol.known_class {
            query.log_prior.clear();
            query.log_prior.extend((0..names.len()).map(|s| if s == truth { 0.0 } else { f64::NEG_INFINITY }));
        } else {
            query.log_prior.clone_from(&prior);
        }
        let start = Instant::now();
        perceiver.classify(observation, &query, &mut work, &mut percept)?.complete()?;
        let ms = start.elapsed().as_secs_f64() * 1e3;
        let mut mean: Vec<f32> = (0..dims.voxels()).map(|v| perceiver.class_mean(percept.class, v)).collect();
        if percept.placed != Similarity::default() {
            let upright = mean.clone();
            turn.set_to_grid(&percept.placed);
            turn.values(&upright, 0.0, &mut mean);
        }
        let figures = completion_figures(object, observation, &percept, |v| mean[v]);
        sums.iou_unknown += figures.iou_unknown;
        sums.iou_all += figures.iou_all;
        sums.iou_unknown_mean_baseline += figures.iou_unknown_mean_baseline;
        sums.iou_all_mean_baseline += figures.iou_all_mean_baseline;
        sums.l2 += figures.l2;
        let pose_error = (query.pose != PoseSearch::Known).then(|| posed.errors(shape, query.pose, &percept.rotation_object_to_grid));
        pose_errors.extend(pose_error);
        placement.extend((query.scale != ScaleSearch::Known).then(|| posed.placement_errors(shape, &percept)));
        per_query.push(QueryFigures { truth, right: percept.class == truth, l2: figures.l2, ms, pose_error });
        predictions.push(Prediction {
            file: shape.file.clone(),
            truth: names[truth].clone(),
            class: names[percept.class].clone(),
            posterior: names.iter().cloned().zip(percept.posterior.iter().copied()).collect(),
            pose_error,
        });
        posteriors.push(percept.posterior.clone());
        truths.push(truth);
        times.push(ms);
        seen(object, truth, observation, &percept);
    }
    let n = shapes.len().max(1) as f64;
    let mut per_class = BTreeMap::new();
    let mut confusion: BTreeMap<String, BTreeMap<String, usize>> = BTreeMap::new();
    for (s, name) in names.iter().enumerate() {
        let of_class: Vec<&QueryFigures> = per_query.iter().filter(|q| q.truth == s).collect();
        if !of_class.is_empty() {
            let right = of_class.iter().filter(|q| q.right).count() as f64;
            per_class.insert(name.clone(), ClassFigures { queries: of_class.len(), accuracy: right / of_class.len() as f64 });
        }
    }
    for prediction in &predictions {
        *confusion.entry(prediction.truth.clone()).or_default().entry(prediction.class.clone()).or_default() += 1;
    }
    Ok(Evaluation {
        pose: query.pose.name(),
        viewpoint: protocol.viewpoint,
        method: query.method,
        queries: shapes.len(),
        accuracy: per_query.iter().filter(|q| q.right).count() as f64 / n,
        per_class,
        confusion,
        completion: CompletionFigures {
            iou_unknown: sums.iou_unknown / n,
            iou_all: sums.iou_all / n,
            iou_unknown_mean_baseline: sums.iou_unknown_mean_baseline / n,
            iou_all_mean_baseline: sums.iou_all_mean_baseline / n,
            l2: sums.l2 / n,
        },
        pose_error_deg: (!pose_errors.is_empty()).then(|| metrics::pose_figures(&pose_errors)),
        placement: (!placement.is_empty()).then(|| metrics::placement_figures(&placement)),
        calibration: metrics::calibration(&posteriors, &truths),
        query_ms: metrics::milliseconds(&times),
        predictions,
        per_query,
    })
}

/// Compares one completion with the truth; `mean` is the baseline's value of a voxel.
pub fn completion_figures(
    truth: &Occupancy,
    observation: &Observation,
    percept: &Percept,
    mean: impl Fn(usize) -> f32,
) -> CompletionFigures {
    let answer = completion_errors(truth, observation, |voxel| percept.occupancy[voxel]);
    let baseline = completion_errors(truth, observation, mean);
    CompletionFigures {
        iou_unknown: answer.iou_unknown,
        iou_all: answer.iou_all,
        iou_unknown_mean_baseline: baseline.iou_unknown,
        iou_all_mean_baseline: baseline.iou_all,
        l2: answer.l2,
    }
}
