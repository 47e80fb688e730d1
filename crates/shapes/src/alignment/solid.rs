//! A shape as the objective sees it: smooth occupancy that can be sampled anywhere, and the moments that normalise its pose.

use super::settings::LONGEST;
use super::transform::ShapeSimilarity;
use crate::{Content, Mesh, voxelise};
use beo_core::grid::{Dims, Occupancy};
use beo_core::linear;
use nalgebra::{Matrix3, Point3, Rotation3, UnitQuaternion, Vector3};

/// How finely a shape is seen, from coarse to fine.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Level {
    /// Half the resolution, far-reaching blur: finds its way from far off.
    Coarse,
    /// The working resolution, blurred.
    Middle,
    /// The working resolution, blurred only as much as sampling needs.
    Fine,
}

impl Level {
    /// Cells along the unit cube at a working resolution.
    pub fn cells(self, resolution: usize) -> usize {
        if self == Self::Coarse { resolution / 2 } else { resolution }
    }
}

/// Fine voxels along a cell of the objective's grid.
const FINER: usize = 2;

/// Occupancy on a fine grid about the shape, 0 to 255, blurred.
struct Smooth {
    values: Vec<u8>,
    sides: [usize; 3],
    /// Voxels on each side that only the blur reaches.
    pad: usize,
    /// Input coordinates of the first voxel's centre, and the voxels' size.
    origin: Vector3<f64>,
    step: f64,
}

/// A complete shape in input coordinates.
pub struct Solid {
    smooth: [Smooth; 3],
    /// Centre of mass.
    pub(super) centre: Vector3<f64>,
    /// Root mean square distance of the mass from the centre.
    pub(super) radius: f64,
    /// Covariance of the mass.
    pub(super) covariance: Matrix3<f64>,
    /// The box about the shape.
    pub(super) bounds: [Point3<f64>; 2],
    /// Points from which the box of the placed shape is computed: the mesh's vertices, or the corners of surface voxels.
    outline: Vec<Point3<f64>>,
}

/// Coordinates of the corner (i, j, k) of a voxel file's grid: the unit cube about its centre, by its longest side.
pub fn grid_point(dims: Dims, [i, j, k]: [f64; 3]) -> Point3<f64> {
    let sides = <[usize; 3]>::from(dims).map(|side| side as f64);
    let longest = sides.iter().copied().fold(0.0, f64::max);
    Point3::new(i - sides[0] / 2.0, j - sides[1] / 2.0, k - sides[2] / 2.0) / longest
}

impl Solid {
    /// The shape in a file for an objective with `resolution` cells along the unit cube; `None` if nothing is filled. Meshes have z up.
    pub fn new(content: &Content, resolution: usize) -> Option<Self> {
        // Four fifths of the cube are the longest side, as in the output.
        let longest = FINER * resolution * 4 / 5;
        let dims = Dims::cube((longest + 2).max(8)).ok()?;
        let (fine, outline) = match content {
            Content::Mesh(mesh) => (voxelise(mesh, dims, longest), used_vertices(mesh)),
            Content::Voxels(object) => (resampled(object, dims, longest)?, corners(object)),
            // Without an inside there are no moments.
            Content::Points(_) => return None,
        };
        let [mut low, mut high] = [*outline.first()?; 2];
        outline.iter().for_each(|p| (low, high) = (low.inf(p), high.sup(p)));
        let step = (high - low).max() / longest as f64;
        let origin = (low + (high - low) / 2.0).coords - Vector3::repeat((dims.x() as f64 - 1.0) / 2.0 * step);

        let place = |voxel: usize| origin + Vector3::from(dims.coordinates(voxel).map(|at| at as f64)) * step;
        let count = fine.count() as f64;
        if count == 0.0 {
            return None;
        }
        let centre = fine.bits().ones().map(place).sum::<Vector3<f64>>() / count;
        let offsets = fine.bits().ones().map(|voxel| place(voxel) - centre);
        let covariance = offsets.map(|d| d * d.transpose()).sum::<Matrix3<f64>>() / count + Matrix3::identity() * (step * step / 12.0);
        let values: Vec<f32> = (0..dims.voxels()).map(|voxel| f32::from(u8::from(fine.bits().contains(voxel)))).collect();
        let (low_voxel, high_voxel) = fine.bounds().map(|[low, high]| (low, high))?;
        let full = Cropped::of(&values, dims, low_voxel, high_voxel, origin, step);
        let halved = full.halved();
        let smooth = [halved.blurred(2.0), full.blurred(2.0), full.blurred(1.0)];
        Some(Self { smooth, centre, radius: covariance.trace().sqrt(), covariance, bounds: [low, high], outline })
    }

