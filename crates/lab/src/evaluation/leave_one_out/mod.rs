//! Leave one out (section IV-D of the paper, which learns from 19 plugs and completes the last one): every shape is completed by a model
//! that was learned from all others, from one view, in known pose and with its class told.
//!
//! | file | what |
//! | --- | --- |
//! | `view` | the one view |
//! | `baselines` | completions by a training shape, and by the mean of them |
//! | `paired` | means with their standard errors, and paired comparison |
//! | `table` | all of it as text |
//! | `figures` | and as pictures |

mod baselines;
pub mod figures;
mod paired;
mod table;
mod view;

pub use baselines::Baselines;
pub use paired::{Mean, Paired};
pub use table::table;
pub use view::OneView;

use super::metrics::{CompletionErrors, completion_errors};
use beo_core::grid::{Observation, Occupancy, View};
use beo_core::learning::{Shape, ShapeSet};
use beo_core::learning::{Step, TrainError, TrainOptions, train};
use beo_core::perception::{PerceiveError, Perceiver, Percept, Query};
use rayon::prelude::*;
use serde::Serialize;
use std::sync::Arc;
use std::time::Instant;

/// The method whose completions are compared with those of all others.
pub const OURS: &str = "beo";

/// The errors of one left-out shape by every way to complete it.
#[derive(Clone, Debug, Serialize)]
pub struct LeftOut {
    /// Path relative to the folder of shapes.
    pub file: String,
    /// Its class.
    pub class: String,
    /// ShapeSet of its class that were learned from.
    pub learned_from: usize,
    /// Voxels that were not observed.
    pub unknown_voxels: usize,
    /// The completion.
    pub beo: CompletionErrors,
    /// The training shape that agrees best with what was observed, in the place of what was not.
    pub nearest: CompletionErrors,
    /// That shape.
    pub nearest_file: String,
    /// The mean of the training shapes of the class.
    pub mean: CompletionErrors,
    /// A bound, not a method: the training shape that agrees best with the truth.
    pub nearest_by_oracle: CompletionErrors,
    /// That shape.
    pub nearest_by_oracle_file: String,
    /// Seconds of training.
    pub train_s: f64,
    /// Milliseconds of the query, completion included.
    pub query_ms: f64,
}

