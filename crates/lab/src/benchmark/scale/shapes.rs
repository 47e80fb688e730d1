//! Made-up shapes of any number of classes, at any resolution: a class is a few boxes, a shape of it has them moved and resized
//! at random.

use beo_core::grid::{Dims, Occupancy};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Boxes of a class.
const BOXES: usize = 6;
/// How far a side of a box moves from shape to shape, in grid sides.
const SPREAD: f64 = 0.05;

/// One shape. The same class and number give the same shape, at every resolution.
pub fn make(dims: Dims, class: usize, number: u64) -> Occupancy {
    let mut of_class = ChaCha8Rng::seed_from_u64(class as u64);
    let mut of_shape = ChaCha8Rng::seed_from_u64(number);
    of_shape.set_stream(1 + class as u64);
    let sides = <[usize; 3]>::from(dims).map(|side| side as f64);
    // The first box is about the middle, so that there is always something to see.
    let boxes: Vec<[(f64, f64); 3]> = (0..BOXES)
        .map(|b| {
            std::array::from_fn(|axis| {
                let middle = if b == 0 { 0.5 } else { of_class.random_range(0.25..0.75) };
                let half = of_class.random_range(0.05..0.22);
                let mut moved = |side: f64| (side + of_shape.random_range(-SPREAD..SPREAD)).clamp(0.1, 0.9) * sides[axis];
                (moved(middle - half), moved(middle + half))
            })
        })
        .collect();
    Occupancy::from_fn(dims, |i, j, k| {
        let centre = [i, j, k].map(|index| index as f64 + 0.5);
        boxes.iter().any(|sides| sides.iter().zip(centre).all(|((low, high), at)| (*low..*high).contains(&at)))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shapes_of_a_class_are_alike_and_classes_differ() {
        let dims = Dims::cube(16).unwrap();
        let differ = |a: &Occupancy, b: &Occupancy| a.count() + b.count() - 2 * a.overlap(b);
        let (mut within, mut between) = (0, 0);
        for class in 0..8 {
            let [one, two, other] = [(class, 0), (class, 1), (class + 1, 0)].map(|(class, number)| make(dims, class, number));
            assert!(one.count() >= beo_shapes::library::FEWEST_FILLED && one != two);
            within += differ(&one, &two);
            between += differ(&one, &other);
        }
        assert!(2 * within < between, "{within} {between}");
        assert_eq!(make(dims, 3, 5), make(dims, 3, 5));
    }

    #[test]
    fn a_shape_fills_the_same_share_at_every_resolution() {
        let share = |side: usize| {
            let shape = make(Dims::cube(side).unwrap(), 4, 2);
            shape.count() as f64 / shape.dims().voxels() as f64
        };
        assert!((share(16) / share(48) - 1.0).abs() < 0.25, "{} {}", share(16), share(48));
    }
}
