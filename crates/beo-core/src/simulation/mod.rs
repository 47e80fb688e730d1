//! Simulated camera views of a complete voxel object, for training and evaluation: the object's boxes are rendered by ray casting, then the
//! grid is carved as for any other depth image.
//!
//! Everything is in voxels of the object's grid, from the grid's centre. The object may stand on a table, be seen with noise, lie
//! partly behind something, and have the strip without readings that structured light leaves beside edges. What else sensors and masks
//! of real scenes get wrong is drawn in `failures`.

mod conditions;
mod failures;

pub use conditions::Conditions;
pub use failures::{Sensing, SensorKind};

use crate::grid::{Dims, Observation, Occupancy, RayCaster, Rotation};
use beo_camera::{Carver, Frame, Grid, Intrinsics, Plane, SensorModel};
use failures::Patches;
use nalgebra::{Isometry3, Point3, Translation3, Unit, UnitQuaternion, Vector3};
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::f64::consts::TAU;

/// Pixels along a side of the simulated image; the object spans most of them.
const SIDE: u32 = 72;
/// Label of the object.
const OBJECT: u16 = 1;
/// Readings of a window whose depths differ by a larger share of the object's longest side are of different surfaces, and not averaged.
const ONE_SURFACE: f64 = 0.12;
/// Label of what is before it.
const OCCLUDER: u16 = 2;

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
pub struct RenderedView {
    intrinsics: Intrinsics,
    depth: Vec<f32>,
    labels: Vec<u16>,
    /// The object's grid, in voxels from its centre, to the camera's frame.
    object_to_camera: Isometry3<f64>,
    sensor: SensorModel,
    /// The table, in the camera's frame, if it is known.
    table: Option<Plane>,
}

impl RenderedView {
    /// Renders `object` from `eye`; `None` for an object without a filled voxel.
    pub fn new(object: &Occupancy, eye: &Eye, conditions: &Conditions, rng: &mut impl Rng) -> Option<Self> {
        let caster = RayCaster::new(object)?;
        let [low, high] = caster.bounds();
        let middle = <[usize; 3]>::from(object.dims()).map(|side| side as f64 / 2.0);
        let size = (0..3).map(|a| high[a] - low[a]).max().unwrap_or(1) as f64;
        let position = eye.position();
        let object_to_camera = look_at(&position);
        // The object's box has its corners within √3 / 2 of its size from the grid's centre.
        let widest = 0.5 * f64::from(SIDE) * eye.distance / (0.95 * size);
        let focal = conditions.pixels.map_or(widest, |pixels| (pixels * eye.distance / size).clamp(0.25 * widest, widest));
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
        let floor = Point3::new(0.0, 0.0, low[2] as f64 - middle[2]);
        let up = Unit::new_normalize(object_to_camera * Vector3::z());
        // Where the mask is cleaned, the plane is known.
        let table = (conditions.table && conditions.cut > 0.0).then(|| Plane::new(up, &(object_to_camera * floor)));
        let mut view = Self { intrinsics, depth, labels, object_to_camera, sensor, table };
        view.lose(conditions, object, rng);
        view.cover(conditions);
        view.spoil(conditions, size, focal / eye.distance, rng);
        view.mislabel(conditions, object, size);
        Some(view)
    }

