//! The frame in which views of cameras are compared: laid about what is seen, turned towards the camera.
//!
//! x is the horizontal direction in which the camera looks at the object, z is up; the origin is the middle of the box about the filled
//! voxels, and the box's longest side is [`SEEN`] units of the [`SPAN`] that are looked at. It depends on neither the object's pose nor
//! its size nor on where the grid lies, so that densities learned in it hold for all of them.

use crate::grid::{Observation, Placed, Rotation, yaw};
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
            trimmed(scratch)
        };
        let ends = [ends(0), ends(1), ends(2)];
        let (low, high) = (Vector3::from(ends.map(|e| e[0] - 0.5)), Vector3::from(ends.map(|e| e[1] + 0.5)));
        let origin = turn.inverse() * ((low + high) / 2.0);
        let unit = (high - low).max() / SEEN;
        let up = camera - origin;
        let elevation = up.z.atan2(up.xy().norm());
        Some(Self { azimuth, elevation, origin, unit, half: (high - low) / (2.0 * unit) })
    }

    /// Averages of the visual hull (filled or unknown) over the cells, in C order, z fastest. What lies below the box is no part of it;
    /// outside of the grid, things are as at its border.
    pub fn hull(&self, observation: &Observation, out: &mut Vec<f32>) {
        let dims = observation.dims();
        let sides = <[usize; 3]>::from(dims).map(|side| side as f64);
        let (known, filled) = (observation.known(), observation.filled());
        let axes: Matrix3<f64> = yaw(self.azimuth).to_rotation_matrix().matrix() * self.unit;
        // Of unit (i, j, k): the middle of it, in voxel coordinates.
        let half = SPAN as f64 / 2.0 - 0.5;
        let start = self.origin + Vector3::from(sides) / 2.0 - axes * Vector3::repeat(half);
        let bottom = (half - self.half.z).ceil().max(0.0) as usize;
        const SIDE: usize = SPAN / CELL;
        out.clear();
        out.resize(CELLS, 0.0);
        const SHARE: f32 = 1.0 / (CELL * CELL * CELL) as f32;
        let clamped = |at: f64, side: f64| at.clamp(0.0, side - 1.0) as usize;
        for i in 0..SPAN {
            for j in 0..SPAN {
                let at = start + axes * Vector3::new(i as f64, j as f64, 0.0);
                let column = (clamped(at.x, sides[0]) * dims.y() + clamped(at.y, sides[1])) * dims.z();
                let stack = ((i / CELL) * SIDE + j / CELL) * SIDE;
                for k in bottom..SPAN {
                    let voxel = column + clamped(at.z + axes[(2, 2)] * k as f64, sides[2]);
                    if !known.contains(voxel) || filled.contains(voxel) {
                        out[stack + k / CELL] += SHARE;
                    }
                }
            }
        }
    }

    /// How an object lies in the grid that is turned by `yaw` radians in this frame, with `scale` units per voxel of its canonical grid,
    /// whose centre is at `place` (units).
    pub fn placed(&self, angle: f64, scale: f64, place: &Vector3<f64>) -> Placed {
        let axes = yaw(self.azimuth);
        Placed { rotation: yaw(self.azimuth + angle), scale: scale * self.unit, shift: self.origin + axes * place * self.unit }
    }

    /// The opposite: yaw in this frame, units per voxel, and place in units.
    pub fn seen(&self, placed: &Placed) -> (Rotation, f64, Vector3<f64>) {
        let back = yaw(-self.azimuth);
        (back * placed.rotation, placed.scale / self.unit, back * (placed.shift - self.origin) / self.unit)
    }
}

/// Lower and upper end of the values, without the outermost on both sides.
fn trimmed(values: &mut [f64]) -> [f64; 2] {
    let left_out = (TRIMMED * values.len() as f64) as usize;
    let last = values.len() - 1 - left_out;
    let low = *values.select_nth_unstable_by(left_out, f64::total_cmp).1;
    let high = *values.select_nth_unstable_by(last, f64::total_cmp).1;
    [low, high]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::{Dims, Occupancy};

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
        let mut hull = Vec::new();
        frame.hull(&observation, &mut hull);
        // 20 × 10 × 6.67 units, of cells of 8.
        let volume = f64::from(hull.iter().sum::<f32>()) * 8.0;
        assert!((volume / (20.0 * 10.0 * 20.0 / 3.0) - 1.0).abs() < 0.08, "{volume}");
        let placed = Placed { rotation: yaw(0.3), scale: 0.9, shift: Vector3::new(1.0, 2.0, 3.0) };
        let (rotation, scale, place) = frame.seen(&placed);
        let back = frame.placed(crate::grid::yaw_of(&rotation), scale, &place);
        assert!((back.shift - placed.shift).norm() < 1e-9 && (back.scale - 0.9).abs() < 1e-9);
        assert!(back.rotation.angle_to(&placed.rotation) < 1e-6);
    }

    #[test]
    fn too_little_to_see_has_no_frame() {
        let dims = Dims::cube(8).unwrap();
        assert!(ViewFrame::new(&Observation::unknown(dims), &Vector3::new(9.0, 0.0, 5.0), &mut Vec::new()).is_none());
    }
}
