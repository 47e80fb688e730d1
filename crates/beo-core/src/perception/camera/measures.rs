//! Measures of a view, at the grid's full resolution: lengths, widths by height, the near surface, the upper surface, how
//! the near surface bends, the outline from above.
//!
//! The shadow's densities (`scores`) average over cells of a tenth of the longest side, where a slender box and a slender cylinder look
//! the same. These measures go along the frame's axes and are relative to the seen box along each of them; only three have a unit, the
//! logarithms of the box's lengths, which are missing where voxels have no known size.

use super::ViewFrame;
use super::view_frame::trimmed;
use crate::grid::{Dims, Observation};
use crate::model::CAMERA_MEASURES;
use fixedbitset::FixedBitSet;
use nalgebra::{Matrix3, Vector3};
use std::f64::consts::PI;

/// Steps along each side of the maps of the near and of the upper surface.
const MAP: usize = 8;
/// Heights at which widths are measured.
const HEIGHTS: usize = 12;
/// Columns of the near surface's profile.
const COLUMNS: usize = 10;
/// Bands of height, shares, over which the profile is averaged.
const BANDS: [[f64; 2]; 3] = [[0.1, 0.4], [0.4, 0.7], [0.7, 0.95]];
/// Measures of a band.
const BENDS: usize = 9;
/// Levels of the histogram of heights.
const LEVELS: usize = 6;
/// Thirds of the height in which what is known to be empty is counted.
const THIRDS: usize = 3;
/// Shares of the height from which on outlines from above are measured: of all, and of what is on top.
const OUTLINED: [f64; 2] = [0.0, 0.8];
/// Directions in which the widths of an outline are measured, over half a turn.
const DIRECTIONS: usize = 8;
/// Share of the points that is left out at each end of a width.
const STRAY: f64 = 0.005;
/// Points of an outline, at least.
const LEAST_OUTLINE: usize = 8;
/// Measures of an outline: widths, the least of them, and the area.
const OUTLINE: usize = DIRECTIONS + 2;
/// Numbers that are measured.
pub const MEASURES: usize = CAMERA_MEASURES;
const _: () = assert!(MEASURES == 7 + HEIGHTS + 2 * MAP * MAP + BANDS.len() * BENDS + 7 + LEVELS + THIRDS + OUTLINED.len() * OUTLINE + 1);
/// Of what is not there to be measured.
const ABSENT: f32 = -1.0;

/// Scratch memory.
#[derive(Default)]
pub struct MeasureScratch {
    /// Nearest filled voxel of each column and row of voxels, in widths from the near side.
    nearest: Vec<f64>,
    /// From above, of what lies higher than each of [`OUTLINED`].
    outlines: [Outline; OUTLINED.len()],
    /// Which third of the height each layer of voxels lies in, if any.
    thirds: Vec<Option<usize>>,
}

/// Filled voxels from above.
#[derive(Default)]
struct Outline {
    /// Voxels from the middle of the box, along the frame's axes.
    points: Vec<[f64; 2]>,
    /// Which columns of voxels have one.
    columns: FixedBitSet,
    along: Vec<f64>,
}

impl Outline {
    fn clear(&mut self, dims: Dims) {
        self.points.clear();
        self.columns.clear();
        self.columns.grow(dims.columns());
    }

    /// Adds a voxel, unless its column has one.
    fn add(&mut self, column: usize, at: &Vector3<f64>) {
        if !self.columns.put(column) {
            self.points.push([at.x, at.y]);
        }
    }