    /// The longest side of the box about the shape as it is.
    pub fn longest(&self) -> f64 {
        (self.bounds[1] - self.bounds[0]).max()
    }

    /// The box about the placed shape.
    pub fn placed_bounds(&self, placement: &ShapeSimilarity) -> [Point3<f64>; 2] {
        let first = placement.place(&self.outline[0]);
        self.outline.iter().map(|p| placement.place(p)).fold([first; 2], |[low, high], p| [low.inf(&p), high.sup(&p)])
    }

    /// As shapes are read otherwise: unturned, the longest side [`LONGEST`], the box about the origin.
    pub(super) fn as_it_is(&self) -> ShapeSimilarity {
        let [low, high] = self.bounds;
        let scale = LONGEST / self.longest();
        ShapeSimilarity { rotation: UnitQuaternion::identity(), scale, translation: -(low.coords + high.coords) / 2.0 * scale }
    }

    /// The third moments of the mass along the axes after a rotation, in units of the radius.
    pub(super) fn skewness(&self, rotation: &UnitQuaternion<f64>) -> Vector3<f64> {
        let smooth = &self.smooth[Level::Coarse as usize];
        let [_, ny, nz] = smooth.sides;
        let (mut mass, mut sum) = (0.0, Vector3::zeros());
        for (at, value) in smooth.values.iter().enumerate().filter(|(_, value)| **value > 0) {
            let cell = Vector3::new((at / (ny * nz)) as f64, (at / nz % ny) as f64, (at % nz) as f64);
            let point = rotation * (smooth.origin + cell * smooth.step - self.centre) / self.radius;
            mass += f64::from(*value);
            sum += point.map(|x| x.powi(3)) * f64::from(*value);
        }
        sum / mass
    }

    /// The rotation that lays the longest principal axis along x and the shortest along z; with `keep_up` the longer horizontal one along
    /// x, about z alone.
    pub(super) fn principal(&self, keep_up: bool) -> UnitQuaternion<f64> {
        principal(&self.covariance, keep_up)
    }

    /// Calls `cell` with the index of every cell of the canvas that the placed shape reaches, and its occupancy there. Returns false, and
    /// calls nothing, if the shape leaves the canvas.
    pub(super) fn for_each_cell(
        &self,
        level: Level,
        canvas: &Canvas,
        placement: &ShapeSimilarity,
        mut cell: impl FnMut(usize, u8),
    ) -> bool {
        let smooth = &self.smooth[level as usize];
        let [_, ny, nz] = smooth.sides;
        // Outline of the fine grid in cells: of the shape, and with what the blur adds.
        let last = smooth.sides.map(|side| side as f64 - 1.0);
        let outline = |pad: f64| {
            let corner = |corner: usize| {
                let at = Vector3::from_fn(|axis, _| if corner >> axis & 1 == 1 { last[axis] - pad } else { pad });
                canvas.cell_of(&placement.place(&Point3::from(smooth.origin + at * smooth.step)))
            };
            (1..8).map(corner).fold([corner(0); 2], |[low, high], p| [low.inf(&p), high.sup(&p)])
        };
        let most = canvas.side as f64 - 1.0;
        let [low, high] = outline(smooth.pad as f64);
        // Coarse voxels' centres lie farther inside the shape: what stays on the canvas there is to stay on the finer ones.
        let margin = if level == Level::Coarse { 1.0 } else { 0.0 };
        if !(low.min() >= margin && high.max() <= most - margin) {
            return false;
        }
        let [low, high] = outline(0.0).map(|end| end.map(|x| x.clamp(0.0, most)));
        // Fine coordinates of cell c: matrix · c + offset.
        let back = placement.rotation.inverse().to_rotation_matrix();
        let matrix = back.matrix() * (canvas.cell / (placement.scale * smooth.step));
        let start = canvas.point_of([0.0; 3]) - placement.translation;
        let offset = (back * start / placement.scale - smooth.origin) / smooth.step;
        let column = matrix.column(2).into_owned();
        for i in low.x.ceil() as usize..=high.x as usize {
            for j in low.y.ceil() as usize..=high.y as usize {
                let base = offset + matrix.column(0) * i as f64 + matrix.column(1) * j as f64;
                // The part of this row of cells that lies within the fine grid.
                let (mut from, mut to) = (low.z.ceil(), high.z.floor());
                for axis in 0..3 {
                    let (slope, at) = (column[axis], base[axis]);
                    if slope.abs() < 1e-12 {
                        if !(at >= 0.0 && at < last[axis]) {
                            to = -1.0;
                        }
                        continue;
                    }
                    let ends = [-at / slope, (last[axis] - at) / slope];
                    from = from.max(ends[0].min(ends[1]).ceil());
                    to = to.min(ends[0].max(ends[1]).floor());
                }
                if from > to {
                    continue;
                }
                let row = canvas.index(i, j, 0);
                for k in from as usize..=to as usize {
                    let at = base + column * k as f64;
                    let whole = at.map(|x| x as usize);
                    let share = at - whole.map(|x| x as f64);
                    let first = (whole.x * ny + whole.y) * nz + whole.z;
                    // Rounding may put the last cell of a row onto the border: what lies beyond is empty.
                    let Some(values) = smooth.values.get(first..) else { continue };
                    let corner = |offset: usize| values.get(offset).map_or(0.0, |v| f64::from(*v));
                    let along = |offset: usize| corner(offset) * (1.0 - share.z) + corner(offset + 1) * share.z;
                    let plane = |offset: usize| along(offset) * (1.0 - share.y) + along(offset + nz) * share.y;
                    let value = plane(0) * (1.0 - share.x) + plane(ny * nz) * share.x;
                    let value = (value + 0.5) as u8;
                    if value > 0 {
                        cell(row + k, value);
                    }
                }
            }
        }
        true
    }
}

