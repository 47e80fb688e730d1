//! A query in known pose allocates nothing once its memory is warm: counted by an allocator that counts.
//!
//! It runs on one thread, as it does in the daemon, so that whatever it allocates is counted.

use beo::grid::{Observation, View};
use beo::perception::{Method, Perceiver, Percept, Query};
use beo::shapes::furniture;
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

#[test]
fn a_query_in_known_pose_allocates_nothing_once_warm() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("models/modelnet10.safetensors");
    let perceiver = Perceiver::new(Arc::new(beo::model::load(&file).unwrap())).unwrap();
    let observations = observations(&perceiver);
    for method in [Method::Auto, Method::Hull, Method::Evidence, Method::Mean] {
        for view in [None, Some(View::Top)] {
            let query = Query { method, view, ..Query::default() };
            let (mut work, mut percept) = (perceiver.workspace(), Percept::default());
            let mut answer = |observation: &Observation| {
                perceiver.classify(observation, &query, &mut work, &mut percept).unwrap();
                perceiver.complete(&query, &mut work, &mut percept).unwrap();
            };
            observations.iter().for_each(&mut answer);
            for (number, observation) in observations.iter().enumerate() {
                let counted = allocation_counter::measure(|| answer(observation));
                assert_eq!((counted.count_total, counted.bytes_total), (0, 0), "{method:?}, {view:?}, observation {number}");
            }
        }
    }
}