    /// Widths in all directions relative to the largest, the least of them, and the area relative to the largest width's square: π / 4 for a disc
    /// and ½ for a square, however they are turned, and somewhat more as widths leave the outermost points out.
    fn measures(&mut self) -> [f64; OUTLINE] {
        let Self { points, along, .. } = self;
        if points.len() < LEAST_OUTLINE {
            return [f64::from(ABSENT); OUTLINE];
        }
        let widths: [f64; DIRECTIONS] = std::array::from_fn(|n| {
            let (sin, cos) = (PI * n as f64 / DIRECTIONS as f64).sin_cos();
            along.clear();
            along.extend(points.iter().map(|[x, y]| cos * x + sin * y));
            let [low, high] = trimmed(along, STRAY);
            high - low + 1.0
        });
        let [least, most] = widths.iter().fold([f64::INFINITY, 0.0], |[least, most], width| [width.min(least), width.max(most)]);
        let mut out = [0.0; OUTLINE];
        out.iter_mut().zip(widths).for_each(|(out, width)| *out = width / most);
        out[DIRECTIONS] = least / most;
        out[DIRECTIONS + 1] = points.len() as f64 / (most * most);
        out
    }
}

/// Where in the box about what is seen a point lies, shares of its sides; `None` outside.
fn share(at: &Vector3<f64>, half: &Vector3<f64>) -> Option<Vector3<f64>> {
    let share = (at + half).component_div(&(2.0 * half));
    share.iter().all(|v| (0.0..1.0).contains(v)).then_some(share)
}

fn step(share: f64, steps: usize) -> usize {
    ((share * steps as f64) as usize).min(steps - 1)
}