    /// Takes readings away where surfaces face up, face away or are hidden within a vessel, and blurs the outline.
    fn lose(&mut self, conditions: &Conditions, object: &Occupancy, rng: &mut impl Rng) {
        let [some, all] = conditions.grazing_rad;
        if all <= 0.0 && conditions.lid <= 0.0 && conditions.inside <= 0.0 && conditions.gloss <= 0.0 && conditions.smear <= 0.0 {
            return;
        }
        let hollow = Hollow::new(object);
        let exact = Self { depth: self.depth.clone(), labels: self.labels.clone(), ..*self };
        let [lids, insides, glosses] = [0; 3].map(|_| Patches::new(rng));
        let up = self.object_to_camera * Vector3::z();
        let back = self.object_to_camera.inverse();
        for pixel in 0..self.depth.len() {
            let chance = rng.random_range(0.0..1.0);
            if exact.labels[pixel] != OBJECT {
                continue;
            }
            let (u, v) = (pixel as u32 % SIDE, pixel as u32 / SIDE);
            let at = [u, v].map(|n| f64::from(n) / f64::from(SIDE - 1));
            let mut is_lost = false;
            let mut is_outline = false;
            if let Some(normal) = exact.normal(pixel) {
                let ray = self.intrinsics.ray([f64::from(u), f64::from(v)]).normalize();
                let angle = normal.dot(&ray).abs().min(1.0).acos();
                let grazed = if all > 0.0 { ((angle - some) / (all - some).max(1e-9)).clamp(0.0, 1.0) } else { 0.0 };
                is_lost |= chance < grazed;
                is_lost |= normal.dot(&up).abs() > 0.85 && lids.at(at) < conditions.lid;
            } else {
                is_outline = true;
            }
            let point = back * self.intrinsics.ray([f64::from(u), f64::from(v)]) * f64::from(exact.depth[pixel]);
            let point = Point3::from(point + back.translation.vector);
            is_lost |= glosses.at(at) < conditions.gloss;
            is_lost |= conditions.inside > 0.0 && hollow.holds(&point) && insides.at(at) < conditions.inside;
            if is_lost {
                self.depth[pixel] = 0.0;
            } else if is_outline && chance < conditions.smear {
                // Between the object and the farthest neighbour that is not far away.
                let own = exact.depth[pixel];
                let beside = [pixel.wrapping_sub(1), pixel + 1, pixel.wrapping_sub(SIDE as usize), pixel + SIDE as usize];
                let other = beside.iter().filter_map(|n| exact.depth.get(*n)).copied().filter(|z| *z < 2.0 * own).fold(own, f32::max);
                self.depth[pixel] = own + (other - own) * (chance / conditions.smear) as f32;
            }
        }
    }

    /// Unit normal of the surface at a pixel of the object, by its neighbours, in the camera's frame; `None` at the outline.
    fn normal(&self, pixel: usize) -> Option<Vector3<f64>> {
        let (u, v) = (pixel as u32 % SIDE, pixel as u32 / SIDE);
        if u == 0 || v == 0 || u + 1 == SIDE || v + 1 == SIDE {
            return None;
        }
        let point = |u: u32, v: u32| {
            let at = (v * SIDE + u) as usize;
            let near = self.labels[at] == OBJECT;
            near.then(|| self.intrinsics.ray([f64::from(u), f64::from(v)]) * f64::from(self.depth[at]))
        };
        let across = point(u + 1, v)? - point(u - 1, v)?;
        let down = point(u, v + 1)? - point(u, v - 1)?;
        across.cross(&down).try_normalize(1e-12)
    }

