//! Support planes under noise, and where grids are laid about boxes and cans on a table: what is seen of them has a closed form.

mod reference;

use beo_camera::{Frame, Grid, Intrinsics, Placement, PlacementError, Plane, PlaneSearch, SensorModel, fit_support, place};
use nalgebra::{Matrix3, Point3, Unit, UnitQuaternion, Vector3};
use proptest::prelude::*;
use reference::{Camera, Matrix, Shape, Vector, add, apply, cross, render, scale, subtract, transposed, turn, unit};

const OBJECT: u16 = 4;
const DIMS: [usize; 3] = [30, 32, 34];

/// Where a camera is in the world (z up, the table at 0) and how it is turned: rows are its axes in the world.
#[derive(Clone, Copy)]
struct View {
    from: Vector,
    axes: Matrix,
}

impl View {
    /// From `from` towards `at`, then rolled and tilted by so many radians.
    fn towards(from: Vector, at: Vector, roll: f64, tilt: [f64; 2]) -> Self {
        let z = unit(subtract(at, from));
        let x = unit(cross(z, [0.0, 0.0, 1.0]));
        let level = [x, cross(z, x), z];
        let turned = reference::product(&turn([1.0, 0.0, 0.0], tilt[0]), &turn([0.0, 1.0, 0.0], tilt[1]));
        Self { from, axes: reference::product(&reference::product(&turned, &turn([0.0, 0.0, 1.0], roll)), &level) }
    }

    fn to_camera(self, point: Vector) -> Vector {
        apply(&self.axes, subtract(point, self.from))
    }

    fn to_world(self, point: Vector) -> Vector {
        add(apply(&transposed(&self.axes), point), self.from)
    }

    fn up(&self) -> Vector {
        apply(&self.axes, [0.0, 0.0, 1.0])
    }

    fn table(&self) -> Shape {
        // Height of a point is up · p + the camera's own.
        Shape::Plane { normal: self.up(), offset: self.from[2] }
    }

    fn support(&self) -> Plane {
        let up = Unit::new_normalize(Vector3::from(self.up()));
        Plane::new(up, &Point3::from(up.into_inner() * -self.from[2]))
    }

    /// A box or can that stands on the table at the origin; `yaw` about the vertical.
    fn cuboid(&self, size: Vector, yaw: f64) -> Shape {
        // Rows: the box's axes in the world, then in the camera frame.
        let axes = reference::product(&transposed(&turn([0.0, 0.0, 1.0], yaw)), &transposed(&self.axes));
        Shape::Cuboid { centre: self.to_camera([0.0, 0.0, size[2] / 2.0]), half: scale(size, 0.5), axes }
    }

    fn can(&self, radius: f64, height: f64) -> Shape {
        let axes = transposed(&self.axes);
        Shape::Cylinder { centre: self.to_camera([0.0, 0.0, height / 2.0]), radius, half: height / 2.0, axes }
    }
}

/// The grid laid about the object, with the table known.
fn placed(view: &View, object: Shape, placement: &Placement) -> Grid {
    let camera = Camera::vga([0.0; 5]);
    let intrinsics = Intrinsics::new(camera.width, camera.height, camera.focal, camera.centre, camera.distortion).unwrap();
    let (depth, labels) = render(&camera, &[(OBJECT, object), (0, view.table())]);
    let frame = Frame::new(&intrinsics, &depth, &labels).unwrap();
    let up = Unit::new_normalize(Vector3::from(view.up()));
    place(&frame, OBJECT, &up, Some(&view.support()), &SensorModel::default(), DIMS, placement).unwrap()
}

/// The grid's centre in the world, and its axes there as columns.
fn in_the_world(view: &View, grid: &Grid) -> (Vector, Matrix3<f64>) {
    let axes = grid.grid_to_camera().rotation.to_rotation_matrix();
    let world = Matrix3::from_rows(&view.axes.map(|row| Vector3::from(row).transpose())).transpose();
    (view.to_world(grid.grid_to_camera().translation.vector.into()), world * axes.matrix())
}

fn distance(a: Vector, b: Vector) -> f64 {
    let d = subtract(a, b);
    reference::dot(d, d).sqrt()
}

/// Width of a pixel on the object, twice: at each end, a reading may lie so far within.
const FOOTPRINTS: f64 = 2.0 * 0.75 / 525.0;

