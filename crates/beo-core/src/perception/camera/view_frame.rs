//! The frame in which views of cameras are compared: laid about what is seen, turned towards the camera; and what is hidden in it.
//!
//! x is the horizontal direction in which the camera looks at the object, z is up; the origin is the middle of the box about the filled
//! voxels, and the box's longest side is [`SEEN`] units of the [`SPAN`] that are looked at. It depends on neither the object's pose nor
//! its size nor on where the grid lies, so that densities learned in it hold for all of them.

use crate::grid::{EMPTY, Observation, Rotation, Similarity, yaw};
use crate::model::CAMERA_CELLS;
use nalgebra::{Matrix3, Vector3};

/// Units along each axis that are looked at …
pub const SPAN: usize = 30;
/// … of which the box about what is seen takes this many along its longest side.
pub const SEEN: f64 = 20.0;
/// Units along an edge of a cell over which the hull is averaged.
const CELL: usize = 2;
/// Cells of the frame.
pub const CELLS: usize = CAMERA_CELLS;
const _: () = assert!(CELLS == (SPAN / CELL) * (SPAN / CELL) * (SPAN / CELL));
/// Share of the filled voxels that is left out at each end of each axis.
const TRIMMED: f64 = 0.005;

/// A layer of which a larger share is known to be empty lies below a table.
const BELOW_TABLE: f64 = 0.97;
/// The object ends above a layer of which below it a larger share is known to be empty, …
const EMPTY_BELOW: f64 = 0.5;
/// … if the table is no more than so many layers deeper where it is deepest.
const TILTED: usize = 3;

/// Where the frame lies in a grid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ViewFrame {
    /// Direction of x in the grid: radians about z.
    pub azimuth: f64,
    /// Of the camera above the horizontal, seen from the origin: radians.
    pub elevation: f64,
    /// The origin, in voxels from the grid's centre.
    pub origin: Vector3<f64>,
    /// A unit, in voxels of the grid.
    pub unit: f64,
    /// Half of the box about what is seen, in units.
    half: Vector3<f64>,
    /// The camera, in units along the frame's axes.
    camera: Vector3<f64>,
}

/// Pixels along a side of the image in which shadows are found: one per unit at the origin's distance.
const PIXELS: usize = 80;

/// How near what is seen is to the camera, by direction.
#[derive(Default)]
pub struct ShadowImage {
    /// Distance along the direction of looking, units; infinite where nothing is seen.
    nearest: Vec<f32>,
    /// Edge of a voxel, units.
    edge: f64,
}

impl ShadowImage {
    fn clear(&mut self, edge: f64) {
        self.nearest.clear();
        self.nearest.resize(PIXELS * PIXELS, f32::INFINITY);
        self.edge = edge;
    }

    /// A filled voxel covers all pixels that it touches. `at`: right, down and forward from the camera.
    fn add(&mut self, at: &Vector3<f64>, distance: f64) {
        if at.z <= 0.0 {
            return;
        }
        let scale = distance / at.z;
        let reach = 0.6 * self.edge * scale;
        let pixels = |centre: f64| {
            let middle = centre * scale + PIXELS as f64 / 2.0;
            let low = (middle - reach).floor().max(0.0) as usize;
            low..((middle + reach).floor().max(-1.0) + 1.0).min(PIXELS as f64) as usize
        };
        for v in pixels(at.y) {
            for u in pixels(at.x) {
                let nearest = &mut self.nearest[v * PIXELS + u];
                *nearest = nearest.min(at.z as f32);
            }
        }
    }

    /// Whether a point is at or behind what is seen in its direction.
    #[inline]
    fn hides(&self, at: &Vector3<f64>, distance: f64) -> bool {
        if at.z <= 0.0 {
            return false;
        }
        let scale = distance / at.z;
        let (u, v) = (at.x * scale + PIXELS as f64 / 2.0, at.y * scale + PIXELS as f64 / 2.0);
        let inside = u >= 0.0 && v >= 0.0 && u < PIXELS as f64 && v < PIXELS as f64;
        inside && at.z >= f64::from(self.nearest[v as usize * PIXELS + u as usize]) - 0.5 * self.edge
    }
}