    /// Applies the faults of the mask, and takes out of it what lies on the table or far behind.
    fn mislabel(&mut self, conditions: &Conditions, object: &Occupancy, size: f64) {
        if conditions.mask_growth != 0 || conditions.mask_shift != [0.0; 2] {
            let exact = self.labels.clone();
            let shift = conditions.mask_shift.map(|v| v.round() as i32);
            let side = SIDE as i32;
            let of = |u: i32, v: i32| {
                let inside = (0..side).contains(&u) && (0..side).contains(&v);
                if inside { exact[(v * side + u) as usize] } else { 0 }
            };
            let reach = conditions.mask_growth.abs();
            let around = |u: i32, v: i32, wanted: &dyn Fn(u16) -> bool| {
                (-reach..=reach).any(|dv| (-reach..=reach).any(|du| du * du + dv * dv <= reach * reach && wanted(of(u + du, v + dv))))
            };
            for v in 0..side {
                for u in 0..side {
                    let own = &mut self.labels[(v * side + u) as usize];
                    if *own == OCCLUDER {
                        continue;
                    }
                    let (x, y) = (u - shift[0], v - shift[1]);
                    let inside = match conditions.mask_growth {
                        n if n < 0 => !around(x, y, &|label| label != OBJECT),
                        _ => around(x, y, &|label| label == OBJECT),
                    };
                    *own = if inside { OBJECT } else { 0 };
                }
            }
        }
        if conditions.cut > 0.0 {
            let frame = Frame::new(&self.intrinsics, &self.depth, &self.labels);
            let Ok(frame) = frame else { return };
            let farthest = self.object_to_camera.translation.vector.z + 1.2 * size;
            let hollow = conditions.keeps_floors.then(|| Hollow::new(object));
            let back = self.object_to_camera.inverse();
            let is_left = |pixel: usize| {
                let Some(point) = frame.point(pixel) else { return true };
                if hollow.as_ref().is_some_and(|hollow| hollow.holds(&(back * point))) {
                    return false;
                }
                let low = self.table.is_some_and(|table| table.height(&point) < conditions.cut * size);
                low || point.z > farthest
            };
            let left: Vec<usize> = (0..self.depth.len()).filter(|pixel| self.labels[*pixel] == OBJECT && is_left(*pixel)).collect();
            left.into_iter().for_each(|pixel| self.labels[pixel] = 0);
        }
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
        self.average(conditions.window, (ONE_SURFACE * size) as f32);
        let gaussian = |rng: &mut dyn FnMut() -> f64| -> f64 {
            let [a, b] = [rng(), rng()];
            // Box and Muller's Gaussian.
            (-2.0 * (1.0 - a).ln()).sqrt() * (TAU * b).cos()
        };
        let mut uniform = || rng.random_range(0.0..1.0);
        let shared: Vec<f64> = match conditions.shared_noise {
            true => smoothed((0..self.depth.len()).map(|_| gaussian(&mut uniform)).collect()),
            false => Vec::new(),
        };
        if conditions.noise > 0.0 || conditions.dropout > 0.0 || conditions.step > 0.0 {
            for (pixel, (depth, label)) in self.depth.iter_mut().zip(&self.labels).enumerate() {
                if *label != OBJECT || *depth <= 0.0 {
                    continue;
                }
                let noise = shared.get(pixel).copied().unwrap_or_else(|| gaussian(&mut uniform));
                *depth += (conditions.noise * size * noise) as f32;
                if conditions.step > 0.0 {
                    let step = (conditions.step * size) as f32;
                    *depth = (*depth / step).round() * step;
                }
                if uniform() < conditions.dropout {
                    *depth = 0.0;
                }
            }
        }
    }

    /// Averages the object's readings over windows of so many pixels to each side, leaving out what is deeper or nearer by `most` voxels.
    fn average(&mut self, window: u32, most: f32) {
        if window == 0 {
            return;
        }
        let (exact, reach, side) = (self.depth.clone(), window as i32, SIDE as i32);
        for pixel in (0..exact.len()).filter(|pixel| self.labels[*pixel] == OBJECT && exact[*pixel] > 0.0) {
            let (u, v) = (pixel as i32 % side, pixel as i32 / side);
            let (mut sum, mut count) = (0.0, 0.0_f32);
            for (x, y) in (-reach..=reach).flat_map(|dv| (-reach..=reach).map(move |du| (u + du, v + dv))) {
                if !(0..side).contains(&x) || !(0..side).contains(&y) {
                    continue;
                }
                let at = (y * side + x) as usize;
                if self.labels[at] == OBJECT && exact[at] > 0.0 && (exact[at] - exact[pixel]).abs() < most {
                    (sum, count) = (sum + exact[at], count + 1.0);
                }
            }
            self.depth[pixel] = sum / count.max(1.0);
        }
    }

    /// Readings of the object, in the camera's frame.
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

    /// Height of the table in the object's grid, voxels from the centre, if it is known.
    pub fn table_height(&self) -> Option<f64> {
        let table = self.table?;
        Some(-table.height(&(self.object_to_camera * Point3::origin())))
    }