/// The principal axes of a covariance as a rotation into them, longest first; with `keep_up` of its horizontal part.
pub(super) fn principal(covariance: &Matrix3<f64>, keep_up: bool) -> UnitQuaternion<f64> {
    if keep_up {
        let (xx, yy, xy) = (covariance[(0, 0)], covariance[(1, 1)], covariance[(0, 1)]);
        return beo_core::grid::yaw(-0.5 * (2.0 * xy).atan2(xx - yy));
    }
    let matrix = faer::Mat::from_fn(3, 3, |i, j| covariance[(i, j)]);
    // Finite, symmetric and small: it converges.
    let Ok(eigen) = linear::symmetric_eigen(matrix.as_ref()) else { return UnitQuaternion::identity() };
    let axis = |h: usize| Vector3::new(eigen.vectors[(0, h)], eigen.vectors[(1, h)], eigen.vectors[(2, h)]);
    let (x, y) = (axis(0), axis(1));
    let rows = Matrix3::from_rows(&[x.transpose(), y.transpose(), x.cross(&y).transpose()]);
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rows))
}

/// The cells of the objective about the origin. It is larger than the unit cube, so that no shape gains by leaving it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Canvas {
    pub side: usize,
    /// Size of a cell.
    pub cell: f64,
}

impl Canvas {
    /// For `cells` along the unit cube.
    pub fn new(cells: usize) -> Self {
        // Odd or even as the number of cells is, so that cells of the unit cube are whole.
        Self { side: cells + 2 * (cells / 2), cell: 1.0 / cells as f64 }
    }

    pub fn cells(&self) -> usize {
        self.side.pow(3)
    }

    pub fn index(&self, i: usize, j: usize, k: usize) -> usize {
        (i * self.side + j) * self.side + k
    }

    /// The cell, not rounded, at a point.
    fn cell_of(&self, point: &Point3<f64>) -> Vector3<f64> {
        point.coords / self.cell + Vector3::repeat((self.side as f64 - 1.0) / 2.0)
    }

    /// The point at a cell's centre.
    pub fn point_of(&self, cell: [f64; 3]) -> Vector3<f64> {
        (Vector3::from(cell) - Vector3::repeat((self.side as f64 - 1.0) / 2.0)) * self.cell
    }
}

fn used_vertices(mesh: &Mesh) -> Vec<Point3<f64>> {
    let mut used = vec![false; mesh.vertices().len()];
    mesh.triangles().iter().flatten().for_each(|v| used[*v as usize] = true);
    mesh.vertices().iter().zip(used).filter(|(_, used)| *used).map(|(p, _)| *p).collect()
}

/// Corners of the voxels that end a run along z: enough for the box about the object however it is turned.
fn corners(object: &Occupancy) -> Vec<Point3<f64>> {
    let dims = object.dims();
    let mut points = Vec::new();
    for voxel in object.bits().ones() {
        let [i, j, k] = dims.coordinates(voxel);
        if k > 0 && object.is_filled(i, j, k - 1) && object.is_filled(i, j, k + 1) {
            continue;
        }
        for corner in 0..8_usize {
            let at = |axis: usize, at: usize| (at + (corner >> axis & 1)) as f64;
            points.push(grid_point(dims, [at(0, i), at(1, j), at(2, k)]));
        }
    }
    points
}