#[test]
fn about_a_box_that_faces_the_camera_the_grid_is_the_boxs_own() {
    // Front face and top are seen: the whole length, width and height of the box.
    for size in [[0.10, 0.16, 0.12], [0.14, 0.08, 0.05], [0.06, 0.06, 0.22]] {
        let view = View::towards([-0.5, 0.0, 0.45], [0.0, 0.0, size[2] / 2.0], 0.0, [0.0; 2]);
        let grid = placed(&view, view.cuboid(size, 0.0), &Placement::default());
        let (centre, axes) = in_the_world(&view, &grid);
        assert!(distance(centre, [0.0, 0.0, size[2] / 2.0]) < FOOTPRINTS, "{size:?} at {centre:?}");
        // x away from the camera, z up.
        assert!((axes - Matrix3::identity()).norm() < 0.02, "{axes}");
        // The longest side is two thirds of the shortest side of the grid.
        let longest = size.into_iter().fold(0.0, f64::max);
        let side = grid.voxel_size_m() * 30.0;
        assert!((side * 2.0 / 3.0 - longest).abs() < 2.0 * FOOTPRINTS, "{size:?}: {side}");
        assert_eq!(grid.dims(), DIMS);
        // Share and known side, in closed form.
        let half = placed(&view, view.cuboid(size, 0.0), &Placement { share: 0.5, ..Placement::default() });
        assert!((half.voxel_size_m() * 0.5 - grid.voxel_size_m() * (2.0 / 3.0)).abs() < 1e-12);
        let known = placed(&view, view.cuboid(size, 0.0), &Placement { known_side_m: Some(0.3), ..Placement::default() });
        assert!((known.voxel_size_m() - 0.3 / (0.8 * 30.0)).abs() < 1e-12 && known.grid_to_camera() == grid.grid_to_camera());
    }
}

#[test]
fn a_box_whose_foot_is_hidden_reaches_down_to_the_table() {
    let size = [0.10, 0.10, 0.12];
    let view = View::towards([-0.5, 0.0, 0.45], [0.0, 0.0, 0.06], 0.0, [0.0; 2]);
    let camera = Camera::vga([0.0; 5]);
    let intrinsics = Intrinsics::new(camera.width, camera.height, camera.focal, camera.centre, camera.distortion).unwrap();
    // Something of 2 cm, broad, stands before it.
    let kerb = Shape::Cuboid { centre: view.to_camera([-0.07, 0.0, 0.01]), half: [0.01, 0.2, 0.01], axes: transposed(&view.axes) };
    let (depth, labels) = render(&camera, &[(OBJECT, view.cuboid(size, 0.0)), (9, kerb), (0, view.table())]);
    let frame = Frame::new(&intrinsics, &depth, &labels).unwrap();
    let up = Unit::new_normalize(Vector3::from(view.up()));
    let laid = |support: Option<&Plane>| {
        let grid = place(&frame, OBJECT, &up, support, &SensorModel::default(), DIMS, &Placement::default()).unwrap();
        (in_the_world(&view, &grid).0[2], grid.voxel_size_m() * 20.0)
    };
    let (with, without) = (laid(Some(&view.support())), laid(None));
    assert!((with.0 - 0.06).abs() < FOOTPRINTS && (with.1 - 0.12).abs() < 2.0 * FOOTPRINTS, "{with:?}");
    assert!(without.0 > 0.06 + 0.003 && without.1 < 0.12 - 0.006, "{without:?}");
    // What hangs far above the table does not reach down.
    let hanging = View { from: add(view.from, [0.0, 0.0, 0.3]), ..view }.support();
    let floating = laid(Some(&hanging));
    assert!((floating.0 - without.0).abs() < 1e-12, "{floating:?}");
}

/// Columns and rows of an image.
type Part = [std::ops::Range<usize>; 2];

/// The grid about the pixels of `labelled`, seen by a camera of 320 × 240 pixels, of which each is 4 mm wide at a metre.
fn grid_about(labelled: &[Part], depth: impl Fn(usize, usize) -> f64, up: Vector3<f64>, support: Option<&Plane>) -> Grid {
    let camera = Intrinsics::new(320, 240, [250.0; 2], [159.5, 119.5], [0.0; 5]).unwrap();
    let depth: Vec<f32> = (0..320 * 240).map(|pixel| depth(pixel % 320, pixel / 320) as f32).collect();
    let mut labels = vec![0; 320 * 240];
    for [columns, rows] in labelled {
        rows.clone().for_each(|row| labels[row * 320 + columns.start..row * 320 + columns.end].fill(OBJECT));
    }
    let frame = Frame::new(&camera, &depth, &labels).unwrap();
    let (up, sensor) = (Unit::new_normalize(up), SensorModel::default());
    place(&frame, OBJECT, &up, support, &sensor, DIMS, &Placement::default()).unwrap()
}