    /// The carved grid: `rotation` and `centre` say how it lies in the object's (axes of the grid to axes of the object; voxels from the
    /// centre), `edge` how big its voxels are, in voxels of the object.
    pub fn carve(&self, dims: Dims, rotation: &Rotation, centre: &Vector3<f64>, edge: f64, bytes: &mut Vec<u8>, out: &mut Observation) {
        let grid_to_object = Isometry3::from_parts(Translation3::from(*centre), *rotation);
        let Ok(grid) = Grid::new(dims.into(), edge, self.object_to_camera * grid_to_object) else { return };
        let Some(frame) = self.frame() else { return };
        bytes.clear();
        bytes.resize(dims.voxels(), 0);
        let carver = Carver { frame, object: OBJECT, sensor: self.sensor, support: self.table, grid };
        if carver.carve(bytes).is_ok() {
            // Only the three codes are written.
            let _ = out.read(bytes);
        }
    }
}

/// Independent Gaussian numbers of an image, averaged with their neighbours (the binomial filter 1 2 1 of both directions) and scaled to
/// deviation 1 again.
fn smoothed(white: Vec<f64>) -> Vec<f64> {
    let side = SIDE as i32;
    let at = |u: i32, v: i32| white[(v.clamp(0, side - 1) * side + u.clamp(0, side - 1)) as usize];
    let row = |u: i32, v: i32| at(u - 1, v) + 2.0 * at(u, v) + at(u + 1, v);
    (0..side * side).map(|n| (n % side, n / side)).map(|(u, v)| (row(u, v - 1) + 2.0 * row(u, v) + row(u, v + 1)) / 6.0).collect()
}

/// Which places of an object's grid lie within a vessel: lower than what stands around them on all four sides.
struct Hollow {
    dims: Dims,
    /// Of each column, the height up to which it is walled in, voxels.
    walled: Vec<f64>,
}

impl Hollow {
    fn new(object: &Occupancy) -> Self {
        let dims = object.dims();
        let (nx, ny) = (dims.x(), dims.y());
        let mut tops = vec![0.0_f64; nx * ny];
        for voxel in object.bits().ones() {
            let [i, j, k] = dims.coordinates(voxel);
            let top = &mut tops[i * ny + j];
            *top = top.max(k as f64 + 1.0);
        }
        let highest = |range: &mut dyn Iterator<Item = (usize, usize)>| range.map(|(i, j)| tops[i * ny + j]).fold(0.0, f64::max);
        let walled = (0..nx * ny)
            .map(|n| (n / ny, n % ny))
            .map(|(i, j)| {
                let [west, east] = [highest(&mut (0..i).map(|n| (n, j))), highest(&mut (i + 1..nx).map(|n| (n, j)))];
                let [south, north] = [highest(&mut (0..j).map(|n| (i, n))), highest(&mut (j + 1..ny).map(|n| (i, n)))];
                west.min(east).min(south).min(north)
            })
            .collect();
        Self { dims, walled }
    }

    /// Whether a point (voxels from the grid's centre) is more than two voxels lower than the rim about it.
    fn holds(&self, point: &Point3<f64>) -> bool {
        let [x, y, z] = <[usize; 3]>::from(self.dims).map(|side| side as f64 / 2.0);
        let (i, j) = ((point.x + x).floor(), (point.y + y).floor());
        let inside = i >= 0.0 && j >= 0.0 && i < 2.0 * x && j < 2.0 * y;
        inside && point.z + z < self.walled[i as usize * self.dims.y() + j as usize] - 2.0
    }
}

/// Observation of an object by a camera under perfect conditions, in the object's own grid; all unknown for an empty object.
pub fn observe(object: &Occupancy, eye: &Eye) -> Observation {
    let mut observation = Observation::unknown(object.dims());
    let mut rng = ChaCha8Rng::seed_from_u64(0);
    if let Some(view) = RenderedView::new(object, eye, &Conditions::default(), &mut rng) {
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