/// Measures a view into `out`, [`MEASURES`] numbers; `voxel_m` is the edge of a voxel, metres, if it is known.
pub fn measure(frame: &ViewFrame, observation: &Observation, voxel_m: Option<f64>, scratch: &mut MeasureScratch, out: &mut Vec<f32>) {
    let dims = observation.dims();
    let middle = Vector3::from(<[usize; 3]>::from(dims).map(|side| (side as f64 - 1.0) / 2.0));
    let half = frame.half_voxels();
    let sides = 2.0 * half;
    let rows = sides.z.ceil() as usize + 1;
    scratch.nearest.clear();
    scratch.nearest.resize(COLUMNS * rows, f64::INFINITY);
    let mut front = [[f64::INFINITY; MAP]; MAP];
    let mut top = [[f64::NEG_INFINITY; MAP]; MAP];
    let mut widths = [[f64::INFINITY, f64::NEG_INFINITY]; HEIGHTS];
    let mut levels = [0_u32; LEVELS];
    let mut count = 0;
    let mut lowest = 1.0_f64;
    scratch.outlines.iter_mut().for_each(|outline| outline.clear(dims));
    let grid_to_axes = frame.grid_to_axes();
    let relative = |voxel: usize| {
        let [i, j, k] = dims.coordinates(voxel);
        grid_to_axes * (Vector3::new(i as f64, j as f64, k as f64) - middle - frame.origin)
    };
    for voxel in observation.filled().ones() {
        count += 1;
        let at = relative(voxel);
        let Some(share) = share(&at, &half) else { continue };
        let near = (at.x + half.x) / sides.y;
        let cell = &mut front[step(share.y, MAP)][step(share.z, MAP)];
        *cell = cell.min(near);
        let cell = &mut top[step(share.x, MAP)][step(share.y, MAP)];
        *cell = cell.max(share.z);
        let width = &mut widths[step(share.z, HEIGHTS)];
        *width = [width[0].min(share.y), width[1].max(share.y)];
        levels[step(share.z, LEVELS)] += 1;
        lowest = lowest.min(share.z);
        for (outline, from) in scratch.outlines.iter_mut().zip(OUTLINED) {
            if share.z >= from {
                outline.add(voxel / dims.z(), &at);
            }
        }
        let cell = &mut scratch.nearest[step(share.y, COLUMNS) * rows + (at.z + half.z) as usize];
        *cell = cell.min(near);
    }
    let mut empty = [0_u32; THIRDS];
    // The axes are turned about the vertical: of a column, only the height differs from voxel to voxel.
    let share_of = |voxel: usize| (relative(voxel) + half).component_div(&sides);
    let third = |k: usize| Some(share_of(k).z).filter(|z| (0.0..1.0).contains(z)).map(|z| step(z, THIRDS));
    scratch.thirds.clear();
    scratch.thirds.extend((0..dims.z()).map(third));
    let is_empty = |voxel: usize| observation.known().contains(voxel) && !observation.filled().contains(voxel);
    for first in (0..dims.columns()).map(|column| column * dims.z()) {
        let at = share_of(first);
        if (0.2..0.8).contains(&at.y) && (0.2..0.9).contains(&at.x) {
            let thirds = scratch.thirds.iter().enumerate().filter_map(|(k, third)| Some((first + k, (*third)?)));
            thirds.filter(|(voxel, _)| is_empty(*voxel)).for_each(|(_, third)| empty[third] += 1);
        }
    }

    out.clear();
    let finite = |value: f64| if value.is_finite() { value as f32 } else { ABSENT };
    out.extend(sides.iter().map(|side| voxel_m.map_or(f32::NAN, |edge| (side * edge).ln() as f32)));
    out.extend([sides.y / sides.z, sides.x / sides.y].map(|ratio| ratio.ln() as f32));
    out.push(frame.elevation as f32);
    let faces = sides.x * sides.y + sides.y * sides.z + sides.z * sides.x;
    out.push((f64::from(count) / faces) as f32);
    out.extend(widths.map(|[low, high]| finite(high - low)));
    out.extend(front.as_flattened().iter().map(|v| finite(*v)));
    out.extend(top.as_flattened().iter().map(|v| finite(*v)));
    for [low, high] in BANDS {
        let is_within = |row: usize| (low..high).contains(&((row as f64 + 0.5) / sides.z));
        let profile: [Option<f64>; COLUMNS] = std::array::from_fn(|column| {
            let of = (0..rows).filter(|row| is_within(*row)).map(|row| scratch.nearest[column * rows + row]);
            mean(of.filter(|v| v.is_finite()))
        });
        out.extend(bends(&profile).map_or([ABSENT; BENDS], |bends| bends.map(|v| v as f32)));
    }
    let heights = |cells: &mut dyn Iterator<Item = [usize; 2]>| {
        let seen = cells.map(|[i, j]| top[i][j]).filter(|v| v.is_finite());
        mean(seen).unwrap_or(f64::from(ABSENT))
    };
    const LAST: usize = MAP - 1;
    let all = || (0..MAP).flat_map(|i| (0..MAP).map(move |j| [i, j]));
    let at_end = |v: usize| v == 0 || v == LAST;
    let inside = heights(&mut all().filter(|at| at.iter().all(|v| (3..5).contains(v))));
    let rim = heights(&mut all().filter(|[i, j]| at_end(*i) != at_end(*j)));
    let [near, far] = [0, LAST].map(|row| heights(&mut (0..MAP).map(|j| [row, j])));
    let seen = |cells: &mut dyn Iterator<Item = [usize; 2]>| {
        let (seen, all) = cells.fold((0, 0), |(seen, all), [i, j]| (seen + i32::from(top[i][j].is_finite()), all + 1));
        f64::from(seen) / f64::from(all)
    };
    let (covered, corners) = (seen(&mut all()), seen(&mut all().filter(|[i, j]| at_end(*i) && at_end(*j))));
    out.extend([inside, rim, inside - rim, near, far, covered, corners].map(|v| v as f32));
    out.extend(levels.map(|n| n as f32 / count.max(1) as f32));
    out.extend(empty.map(|n| (f64::from(n) / sides.product()) as f32));
    scratch.outlines.iter_mut().for_each(|outline| out.extend(outline.measures().map(|v| v as f32)));
    out.push(lowest as f32);
    debug_assert_eq!(out.len(), MEASURES);
}

fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, count) = values.fold((0.0, 0), |(sum, count), v| (sum + v, count + 1));
    (count > 0).then(|| sum / f64::from(count))
}

