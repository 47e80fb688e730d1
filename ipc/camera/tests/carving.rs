//! Carving against a slow reference: rays are cast through rendered scenes of spheres, boxes, cylinders and planes.
//!
//! Two comparisons. By the ray of the pixel that a voxel projects to, every voxel must be the same (but for those on a boundary to within
//! 10⁻⁶ m or 10⁻⁶ pixels, where `f32` readings decide). By the ray through the voxel's own centre, it must be the same wherever all rays
//! within half a pixel of it agree; elsewhere an edge or a slope is nearer than the pixels' size.

mod reference;

use beo_camera::{Carver, EMPTY, FILLED, Frame, Grid, Intrinsics, Plane, SensorModel, UNKNOWN};
use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, Unit, UnitQuaternion, Vector3};
use proptest::prelude::*;
use reference::{Camera, IDENTITY, Matrix, Placed, Sensor, Shape, Vector, apply, cast, classify, dot, product, render, turn};

const OBJECT: u16 = 3;
const OTHER: u16 = 5;
const KINECT: Sensor = [0.001, 0.0019, 2.0];
const LENS: [f64; 5] = [0.12, -0.2, 0.002, -0.001, 0.05];

#[derive(Clone)]
struct Scene {
    camera: Camera,
    shapes: Vec<(u16, Shape)>,
    grid: Placed,
    sensor: Sensor,
    /// normal · p + offset is the height.
    support: Option<(Vector, f64)>,
    /// Pixels without reading.
    missing: fn([u32; 2]) -> bool,
}