/// A part of a wall at one metre, and whatever else is labelled.
fn wall_and(more: &[Part]) -> Grid {
    let labelled: Vec<Part> = std::iter::once([120..200, 80..160]).chain(more.iter().cloned()).collect();
    grid_about(&labelled, |_, _| 1.0, -Vector3::y(), None)
}

/// The longest side of the box that a grid is laid about.
fn longest_side_m(grid: &Grid) -> f64 {
    grid.voxel_size_m() * 20.0
}

fn moved(a: &Grid, b: &Grid) -> f64 {
    (a.grid_to_camera().translation.vector - b.grid_to_camera().translation.vector).norm()
}

/// Half a percent of the readings is left out at each end of each axis.
#[test]
fn a_few_readings_far_off_move_no_side_of_the_box() {
    let plain = wall_and(&[]);
    assert!((longest_side_m(&plain) - 0.32).abs() < 0.01, "{}", longest_side_m(&plain));
    // 20 of 6,400 readings, all beside others of their depth: to the left, to the right, above and below.
    for far in [[10..12, 110..120], [300..302, 110..120], [150..160, 5..7], [150..160, 230..232]] {
        let grid = wall_and(&[far]);
        assert!((longest_side_m(&grid) - longest_side_m(&plain)).abs() < 0.01 && moved(&grid, &plain) < 0.01, "{grid:?}");
    }
}

#[test]
fn readings_without_neighbours_count_only_where_there_are_no_others() {
    let plain = wall_and(&[]);
    // 180 of 6,580 readings, each beside readings of the wall that are not the object's.
    let lone = |from: usize| -> Vec<Part> {
        (from..from + 30).step_by(2).flat_map(|u| (110..134).step_by(2).map(move |v| [u..u + 1, v..v + 1])).collect()
    };
    let grid = wall_and(&lone(280));
    assert!((longest_side_m(&grid) - longest_side_m(&plain)).abs() < 0.01 && moved(&grid, &plain) < 0.01, "{grid:?}");
    let alone = grid_about(&lone(146), |_, _| 1.0, -Vector3::y(), None);
    assert!((longest_side_m(&alone) - 0.112).abs() < 0.005, "28 pixels from the first column to the last: {}", longest_side_m(&alone));
    // Of a handle two pixels thick no reading has four neighbours: it is the object's all the same, but for its last half percent.
    let handle = wall_and(&[[200..280, 119..121]]);
    assert!((0.48..0.64).contains(&longest_side_m(&handle)), "{}", longest_side_m(&handle));
}

#[test]
fn how_alike_neighbours_are_follows_the_sensor() {
    // At three metres, the right half is as rough as the sensor's noise lets a plane be.
    let rough = 3.0 * SensorModel::default().deviation(3.0);
    assert!(rough > 0.01, "more than is alike at any distance");
    let depth = |u: usize, v: usize| if u >= 160 && (u + v).is_multiple_of(2) { 3.0 + rough } else { 3.0 };
    let grid = grid_about(&[[120..200, 100..140]], depth, -Vector3::y(), None);
    assert!((longest_side_m(&grid) - 0.96).abs() < 0.04, "{}", longest_side_m(&grid));
}

#[test]
fn the_box_reaches_down_to_a_near_support_along_the_vertical() {
    // The support slopes, and passes so far below the lowest reading of a wall of 32 cm, or of a tile of 4 cm.
    let slope = 40_f64.to_radians();
    let normal = Unit::new_normalize(Vector3::new(0.0, -slope.cos(), -slope.sin()));
    let wall: Part = [120..200, 80..160];
    let tile: Part = [155..165, 115..125];
    for (part, lowest, gap, height) in [
        (&wall, 0.16, 0.08, 0.40),
        // Beyond three tenths of the height, an object hangs.
        (&wall, 0.16, 0.12, 0.32),
        (&tile, 0.02, 0.016, 0.054),
        (&tile, 0.02, 0.024, 0.04),
    ] {
        let plane = Plane::new(normal, &Point3::new(0.0, lowest + gap, 1.0));
        let grid = grid_about(std::slice::from_ref(part), |_, _| 1.0, -Vector3::y(), Some(&plane));
        assert!((longest_side_m(&grid) - height).abs() < 0.007, "{gap} m below: {}", longest_side_m(&grid));
    }
}