/// A way to complete: its name, and its errors of a shape.
type Way = (&'static str, fn(&LeftOut) -> &CompletionErrors);

/// A figure of merit: its name, its value, and whether less of it is better.
type Merit = (&'static str, fn(&CompletionErrors) -> f64, bool);

impl LeftOut {
    /// All ways to complete, ours first and the bound last.
    pub const WAYS: [Way; 4] =
        [(OURS, |s| &s.beo), ("nearest", |s| &s.nearest), ("mean", |s| &s.mean), ("nearest_by_oracle", |s| &s.nearest_by_oracle)];
}

impl CompletionErrors {
    /// All figures of merit.
    pub const MERITS: [Merit; 3] = [("iou_unknown", |e| e.iou_unknown, false), ("iou_all", |e| e.iou_all, false), ("l2", |e| e.l2, true)];
}

/// The observation of a left-out shape and its completion, for pictures: turned so that the viewer is above ([`OneView::place`]).
pub struct Example<'a> {
    /// The errors.
    pub errors: &'a LeftOut,
    /// The shape itself.
    pub truth: &'a Occupancy,
    /// The observation of it.
    pub observation: &'a Observation,
    /// Our completion: a probability per voxel.
    pub completion: &'a [f32],
    /// The other ways.
    pub baselines: &'a Baselines<'a>,
}

/// A shape could not be learned without, or not be completed.
#[derive(Debug, thiserror::Error)]
pub enum LeaveOneOutError {
    /// The training failed.
    #[error("without {file}: {source}")]
    Train {
        /// The shape that was left out.
        file: String,
        /// Why.
        source: TrainError,
    },
    /// The query failed.
    #[error("{file}: {source}")]
    Perceive {
        /// The shape that was to be completed.
        file: String,
        /// Why.
        source: PerceiveError,
    },
}

/// Leaves out the shapes at the places `chosen`, each in turn, and completes it from one view. `learning` is told of the training's steps,
/// with the place among `chosen`; `seen` is called after each shape.
///
/// Models are learned for that view: their calibration is of what it hides. The same shapes and options give the same errors, whatever
/// the number of threads.
///
/// # Errors
/// [`LeaveOneOutError`], at the first shape.
pub fn leave_one_out(
    mut shapes: ShapeSet,
    chosen: &[usize],
    view: OneView,
    options: &TrainOptions,
    learning: &(dyn Fn(usize, Step) + Sync),
    mut seen: impl FnMut(Example<'_>),
) -> Result<Vec<LeftOut>, LeaveOneOutError> {
    shapes.shapes.par_iter_mut().filter(|_| view != OneView::Top).for_each(|shape| shape.object = view.turned(&shape.object));
    let mut outcome = Vec::new();
    for (n, &place) in chosen.iter().enumerate() {
        let shape = shapes.shapes.remove(place);
        outcome.push(complete_one(&shapes, &shape, options, &|step| learning(n, step), &mut seen)?);
        shapes.shapes.insert(place, shape);
    }
    Ok(outcome)
}

/// Learns from `others`, and completes `shape` seen from above.
fn complete_one(
    others: &ShapeSet,
    shape: &Shape,
    options: &TrainOptions,
    learning: &(dyn Fn(Step) + Sync),
    seen: &mut impl FnMut(Example<'_>),
) -> Result<LeftOut, LeaveOneOutError> {
    let start = Instant::now();
    let options = TrainOptions { poses: false, ..options.clone() };
    let model = train(others, &options, learning).map_err(|source| LeaveOneOutError::Train { file: shape.file.clone(), source })?;
    let train_s = start.elapsed().as_secs_f64();
    let observation = View::Top.of(&shape.object);
    let (percept, query_ms) =
        complete(model, &observation, shape.class).map_err(|source| LeaveOneOutError::Perceive { file: shape.file.clone(), source })?;

    let truth = &shape.object;
    let baselines = Baselines::new(others.shapes.iter().filter(|other| other.class == shape.class), &observation, truth);
    let voxels = truth.dims().voxels();
    let of_shape = |other: &Shape| completion_errors(truth, &observation, |voxel| baselines.by_shape(other, voxel));
    let errors = LeftOut {
        file: shape.file.clone(),
        class: others.classes[shape.class].clone(),
        learned_from: baselines.shapes,
        unknown_voxels: voxels - observation.known().count_ones(..),
        beo: completion_errors(truth, &observation, |voxel| percept.occupancy[voxel]),
        nearest: of_shape(baselines.nearest),
        nearest_file: baselines.nearest.file.clone(),
        mean: completion_errors(truth, &observation, |voxel| baselines.by_mean(voxel)),
        nearest_by_oracle: of_shape(baselines.nearest_by_oracle),
        nearest_by_oracle_file: baselines.nearest_by_oracle.file.clone(),
        train_s,
        query_ms,
    };
    seen(Example { errors: &errors, truth, observation: &observation, completion: &percept.occupancy, baselines: &baselines });
    Ok(errors)
}

/// Completes one observation in known pose, its class told; with the milliseconds that it took.
fn complete(model: beo_core::model::Model, observation: &Observation, class: usize) -> Result<(Percept, f64), PerceiveError> {
    let log_prior = (0..model.classes.len()).map(|s| if s == class { 0.0 } else { f64::NEG_INFINITY }).collect();
    let query = Query { log_prior, completion: true, ..Query::default() };
    let perceiver = Perceiver::new(Arc::new(model))?;
    let (mut work, mut percept) = (perceiver.workspace(), Percept::default());
    let start = Instant::now();
    perceiver.classify(observation, &query, &mut work, &mut percept)?.complete()?;
    Ok((percept, start.elapsed().as_secs_f64() * 1e3))
}

/// The outcome at one resolution.
#[derive(Clone, Debug, Serialize)]
pub struct Outcome {
    /// Voxels along each side of the grid.
    pub resolution: usize,
    /// ShapeSet that were left out.
    pub shapes: usize,
    /// Mean errors by way of completion and figure of merit.
    pub summary: Named<Named<Mean>>,
    /// Our completions against each other way, shape by shape, by figure of merit.
    pub paired: Named<Named<Paired>>,
    /// Every shape, in path order.
    pub per_shape: Vec<LeftOut>,
}

/// Values by name, in their order.
#[derive(Clone, Debug)]
pub struct Named<T>(pub Vec<(&'static str, T)>);

impl<T: Serialize> Serialize for Named<T> {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_map(self.0.iter().map(|(name, value)| (name, value)))
    }
}

impl<T> Named<T> {
    /// Values by figure of merit.
    fn by_merit(of: impl Fn(&Merit) -> T) -> Self {
        Self(CompletionErrors::MERITS.iter().map(|merit| (merit.0, of(merit))).collect())
    }

    /// The value of a name.
    pub fn get(&self, name: &str) -> Option<&T> {
        self.0.iter().find(|(known, _)| *known == name).map(|(_, value)| value)
    }
}

impl Outcome {
    /// Sums up the errors of all shapes.
    pub fn new(resolution: usize, per_shape: Vec<LeftOut>) -> Self {
        let values = |way: &Way, merit: &Merit| -> Vec<f64> { per_shape.iter().map(|shape| merit.1(way.1(shape))).collect() };
        let [ours, others @ ..] = &LeftOut::WAYS;
        let mean_of = |way: &Way| (way.0, Named::by_merit(|merit| Mean::of(&values(way, merit))));
        let compared_with = |way: &Way| {
            let compare = |merit: &Merit| {
                let gain = if merit.2 { -1.0 } else { 1.0 };
                let (ours, theirs) = (values(ours, merit), values(way, merit));
                Paired::of(&ours.iter().zip(theirs).map(|(ours, theirs)| gain * (ours - theirs)).collect::<Vec<_>>())
            };
            (way.0, Named::by_merit(compare))
        };
        Self {
            resolution,
            shapes: per_shape.len(),
            summary: Named(LeftOut::WAYS.iter().map(mean_of).collect()),
            paired: Named(others.iter().map(compared_with).collect()),
            per_shape,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use beo_core::grid::Dims;

    /// Boxes of several widths, depths and heights, all on one ground and against one wall: what they hide is filled down to the one and back
    /// to the other.
    fn boxes(dims: Dims) -> ShapeSet {
        let size = |n: usize| [3 + n % 4, 4 + n / 4 % 3, 3 + n * 5 % 7];
        let object = |n: usize| {
            let [x, y, z] = size(n);
            Occupancy::from_fn(dims, |i, j, k| (9 - x..9).contains(&i) && (2..2 + y).contains(&j) && (1..1 + z).contains(&k))
        };
        let shapes = (0..12).map(|n| Shape { object: object(n), class: 0, file: format!("box/{n}") }).collect();
        ShapeSet { classes: vec!["box".into()], shapes, ..ShapeSet::default() }
    }

    #[test]
    fn boxes_are_completed_by_others_from_above_and_from_the_side() {
        let dims = Dims::new(12, 10, 14).unwrap();
        for view in [OneView::Top, OneView::Side] {
            let (shapes, chosen) = (boxes(dims), [1, 4, 5, 6, 9]);
            let objects: Vec<Occupancy> = shapes.shapes.iter().map(|shape| shape.object.clone()).collect();
            let mut drawn = Vec::new();
            let outcome = leave_one_out(shapes, &chosen, view, &TrainOptions::default(), &|_, _| {}, |example| {
                assert_eq!(example.truth, &view.turned(&objects[chosen[drawn.len()]]));
                // Nothing that was observed is changed.
                for (voxel, p) in example.completion.iter().enumerate().filter(|(voxel, _)| example.observation.known().contains(*voxel)) {
                    assert_eq!(*p, f32::from(example.observation.code(voxel)));
                }
                drawn.push(example.errors.file.clone());
            })
            .unwrap();
            for (shape, place) in outcome.iter().zip(chosen) {
                assert_eq!((shape.file.clone(), shape.learned_from), (format!("box/{place}"), 11));
                assert!(shape.nearest_file != shape.file && shape.nearest_by_oracle_file != shape.file);
                assert!(shape.nearest_by_oracle.iou_unknown >= shape.nearest.iou_unknown);
                assert!(shape.unknown_voxels > 0);
            }
            assert_eq!(drawn, outcome.iter().map(|shape| shape.file.clone()).collect::<Vec<_>>());
            let outcome = Outcome::new(14, outcome);
            let mean = |way: &str| outcome.summary.get(way).unwrap().get("iou_unknown").unwrap().mean;
            assert!(mean("beo") > 0.9 && mean("beo") > mean("mean"), "{view:?}: {} {}", mean("beo"), mean("mean"));
        }
    }

    #[test]
    fn a_shape_that_cannot_be_learned_without_is_named() {
        let mut shapes = boxes(Dims::cube(14).unwrap());
        shapes.shapes.truncate(4);
        let error = leave_one_out(shapes, &[2], OneView::Top, &TrainOptions::default(), &|_, _| {}, |_| {}).unwrap_err();
        assert!(error.to_string().starts_with("without box/2: class `box` has 3 shapes, at least 4"), "{error}");
    }

    #[test]
    fn less_distance_and_more_overlap_are_better() {
        let errors = |iou_unknown: f64, l2: f64| CompletionErrors { iou_unknown, iou_all: iou_unknown, l2 };
        let shape = |n: usize| LeftOut {
            file: n.to_string(),
            class: "a".into(),
            learned_from: 4,
            unknown_voxels: 9,
            beo: errors(0.5 + 0.1 * n as f64, 2.0 + n as f64),
            nearest: errors(0.4, 4.5),
            nearest_file: String::new(),
            mean: errors(0.5, 2.0),
            nearest_by_oracle: errors(0.9, 1.0),
            nearest_by_oracle_file: String::new(),
            train_s: 0.0,
            query_ms: 0.0,
        };
        let outcome = Outcome::new(30, (0..4).map(shape).collect());
        let counts = |way: &str, merit: &str| {
            let paired = outcome.paired.get(way).unwrap().get(merit).unwrap();
            [paired.better, paired.worse, paired.equal]
        };
        assert_eq!((counts("nearest", "iou_unknown"), counts("nearest", "l2")), ([4, 0, 0], [3, 1, 0]));
        assert_eq!((counts("mean", "iou_unknown"), counts("mean", "l2")), ([3, 0, 1], [0, 3, 1]));
        let text = table(&[outcome], OneView::Side);
        assert!(text.contains("from the side") && text.contains("0.650 ± 0.065"), "{text}");
        assert!(text.lines().any(|line| line.contains("nearest by oracle") && line.contains("0   4   0")), "{text}");
    }
}
