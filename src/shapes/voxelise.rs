//! Meshes to voxels: the surface by exact triangle–box overlap, the inside by flooding the outside.
//!
//! Overlap is the separating axis test of Akenine-Möller, "Fast 3D Triangle-Box Overlap Testing" (2001): a triangle and a box
//! are apart if and only if one of 13 axes separates them (3 box normals, the triangle's normal, 9 products of edges).

use super::Mesh;
use crate::grid::{Dims, Occupancy};
use nalgebra::{Point3, Vector3};

/// Voxels that the longest side of a shape takes on a grid: four fifths of the smallest side, as in 3DShapeNets (24 of 30).
pub fn longest_side(dims: Dims) -> usize {
    let smallest = dims.x().min(dims.y()).min(dims.z());
    (smallest * 4 + 2) / 5
}

/// Voxelises a mesh (z up): its bounding box is centred on the grid's centre and scaled so that the longest side takes
/// `longest` voxels (less than a millionth, so that faces on the box do not touch the voxels outside). A voxel is filled if the
/// surface touches it, or if it is cut off from the grid's border by filled voxels (through faces).
///
/// What does not fit into the grid (where `longest` exceeds a side) is cut off.
pub fn voxelise(mesh: &Mesh, dims: Dims, longest: usize) -> Occupancy {
    let mut object = surface(mesh, dims, longest);
    fill_inside(&mut object);
    object
}

/// The voxels that the surface touches: [`voxelise`] without filling the inside.
pub fn surface(mesh: &Mesh, dims: Dims, longest: usize) -> Occupancy {
    let [low, high] = mesh.bounds();
    let scale = longest as f64 * (1.0 - 1e-6) / (high - low).max();
    let middle = low + (high - low) / 2.0;
    let centre = Vector3::new(dims.x() as f64, dims.y() as f64, dims.z() as f64) / 2.0;
    let mut object = Occupancy::empty(dims);
    for &triangle in mesh.triangles() {
        let corners = mesh.corners(triangle).map(|p| Point3::from((p - middle) * scale + centre));
        rasterise(&Triangle::new(corners), &mut object);
    }
    object
}

/// A triangle in voxel units, with what the overlap test needs.
struct Triangle {
    corners: [Point3<f64>; 3],
    edges: [Vector3<f64>; 3],
    normal: Vector3<f64>,
}

impl Triangle {
    fn new(corners: [Point3<f64>; 3]) -> Self {
        let [a, b, c] = corners;
        let edges = [b - a, c - b, a - c];
        Self { corners, edges, normal: edges[0].cross(&edges[1]) }
    }

    /// Whether the triangle touches the closed unit box around `centre`.
    fn overlaps(&self, centre: Point3<f64>) -> bool {
        let v = self.corners.map(|p| p - centre);
        for axis in 0..3 {
            let (low, high) = extremes(v.map(|p| p[axis]));
            if low > 0.5 || high < -0.5 {
                return false;
            }
        }
        let radius = |axis: &Vector3<f64>| 0.5 * (axis.x.abs() + axis.y.abs() + axis.z.abs());
        if self.normal.dot(&v[0]).abs() > radius(&self.normal) {
            return false;
        }
        for edge in &self.edges {
            for axis in [Vector3::new(0.0, -edge.z, edge.y), Vector3::new(edge.z, 0.0, -edge.x), Vector3::new(-edge.y, edge.x, 0.0)] {
                let (low, high) = extremes(v.map(|p| p.dot(&axis)));
                let radius = radius(&axis);
                if low > radius || high < -radius {
                    return false;
                }
            }
        }
        true
    }
}

fn extremes([a, b, c]: [f64; 3]) -> (f64, f64) {
    (a.min(b).min(c), a.max(b).max(c))
}

/// Slack of the ranges that pick candidates for the exact test, in voxels: above rounding errors at 256 voxels.
const SLACK: f64 = 1e-6;

/// The voxels that the closed interval may touch, cut to 0..n.
fn voxel_range(low: f64, high: f64, n: usize) -> std::ops::Range<usize> {
    // Casts saturate, so far-off numbers give empty ranges.
    let first = ((low - SLACK).ceil() - 1.0).max(0.0) as usize;
    let end = ((high + SLACK).floor() + 1.0).clamp(0.0, n as f64) as usize;
    first.min(n)..end
}

