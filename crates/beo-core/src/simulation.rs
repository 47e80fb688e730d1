//! What a camera sees of a complete voxel object, for training and evaluation: the object's boxes are rendered by ray casting, then the
//! grid is carved as for any other depth image.
//!
//! Everything is in voxels of the object's grid, from the grid's centre. The object may stand on a table, be seen with noise, lie
//! partly behind something, and have the strip without readings that structured light leaves beside edges.

use crate::grid::{Dims, Observation, Occupancy, RayCaster, Rotation};
use beo_camera::{Carver, Frame, Grid, Intrinsics, SensorModel};
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::f64::consts::TAU;

/// Pixels along a side of the simulated image; the object spans most of them.
const SIDE: u32 = 72;
/// Label of the object.
const OBJECT: u16 = 1;
/// Label of what is before it.
const OCCLUDER: u16 = 2;

/// What there is besides the object, and how well it is seen. Lengths are shares of the object's longest side.
#[derive(Clone, Debug, Default)]
pub struct Conditions {
    /// Whether the object stands on a table.
    pub table: bool,
    /// Standard deviation of a reading.
    pub noise: f64,
    /// Width of the strip beside the object in which there are no readings; negative for the left side.
    pub strip: f64,
    /// Share of the pixels without a reading.
    pub dropout: f64,
    /// Part of the image that something before the object covers: left, right, top, bottom, as shares of the object's extent in the image.
    pub occluder: Option<[f64; 4]>,
}

impl Conditions {
    /// Conditions as cameras meet them, drawn at random.
    pub fn draw(rng: &mut impl Rng) -> Self {
        let chance = |rng: &mut dyn FnMut() -> f64, p: f64| rng() < p;
        let mut uniform = || rng.random_range(0.0..1.0);
        let table = chance(&mut uniform, 0.8);
        let noise = if chance(&mut uniform, 0.5) { 0.015 * uniform() } else { 0.0 };
        let strip = if chance(&mut uniform, 0.5) { 0.16 * (uniform() - 0.5) } else { 0.0 };
        let dropout = if chance(&mut uniform, 0.3) { 0.05 * uniform() } else { 0.0 };
        let occluder = chance(&mut uniform, 0.15).then(|| {
            // From one side, over at most two fifths of the object.
            let reach = 0.05 + 0.35 * uniform();
            match (4.0 * uniform()) as u32 {
                0 => [-1.0, reach, -1.0, 2.0],
                1 => [1.0 - reach, 2.0, -1.0, 2.0],
                2 => [reach, 2.0, 1.0 - reach, 2.0],
                _ => [-1.0, reach, 1.0 - reach, 2.0],
            }
        });
        Self { table, noise, strip, dropout, occluder }
    }
}

/// A camera's place: azimuth (counter-clockwise from +x) and elevation above the horizontal, radians, distance from the grid's centre.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Eye {
    /// Radians about +z.
    pub azimuth: f64,
    /// Radians above the horizontal.
    pub elevation: f64,
    /// In units of the caller: voxels here.
    pub distance: f64,
}

impl Eye {
    /// The place, from the point that is looked at.
    pub fn position(&self) -> Vector3<f64> {
        let (sin, cos) = self.elevation.sin_cos();
        Vector3::new(cos * self.azimuth.cos(), cos * self.azimuth.sin(), sin) * self.distance
    }
}

/// An image of an object.
pub struct View {
    intrinsics: Intrinsics,
    depth: Vec<f32>,
    labels: Vec<u16>,
    /// The object's grid, in voxels from its centre, to the camera's frame.
    object_to_camera: Isometry3<f64>,
    sensor: SensorModel,
}

impl View {
    /// Renders `object` from `eye`; `None` for an object without a filled voxel.
    pub fn new(object: &Occupancy, eye: &Eye, conditions: &Conditions, rng: &mut impl Rng) -> Option<Self> {
        let caster = RayCaster::new(object)?;
        let [low, high] = caster.bounds();
        let middle = <[usize; 3]>::from(object.dims()).map(|side| side as f64 / 2.0);
        let size = (0..3).map(|a| high[a] - low[a]).max().unwrap_or(1) as f64;
        let position = eye.position();
        let object_to_camera = look_at(&position);
        // The object's box has its corners within √3 / 2 of its size from the grid's centre.
        let focal = 0.5 * f64::from(SIDE) * eye.distance / (0.95 * size);
        let centre = (f64::from(SIDE) - 1.0) / 2.0;
        let intrinsics = Intrinsics::new(SIDE, SIDE, [focal; 2], [centre; 2], [0.0; 5]).ok()?;
        let camera_to_object = object_to_camera.inverse();
        let origin = Point3::from(position + Vector3::from(middle));
        let pixels = (SIDE * SIDE) as usize;
        let (mut depth, mut labels) = (vec![0.0_f32; pixels], vec![0; pixels]);
        for pixel in 0..pixels {
            let at = [(pixel as u32 % SIDE) as f64, (pixel as u32 / SIDE) as f64];
            let ray = camera_to_object * intrinsics.ray(at);
            if let Some(t) = caster.hit(&origin, &ray) {
                (depth[pixel], labels[pixel]) = (t as f32, OBJECT);
            } else {
                // What is behind: the table, or something far away.
                let table = (low[2] as f64 - origin.z) / ray.z;
                depth[pixel] = if conditions.table && table > 0.0 { table as f32 } else { 1e4 * size as f32 };
            }
        }
        let sensor = SensorModel { constant_m: conditions.noise * size, quadratic_per_m: 0.0, ..SensorModel::default() };
        let mut view = Self { intrinsics, depth, labels, object_to_camera, sensor };
        view.cover(conditions);
        view.spoil(conditions, size, focal / eye.distance, rng);
        Some(view)
    }