impl ViewFrame {
    /// The frame of an observation by a camera at `camera` (voxels from the grid's centre); `None` where too little is seen.
    pub fn new(observation: &Observation, camera: &Vector3<f64>, scratch: &mut Vec<f64>) -> Option<Self> {
        let dims = observation.dims();
        let middle = Vector3::from(<[usize; 3]>::from(dims).map(|side| (side as f64 - 1.0) / 2.0));
        let count = observation.filled().count_ones(..);
        if count < 8 {
            return None;
        }
        let filled = || {
            observation.filled().ones().map(|voxel| {
                let [i, j, k] = dims.coordinates(voxel);
                Vector3::new(i as f64, j as f64, k as f64) - middle
            })
        };
        let centre = filled().sum::<Vector3<f64>>() / count as f64;
        let away = centre - camera;
        // From straight above, the direction of looking is that of the grid's x.
        let azimuth = if away.xy().norm() > 1e-3 * away.norm() { away.y.atan2(away.x) } else { 0.0 };
        let turn = yaw(-azimuth).to_rotation_matrix();
        let mut ends = |axis: usize| {
            scratch.clear();
            scratch.extend(filled().map(|at| turn.matrix().row(axis).transpose().dot(&at)));
            trimmed(scratch, TRIMMED)
        };
        let ends = [ends(0), ends(1), ends(2)];
        let (mut low, high) = (Vector3::from(ends.map(|e| e[0] - 0.5)), Vector3::from(ends.map(|e| e[1] + 0.5)));
        low.z = bottom(observation, turn.matrix(), &low, &high);
        let origin = turn.inverse() * ((low + high) / 2.0);
        let unit = (high - low).max() / SEEN;
        let up = camera - origin;
        let elevation = up.z.atan2(up.xy().norm());
        Some(Self { azimuth, elevation, origin, unit, half: (high - low) / (2.0 * unit), camera: turn * up / unit })
    }

    /// Half of the box about what is seen along the frame's axes, in voxels of the grid.
    pub fn half_voxels(&self) -> Vector3<f64> {
        self.half * self.unit
    }

    /// From the grid's axes to the frame's.
    pub fn grid_to_axes(&self) -> Rotation {
        yaw(-self.azimuth)
    }

    /// Averages over the cells of the shadow of what is seen: filled voxels and what they hide from the camera; C order, z fastest. What
    /// lies below the box is no part of it.
    ///
    /// Unlike the visual hull, it does not depend on what there is beside and behind the object: a table, a wall, or nothing that the
    /// sensor could read.
    pub fn shadow(&self, observation: &Observation, image: &mut ShadowImage, out: &mut Vec<f32>) {
        self.render(observation, image);
        // Of unit (i, j, k): the middle of it, from the origin.
        let half = SPAN as f64 / 2.0 - 0.5;
        let bottom = (half - self.half.z).ceil().max(0.0) as usize;
        let axes = self.looking();
        const SIDE: usize = SPAN / CELL;
        const SHARE: f32 = 1.0 / (CELL * CELL * CELL) as f32;
        out.clear();
        out.resize(CELLS, 0.0);
        let up = axes.column(2).into_owned();
        for i in 0..SPAN {
            for j in 0..SPAN {
                let start = axes * (Vector3::new(i as f64 - half, j as f64 - half, -half) - self.camera);
                let stack = ((i / CELL) * SIDE + j / CELL) * SIDE;
                for k in bottom..SPAN {
                    if image.hides(&(start + up * k as f64), self.distance()) {
                        out[stack + k / CELL] += SHARE;
                    }
                }
            }
        }
    }

    /// Distance of the camera from the origin, units.
    fn distance(&self) -> f64 {
        self.camera.norm().max(1e-6)
    }

    /// Rows: right and down in the camera's image, and the direction from the camera to the origin, in the frame.
    fn looking(&self) -> Matrix3<f64> {
        let forward = (-self.camera).try_normalize(1e-9).unwrap_or(Vector3::x());
        let right = forward.cross(&Vector3::z()).try_normalize(1e-9).unwrap_or(-Vector3::y());
        Matrix3::from_rows(&[right.transpose(), forward.cross(&right).transpose(), forward.transpose()])
    }

    /// Where filled voxels are seen, and how far away.
    fn render(&self, observation: &Observation, image: &mut ShadowImage) {
        let dims = observation.dims();
        let middle = Vector3::from(<[usize; 3]>::from(dims).map(|side| (side as f64 - 1.0) / 2.0));
        let back = yaw(-self.azimuth).to_rotation_matrix();
        let axes = self.looking();
        let turn = axes * back.matrix() / self.unit;
        let shift = axes * self.camera + turn * self.origin;
        image.clear(1.0 / self.unit);
        for voxel in observation.filled().ones() {
            let [i, j, k] = dims.coordinates(voxel);
            image.add(&(turn * (Vector3::new(i as f64, j as f64, k as f64) - middle) - shift), self.distance());
        }
    }