/// The direction in which the camera looks at an object says nothing if it is nearly the vertical.
#[test]
fn from_straight_above_x_is_up_in_the_image() {
    // Its middle is 3 cm to the right of the axis, at a metre.
    let grid = grid_about(&[[147..187, 100..140]], |_, _| 1.0, -Vector3::z(), None);
    let x = grid.grid_to_camera().rotation * Vector3::x();
    assert!((x + Vector3::y()).norm() < 1e-6, "{x}");
    let aside = grid_about(&[[187..227, 100..140]], |_, _| 1.0, -Vector3::z(), None);
    let x = aside.grid_to_camera().rotation * Vector3::x();
    assert!((x - Vector3::x()).norm() < 0.02, "{x}");
}

#[test]
fn a_box_whose_sides_have_no_readings_reaches_down_to_the_table() {
    let size = [0.07, 0.07, 0.2];
    let view = View::towards([-0.5, 0.0, 0.55], [0.0, 0.0, 0.1], 0.0, [0.0; 2]);
    let camera = Camera::vga([0.0; 5]);
    let intrinsics = Intrinsics::new(camera.width, camera.height, camera.focal, camera.centre, camera.distortion).unwrap();
    let up = Unit::new_normalize(Vector3::from(view.up()));
    let (depth, labels) = render(&camera, &[(OBJECT, view.cuboid(size, 0.0)), (0, view.table())]);
    let laid = |behind: f32| {
        let whole = Frame::new(&intrinsics, &depth, &labels).unwrap();
        let is_side = |pixel: usize| whole.point(pixel).is_some_and(|point| view.support().height(&point) < 0.19);
        let is_dark: Vec<bool> = (0..depth.len()).map(|pixel| labels[pixel] == OBJECT && is_side(pixel)).collect();
        let seen: Vec<f32> = depth.iter().zip(&is_dark).map(|(z, dark)| if *dark { behind } else { *z }).collect();
        let mask: Vec<u16> = labels.iter().zip(&is_dark).map(|(label, dark)| if *dark { 0 } else { *label }).collect();
        let frame = Frame::new(&intrinsics, &seen, &mask).unwrap();
        let grid = place(&frame, OBJECT, &up, Some(&view.support()), &SensorModel::default(), DIMS, &Placement::default()).unwrap();
        (in_the_world(&view, &grid).0[2], grid.voxel_size_m() * 20.0)
    };
    let dark = laid(0.0);
    assert!((dark.0 - 0.1).abs() < FOOTPRINTS && (dark.1 - 0.2).abs() < 2.0 * FOOTPRINTS, "{dark:?}");
    // A lid that floats, with the table seen below it, is a lid.
    let lid = laid(1.0);
    assert!(lid.0 > 0.18 && lid.1 < 0.1, "{lid:?}");
}

#[test]
fn objects_that_are_hardly_seen_have_no_grid_but_a_reason() {
    let camera = Intrinsics::new(64, 48, [60.0, 60.0], [31.5, 23.5], [0.0; 5]).unwrap();
    let up = -Vector3::y_axis();
    let laid = |depth: &[f32], labels: &[u16], placement: &Placement| {
        place(&Frame::new(&camera, depth, labels).unwrap(), OBJECT, &up, None, &SensorModel::default(), DIMS, placement)
    };
    let mut labels = vec![0; 64 * 48];
    labels[..39].fill(OBJECT);
    let few = |found| Err(PlacementError::TooFew { object: OBJECT, found, least: 40 });
    assert_eq!(laid(&[1.0; 64 * 48], &labels, &Placement::default()), few(39));
    labels[39] = OBJECT;
    assert!(laid(&[1.0; 64 * 48], &labels, &Placement::default()).is_ok(), "40 are enough");
    labels.fill(OBJECT);
    for bad in [0.0, -1.0, f32::NAN, f32::INFINITY] {
        assert_eq!(laid(&[bad; 64 * 48], &labels, &Placement::default()), few(0));
    }
    // None asked for, none there; readings beyond all measure; shares that make no grid.
    let none = Placement { least_readings: 0, ..Placement::default() };
    assert!(matches!(laid(&[0.0; 64 * 48], &labels, &none), Err(PlacementError::TooFew { found: 0, .. })));
    assert!(laid(&[f32::MAX; 64 * 48], &labels, &Placement::default()).is_ok_and(|grid| grid.voxel_size_m().is_finite()));
    for share in [0.0, -1.0, f64::NAN] {
        assert!(matches!(laid(&[1.0; 64 * 48], &labels, &Placement { share, ..none }), Err(PlacementError::Grid(_))));
    }
}