/// How a profile of the near surface bends, in widths: slope and curvature; what a line, a parabola, the best corner and half an ellipse
/// leave of it (root mean square); the ellipse's depth; how far the middle stands before the ends. `None` for too few columns.
fn bends(profile: &[Option<f64>; COLUMNS]) -> Option<[f64; BENDS]> {
    // From −1 to 1 over the width.
    let across = |column: usize| (2.0 * column as f64 + 1.0) / COLUMNS as f64 - 1.0;
    let seen = || profile.iter().enumerate().filter_map(|(column, v)| Some((across(column), (*v)?)));
    if seen().count() < COLUMNS / 2 {
        return None;
    }
    let (_, line) = fit(&seen, &|_| 0.0)?;
    let ([_, tilt, curvature], parabola) = fit(&seen, &|t| t * t)?;
    let ([.., depth], ellipse) = fit(&seen, &|t| (1.0 - t * t).max(0.0).sqrt())?;
    let corner_at = |n: i32| fit(&seen, &|t| (t - 0.2 * f64::from(n)).abs()).map(|(_, left)| left);
    let corner = (-3..=3).filter_map(corner_at).fold(f64::INFINITY, f64::min);
    let nearest = seen().map(|(_, v)| v).fold(f64::INFINITY, f64::min);
    let (first, last) = (seen().next()?.1, seen().next_back()?.1);
    Some([tilt, curvature, line, parabola, corner, ellipse, corner - ellipse, depth, nearest - (first + last) / 2.0])
}

