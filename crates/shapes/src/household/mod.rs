//! Made-up household things that stand on tables: closed triangle meshes in metres, true to scale, z up, and their voxels.
//!
//! | file | what |
//! | --- | --- |
//! | `solid` | the closed surfaces that things are put together from |
//! | `carton` | boxes, cartons of drinks, open boxes |
//! | `can` | cans, tubes |
//! | `bottle` | bottles, jugs, sprayers |
//! | `vessel` | mugs and tumblers, bowls, plates; some with something in them |
//! | `tray` | cutlery boxes |
//!
//! Canonical orientation: upright, standing on z = 0; boxes on their smallest face; the longer horizontal side along x, handles and nozzles
//! towards +x. Sizes and proportions are drawn from ranges about those of supermarket goods and tableware (each file says which); no
//! scanned shape is used. How things lie on their sides is learned from the shapes (resting poses), not drawn here.

mod bottle;
mod can;
mod carton;
mod random;
mod solid;
mod tray;
mod vessel;

use super::{Mesh, longest_side, voxelise};
use beo_core::grid::{Dims, Occupancy};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use random::Random;

/// The classes that [`mesh`] and [`make`] know, sorted.
pub const CLASSES: [&str; 7] = ["bottle", "bowl", "box", "can", "cutlery_box", "mug", "plate"];

/// The surface of a random thing, metres; `None` for an unknown class. The same seed gives the same thing; classes do not share random
/// numbers. Every part is a closed surface with its normals outwards; parts of one thing may overlap.
pub fn mesh(class: &str, rng_seed: u64) -> Option<Mesh> {
    let index = CLASSES.iter().position(|c| *c == class)?;
    let mut rng = ChaCha8Rng::seed_from_u64(rng_seed);
    rng.set_stream(index as u64);
    let mut r = Random(rng);
    let solid = match class {
        "bottle" => bottle::bottle(&mut r),
        "bowl" => vessel::bowl(&mut r),
        "box" => carton::carton(&mut r),
        "can" => can::can(&mut r),
        "cutlery_box" => tray::cutlery_box(&mut r),
        "mug" => vessel::mug(&mut r),
        _ => vessel::plate(&mut r),
    };
    Some(solid.into_mesh())
}

/// A random thing as voxels, centred, with the longest side of [`longest_side`] voxels; `None` for an unknown class. What is hollow
/// and open stays hollow.
pub fn make(class: &str, dims: Dims, rng_seed: u64) -> Option<Occupancy> {
    Some(voxelise(&mesh(class, rng_seed)?, dims, longest_side(dims)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashMap;

    #[test]
    fn surfaces_are_closed_with_their_normals_outwards() {
        for class in CLASSES {
            for seed in 0..60 {
                let mesh = mesh(class, seed).unwrap();
                let mut edges: HashMap<(u32, u32), i32> = HashMap::new();
                for &[a, b, c] in mesh.triangles() {
                    for (from, to) in [(a, b), (b, c), (c, a)] {
                        *edges.entry((from, to)).or_default() += 1;
                    }
                }
                // Every edge is passed once in each direction.
                assert!(edges.iter().all(|(&(a, b), n)| *n == 1 && edges.get(&(b, a)) == Some(&1)), "{class} {seed}");
                let corners = mesh.triangles().iter().map(|t| mesh.corners(*t).map(|p| p.coords));
                let volume: f64 = corners.map(|[a, b, c]| a.dot(&b.cross(&c)) / 6.0).sum();
                let [low, high] = mesh.bounds();
                let share = volume / (high - low).product();
                assert!((0.01..=1.0 + 1e-9).contains(&share), "{class} {seed}: fills {share} of its box");
            }
        }
    }

    #[test]
    fn things_stand_on_the_ground_at_household_size_with_their_long_side_along_x() {
        let mut handles = 0;
        for class in CLASSES {
            for seed in 0..200 {
                let [low, high] = mesh(class, seed).unwrap().bounds();
                let size = high - low;
                assert!(low.z.abs() < 1e-12, "{class} {seed}");
                assert!((0.050..0.45).contains(&size.max()) && size.min() > 0.008, "{class} {seed}: {size:?}");
                assert!(size.x >= size.y - 1e-3, "{class} {seed}: {size:?}");
                if class == "mug" {
                    handles += usize::from(high.x > 0.02 - low.x);
                    assert!(high.x > -low.x - 1e-9, "{class} {seed}: no handle is at −x");
                }
            }
        }
        assert!((140..200).contains(&handles), "{handles} mugs with a handle, the others are tumblers");
    }

    /// Seen from above, an open vessel goes deep in its middle; one with something in it does not.
    #[test]
    fn open_vessels_stay_hollow_as_voxels() {
        for side in [30, 64] {
            let dims = Dims::cube(side).unwrap();
            for class in ["bowl", "mug", "plate", "cutlery_box"] {
                let mut empty = 0;
                for seed in 0..40 {
                    let object = make(class, dims, seed).unwrap();
                    let top = |i: usize, j: usize| (0..side).rev().find(|k| object.is_filled(i, j, *k));
                    let filled: Vec<_> = object.bits().ones().map(|v| dims.coordinates(v)).collect();
                    let (low, high) = (filled.iter().map(|v| v[2]).min().unwrap(), filled.iter().map(|v| v[2]).max().unwrap());
                    let tops = (0..side * side).filter_map(|n| top(n / side, n % side));
                    let (deep, all) = tops.fold((0, 0), |(deep, all), top| (deep + usize::from(2 * top < low + high), all + 1));
                    empty += usize::from(deep * 5 >= all);
                }
                let expected = if ["bowl", "mug"].contains(&class) { 28..40 } else { 40..41 };
                assert!(expected.contains(&empty), "{class} at {side}: {empty} of 40 end below the middle in many columns");
            }
        }
    }

    #[test]
    fn the_same_seed_gives_the_same_thing_and_another_seed_another() {
        let dims = Dims::cube(30).unwrap();
        for class in CLASSES {
            assert_eq!(mesh(class, 3), mesh(class, 3));
            assert_ne!(mesh(class, 3), mesh(class, 4));
            assert_eq!(make(class, dims, 3), make(class, dims, 3));
        }
        assert!(mesh("fork", 1).is_none() && make("fork", dims, 1).is_none());
    }

    #[test]
    #[ignore = "writes a picture for a person to look at: set BEO_PICTURES to a folder"]
    fn pictures_to_look_at() {
        use beo_picture::{Colour, draw_shape, sheet};
        let Some(folder) = std::env::var_os("BEO_PICTURES") else { return };
        let dims = Dims::cube(30).unwrap();
        let picture = |class, seed| (draw_shape(&make(class, dims, seed).unwrap(), 150, Colour::KNOWN), format!("{class} {seed}"));
        let rows: Vec<Vec<_>> = CLASSES.iter().map(|class| (0..10).map(|seed| picture(*class, seed)).collect()).collect();
        sheet(&rows, "Made-up household things").save(&std::path::Path::new(&folder).join("household.png")).unwrap();
    }
}