#[test]
fn where_nothing_could_stand_there_is_no_support() {
    let camera = Camera::vga([0.0; 5]);
    let intrinsics = Intrinsics::new(camera.width, camera.height, camera.focal, camera.centre, camera.distortion).unwrap();
    let search = PlaneSearch { label: None, up: None, sensor: SensorModel::default() };
    let fitted = |shape: Shape| {
        let (depth, labels) = render(&camera, &[(0, shape)]);
        fit_support(&Frame::new(&intrinsics, &depth, &labels).unwrap(), &search)
    };
    // A wall in front of an upright camera, a ceiling, nothing.
    assert_eq!(fitted(Shape::Plane { normal: [0.9, 0.0, -0.4], offset: 1.0 }), None);
    assert_eq!(fitted(Shape::Plane { normal: [0.0, 1.0, -0.1], offset: 1.0 }), None);
    assert_eq!(fitted(Shape::Plane { normal: [0.0, 0.0, 1.0], offset: 1.0 }), None);
    // Readings and cameras beyond all measure end, without a plane that is not one.
    for (focal, depth) in [(1e-300, f32::MAX), (1e-200, 1.0), (525.0, f32::MAX), (1e-150, 1e30)] {
        let intrinsics = Intrinsics::new(64, 48, [focal; 2], [31.5, 23.5], [0.0; 5]).unwrap();
        let depth: Vec<f32> = (0..64_u16 * 48).map(|i| depth / (1.0 + f32::from(i % 7))).collect();
        let frame = Frame::new(&intrinsics, &depth, &[0; 64 * 48]).unwrap();
        let wide = PlaneSearch { sensor: SensorModel { quadratic_per_m: 1e300, ..SensorModel::default() }, ..search };
        for search in [search, wide] {
            let plane = fit_support(&frame, &search);
            assert!(plane.is_none_or(|plane| plane.normal().iter().all(|n| n.is_finite())), "{focal} {plane:?}");
        }
    }
}

/// Standard normal numbers (Box and Muller) of a small generator (splitmix64), so that the noise is the same everywhere.
struct Noise(u64);

