//! The fast answers beside the plain ones, with the shipped model.

use crate::class::Reference;
use crate::every_degree::EveryDegree;
use crate::observations::{at_random, from_above, from_the_side, furniture, real_shapes};
use beo_core::grid::{Dims, Observation, Occupancy, Outside, Rotation, Turn, uniform_rotation, yaw, yaw_of};
use beo_core::model::{Model, load};
use beo_core::perception::{CompletionFrame, Perceiver, Percept, PoseSearch, Query};
use rayon::prelude::*;
use std::sync::{Arc, LazyLock};

/// Of probabilities of classes.
pub const POSTERIOR: f64 = 1e-3;
/// Of probabilities and deviations of voxels.
const VOXEL: f64 = 2e-3;

fn shipped() -> Model {
    load(concat!(env!("CARGO_MANIFEST_DIR"), "/models/modelnet10.safetensors").as_ref()).unwrap()
}

pub static REFERENCE: LazyLock<Reference> = LazyLock::new(|| Reference::new(shipped()));
pub static PERCEIVER: LazyLock<Perceiver> = LazyLock::new(|| Perceiver::new(Arc::new(shipped())).unwrap());

fn dims() -> Dims {
    REFERENCE.model.dims()
}

fn answer(observation: &Observation, query: &Query) -> Percept {
    let (mut work, mut percept) = (PERCEIVER.workspace(), Percept::default());
    PERCEIVER.classify(observation, query, &mut work, &mut percept).unwrap().complete().unwrap();
    percept
}

/// Largest differences over some queries.
#[derive(Clone, Copy, Debug, Default)]
struct Differences {
    posterior: f64,
    occupancy: f64,
    deviation: f64,
    other_classes: usize,
}

impl Differences {
    /// Of one query.
    fn of(percept: &Percept, observation: &Observation, log_prior: &[f64]) -> Self {
        let posterior = REFERENCE.posterior(observation, log_prior);
        let completion = REFERENCE.complete(observation, &posterior);
        Self {
            posterior: largest(&percept.posterior, &posterior),
            occupancy: largest_of_voxels(&percept.occupancy, &completion.occupancy),
            deviation: largest_of_voxels(&percept.deviation, &completion.deviation),
            other_classes: usize::from(percept.class != most_probable(&posterior)),
        }
    }

    fn and(self, other: Self) -> Self {
        Self {
            posterior: self.posterior.max(other.posterior),
            occupancy: self.occupancy.max(other.occupancy),
            deviation: self.deviation.max(other.deviation),
            other_classes: self.other_classes + other.other_classes,
        }
    }

    /// Differences that are not numbers are none that are small.
    fn are_small(&self) -> bool {
        self.posterior <= POSTERIOR && self.occupancy <= VOXEL && self.deviation <= VOXEL && self.other_classes == 0
    }
}

pub fn most_probable(posterior: &[f64]) -> usize {
    (0..posterior.len()).max_by(|a, b| posterior[*a].total_cmp(&posterior[*b]).then(b.cmp(a))).unwrap()
}

pub fn largest(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    let differences = a.iter().zip(b).map(|(a, b)| (a - b).abs());
    differences.fold(0.0, |largest, d| if d <= largest { largest } else { d })
}

fn largest_of_voxels(a: &[f32], b: &[f64]) -> f64 {
    largest(&a.iter().map(|v| f64::from(*v)).collect::<Vec<_>>(), b)
}

/// The fast answers to these observations in known pose are the plain ones.
fn agree(observations: &[Observation], log_prior: &[f64]) {
    let query = Query { completion: true, log_prior: log_prior.to_vec(), ..Query::default() };
    let found = observations.par_iter().map(|o| Differences::of(&answer(o, &query), o, log_prior));
    let found = found.reduce(Differences::default, Differences::and);
    assert!(found.are_small(), "{} queries: {found:?}", observations.len());
}

fn seen_from_above(objects: &[Occupancy]) -> Vec<Observation> {
    objects.iter().map(|object| from_above(object, &Rotation::identity())).collect()
}

#[test]
fn furniture_from_above_is_answered_as_by_the_plain_equations() {
    agree(&seen_from_above(&furniture(dims(), 0..6)), &[]);
}

#[test]
fn every_validation_query_is_answered_as_by_the_plain_equations() {
    if let Some(objects) = real_shapes(dims()) {
        agree(&seen_from_above(&objects), &[]);
    }
}