    /// How an object lies in the grid that is turned by `yaw` radians in this frame, with `scale` units per voxel of its canonical grid,
    /// whose centre is at `place` (units).
    pub fn placed(&self, angle: f64, scale: f64, place: &Vector3<f64>) -> Similarity {
        let axes = yaw(self.azimuth);
        Similarity {
            rotation: yaw(self.azimuth + angle),
            scale: scale * self.unit,
            translation_voxels: self.origin + axes * place * self.unit,
        }
    }

    /// The opposite: yaw in this frame, units per voxel, and place in units.
    pub fn seen(&self, placed: &Similarity) -> (Rotation, f64, Vector3<f64>) {
        let back = yaw(-self.azimuth);
        (back * placed.rotation, placed.scale / self.unit, back * (placed.translation_voxels - self.origin) / self.unit)
    }
}

/// Where an object ends whose filled voxels end at `low.z`, voxels from the grid's centre: on the table, if nothing is known of what is between.
/// The sides of shiny things often have no reading, and their lower parts are hidden by others. A layer that is known to be empty as far as the
/// grid goes is below a table: without one, some of it would lie in the object's shadow. `turn` goes from the grid's axes to those of the box
/// from `low` to `high`.
fn bottom(observation: &Observation, turn: &Matrix3<f64>, low: &Vector3<f64>, high: &Vector3<f64>) -> f64 {
    let dims = observation.dims();
    let middle = Vector3::from(<[usize; 3]>::from(dims).map(|side| (side as f64 - 1.0) / 2.0));
    let is_below = |i: usize, j: usize| {
        let at = turn * (Vector3::new(i as f64, j as f64, 0.0) - middle);
        (low.x..=high.x).contains(&at.x) && (low.y..=high.y).contains(&at.y)
    };
    let lowest = (low.z + 0.5 + middle.z).round().clamp(0.0, dims.z() as f64 - 1.0) as usize;
    // Of a layer's columns that count, the share that is known to be empty.
    let empty_share = |k: usize, counts: &dyn Fn(usize, usize) -> bool| {
        let columns = (0..dims.x()).flat_map(|i| (0..dims.y()).map(move |j| (i, j))).filter(|(i, j)| counts(*i, *j));
        let (empty, all) = columns.fold((0_u32, 0_u32), |(empty, all), (i, j)| {
            let is_empty = observation.code(dims.index(i, j, k)) == EMPTY;
            (empty + u32::from(is_empty), all + 1)
        });
        f64::from(empty) / f64::from(all.max(1))
    };
    let Some(first) = (0..lowest).rev().find(|k| empty_share(*k, &is_below) > EMPTY_BELOW) else { return low.z };
    // A table may be a little tilted in the grid; what is seen through, and no table soon below, is nothing to stand on.
    let is_table = (first.saturating_sub(TILTED)..=first).any(|k| empty_share(k, &|_, _| true) > BELOW_TABLE);
    if is_table { first as f64 + 0.5 - middle.z } else { low.z }
}