/// Marks the voxels that the triangle touches. Candidates are found by slabs along one axis, then strips along a second, then the
/// plane's interval along the third, on which the normal is longest: about three per voxel column that the triangle covers.
fn rasterise(triangle: &Triangle, object: &mut Occupancy) {
    let dims = object.dims();
    let sides = <[usize; 3]>::from(dims);
    let normal = triangle.normal;
    let depth = normal.iamax();
    let (u, v) = ((depth + 1) % 3, (depth + 2) % 3);
    let all = |axis: usize| extremes(triangle.corners.map(|p| p[axis]));
    let (u_low, u_high) = all(u);
    let (depth_low, depth_high) = all(depth);
    for i in voxel_range(u_low, u_high, sides[u]) {
        let Some((v_low, v_high)) = extent_in_slab(triangle, u, v, i as f64) else { continue };
        for j in voxel_range(v_low, v_high, sides[v]) {
            let (mut low, mut high) = (depth_low, depth_high);
            if normal[depth] != 0.0 {
                // The plane's depth over the middle of the column, and how far it changes within it.
                let to_middle =
                    normal[u] * (i as f64 + 0.5 - triangle.corners[0][u]) + normal[v] * (j as f64 + 0.5 - triangle.corners[0][v]);
                let at_middle = triangle.corners[0][depth] - to_middle / normal[depth];
                let change = 0.5 * (normal[u].abs() + normal[v].abs()) / normal[depth].abs();
                // A sliver's normal is inexact; then the triangle's own extent bounds the search.
                let reach = change + SLACK * (1.0 + at_middle.abs());
                if reach.is_finite() && is_well_conditioned(triangle) {
                    (low, high) = (low.max(at_middle - reach), high.min(at_middle + reach));
                }
            }
            for k in voxel_range(low, high, sides[depth]) {
                let mut voxel = [0; 3];
                (voxel[u], voxel[v], voxel[depth]) = (i, j, k);
                let [x, y, z] = voxel;
                if !object.is_filled(x, y, z) && triangle.overlaps(Point3::new(x as f64 + 0.5, y as f64 + 0.5, z as f64 + 0.5)) {
                    object.fill(x, y, z);
                }
            }
        }
    }
}

/// Whether the triangle's normal is known to much better than the slack.
fn is_well_conditioned(triangle: &Triangle) -> bool {
    let longest = triangle.edges.iter().map(|e| e.norm_squared()).fold(0.0, f64::max);
    triangle.normal.norm() > 1e-7 * longest
}

/// Extent along axis `v` of the part of the triangle whose `u` lies in [i, i + 1].
fn extent_in_slab(triangle: &Triangle, u: usize, v: usize, i: f64) -> Option<(f64, f64)> {
    let (near, far) = (i - SLACK, i + 1.0 + SLACK);
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    let mut include = |value: f64| (low, high) = (low.min(value), high.max(value));
    for (a, edge) in triangle.corners.iter().zip(&triangle.edges) {
        if (near..=far).contains(&a[u]) {
            include(a[v]);
        }
        for cut in [near, far] {
            let t = (cut - a[u]) / edge[u];
            if (0.0..=1.0).contains(&t) {
                include(a[v] + t * edge[v]);
            }
        }
    }
    (low <= high).then_some((low, high))
}

/// Fills every empty voxel that no path of empty voxels (through faces) connects with the grid's border.
fn fill_inside(object: &mut Occupancy) {
    let dims = object.dims();
    let (nx, ny, nz) = (dims.x(), dims.y(), dims.z());
    // `closed`: filled, or already known to be outside. Runs of open voxels along z are taken at once.
    let mut closed = object.bits().clone();
    let mut outside = fixedbitset::FixedBitSet::with_capacity(dims.voxels());
    let mut seeds: Vec<(usize, usize, usize)> = Vec::new();
    let seed = |i: usize, j: usize, closed: &fixedbitset::FixedBitSet, from: usize, to: usize, seeds: &mut Vec<_>| {
        let start = dims.index(i, j, 0);
        let mut is_run = false;
        for k in from..to {
            let is_open = !closed.contains(start + k);
            if is_open && !is_run {
                seeds.push((i, j, k));
            }
            is_run = is_open;
        }
    };
    for i in 0..nx {
        for j in 0..ny {
            if i == 0 || j == 0 || i + 1 == nx || j + 1 == ny {
                seed(i, j, &closed, 0, nz, &mut seeds);
            } else {
                seed(i, j, &closed, 0, 1, &mut seeds);
                seed(i, j, &closed, nz - 1, nz, &mut seeds);
            }
        }
    }
    while let Some((i, j, k)) = seeds.pop() {
        let start = dims.index(i, j, 0);
        if closed.contains(start + k) {
            continue;
        }
        let from = (0..k).rev().find(|n| closed.contains(start + n)).map_or(0, |n| n + 1);
        let to = (k..nz).find(|n| closed.contains(start + n)).unwrap_or(nz);
        closed.insert_range(start + from..start + to);
        outside.insert_range(start + from..start + to);
        let neighbours = [(i.wrapping_sub(1), j), (i + 1, j), (i, j.wrapping_sub(1)), (i, j + 1)];
        for (i, j) in neighbours.into_iter().filter(|(i, j)| *i < nx && *j < ny) {
            seed(i, j, &closed, from, to, &mut seeds);
        }
    }
    outside.toggle_range(..);
    *object = Occupancy::from_bits(dims, outside);
}