/// Least squares of 1, t and a third function: the three factors, and the root mean square of what is left. A third function without
/// values of its own is left out.
fn fit<I: Iterator<Item = (f64, f64)>>(seen: &impl Fn() -> I, third: &dyn Fn(f64) -> f64) -> Option<([f64; 3], f64)> {
    let row = |t: f64| Vector3::new(1.0, t, third(t));
    let (mut gram, mut right) = (Matrix3::from_diagonal_element(1e-9), Vector3::zeros());
    for (t, v) in seen() {
        gram += row(t) * row(t).transpose();
        right += row(t) * v;
    }
    let factors = gram.cholesky()?.solve(&right);
    let left = mean(seen().map(|(t, v)| (v - row(t).dot(&factors)).powi(2)))?;
    Some((factors.into(), left.sqrt()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::{Dims, Occupancy};
    use std::f64::consts::{FRAC_1_SQRT_2, FRAC_PI_4};

    fn seen(object: &Occupancy) -> Vec<f32> {
        // Only what a camera at −x sees of it: the nearest voxel of each row along x.
        let dims = object.dims();
        let near = Occupancy::from_fn(dims, |i, j, k| object.is_filled(i, j, k) && (0..i).all(|n| !object.is_filled(n, j, k)));
        let observation = Observation::complete(&near);
        let frame = ViewFrame::new(&observation, &Vector3::new(-100.0, 0.0, 30.0), &mut Vec::new()).unwrap();
        let mut out = Vec::new();
        measure(&frame, &observation, Some(0.01), &mut MeasureScratch::default(), &mut out);
        out
    }

    fn column(is_inside: impl Fn(f64, f64) -> bool) -> Occupancy {
        Occupancy::from_fn(Dims::cube(40).unwrap(), |i, j, k| (8..32).contains(&k) && is_inside(i as f64 - 19.5, j as f64 - 19.5))
    }

    const BENT: usize = 7 + HEIGHTS + 2 * MAP * MAP;

    /// A cylinder's near side is half an ellipse, that of a box seen on an edge a corner, that of one seen on a face a line.
    #[test]
    fn profiles_tell_a_cylinder_from_an_edge_and_from_a_face() {
        let cylinder = seen(&column(|x, y| x.hypot(y) < 12.0));
        let edge = seen(&column(|x, y| ((x + y) * FRAC_1_SQRT_2).abs() < 9.0 && ((x - y) * FRAC_1_SQRT_2).abs() < 9.0));
        let face = seen(&column(|x, y| x.abs() < 9.0 && y.abs() < 9.0));
        let of = |view: &[f32], n: usize| view[BENT + BENDS + n];
        // What a corner leaves less what an ellipse leaves.
        assert!(of(&cylinder, 6) > 0.005, "{}", of(&cylinder, 6));
        assert!(of(&edge, 6) < -0.005, "{}", of(&edge, 6));
        assert!(of(&face, 2) < 1e-3 && of(&cylinder, 2) > 0.05 && of(&edge, 2) > 0.05);
    }

    #[test]
    fn measures_have_their_number_and_only_three_have_a_unit() {
        let object = column(|x, y| x.abs() < 6.0 && y.abs() < 10.0);
        let observation = Observation::complete(&object);
        let frame = ViewFrame::new(&observation, &Vector3::new(-100.0, 0.0, 30.0), &mut Vec::new()).unwrap();
        let of = |voxel_m| {
            let mut out = Vec::new();
            measure(&frame, &observation, voxel_m, &mut MeasureScratch::default(), &mut out);
            out
        };
        let (unknown, small, large) = (of(None), of(Some(0.001)), of(Some(0.002)));
        assert_eq!((unknown.len(), small.len()), (MEASURES, MEASURES));
        assert!(unknown[..3].iter().all(|v| v.is_nan()) && unknown[3..].iter().all(|v| v.is_finite()));
        assert_eq!((&unknown[3..], &small[3..]), (&small[3..], &large[3..]));
        for (n, side) in [12.0_f32, 20.0, 24.0].into_iter().enumerate() {
            assert!((small[n] - (0.001 * side).ln()).abs() < 1e-5 && (large[n] - (0.002 * side).ln()).abs() < 1e-5);
        }
    }

    /// A disc's widths are all the same, and its area is π / 4 of their square. In the direction θ from one of its sides, a square of side 1 is
    /// |cos θ| + |sin θ| wide.
    #[test]
    fn outlines_tell_a_disc_from_a_square_however_it_is_turned() {
        let of = |is_inside: &dyn Fn(f64, f64) -> bool| {
            let object = column(is_inside);
            let frame = ViewFrame::new(&Observation::complete(&object), &Vector3::new(-100.0, 0.0, 30.0), &mut Vec::new()).unwrap();
            let mut out = Vec::new();
            measure(&frame, &Observation::complete(&object), None, &mut MeasureScratch::default(), &mut out);
            let top = &out[MEASURES - 1 - OUTLINE..MEASURES - 1];
            [top[DIRECTIONS], top[DIRECTIONS + 1]]
        };
        let [least, area] = of(&|x, y| x.hypot(y) < 12.0);
        assert!(least > 0.95 && (area - FRAC_PI_4 as f32).abs() < 0.07, "{least} {area}");
        for angle in [0.0_f64, 0.2, 0.4, FRAC_PI_4] {
            let (sin, cos) = angle.sin_cos();
            let [least, area] = of(&|x, y| (cos * x + sin * y).abs() < 10.0 && (cos * y - sin * x).abs() < 10.0);
            let width = |n: usize| {
                let (sin, cos) = (PI as f32 * n as f32 / DIRECTIONS as f32 - angle as f32).sin_cos();
                cos.abs() + sin.abs()
            };
            let [low, high] = (0..DIRECTIONS).map(width).fold([f32::INFINITY, 0.0], |[low, high], w| [low.min(w), high.max(w)]);
            // Twenty voxels to a side: corners lose two.
            assert!(least < 0.9 && (least - low / high).abs() < 0.12 && (area - high.powi(-2)).abs() < 0.12, "{angle}: {least} {area}");
        }
    }

    /// Polynomials by numpy.polyfit of the same ten points.
    #[test]
    fn least_squares_are_those_of_numpy() {
        let values = [0.3, 0.1, 0.05, 0.0, 0.02, 0.0, 0.1, 0.12, 0.2, 0.41];
        let profile = values.map(Some);
        let found = bends(&profile).unwrap();
        let expected = [0.070_303_03, 0.408_143_94, 0.122_511_100, 0.030_596_841];
        assert!(found.iter().zip(expected).all(|(found, expected)| (found - expected).abs() < 1e-6), "{found:?}");
        assert!((found[8] + 0.355).abs() < 1e-9);
    }
}