/// Lower and upper end of the values, without the outermost on both sides: a share of all at each.
pub(super) fn trimmed(values: &mut [f64], share: f64) -> [f64; 2] {
    let left_out = (share * values.len() as f64) as usize;
    let last = values.len() - 1 - left_out;
    let low = *values.select_nth_unstable_by(left_out, f64::total_cmp).1;
    let high = *values.select_nth_unstable_by(last, f64::total_cmp).1;
    [low, high]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::{Dims, FILLED, Occupancy, UNKNOWN};

    /// A box of 12 × 6 × 4 voxels, known all around, seen from −y: x of the frame is +y of the grid.
    #[test]
    fn the_frame_is_laid_about_the_box_that_is_seen() {
        let dims = Dims::cube(30).unwrap();
        let object = Occupancy::from_fn(dims, |i, j, k| (9..21).contains(&i) && (14..20).contains(&j) && (2..6).contains(&k));
        let observation = Observation::complete(&object);
        let frame = ViewFrame::new(&observation, &Vector3::new(0.0, -60.0, 50.0), &mut Vec::new()).unwrap();
        assert!((frame.azimuth - std::f64::consts::FRAC_PI_2).abs() < 1e-9);
        assert!((frame.origin - Vector3::new(0.0, 2.0, -11.0)).norm() < 1e-9, "{}", frame.origin);
        assert!((frame.unit - 12.0 / SEEN).abs() < 1e-9);
        assert!((frame.elevation - (61.0_f64).atan2(62.0)).abs() < 1e-9);
        // Against the rays from the camera to the middle of each unit, walked in small steps.
        let mut shadow = Vec::new();
        frame.shadow(&observation, &mut ShadowImage::default(), &mut shadow);
        let middle = Vector3::repeat(14.5);
        let into_grid = |at: Vector3<f64>| yaw(frame.azimuth) * at * frame.unit + frame.origin + middle;
        let camera = into_grid(frame.camera);
        assert!((camera - middle - Vector3::new(0.0, -60.0, 50.0)).norm() < 1e-9);
        let mut expected = vec![0.0_f32; CELLS];
        for (i, j, k) in (0..SPAN).flat_map(|i| (0..SPAN).flat_map(move |j| (0..SPAN).map(move |k| (i, j, k)))) {
            let at = into_grid(Vector3::new(i as f64, j as f64, k as f64) - middle);
            let inside = |p: Vector3<f64>| {
                p.iter().all(|v| *v >= -0.5) && {
                    let [i, j, k] = [p.x, p.y, p.z].map(|v| v.round() as usize);
                    object.is_filled(i, j, k)
                }
            };
            let hidden = (0..1000).any(|step| inside(camera + (at - camera) * (f64::from(step) / 999.0)));
            if hidden && k as f64 > 14.5 - frame.half.z {
                expected[((i / 2) * 15 + j / 2) * 15 + k / 2] += 0.125;
            }
        }
        let (found, sum): (f32, f32) = (shadow.iter().sum(), expected.iter().sum());
        let apart: f32 = shadow.iter().zip(&expected).map(|(a, b)| (a - b).abs()).sum();
        // The image's pixels are as wide as a voxel and a half: borders are blurred by that.
        assert!((found / sum - 1.0).abs() < 0.3 && apart < 0.4 * sum, "{found} {sum} {apart}");
        let placed = Similarity { rotation: yaw(0.3), scale: 0.9, translation_voxels: Vector3::new(1.0, 2.0, 3.0) };
        let (rotation, scale, place) = frame.seen(&placed);
        let back = frame.placed(crate::grid::yaw_of(&rotation), scale, &place);
        assert!((back.translation_voxels - placed.translation_voxels).norm() < 1e-9 && (back.scale - 0.9).abs() < 1e-9);
        assert!(back.rotation.angle_to(&placed.rotation) < 1e-6);
    }

    /// A lid high above a table, with nothing seen between them, ends on the table; without a table, or if it floats, where it ends itself.
    #[test]
    fn what_has_no_readings_reaches_down_to_what_is_empty() {
        let dims = Dims::cube(30).unwrap();
        let lid = Occupancy::from_fn(dims, |i, j, k| (9..21).contains(&i) && (9..21).contains(&j) && k == 24);
        let frame_of = |is_empty: &dyn Fn(usize, usize, usize) -> bool| {
            let code = |voxel: usize| {
                let [i, j, k] = dims.coordinates(voxel);
                if lid.is_filled(i, j, k) {
                    FILLED
                } else if is_empty(i, j, k) {
                    EMPTY
                } else {
                    UNKNOWN
                }
            };
            let mut seen = Observation::unknown(dims);
            seen.read(&(0..dims.voxels()).map(code).collect::<Vec<_>>()).unwrap();
            ViewFrame::new(&seen, &Vector3::new(-60.0, 0.0, 50.0), &mut Vec::new()).unwrap()
        };
        let height = |frame: &ViewFrame| 2.0 * frame.half_voxels().z;
        let of_table = frame_of(&|_, _, k| k < 5);
        assert!((height(&of_table) - 20.0).abs() < 1e-9 && (of_table.origin.z - (15.0 - 15.0)).abs() < 1e-9, "{}", of_table.origin);
        assert!((height(&frame_of(&|_, _, _| false)) - 1.0).abs() < 1e-9);
        assert!((height(&frame_of(&|_, _, k| k < 24)) - 1.0).abs() < 1e-9);
        // What is seen beside and in front of it is not below it; what is seen behind it, without a table, is not one.
        assert!((height(&frame_of(&|i, j, k| k < 5 || k < 24 && (i < 9 || j < 8))) - 20.0).abs() < 1e-9);
        assert!((height(&frame_of(&|i, _, k| k < 5 && i < 25)) - 1.0).abs() < 1e-9);
        // It floats above a table.
        assert!((height(&frame_of(&|i, _, k| k < 5 || (15..24).contains(&k) && (9..21).contains(&i))) - 1.0).abs() < 1e-9);
    }

    #[test]
    fn too_little_to_see_has_no_frame() {
        let dims = Dims::cube(8).unwrap();
        assert!(ViewFrame::new(&Observation::unknown(dims), &Vector3::new(9.0, 0.0, 5.0), &mut Vec::new()).is_none());
    }
}