/// The axes of a grid that stands upright before a camera which is pitched down by `pitch` radians.
fn upright(pitch: f64) -> Matrix {
    // Columns: x away from the camera and horizontal, y to the left, z up. Before the pitch: x = z of the camera, y = −x, z = −y.
    product(&turn([1.0, 0.0, 0.0], pitch), &[[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
}

fn cuboid(centre: Vector, half: Vector, rotation: &Matrix) -> Shape {
    Shape::Cuboid { centre, half, axes: reference::transposed(rotation) }
}

impl Scene {
    fn new(shapes: Vec<(u16, Shape)>, grid: Placed) -> Self {
        Self { camera: Camera::vga([0.0; 5]), shapes, grid, sensor: KINECT, support: None, missing: |_| false }
    }

    /// A box of 12 × 8 × 14 cm before the camera.
    fn of_a_box() -> Self {
        let (centre, rotation) = ([0.03, 0.02, 0.62], upright(0.6));
        let shape = cuboid(centre, [0.06, 0.04, 0.07], &product(&rotation, &turn([0.0, 0.0, 1.0], 0.5)));
        Self::new(vec![(OBJECT, shape)], Placed { dims: [24, 22, 26], voxel: 0.009, centre, rotation })
    }

    fn carve(&self) -> Vec<u8> {
        let camera = self.camera;
        let intrinsics = Intrinsics::new(camera.width, camera.height, camera.focal, camera.centre, camera.distortion).unwrap();
        let (mut depth, labels) = render(&camera, &self.shapes);
        camera.pixels().filter(|pixel| (self.missing)(*pixel)).for_each(|pixel| depth[camera.index(pixel)] = f32::NAN);
        let rotation = Matrix3::from_rows(&self.grid.rotation.map(|row| Vector3::from(row).transpose()));
        let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation));
        let place = Isometry3::from_parts(Translation3::from(Vector3::from(self.grid.centre)), rotation);
        let carver = Carver {
            frame: Frame::new(&intrinsics, &depth, &labels).unwrap(),
            object: OBJECT,
            sensor: SensorModel::new(self.sensor[0], self.sensor[1], self.sensor[2]).unwrap(),
            support: self.support.map(|(normal, offset)| {
                let normal = Unit::new_normalize(Vector3::from(normal));
                Plane::new(normal, &Point3::from(normal.into_inner() * -offset))
            }),
            grid: Grid::new(self.grid.dims, self.grid.voxel, place).unwrap(),
        };
        let mut voxels = vec![7; carver.grid.voxels()];
        carver.carve(&mut voxels).unwrap();
        let mut layers = vec![9; carver.grid.voxels()];
        layers.chunks_exact_mut(carver.layer()).enumerate().rev().for_each(|(i, layer)| carver.carve_layer(i, layer));
        assert_eq!(voxels, layers, "by layers as in one go");
        voxels
    }

    /// Below the plane is empty, unless the object is seen there.
    fn stands(&self, point: Vector, seen: u8) -> u8 {
        match self.support {
            Some((normal, offset)) if seen != FILLED && dot(normal, point) + offset < 0.0 => EMPTY,
            _ => seen,
        }
    }

    /// The code of a point by the ray at u, v; `None` where u, v are not in the image.
    fn by_ray(&self, point: Vector, [u, v]: [f64; 2], pixel: [u32; 2]) -> (u8, f64) {
        let hit = if (self.missing)(pixel) { None } else { cast(&self.shapes, self.camera.direction([u, v])) };
        let (seen, margin) = classify(point[2], hit, OBJECT, &self.sensor, self.grid.half_depth());
        (self.stands(point, seen), margin)
    }

    /// Compares every voxel by both references; the carved grid, and the share of voxels that agree with the rays through their centres.
    fn compare(&self, half_pixel: bool) -> (Vec<u8>, f64) {
        let carved = self.carve();
        let (mut alike, mut near_edges) = (0, 0);
        for (voxel, &found) in self.grid.voxels().zip(&carved) {
            let point = self.grid.at(voxel);
            let seen_at = self.camera.project(point).and_then(|at| Some((at, self.camera.nearest(at)?)));
            let Some((at, pixel)) = seen_at else {
                assert_eq!(found, self.stands(point, UNKNOWN), "{voxel:?} is not in the image");
                alike += 1;
                continue;
            };
            let centre = pixel.map(f64::from);
            let (expected, margin) = self.by_ray(point, centre, pixel);
            let on_a_border = (0..2).any(|i| (0.5 - (at[i] - centre[i]).abs()).abs() < 1e-6);
            assert!(found == expected || margin < 1e-6 || on_a_border, "{voxel:?} at {at:?}: {found}, by its pixel {expected}");
            let (truth, _) = self.by_ray(point, at, pixel);
            alike += usize::from(found == truth);
            if half_pixel && found != truth {
                near_edges += 1;
                // A lattice over the square in which the pixel's centre lies, and a little beyond it.
                let offsets = (-6..=6).map(|i| 0.09 * f64::from(i));
                let differs =
                    offsets.clone().any(|du| offsets.clone().any(|dv| self.by_ray(point, [at[0] + du, at[1] + dv], pixel).0 != truth));
                assert!(differs, "{voxel:?} at {at:?}: {found}, by its ray {truth}, with no edge within half a pixel");
            }
        }
        assert!(!half_pixel || near_edges < carved.len() / 50, "{near_edges} near edges");
        (carved, alike as f64 / self.grid.voxels().count() as f64)
    }

    /// As [`Self::compare`], without and with a lens, and at least 99 % alike.
    fn agrees(&self) -> Vec<u8> {
        for distortion in [LENS, [0.0; 5]] {
            let scene = Self { camera: Camera { distortion, ..self.camera }, ..self.clone() };
            let (carved, share) = scene.compare(true);
            assert!(share > 0.99, "only {share} agree, distortion {distortion:?}");
            if distortion == [0.0; 5] {
                return carved;
            }
        }
        unreachable!("the last has no distortion")
    }
}

fn count(voxels: &[u8], code: u8) -> usize {
    voxels.iter().filter(|found| **found == code).count()
}

#[test]
fn an_object_alone_is_a_shell_with_a_shadow() {
    let mut scene = Scene::of_a_box();
    let (nothing_else, wall) = (scene.agrees(), (OTHER, Shape::Plane { normal: [0.0, 0.0, -1.0], offset: 1.5 }));
    assert!(count(&nothing_else, FILLED) > 300 && count(&nothing_else, UNKNOWN) > 1000);
    // A wall far behind says that all beside the object is empty, and changes nothing on the object.
    scene.shapes.push(wall);
    let with_wall = scene.agrees();
    assert!(count(&with_wall, EMPTY) > count(&nothing_else, EMPTY) + 1000);
    assert!(nothing_else.iter().zip(&with_wall).all(|(a, b)| *a != FILLED || a == b));
}

#[test]
fn balls_and_cans_agree_too() {
    let (centre, rotation) = ([-0.04, 0.05, 0.5], upright(0.4));
    // Turned aside: the can's silhouette would lie along a layer of voxels, and half a pixel decide for all of them at once.
    let grid = Placed { dims: [20, 21, 22], voxel: 0.01, centre, rotation: product(&rotation, &turn([0.0, 0.0, 1.0], 0.4)) };
    let wall = (OTHER, Shape::Plane { normal: [0.1, -0.3, -1.0], offset: 1.2 });
    let ball = Shape::Sphere { centre, radius: 0.06 };
    let can = Shape::Cylinder { centre, radius: 0.04, half: 0.06, axes: reference::transposed(&rotation) };
    for shape in [ball, can] {
        assert!(count(&Scene::new(vec![(OBJECT, shape), wall], grid).agrees(), FILLED) > 100);
    }
}

#[test]
fn behind_something_in_front_all_is_unknown_and_never_empty() {
    let mut scene = Scene::of_a_box();
    scene.shapes.push((OTHER, Shape::Plane { normal: [0.0, 0.0, -1.0], offset: 1.5 }));
    // A board before the left half of the grid.
    let board = cuboid([-0.07, 0.0, 0.35], [0.08, 0.2, 0.002], &IDENTITY);
    scene.shapes.push((OTHER, board));
    let carved = scene.agrees();
    let hidden: Vec<u8> = scene
        .grid
        .voxels()
        .zip(&carved)
        .filter(|(voxel, _)| {
            // Well within the board's shadow.
            let [x, _, z] = scene.grid.at(*voxel);
            x / z * 0.35 < 0.005
        })
        .map(|(_, code)| *code)
        .collect();
    assert!(hidden.len() > 3000 && hidden.iter().all(|code| *code == UNKNOWN), "{}", hidden.len());
    assert!(count(&carved, FILLED) > 100, "the right half is still seen");
}

#[test]
fn pixels_without_reading_say_nothing() {
    let mut scene = Scene::of_a_box();
    scene.shapes.push((OTHER, Shape::Plane { normal: [0.0, 0.0, -1.0], offset: 1.5 }));
    let whole = scene.agrees();
    scene.missing = |[column, row]| column % 7 < 3 || row > 130;
    let (carved, _) = scene.compare(false);
    assert!(whole.iter().zip(&carved).all(|(whole, holes)| holes == whole || *holes == UNKNOWN));
    let lost = whole.iter().zip(&carved).filter(|(whole, holes)| holes != whole).count();
    assert!(lost > whole.len() / 4, "{lost}");
    scene.missing = |_| true;
    assert!(scene.carve().iter().all(|code| *code == UNKNOWN));
}

#[test]
fn what_is_not_in_the_image_or_behind_the_camera_is_unknown() {
    // About the camera: half of the grid is behind it, most beside the image.
    let shapes = vec![(OBJECT, Shape::Sphere { centre: [0.0, 0.0, 0.5], radius: 0.2 })];
    let grid = Placed { dims: [30, 24, 20], voxel: 0.05, centre: [0.1, 0.0, 0.1], rotation: turn([1.0, 2.0, 0.5], 0.8) };
    let mut scene = Scene::new(shapes, grid);
    scene.camera.distortion = LENS;
    let (carved, _) = scene.compare(false);
    assert!(count(&carved, FILLED) > 10 && count(&carved, EMPTY) > 10 && count(&carved, UNKNOWN) > carved.len() / 2);
    let behind: Vec<u8> = grid.voxels().zip(&carved).filter(|(voxel, _)| grid.at(*voxel)[2] <= 0.0).map(|(_, code)| *code).collect();
    assert!(behind.len() > 1000 && behind.iter().all(|code| *code == UNKNOWN));
    // Beside the image, nothing comes back in through the distortion, x (1 − 0.4 x²) being 0.15 at x = 1.5. A wall says what is seen.
    scene.shapes = vec![(OBJECT, Shape::Plane { normal: [0.0, 0.0, -1.0], offset: 3.0 })];
    (scene.grid.centre, scene.grid.voxel) = ([1.35, 0.0, 0.9], 0.005);
    scene.camera.distortion = [-0.4, 0.0, 0.0, 0.0, 0.0];
    assert!(scene.carve().iter().all(|code| *code == UNKNOWN));
}

#[test]
fn a_thing_within_the_grid_that_is_not_the_object_is_never_filled() {
    let mut scene = Scene::of_a_box();
    scene.shapes[0].0 = OTHER;
    let carved = scene.agrees();
    assert_eq!(count(&carved, FILLED), 0);
    // Something else behind it, as near as the band.
    scene.shapes.push((OBJECT, Shape::Sphere { centre: [0.03, 0.02, 0.8], radius: 0.05 }));
    scene.agrees();
}

#[test]
fn below_the_support_plane_is_empty_unless_the_object_is_seen_there() {
    let mut scene = Scene::of_a_box();
    let up = apply(&scene.grid.rotation, [0.0, 0.0, 1.0]);
    let height = |distance: f64| -dot(up, scene.grid.centre) + distance;
    let (table, without) = (Shape::Plane { normal: up, offset: height(0.07) }, scene.agrees());
    scene.shapes.push((0, table));
    let unsupported = scene.agrees();
    scene.support = Some((up, height(0.07)));
    let carved = scene.agrees();
    let [nx, ny, nz] = scene.grid.dims;
    // The lowest layers are below the table: known from the plane alone.
    let lowest = |carved: &[u8], code| (0..nx * ny).filter(|column| carved[column * nz] == code).count();
    assert_eq!(lowest(&carved, EMPTY), nx * ny);
    assert!(lowest(&unsupported, UNKNOWN) > 0);
    assert!(count(&carved, FILLED) >= count(&without, FILLED) * 9 / 10, "the table hides nothing of the object");
    // A plane that is too high cuts nothing off that is seen.
    scene.support = Some((up, height(0.0)));
    let high = scene.agrees();
    assert_eq!(count(&high, FILLED), count(&carved, FILLED));
    assert!(count(&high, EMPTY) > count(&carved, EMPTY));
}

#[test]
fn oblique_grids_agree() {
    for (axis, angle) in [([1.0, 1.0, 1.0], 0.7), ([0.2, -1.0, 0.4], 2.2), ([0.0, 0.0, 1.0], std::f64::consts::FRAC_PI_4)] {
        let mut scene = Scene::of_a_box();
        scene.shapes.push((OTHER, Shape::Plane { normal: [0.2, -0.5, -1.0], offset: 1.1 }));
        scene.grid.rotation = turn(axis, angle);
        assert!(count(&scene.agrees(), FILLED) > 200);
    }
}

/// Voxels along the optical axis that a wall at so many metres fills.
fn thickness(distance: f64, sensor: Sensor) -> usize {
    let grid = Placed { dims: [8, 8, 128], voxel: 0.002, centre: [0.0, 0.0, distance], rotation: IDENTITY };
    let wall = Shape::Plane { normal: [0.0, 0.0, -1.0], offset: distance };
    let mut scene = Scene::new(vec![(OBJECT, wall)], grid);
    scene.sensor = sensor;
    count(&scene.carve()[..128], FILLED)
}

#[test]
fn the_farther_the_wider_the_band_and_never_thinner_than_a_voxel() {
    // 2 · 2 (1 mm + 5 mm/m² z²) in voxels of 2 mm: the closed form, to within a voxel at each end.
    for distance in [0.501, 1.001, 1.501, 2.001] {
        let expected = 2.0 * 2.0 * (0.001 + 0.005 * distance * distance) / 0.002;
        let found = thickness(distance, [0.001, 0.005, 2.0]) as f64;
        assert!((found - expected).abs() <= 1.0, "{distance} m: {found} voxels, {expected} expected");
    }
    assert!((1..=2).contains(&thickness(1.0, [0.0; 3])));
}

/// A shape somewhere before the camera.
fn shapes() -> impl Strategy<Value = Shape> {
    let centre = (-0.15..0.15_f64, -0.12..0.12_f64, 0.4..1.0_f64).prop_map(|(x, y, z)| [x * z / 0.6, y * z / 0.6, z]);
    let rotation =
        (prop::array::uniform3(-1.0..1.0_f64), 0.0..3.0_f64).prop_map(|(axis, angle)| turn(reference::add(axis, [1.1, 0.0, 0.0]), angle));
    (centre, rotation, prop::array::uniform3(0.02..0.12_f64), 0..3).prop_map(|(centre, axes, size, kind)| match kind {
        0 => Shape::Sphere { centre, radius: size[0] },
        1 => Shape::Cuboid { centre, half: size, axes },
        _ => Shape::Cylinder { centre, radius: size[0], half: size[1], axes },
    })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn random_scenes_agree(
        object in shapes(),
        others in prop::collection::vec(shapes(), 0..4),
        axis in prop::array::uniform3(-1.0..1.0_f64),
        angle in 0.0..3.0_f64,
        centre in (-0.1..0.1_f64, -0.1..0.1_f64, 0.3..1.0_f64),
        lens in prop::array::uniform5(-1.0..1.0_f64),
        table in any::<bool>(),
        sensor in (0.0..0.005_f64, 0.0..0.01_f64, 0.0..3.0_f64),
    ) {
        let all = std::iter::once((OBJECT, object)).chain(others.into_iter().map(|shape| (OTHER, shape)));
        let plane = ([0.05, -0.8, -0.5], 0.7);
        let shapes = all.chain(table.then_some((0, Shape::Plane { normal: plane.0, offset: plane.1 }))).collect();
        let rotation = turn(reference::add(axis, [0.0, 0.0, 1.1]), angle);
        let grid = Placed { dims: [18, 20, 22], voxel: 0.012, centre: [centre.0, centre.1, centre.2], rotation };
        let length = dot(plane.0, plane.0).sqrt();
        let mut scene = Scene::new(shapes, grid);
        scene.sensor = [sensor.0, sensor.1, sensor.2];
        scene.support = table.then_some((plane.0.map(|n| n / length), plane.1 / length));
        scene.camera.distortion = [0.15 * lens[0], 0.1 * lens[1], 0.005 * lens[2], 0.005 * lens[3], 0.03 * lens[4]];
        let (carved, share) = scene.compare(false);
        prop_assert!(share > 0.99, "{share}");
        prop_assert!(carved.iter().all(|code| [EMPTY, FILLED, UNKNOWN].contains(code)));
    }
}
