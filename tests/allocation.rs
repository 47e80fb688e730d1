//! A query in known pose, turned about z and seen as the model's densities expect, or of what a camera sees, allocates nothing once its memory
//! is warm: counted by an allocator that counts.
//!
//! It runs on one thread, as it does in the daemon, so that whatever it allocates is counted.

use beo_core::grid::{Observation, Outside, View, yaw};
use beo_core::perception::{Method, Perceiver, Percept, PoseSearch, Query, RotationPrior, ScaleSearch};
use beo_core::simulation::{self, Eye};
use beo_shapes::furniture;
use std::path::Path;
use std::sync::Arc;

/// From above, from the side, with voxels left out at random, nothing seen, nothing filled.
fn observations(perceiver: &Perceiver) -> Vec<Observation> {
    let dims = perceiver.model().dims();
    let mut all = vec![Observation::unknown(dims), Observation::from_bytes(dims, &vec![0; dims.voxels()]).unwrap()];
    for (seed, class) in (0..).zip(furniture::CLASSES.iter().cycle().take(30)) {
        let object = furniture::make(class, dims, seed).unwrap();
        all.push(View::Top.of(&object));
        let mut some = Observation::unknown(dims);
        (0..dims.voxels()).filter(|v| !(v * 7919 + seed as usize).is_multiple_of(3)).for_each(|v| some.set(v, object.bits().contains(v)));
        all.push(some);
    }
    all
}

fn perceiver() -> Perceiver {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("models/modelnet10.safetensors");
    Perceiver::new(Arc::new(beo_core::model::load(&file).unwrap())).unwrap()
}

/// Asks once to warm up, and once to count.
fn count(perceiver: &Perceiver, observations: &[Observation], query: &Query) {
    let (mut work, mut percept) = (perceiver.workspace(), Percept::default());
    let mut answer = |observation: &Observation| {
        perceiver.classify(observation, query, &mut work, &mut percept).unwrap().complete().unwrap();
    };
    observations.iter().for_each(&mut answer);
    for (number, observation) in observations.iter().enumerate() {
        let counted = allocation_counter::measure(|| answer(observation));
        assert_eq!((counted.count_total, counted.bytes_total), (0, 0), "{query:?}, observation {number}");
    }
}

/// What cameras see of furniture, and where they were.
fn seen_by_cameras(perceiver: &Perceiver) -> Vec<(Observation, Query)> {
    let dims = perceiver.model().dims();
    let seen = furniture::CLASSES.iter().cycle().take(12).zip(0..).map(|(class, seed)| {
        let object = furniture::make(class, dims, seed).unwrap();
        let eye = Eye { azimuth: 0.7 * seed as f64, elevation: 0.6, distance: 70.0 };
        let outside = Outside::Unknown;
        let query = Query { camera: Some(eye.position()), pose: PoseSearch::YAW, outside, completion: true, ..Query::default() };
        (simulation::observe(&object, &eye), query)
    });
    seen.collect()
}

#[test]
fn a_query_of_what_a_camera_sees_allocates_nothing_once_warm() {
    let perceiver = perceiver();
    let seen = seen_by_cameras(&perceiver);
    for (scale, followed) in
        [(ScaleSearch::Known, false), (ScaleSearch::Search { side: None }, false), (ScaleSearch::Search { side: None }, true)]
    {
        let (mut work, mut percept) = (perceiver.workspace(), Percept::default());
        let mut answer = |(observation, query): &(Observation, Query)| {
            let mut query = Query { scale, ..query.clone() };
            if followed {
                // As of an object that was answered in the frame before.
                perceiver.classify(observation, &query, &mut work, &mut percept).unwrap();
                (query.rotation_prior, query.expected) = (RotationPrior::continuing(&percept), percept.expected);
            }
            let counted = allocation_counter::measure(|| {
                perceiver.classify(observation, &query, &mut work, &mut percept).unwrap().complete().unwrap();
            });
            (counted.count_total, counted.bytes_total)
        };
        for seen in &seen {
            answer(seen);
        }
        for (number, seen) in seen.iter().enumerate() {
            assert_eq!(answer(seen), (0, 0), "{scale:?}, followed: {followed}, observation {number}");
        }
    }
}

#[test]
fn a_query_in_known_pose_allocates_nothing_once_warm() {
    let perceiver = perceiver();
    let observations = observations(&perceiver);
    for method in [Method::Auto, Method::Hull, Method::Evidence, Method::Mean] {
        for view in [None, Some(View::Top)] {
            count(&perceiver, &observations, &Query { method, view, ..Query::default() });
        }
    }
}

#[test]
fn a_query_about_z_allocates_nothing_once_warm_tracked_or_not() {
    let perceiver = perceiver();
    // Without those of which voxels are hidden at random: their hulls have a hundred times the runs.
    let observations: Vec<Observation> = observations(&perceiver).into_iter().step_by(2).collect();
    for prior in [RotationPrior::uniform(), RotationPrior::mixture([(yaw(0.4), 0.6), (yaw(3.5), 0.4)], 30.0, 0.02)] {
        for method in [Method::Auto, Method::Hull] {
            let query = Query { method, view: Some(View::Top), pose: PoseSearch::YAW, rotation_prior: prior.clone(), ..Query::default() };
            count(&perceiver, &observations, &query);
        }
    }
}
