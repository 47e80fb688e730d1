//! The observations of the comparison.

use beo_core::grid::{Dims, Observation, Occupancy, Rotation, Turn, View};
use beo_shapes::library::{self, LoadOptions};
use beo_shapes::{ReadOptions, furniture};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::io::Write;

/// A piece of furniture of each class for each seed.
pub fn furniture(dims: Dims, seeds: std::ops::Range<u64>) -> Vec<Occupancy> {
    let of_seed = |seed| furniture::CLASSES.map(|class| furniture::make(class, dims, seed).unwrap());
    seeds.flat_map(of_seed).collect()
}

/// The view from above of an object turned by `rotation`.
pub fn from_above(object: &Occupancy, rotation: &Rotation) -> Observation {
    View::Top.of(&Turn::new(object.dims(), rotation).occupancy(object))
}

/// The view along +x: in each line of voxels all behind the first filled one is unknown.
pub fn from_the_side(object: &Occupancy) -> Observation {
    let dims = object.dims();
    let mut seen = Observation::unknown(dims);
    for (j, k) in (0..dims.y()).flat_map(|j| (0..dims.z()).map(move |k| (j, k))) {
        for i in 0..dims.x() {
            seen.set(dims.index(i, j, k), object.is_filled(i, j, k));
            if object.is_filled(i, j, k) {
                break;
            }
        }
    }
    seen
}

/// A share of an object's voxels, drawn at random.
pub fn at_random(object: &Occupancy, share: f64, seed: u64) -> Observation {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut seen = Observation::unknown(object.dims());
    for voxel in 0..object.dims().voxels() {
        if rng.random_range(0.0..1.0) < share {
            seen.set(voxel, object.bits().contains(voxel));
        }
    }
    seen
}

/// The real shapes of `validation`, where BEO_MODELNET10 names their folder; a line that says that they are left out otherwise.
pub fn real_shapes(dims: Dims) -> Option<Vec<Occupancy>> {
    let Some(folder) = std::env::var_os("BEO_MODELNET10") else {
        // Past the test runner, which shows what a passing test prints to nobody.
        let _ = writeln!(std::io::stderr(), "skipped: set BEO_MODELNET10 to the folder of ModelNet10 grids");
        return None;
    };
    let library = library::scan(folder.as_ref(), &["validation"]).unwrap();
    let options = LoadOptions { read: ReadOptions::new(dims), skip_duplicates: false, minimum: 0, units: beo_shapes::Units::None };
    let shapes = library::load(&library, &options, |_| ()).unwrap();
    Some(shapes.set.shapes.into_iter().map(|shape| shape.object).collect())
}
