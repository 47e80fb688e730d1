//! Shapes whose true poses are known.

use super::solid::{Canvas, Level};
use super::*;
use crate::{Content, Mesh};
use beo_core::grid::uniform_rotation;
use nalgebra::{Point3, Vector3};
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};

/// Boxes, lower and upper corner each, as one mesh.
fn boxes(boxes: &[[[f64; 3]; 2]]) -> Mesh {
    let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
    for [low, high] in boxes {
        let first = vertices.len() as u32;
        vertices.extend((0..8).map(|c| Point3::from([0, 1, 2].map(|a| if c >> a & 1 == 0 { low[a] } else { high[a] }))));
        let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        triangles.extend(quads.iter().flat_map(|[a, b, c, d]| [[a, b, c], [a, c, d]].map(|t| t.map(|v| v + first))));
    }
    Mesh::new(vertices, triangles).unwrap()
}

/// A hammer that is like no mirror image of itself: the head reaches out farther on one side, and has a knob on top at that end.
fn hammer(length: f64, head: f64) -> Mesh {
    boxes(&[
        [[-0.6, -0.6, 0.0], [0.6, 0.6, length]],
        [[-1.5, -0.9, length], [head, 0.9, length + 1.8]],
        [[head - 1.0, -0.9, length + 1.7], [head, 2.0, length + 2.6]],
    ])
}

/// Hammers of varied proportions, each turned, scaled and moved, with what did that.
fn scattered(count: usize, varied: f64, keep_up: bool, seed: u64) -> (Vec<Solid>, Vec<ShapeSimilarity>) {
    let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
    let mut number = |low: f64, high: f64| low + (high - low) * random.random::<f64>();
    (0..count)
        .map(|_| {
            let mesh = hammer(8.0 + varied * number(-1.5, 1.5), 3.5 + varied * number(-0.7, 0.7));
            let rotation = match keep_up {
                true => beo_core::grid::yaw(number(0.0, std::f64::consts::TAU)),
                false => uniform_rotation([number(0.0, 1.0), number(0.0, 1.0), number(0.0, 1.0)]),
            };
            let translation = Vector3::from_fn(|_, _| number(-50.0, 50.0));
            let pose = ShapeSimilarity { rotation, scale: number(0.2, 5.0), translation };
            (Solid::new(&Content::Mesh(mesh.mapped(|p| pose.place(p)).unwrap()), 24).unwrap(), pose)
        })
        .unzip()
}

fn settings() -> AlignmentSettings {
    AlignmentSettings { resolution: 24, ..AlignmentSettings::default() }
}

/// From a shape's own coordinates to where it came to lie.
fn recovered(found: &Congealed, truth: &[ShapeSimilarity]) -> Vec<ShapeSimilarity> {
    found.after.placements.iter().zip(truth).map(|(placement, pose)| placement.after(pose)).collect()
}

#[test]
fn scattered_hammers_come_to_lie_alike() {
    let (solids, truth) = scattered(9, 1.0, false, 3);
    let found = congeal(&solids, &settings(), |_| {});
    assert!(found.after.entropy < 0.6 * found.before.entropy, "{} {}", found.before.entropy, found.after.entropy);
    assert!(found.after.entropy < found.normalised.entropy);
    let recovered = recovered(&found, &truth);
    for one in &recovered {
        let apart = one.rotation.angle_to(&recovered[0].rotation).to_degrees();
        assert!(apart < 8.0, "{apart}°");
    }
}

#[test]
fn copies_of_one_shape_come_to_lie_in_one_place() {
    let (solids, truth) = scattered(6, 0.0, false, 5);
    let recovered = recovered(&congeal(&solids, &settings(), |_| {}), &truth);
    let middle = recovered[0];
    for one in &recovered {
        let apart = one.rotation.angle_to(&middle.rotation).to_degrees();
        assert!(apart < 3.0, "{apart}°");
        assert!((one.scale / middle.scale).ln().abs() < 0.05, "{} {}", one.scale, middle.scale);
        // The hammer's middle; a cell is 1/24.
        let at = |pose: &ShapeSimilarity| pose.place(&Point3::new(0.0, 0.0, 5.0));
        assert!((at(one) - at(&middle)).norm() < 0.6 / 24.0, "{} {}", at(one), at(&middle));
    }
}

