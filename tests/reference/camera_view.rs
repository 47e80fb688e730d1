//! What a camera's view shows: the frame about the filled voxels, and the shadow of what is seen, averaged over the cells of that frame.
//!
//! Every point is compared with every filled voxel; there is no image in between.

use beo_core::grid::{EMPTY, FILLED, Observation, Similarity};
use nalgebra::{Matrix3, UnitQuaternion, Vector3};

/// Units along each axis that are looked at; the box about what is seen takes `LONGEST` of them along its longest side.
const SPAN: usize = 30;
const LONGEST: f64 = 20.0;
/// Units along an edge of a cell.
const CELL: usize = 2;
/// Pixels along a side of the image whose pixels decide what hides what.
const PIXELS: f64 = 80.0;
/// Share of the filled voxels that is left out at each end of each axis.
const TRIMMED: f64 = 0.005;
/// A voxel covers the pixels within this share of its edge from its centre, and hides what is no nearer than half an edge before it.
const REACH: f64 = 0.6;

/// A frame with x in the horizontal direction in which the camera looks at the object and z up.
pub struct Frame {
    /// Radians from the grid's x to the frame's.
    pub azimuth: f64,
    /// Of the camera above the horizontal, radians.
    pub elevation: f64,
    /// Voxels from the grid's centre, along the grid's axes.
    pub origin: Vector3<f64>,
    /// Voxels of the grid.
    pub unit: f64,
    /// Sides of the box about what is seen, units.
    sides: Vector3<f64>,
    /// Units, along the frame's axes.
    camera: Vector3<f64>,
    /// The filled voxels, likewise.
    filled: Vec<Vector3<f64>>,
}

/// The voxels that have a code, from the grid's centre.
fn from_the_centre(seen: &Observation, code: u8) -> Vec<Vector3<f64>> {
    let dims = seen.dims();
    let middle = Vector3::new(dims.x() as f64, dims.y() as f64, dims.z() as f64).add_scalar(-1.0) / 2.0;
    let voxels = (0..dims.voxels()).filter(|v| seen.code(*v) == code);
    voxels.map(|v| Vector3::from(dims.coordinates(v).map(|c| c as f64)) - middle).collect()
}

/// Height at which what is seen from `low` up stands on a table, voxels from the grid's centre: above the first layer down of which more than half
/// is known to be empty below the object, if 0.97 of it or of one of the three next ones is so as far as the grid goes; else where it ends itself.
fn foot(seen: &Observation, azimuth: f64, low: &Vector3<f64>, high: &Vector3<f64>) -> f64 {
    let half = (seen.dims().z() as f64 - 1.0) / 2.0;
    let shares = |z: f64| {
        let in_layer = |code: Option<u8>| -> Vec<Vector3<f64>> {
            let codes = code.map_or(vec![EMPTY, FILLED, beo_core::grid::UNKNOWN], |code| vec![code]);
            codes.iter().flat_map(|code| from_the_centre(seen, *code)).filter(|at| (at.z - z).abs() < 0.25).collect()
        };
        let below = |at: &&Vector3<f64>| {
            let at = about_z(-azimuth) * **at;
            (0..2).all(|axis| low[axis] <= at[axis] && at[axis] <= high[axis])
        };
        let (empty, all) = (in_layer(Some(EMPTY)), in_layer(None));
        let of_object = all.iter().filter(below).count().max(1) as f64;
        (empty.len() as f64 / all.len().max(1) as f64, empty.iter().filter(below).count() as f64 / of_object)
    };
    let lowest = (low.z + 0.5 + half).round() - half;
    let layers = std::iter::successors(Some(lowest - 1.0), |z| Some(z - 1.0)).take_while(|z| *z >= -half - 0.25);
    let Some(first) = layers.clone().find(|z| shares(*z).1 > 0.5) else { return low.z };
    let is_table = layers.filter(|z| *z <= first && *z >= first - 3.25).any(|z| shares(z).0 > 0.97);
    if is_table { first + 0.5 } else { low.z }
}

/// The matrix of a rotation about z.
pub fn about_z(angle: f64) -> Matrix3<f64> {
    let (sin, cos) = angle.sin_cos();
    Matrix3::new(cos, -sin, 0.0, sin, cos, 0.0, 0.0, 0.0, 1.0)
}