impl Noise {
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn normal(&mut self) -> f64 {
        (-2.0 * (1.0 - self.uniform()).ln()).sqrt() * (std::f64::consts::TAU * self.uniform()).cos()
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 16, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn the_table_is_found_under_noise_and_dropouts(
        elevation in 0.35..1.3_f64, distance in 0.5..1.4_f64, roll in -0.3..0.3_f64, tilt in prop::array::uniform2(-0.1..0.1_f64), seed in any::<u64>(),
    ) {
        let from = [-distance * elevation.cos(), 0.0, distance * elevation.sin()];
        let view = View::towards(from, [0.0; 3], roll, tilt);
        let camera = Camera::vga([0.0; 5]);
        let intrinsics = Intrinsics::new(camera.width, camera.height, camera.focal, camera.centre, camera.distortion).unwrap();
        // A box with another label, and one that has none: up to a third of the readings are not the table's.
        let clutter = view.cuboid([0.15, 0.15, 0.1], 0.4);
        let shapes = [(OBJECT, view.can(0.05, 0.2)), (0, clutter), (0, view.table())];
        let (mut depth, labels) = render(&camera, &shapes);
        let (sensor, mut noise) = (SensorModel::default(), Noise(seed));
        for reading in &mut depth {
            let off = sensor.deviation(f64::from(*reading)) * noise.normal();
            *reading = if noise.uniform() < 0.2 { 0.0 } else { (*reading + off as f32).max(0.0) };
        }
        let frame = Frame::new(&intrinsics, &depth, &labels).unwrap();
        let plane = fit_support(&frame, &PlaneSearch { label: None, up: None, sensor });
        prop_assert!(plane.is_some(), "a table is there");
        let plane = plane.unwrap();
        prop_assert!(plane.normal().norm() - 1.0 < 1e-9);
        let angle = plane.normal().angle(&Vector3::from(view.up()));
        prop_assert!(angle < 0.5_f64.to_radians(), "{} degrees off", angle.to_degrees());
        let foot = plane.height(&Point3::from(Vector3::from(view.to_camera([0.0; 3]))));
        prop_assert!(foot.abs() < 0.002, "{} m off where the objects stand", foot);
        prop_assert_eq!(fit_support(&frame, &PlaneSearch { label: None, up: None, sensor }), Some(plane));
    }

    /// The same can, seen from all around: the same box in the world, its x away from the camera.
    #[test]
    fn a_can_has_the_same_place_and_size_from_all_around(azimuth in -3.1..3.1_f64, elevation in 0.4..1.1_f64) {
        let (radius, height) = (0.045, 0.12);
        let away = [azimuth.cos(), azimuth.sin(), 0.0];
        let from = add(scale(away, -0.7 * elevation.cos()), [0.0, 0.0, 0.06 + 0.7 * elevation.sin()]);
        let view = View::towards(from, [0.0, 0.0, 0.06], 0.0, [0.0; 2]);
        let grid = placed(&view, view.can(radius, height), &Placement::default());
        let (centre, axes) = in_the_world(&view, &grid);
        // Half a percent of the readings is left out on each side: at a round end, those of a few rows.
        prop_assert!(distance(centre, [0.0, 0.0, height / 2.0]) < 2.0 * FOOTPRINTS, "{:?}", centre);
        prop_assert!((grid.voxel_size_m() * 20.0 - height).abs() < 2.0 * FOOTPRINTS, "{}", grid.voxel_size_m() * 20.0);
        prop_assert!((axes.column(0).into_owned() - Vector3::from(away)).norm() < 0.02, "{}", axes);
        prop_assert!((axes.column(2).into_owned() - Vector3::z()).norm() < 1e-6);
    }

    /// A camera at one place, however it is turned: the same grid in the world.
    #[test]
    fn how_the_camera_is_turned_does_not_matter(roll in -3.0..3.0_f64, tilt in prop::array::uniform2(-0.2..0.2_f64), yaw in 0.0..1.5_f64) {
        let size = [0.10, 0.07, 0.12];
        let at = [0.0, 0.0, 0.06];
        let level = View::towards([-0.5, 0.2, 0.45], at, 0.0, [0.0; 2]);
        let turned = View::towards([-0.5, 0.2, 0.45], at, roll, tilt);
        let grids = [level, turned].map(|view| (placed(&view, view.cuboid(size, yaw), &Placement::default()), view));
        let [a, b] = grids.map(|(grid, view)| (in_the_world(&view, &grid), grid.voxel_size_m() * 20.0));
        prop_assert!(distance(a.0.0, b.0.0) < FOOTPRINTS, "{:?} {:?}", a.0.0, b.0.0);
        prop_assert!((a.1 - b.1).abs() < FOOTPRINTS, "{} {}", a.1, b.1);
        prop_assert!((a.0.1 - b.0.1).norm() < 0.03, "{} {}", a.0.1, b.0.1);
    }

    /// Turned about the vertical together, camera and object: in the camera nothing changes, so neither does the grid.
    #[test]
    fn the_world_may_be_turned(yaw in -3.0..3.0_f64) {
        let grid = |turned: f64| {
            let from = apply(&turn([0.0, 0.0, 1.0], turned), [-0.5, 0.1, 0.4]);
            let view = View::towards(from, [0.0, 0.0, 0.05], 0.1, [0.05, 0.0]);
            placed(&view, view.cuboid([0.1, 0.06, 0.1], 0.7 + turned), &Placement::default())
        };
        let (still, turned) = (grid(0.0), grid(yaw));
        let off: UnitQuaternion<f64> = still.grid_to_camera().rotation.rotation_to(&turned.grid_to_camera().rotation);
        prop_assert!(off.angle() < 1e-3);
        prop_assert!((still.grid_to_camera().translation.vector - turned.grid_to_camera().translation.vector).norm() < 1e-3);
        prop_assert!((still.voxel_size_m() / turned.voxel_size_m() - 1.0).abs() < 0.01);
    }
}