#[test]
fn with_up_kept_shapes_are_turned_about_the_vertical_only() {
    let (solids, truth) = scattered(8, 1.0, true, 9);
    let found = congeal(&solids, &AlignmentSettings { keep_up: true, ..settings() }, |_| {});
    let recovered = recovered(&found, &truth);
    for (placement, one) in found.after.placements.iter().zip(&recovered) {
        assert!(((placement.rotation * Vector3::z()) - Vector3::z()).norm() < 1e-9);
        assert!(one.rotation.angle_to(&recovered[0].rotation).to_degrees() < 8.0);
    }
}

#[test]
fn entropy_never_rises_in_a_descent() {
    let (solids, _) = scattered(5, 1.0, false, 11);
    let found = congeal(&solids, &settings(), |_| {});
    assert_eq!(found.descents.len(), 3);
    for descent in &found.descents {
        assert!(descent.windows(2).all(|pair| pair[1] <= pair[0]), "{descent:?}");
    }
    assert!(found.descents.iter().any(|descent| descent.len() > 2), "nothing was gained: {:?}", found.descents);
}

#[test]
fn threads_do_not_change_the_result_and_neither_does_running_again() {
    let (solids, _) = scattered(4, 1.0, false, 13);
    let on =
        |threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(|| congeal(&solids, &settings(), |_| {}));
    let (one, three) = (on(1), on(3));
    assert_eq!(one.after.placements, three.after.placements);
    assert_eq!(one.descents, three.descents);
}

#[test]
fn aligned_shapes_fill_four_fifths_of_the_cube_and_none_leaves_it() {
    let (mut solids, _) = scattered(4, 1.0, false, 17);
    let check = |solids: &[Solid]| {
        let found = congeal(solids, &settings(), |_| {});
        let boxes: Vec<_> = solids.iter().zip(&found.after.placements).map(|(solid, placement)| solid.placed_bounds(placement)).collect();
        assert!(boxes.iter().flatten().all(|p| p.iter().all(|x| x.abs() <= 0.5)), "{boxes:?}");
        // The long side along x, the thin one along z.
        let mean = |axis: usize| boxes.iter().map(|[low, high]| high[axis] - low[axis]).sum::<f64>() / boxes.len() as f64;
        assert!(mean(0) > mean(1) && mean(1) > mean(2), "{} {} {}", mean(0), mean(1), mean(2));
        // The longer ends point to +x and +y.
        let skewness = solids.iter().zip(&found.after.placements).map(|(solid, placement)| solid.skewness(&placement.rotation));
        let skewness = skewness.sum::<Vector3<f64>>();
        assert!(skewness.x >= 0.0 && skewness.y >= 0.0, "{skewness}");
        boxes.iter().map(|[low, high]| (high - low).max()).sum::<f64>() / boxes.len() as f64
    };
    assert!((check(&solids) - 0.8).abs() < 1e-9);
    assert!((check(&scattered(4, 1.0, false, 18).0) - 0.8).abs() < 1e-9);
    // One that is much longer makes all smaller.
    let rod = boxes(&[[[-0.2, -0.3, 0.0], [0.2, 0.3, 30.0]]]);
    solids.push(Solid::new(&Content::Mesh(rod), 24).unwrap());
    check(&solids);
}

#[test]
fn entropies_are_those_of_closed_forms() {
    assert_eq!([0.0, 0.5, 1.0].map(binary_entropy), [0.0, 1.0, 0.0]);
    assert!((binary_entropy(0.25) - 0.811_278_124_459_133).abs() < 1e-12);
    // Two large cubes side by side do not overlap: every cell of either is filled half the time, but for the blurred faces. A cube of a 0.3 side
    // has 12³ cells of 1/40.
    let cube = Solid::new(&Content::Mesh(boxes(&[[[-1.0; 3], [1.0; 3]]])), 40).unwrap();
    let at = |x: f64| ShapeSimilarity { rotation: Rotation::identity(), scale: 0.15, translation: Vector3::new(x, 0.0, 0.0) };
    let entropy = |placements: &[ShapeSimilarity]| {
        let mut stack = Stack::new(Level::Fine, 40, placements.len());
        assert!(placements.iter().all(|placement| stack.add(&cube, placement)));
        (stack.entropy(), stack.volume())
    };
    let (apart, volume) = entropy(&[at(-0.25), at(0.25)]);
    assert!((volume / 1728.0 - 1.0).abs() < 0.15, "{volume}");
    assert!(apart > 2.0 * 1000.0 && apart < 2.0 * 16.0 * 16.0 * 16.0, "{apart}");
    // Any number of copies in one place have the entropy of one: that of its faces.
    let (one, _) = entropy(&[at(0.0)]);
    let (three, _) = entropy(&[at(0.0); 3]);
    assert!((one - three).abs() < 1e-3 * one && one < 0.5 * apart, "{one} {three} {apart}");
}