#[test]
fn other_views_are_answered_as_by_the_plain_equations() {
    let objects = furniture(dims(), 20..22);
    let sides = objects.iter().map(from_the_side);
    let parts = objects.iter().enumerate().map(|(i, object)| at_random(object, 0.05 + 0.045 * i as f64, i as u64));
    let turned = objects.iter().enumerate().map(|(i, object)| {
        let third = |n: usize| ((i * n) as f64 * 0.618).fract();
        from_above(object, &uniform_rotation([third(1), third(2), third(3)]))
    });
    agree(&sides.chain(parts).chain(turned).collect::<Vec<_>>(), &[]);
}

#[test]
fn observations_that_say_little_or_all_are_answered_as_by_the_plain_equations() {
    let object = &furniture(dims(), 30..31)[2];
    let nothing = Observation::unknown(dims());
    let mut half_empty = nothing.clone();
    half_empty.set_empty(0..dims().voxels() / 2);
    let mut empty = nothing.clone();
    empty.set_empty(0..dims().voxels());
    let mut one = nothing.clone();
    one.set(dims().index(15, 15, 15), true);
    agree(&[nothing, half_empty, empty, one, Observation::complete(object)], &[]);
}

#[test]
fn a_prior_over_the_classes_counts_as_by_the_plain_equations() {
    let log_prior: Vec<f64> = (0..10).map(|s| -0.3 * f64::from(s)).collect();
    agree(&seen_from_above(&furniture(dims(), 40..42)), &log_prior);
    // Classes that are left out.
    let only: Vec<f64> = (0..10).map(|s| if s % 3 == 0 { 0.0 } else { f64::NEG_INFINITY }).collect();
    agree(&seen_from_above(&furniture(dims(), 40..41)), &only);
}

/// At the pose and with the class posterior that were answered, a search completes as the plain equations do.
#[test]
fn turned_objects_are_completed_as_by_the_plain_equations() {
    let objects = furniture(dims(), 50..52);
    let worst = objects.par_iter().enumerate().map(|(i, object)| {
        let pose = if i % 2 == 0 { PoseSearch::YAW } else { PoseSearch::Full };
        let query = Query { pose, completion: true, frame: CompletionFrame::Object, ..Query::default() };
        let seen = from_above(object, &yaw(0.7 * i as f64));
        let percept = answer(&seen, &query);
        let back = Turn::new(dims(), &percept.rotation_object_to_grid.inverse()).observation(&seen, Outside::Empty);
        let completion = REFERENCE.complete(&back, &percept.posterior);
        largest_of_voxels(&percept.occupancy, &completion.occupancy).max(largest_of_voxels(&percept.deviation, &completion.deviation))
    });
    let worst = worst.reduce(|| 0.0, |a, b| if b <= a { a } else { b });
    assert!(worst <= VOXEL, "{worst}");
}

/// The search over yaw beside every whole degree. Neighbouring angles differ by some nats, as which voxels are nearest changes
/// with every turn: so do the best of all angles and the best whole degree.
fn agree_on_yaw(objects: &[Occupancy]) {
    let query = Query { pose: PoseSearch::YAW, ..Query::default() };
    let compared: Vec<(bool, f64, Option<f64>)> = objects
        .par_iter()
        .enumerate()
        .map(|(i, object)| {
            let seen = from_above(object, &yaw((17.0 * i as f64).to_radians()));
            let percept = answer(&seen, &query);
            let EveryDegree { posterior, best } = REFERENCE.every_degree(&seen);
            let first = &percept.hypotheses[0];
            let off = (yaw_of(&first.rotation).to_degrees() - best[first.class] as f64 + 180.0).rem_euclid(360.0) - 180.0;
            // Only where one pose is likely are both answers bound to be that one.
            let sure = first.probability > 0.9;
            (percept.class != most_probable(&posterior), largest(&percept.posterior, &posterior), sure.then_some(off.abs()))
        })
        .collect();
    let queries = compared.len();
    let others = compared.iter().filter(|c| c.0).count();
    let mut posteriors: Vec<f64> = compared.iter().map(|c| c.1).collect();
    posteriors.sort_by(f64::total_cmp);
    let angles: Vec<f64> = compared.iter().filter_map(|c| c.2).collect();
    let (median, farthest) = (posteriors[queries / 2], angles.iter().copied().fold(0.0, f64::max));
    println!("{queries} queries: {others} of another class, posterior {median:.1e} (median), {} sure, {farthest:.1}°", angles.len());
    assert!(others * 15 <= queries && median <= POSTERIOR && farthest <= 5.0 && angles.len() * 4 > queries);
}

#[test]
fn the_search_over_yaw_finds_what_exhaustive_search_does() {
    agree_on_yaw(&furniture(dims(), 60..63));
    if let Some(objects) = real_shapes(dims()) {
        agree_on_yaw(&objects.into_iter().step_by(15).collect::<Vec<_>>());
    }
}
