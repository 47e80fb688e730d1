//! Messages of producers: any header and any payload, through the daemon's checks, its copy and its answer.

use super::plain::{bytes_of, message};
use super::small_model::{SIDE, model};
use beo::service::ask;
use beo_core::grid::{Dims, Observation, UNKNOWN};
use beo_core::perception::{Perceiver, Percept, PoseSearch, Query, Workspace};
use beo_ipc::validate::validate;
use beo_ipc::{ObservationHeader, PerceptStatus, text};
use std::cell::RefCell;
use std::sync::{Arc, OnceLock};

/// A header, then voxels. Where the header is one for the model but the voxels are too few or none, the rest is unknown.
pub fn run(data: &[u8]) {
    let (header, voxels) = message(data);
    refused_or(&header, voxels.len(), |count| assert_eq!(count, voxels.len()));
    let mut filled = voxels.to_vec();
    filled.resize(SIDE * SIDE * SIDE, UNKNOWN);
    refused_or(&header, filled.len(), |_| answer(&header, &filled));
}

/// Checks as the daemon does; what is refused has a percept that says why.
fn refused_or(header: &ObservationHeader, payload_len: usize, accepted: impl FnOnce(usize)) {
    match validate(header, payload_len) {
        Ok(count) => accepted(count),
        Err(refusal) => {
            let percept = beo_ipc::Percept::refusing(header, &refusal);
            assert!(percept.status != 0 && PerceptStatus::from_code(percept.status).is_some());
            assert_eq!(text::from_field(&percept.explanation), refusal.to_string());
            assert!(percept.position_m.iter().chain(&percept.orientation).all(|value| value.is_finite()));
        }
    }
}

thread_local! {
    static SCRATCH: RefCell<Option<(Workspace, Percept)>> = const { RefCell::new(None) };
}

fn answer(header: &ObservationHeader, voxels: &[u8]) {
    let dims = Dims::cube(SIDE).expect("a size of a grid");
    if header.dims != <[usize; 3]>::from(dims).map(|side| side as u32) {
        return;
    }
    let Ok(observation) = Observation::from_bytes(dims, voxels) else { return };
    let perceiver = perceiver();
    let mut query = Query { completion: true, ..Query::default() };
    ask(&mut query, header, PoseSearch::Known);
    SCRATCH.with_borrow_mut(|scratch| {
        let (work, percept) = scratch.get_or_insert_with(|| (perceiver.workspace(), Percept::default()));
        if let Ok(classified) = perceiver.classify(&observation, &query, work, percept) {
            let found = classified.percept();
            let total: f64 = found.posterior.iter().sum();
            assert!((total - 1.0).abs() < 1e-6, "the posterior sums to {total}");
            assert!(found.rotation_object_to_grid.coords.iter().all(|value| value.is_finite()) && found.rotation_spread_rad.is_finite());
            if classified.complete().is_ok() {
                assert!(percept.occupancy.iter().all(|p| (0.0..=1.0).contains(p)), "occupancies are probabilities");
            }
        }
    });
}

fn perceiver() -> &'static Perceiver {
    static PERCEIVER: OnceLock<Perceiver> = OnceLock::new();
    PERCEIVER.get_or_init(|| Perceiver::new(Arc::new(model())).expect("a usable model"))
}

/// The model's tables and the scratch memory of a query, made on first use, and a small multiple of the message.
pub fn most_bytes(len: usize) -> usize {
    64 * len + (64 << 20)
}

/// Seeds.
pub fn seeds() -> Vec<Vec<u8>> {
    let good = ObservationHeader::new([SIDE as u32; 3]);
    let mut seeds = Vec::new();
    for pose_search in 0..3 {
        for variant in 0..3_u32 {
            let header = ObservationHeader {
                pose_search,
                tasks: 7,
                view: variant & 1,
                outside: variant >> 1,
                completion_frame: variant & 1,
                rotation_prior: [0.0, 0.6, 0.0, 0.8],
                rotation_prior_concentration: 4.0 * variant as f32,
                unit: variant & 1,
                cut: variant,
                share_edge: 0.25 * variant as f32,
                ..good
            };
            let mut bytes = bytes_of(&header);
            bytes.extend((0..SIDE * SIDE * SIDE).map(|voxel| match (voxel % SIDE, voxel / SIDE % 3) {
                (5.., _) => 0,
                (4, 0..2) => 1,
                (_, 2) => 0,
                _ => UNKNOWN,
            }));
            seeds.push(bytes);
        }
    }
    seeds
}