#[test]
fn a_shape_that_leaves_the_canvas_is_not_counted_as_gone() {
    let cube = Solid::new(&Content::Mesh(boxes(&[[[-1.0; 3], [1.0; 3]]])), 20).unwrap();
    let mut stack = Stack::new(Level::Fine, 20, 2);
    let far = ShapeSimilarity { rotation: Rotation::identity(), scale: 0.2, translation: Vector3::new(0.95, 0.0, 0.0) };
    assert_eq!(stack.rise(&cube, &far), f64::INFINITY);
    assert!(!stack.add(&cube, &far));
    assert_eq!(stack.entropy(), 0.0);
    assert!(Canvas::new(20).side == 40 && Canvas::new(21).side == 41);
}

/// However coarse, a rod among blocks stays within the canvas: it is longer than they are where all have one radius.
#[test]
fn shapes_of_unlike_proportions_can_be_compared() {
    let solid = |size: [f64; 3]| Solid::new(&Content::Mesh(boxes(&[[[0.0; 3], size]])), 16).unwrap();
    let solids = [solid([1.0, 1.1, 1.2]), solid([1.0, 0.9, 1.1]), solid([0.1, 0.1, 4.0]), solid([1.3, 1.0, 1.2])];
    let found = congeal(&solids, &AlignmentSettings { resolution: 16, ..settings() }, |_| {});
    assert!(found.descents.iter().flatten().all(|entropy| entropy.is_finite()), "{:?}", found.descents);
    // Nor do the blocks shrink for the rod to grow.
    let scale = |shape: usize| found.after.placements[shape].scale / found.normalised.placements[shape].scale;
    assert!((0..4).all(|shape| (scale(shape) / scale(0)).ln().abs() <= 2.0 * 1.5_f64.ln() + 1e-6));
}

#[test]
fn nothing_filled_is_no_solid() {
    let dims = beo_core::grid::Dims::cube(8).unwrap();
    assert!(Solid::new(&Content::Voxels(beo_core::grid::Occupancy::empty(dims)), 20).is_none());
    let one = beo_core::grid::Occupancy::from_fn(dims, |i, j, k| (i, j, k) == (1, 2, 3));
    let solid = Solid::new(&Content::Voxels(one), 20).unwrap();
    assert!((solid.centre - Vector3::new(1.5, 2.5, 3.5).map(|x| x / 8.0 - 0.5)).norm() < 1e-9, "{}", solid.centre);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(16))]

    #[test]
    fn what_is_taken_out_of_a_stack_leaves_no_trace(turn in [0.0..1.0, 0.0..1.0, 0.0..1.0], at in [-0.2..0.2, -0.2..0.2, -0.2..0.2]) {
        let solid = Solid::new(&Content::Mesh(hammer(8.0, 3.5)), 20).unwrap();
        let base = ShapeSimilarity { rotation: Rotation::identity(), scale: 0.06, translation: Vector3::new(0.0, 0.0, -0.3) };
        let other = ShapeSimilarity { rotation: uniform_rotation(turn), scale: 0.05, translation: Vector3::from(at) };
        let mut stack = Stack::new(Level::Fine, 20, 2);
        prop_assert!(stack.add(&solid, &base));
        let alone = stack.entropy();
        let rise = stack.rise(&solid, &other);
        prop_assert!(stack.add(&solid, &other));
        prop_assert!((stack.entropy() - alone - rise).abs() < 1e-3, "{} {alone} {rise}", stack.entropy());
        stack.remove(&solid, &other);
        prop_assert_eq!(stack.entropy(), alone);
    }

    #[test]
    fn similarities_compose_and_go_back(turn in [0.0..1.0, 0.0..1.0, 0.0..1.0], scale in 0.1..10.0, p in [-5.0..5.0, -5.0..5.0, -5.0..5.0]) {
        let one = ShapeSimilarity { rotation: uniform_rotation(turn), scale, translation: Vector3::from(p) };
        let two = ShapeSimilarity { rotation: uniform_rotation([turn[1], turn[2], turn[0]]), scale: 1.0 / (1.0 + scale), translation: Vector3::x() };
        let point = Point3::new(p[1], p[2], p[0]);
        prop_assert!((two.after(&one).place(&point) - two.place(&one.place(&point))).norm() < 1e-9);
        prop_assert!((one.place_back(&one.place(&point)) - point).norm() < 1e-9);
    }
}