/// The object's box centred on another grid, its longest side over `longest` voxels there.
fn resampled(object: &Occupancy, dims: Dims, longest: usize) -> Option<Occupancy> {
    let [low, high] = object.bounds()?;
    let side = (0..3).map(|a| high[a] - low[a]).max()? as f64 / longest as f64;
    let source = |axis: usize, at: usize| {
        let middle = (low[axis] + high[axis]) as f64 / 2.0;
        let at = middle + (at as f64 + 0.5 - dims.x() as f64 / 2.0) * side;
        if at < 0.0 { usize::MAX } else { at as usize }
    };
    Some(Occupancy::from_fn(dims, |i, j, k| object.is_filled(source(0, i), source(1, j), source(2, k))))
}

/// A box of occupancies before they are blurred.
struct Cropped {
    values: Vec<f32>,
    sides: [usize; 3],
    origin: Vector3<f64>,
    step: f64,
}

impl Cropped {
    fn of(values: &[f32], dims: Dims, low: [usize; 3], high: [usize; 3], origin: Vector3<f64>, step: f64) -> Self {
        let sides = [0, 1, 2].map(|a| high[a] - low[a]);
        let mut out = Vec::with_capacity(sides.iter().product());
        for i in low[0]..high[0] {
            for j in low[1]..high[1] {
                let start = dims.index(i, j, low[2]);
                out.extend_from_slice(&values[start..start + sides[2]]);
            }
        }
        Self { values: out, sides, origin: origin + Vector3::from(low.map(|at| at as f64)) * step, step }
    }

    fn at(&self, [i, j, k]: [usize; 3]) -> f32 {
        let [nx, ny, nz] = self.sides;
        if i < nx && j < ny && k < nz { self.values[(i * ny + j) * nz + k] } else { 0.0 }
    }

    /// Half the resolution.
    fn halved(&self) -> Self {
        let sides = self.sides.map(|side| side.div_ceil(2));
        let mut values = Vec::with_capacity(sides.iter().product());
        for i in 0..sides[0] {
            for j in 0..sides[1] {
                for k in 0..sides[2] {
                    let part = |c: usize| self.at([2 * i + (c & 1), 2 * j + (c >> 1 & 1), 2 * k + (c >> 2)]);
                    values.push((0..8).map(part).sum::<f32>() / 8.0);
                }
            }
        }
        Self { values, sides, origin: self.origin + Vector3::repeat(self.step / 2.0), step: 2.0 * self.step }
    }

    /// Convolved with a Gaussian of `sigma` voxels along each axis, with an empty border.
    fn blurred(&self, sigma: f32) -> Smooth {
        let reach = (3.0 * sigma).ceil() as usize;
        let weights: Vec<f32> = (0..=2 * reach).map(|n| (-0.5 * ((n as f32 - reach as f32) / sigma).powi(2)).exp()).collect();
        let sum: f32 = weights.iter().sum();
        let pad = reach + 1;
        let sides = self.sides.map(|side| side + 2 * pad);
        let mut values = vec![0.0_f32; sides.iter().product()];
        for i in 0..self.sides[0] {
            for j in 0..self.sides[1] {
                let from = (i * self.sides[1] + j) * self.sides[2];
                let to = ((i + pad) * sides[1] + j + pad) * sides[2] + pad;
                values[to..to + self.sides[2]].copy_from_slice(&self.values[from..from + self.sides[2]]);
            }
        }
        let strides = [sides[1] * sides[2], sides[2], 1];
        let mut line = Vec::new();
        for axis in 0..3 {
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            for a in 0..sides[u] {
                for b in 0..sides[v] {
                    let start = a * strides[u] + b * strides[v];
                    line.clear();
                    line.extend((0..sides[axis]).map(|n| values[start + n * strides[axis]]));
                    if line.iter().all(|value| *value == 0.0) {
                        continue;
                    }
                    for n in 0..sides[axis] {
                        let (from, to) = (n.saturating_sub(reach), (n + reach + 1).min(sides[axis]));
                        let skipped = from + reach - n;
                        let blurred: f32 = line[from..to].iter().zip(&weights[skipped..]).map(|(v, w)| v * w).sum();
                        values[start + n * strides[axis]] = blurred / sum;
                    }
                }
            }
        }
        let values = values.iter().map(|v| (255.0 * v).round().clamp(0.0, 255.0) as u8).collect();
        Smooth { values, sides, pad, origin: self.origin - Vector3::repeat(pad as f64 * self.step), step: self.step }
    }
}