impl Frame {
    /// Of an observation by a camera at `camera`, voxels from the grid's centre.
    pub fn new(seen: &Observation, camera: &Vector3<f64>) -> Self {
        let filled = from_the_centre(seen, FILLED);
        let away = filled.iter().sum::<Vector3<f64>>() / filled.len() as f64 - camera;
        let azimuth = away.y.atan2(away.x);
        let along: Vec<Vector3<f64>> = filled.iter().map(|at| about_z(-azimuth) * at).collect();
        let left_out = (TRIMMED * filled.len() as f64).floor() as usize;
        let end = |axis: usize, place: usize| {
            let mut values: Vec<f64> = along.iter().map(|at| at[axis]).collect();
            values.sort_by(f64::total_cmp);
            values[place]
        };
        let mut low = Vector3::from_fn(|axis, _| end(axis, left_out) - 0.5);
        let high = Vector3::from_fn(|axis, _| end(axis, filled.len() - 1 - left_out) + 0.5);
        low.z = foot(seen, azimuth, &low, &high);
        let sides = high - low;
        let unit = sides.max() / LONGEST;
        let origin = about_z(azimuth) * (low + high) / 2.0;
        let up = camera - origin;
        Self {
            azimuth,
            elevation: up.z.atan2(up.x.hypot(up.y)),
            origin,
            unit,
            sides: sides / unit,
            camera: about_z(-azimuth) * up / unit,
            filled: filled.iter().map(|at| about_z(-azimuth) * (at - origin) / unit).collect(),
        }
    }

    /// Sides of the box about what is seen, voxels of the grid.
    pub fn sides_voxels(&self) -> Vector3<f64> {
        self.sides * self.unit
    }

    /// The voxels that have a code, from the origin along the frame's axes, in voxels of the grid.
    pub fn voxels(&self, seen: &Observation, code: u8) -> Vec<Vector3<f64>> {
        from_the_centre(seen, code).iter().map(|at| about_z(-self.azimuth) * (at - self.origin)).collect()
    }

    /// Shares of the cells that lie in the shadow of what is seen, C order; nothing below the box about it counts.
    pub fn shadow(&self) -> Vec<f64> {
        let (distance, edge) = (self.camera.norm(), 1.0 / self.unit);
        let forward = -self.camera / distance;
        let right = forward.cross(&Vector3::z()).normalize();
        let down = forward.cross(&right);
        // Place in the image, pixels, and depth, units.
        let project = |at: &Vector3<f64>| {
            let away = at - self.camera;
            let depth = forward.dot(&away);
            let pixel = |axis: &Vector3<f64>| axis.dot(&away) * distance / depth + PIXELS / 2.0;
            (pixel(&right), pixel(&down), depth)
        };
        let voxels: Vec<(f64, f64, f64)> = self.filled.iter().map(project).filter(|(.., depth)| *depth > 0.0).collect();
        let hides = |(u, v, depth): (f64, f64, f64), at: &(f64, f64, f64)| {
            let reach = REACH * edge * distance / depth;
            let covers = |centre: f64, pixel: f64| (centre - reach).floor() <= pixel && pixel <= (centre + reach).floor();
            covers(u, at.0.floor()) && covers(v, at.1.floor()) && at.2 >= depth - 0.5 * edge
        };
        let side = SPAN / CELL;
        let half = (SPAN as f64 - 1.0) / 2.0;
        let mut cells = vec![0.0; side * side * side];
        for (i, j, k) in (0..SPAN).flat_map(|i| (0..SPAN).flat_map(move |j| (0..SPAN).map(move |k| (i, j, k)))) {
            let at = Vector3::new(i as f64, j as f64, k as f64).add_scalar(-half);
            let image = project(&at);
            let is_within = [image.0, image.1].iter().all(|v| (0.0..PIXELS).contains(v)) && image.2 > 0.0;
            if at.z >= -self.sides.z / 2.0 && is_within && voxels.iter().any(|voxel| hides(*voxel, &image)) {
                cells[((i / CELL) * side + j / CELL) * side + k / CELL] += 1.0 / (CELL * CELL * CELL) as f64;
            }
        }
        cells
    }

    /// How an object lies in the grid that rests by `resting`, is turned by `angle` in this frame, whose voxels measure `scale` units and
    /// whose grid has its centre at `place`, units.
    pub fn placed(&self, resting: [f64; 4], angle: f64, scale: f64, place: &Vector3<f64>) -> Placed {
        let [x, y, z, w] = resting;
        let resting = UnitQuaternion::new_normalize(nalgebra::Quaternion::new(w, x, y, z)).to_rotation_matrix().into_inner();
        Placed {
            rotation: about_z(self.azimuth + angle) * resting,
            scale: scale * self.unit,
            shift: self.origin + about_z(self.azimuth) * place * self.unit,
        }
    }

    /// The opposite of upright objects: angle, scale and place.
    pub fn parameters(&self, placed: &Similarity) -> (f64, f64, Vector3<f64>) {
        let x = placed.rotation * Vector3::x();
        let place = about_z(-self.azimuth) * (placed.translation_voxels - self.origin) / self.unit;
        (x.y.atan2(x.x) - self.azimuth, placed.scale / self.unit, place)
    }
}

/// How an object lies in a grid: g = scale · R p + shift.
pub struct Placed {
    pub rotation: Matrix3<f64>,
    pub scale: f64,
    pub shift: Vector3<f64>,
}

impl Placed {
    /// As the training shapes stand in their grids.
    pub fn as_it_came() -> Self {
        Self { rotation: Matrix3::identity(), scale: 1.0, shift: Vector3::zeros() }
    }
}