    /// Puts something in front.
    fn cover(&mut self, conditions: &Conditions) {
        let Some([left, right, top, bottom]) = conditions.occluder else { return };
        let seen = |axis: u32| {
            let place = move |pixel: usize| if axis == 0 { pixel as u32 % SIDE } else { pixel as u32 / SIDE };
            let of_object = self.labels.iter().enumerate().filter(|(_, label)| **label == OBJECT).map(|(pixel, _)| place(pixel));
            of_object.fold((SIDE, 0), |(low, high), at| (low.min(at), high.max(at)))
        };
        let [columns, rows] = [seen(0), seen(1)];
        let within = |at: u32, (low, high): (u32, u32), from: f64, to: f64| {
            let share = (f64::from(at) - f64::from(low)) / f64::from(high.saturating_sub(low).max(1));
            (from..to).contains(&share)
        };
        for pixel in 0..self.labels.len() {
            let (u, v) = (pixel as u32 % SIDE, pixel as u32 / SIDE);
            if within(u, columns, left, right) && within(v, rows, top, bottom) {
                self.depth[pixel] = (self.object_to_camera.translation.vector.z * 0.6) as f32;
                self.labels[pixel] = OCCLUDER;
            }
        }
    }

    /// Takes readings away and makes the others noisy. `scale`: pixels per voxel.
    fn spoil(&mut self, conditions: &Conditions, size: f64, scale: f64, rng: &mut impl Rng) {
        let width = (conditions.strip.abs() * size * scale) as usize;
        if width > 0 {
            for row in 0..SIDE as usize {
                let row = row * SIDE as usize..(row + 1) * SIDE as usize;
                let labels: Vec<u16> = self.labels[row.clone()].to_vec();
                for (u, depth) in self.depth[row].iter_mut().enumerate() {
                    // Background beside an edge of the object.
                    let beside = if conditions.strip > 0.0 { u.saturating_sub(width)..u } else { u + 1..(u + 1 + width).min(labels.len()) };
                    if labels[u] == 0 && labels[beside].contains(&OBJECT) {
                        *depth = 0.0;
                    }
                }
            }
        }
        if conditions.noise > 0.0 || conditions.dropout > 0.0 {
            for (depth, label) in self.depth.iter_mut().zip(&self.labels) {
                if *label != OBJECT {
                    continue;
                }
                let [a, b, c]: [f64; 3] = std::array::from_fn(|_| rng.random_range(0.0..1.0));
                // Box and Muller's Gaussian.
                *depth += (conditions.noise * size * (-2.0 * (1.0 - a).ln()).sqrt() * (TAU * b).cos()) as f32;
                if c < conditions.dropout {
                    *depth = 0.0;
                }
            }
        }
    }

    /// What is seen of the object, in the camera's frame.
    pub fn frame(&self) -> Option<Frame<'_>> {
        Frame::new(&self.intrinsics, &self.depth, &self.labels).ok()
    }

    /// Points of the object that are seen, in its grid: voxels from the centre.
    pub fn points(&self) -> Vec<Point3<f64>> {
        let Some(frame) = self.frame() else { return Vec::new() };
        let back = self.object_to_camera.inverse();
        (0..self.labels.len())
            .filter(|pixel| self.labels[*pixel] == OBJECT)
            .filter_map(|pixel| frame.point(pixel))
            .map(|p| back * p)
            .collect()
    }

    /// The carved grid: `rotation` and `centre` say how it lies in the object's (axes of the grid to axes of the object; voxels from the
    /// centre), `edge` how big its voxels are, in voxels of the object.
    pub fn carve(&self, dims: Dims, rotation: &Rotation, centre: &Vector3<f64>, edge: f64, bytes: &mut Vec<u8>, out: &mut Observation) {
        let grid_to_object = Isometry3::from_parts(Translation3::from(*centre), *rotation);
        let Ok(grid) = Grid::new(dims.into(), edge, self.object_to_camera * grid_to_object) else { return };
        let Some(frame) = self.frame() else { return };
        bytes.clear();
        bytes.resize(dims.voxels(), 0);
        let carver = Carver { frame, object: OBJECT, sensor: self.sensor, support: None, grid };
        if carver.carve(bytes).is_ok() {
            // Only the three codes are written.
            let _ = out.read(bytes);
        }
    }
}

/// What a camera sees of an object under perfect conditions, in the object's own grid; all unknown for an empty object.
pub fn observe(object: &Occupancy, eye: &Eye) -> Observation {
    let mut observation = Observation::unknown(object.dims());
    let mut rng = ChaCha8Rng::seed_from_u64(0);
    if let Some(view) = View::new(object, eye, &Conditions::default(), &mut rng) {
        view.carve(object.dims(), &Rotation::identity(), &Vector3::zeros(), 1.0, &mut Vec::new(), &mut observation);
    }
    observation
}

/// The pose of a camera at `position` that looks at the origin, z up: takes the scene to the camera's frame.
fn look_at(position: &Vector3<f64>) -> Isometry3<f64> {
    let forward = -position.normalize();
    let right = forward.cross(&Vector3::z()).try_normalize(1e-6).unwrap_or(Vector3::y() * -1.0);
    let down = forward.cross(&right);
    let camera = nalgebra::Matrix3::from_rows(&[right.transpose(), down.transpose(), forward.transpose()]);
    let rotation = UnitQuaternion::from_rotation_matrix(&nalgebra::Rotation3::from_matrix_unchecked(camera));
    Isometry3::from_parts(Translation3::from(-(rotation * position)), rotation)
}
