//! Meshes to voxels: the surface by exact triangle–box overlap, the inside by flooding the outside.
//!
//! Overlap is the separating axis test of Akenine-Möller, "Fast 3D Triangle-Box Overlap Testing" (2001): a triangle and a box
//! are apart if and only if one of 13 axes separates them (3 box normals, the triangle's normal, 9 products of edges).

use super::{Mesh, PointCloud};
use beo_core::grid::{Dims, Occupancy};
use nalgebra::{Point3, Vector3};

/// Voxelises a mesh (z up): its bounding box is centred on the grid's centre and scaled so that the longest side takes
/// `longest` voxels (less than a millionth, so that faces on the box do not touch the voxels outside). A voxel is filled if the
/// surface touches it, or if it is cut off from the grid's border by filled voxels (through faces).
///
/// Parts that do not fit into the grid (where `longest` exceeds a side) are cut off.
pub fn voxelise(mesh: &Mesh, dims: Dims, longest: usize) -> Occupancy {
    let mut object = surface(mesh, dims, longest);
    fill_inside(&mut object);
    object
}

/// The voxels that the surface touches: [`voxelise`] without filling the inside.
pub fn surface(mesh: &Mesh, dims: Dims, longest: usize) -> Occupancy {
    Frame::fitted(mesh.bounds(), dims, longest).surface(mesh)
}

/// Voxelises a mesh as it lies in the unit cube about the origin, whose sides are those of the grid (the smallest one of it, where they
/// differ), as [`voxelise`] fills voxels. What lies outside of the grid is cut off.
pub fn voxelise_unit_cube(mesh: &Mesh, dims: Dims) -> Occupancy {
    let mut object = Frame::unit_cube(dims).surface(mesh);
    fill_inside(&mut object);
    object
}

/// Where places of a file lie on a grid. All of it is in double precision, and offsets are taken away before anything is scaled.
#[derive(Debug, Clone, Copy)]
pub(super) struct Frame {
    dims: Dims,
    /// The place that becomes the grid's centre.
    middle: Point3<f64>,
    /// Voxels of a unit of the file.
    scale: f64,
}

impl Frame {
    /// A box in the middle of the grid, `longest` voxels along its longest side.
    pub fn fitted([low, high]: [Point3<f64>; 2], dims: Dims, longest: usize) -> Self {
        let scale = longest as f64 * (1.0 - 1e-6) / (high - low).max();
        Self { dims, middle: low + (high - low) / 2.0, scale }
    }

    /// The unit cube about the origin.
    pub fn unit_cube(dims: Dims) -> Self {
        Self { dims, middle: Point3::origin(), scale: dims.x().min(dims.y()).min(dims.z()) as f64 }
    }

    /// A place in voxels from the grid's first corner.
    pub fn place(&self, point: &Point3<f64>) -> Point3<f64> {
        let centre = Vector3::new(self.dims.x() as f64, self.dims.y() as f64, self.dims.z() as f64) / 2.0;
        Point3::from((point - self.middle) * self.scale + centre)
    }

    /// The voxels that the triangles touch.
    pub fn surface(&self, mesh: &Mesh) -> Occupancy {
        let mut object = Occupancy::empty(self.dims);
        for &triangle in mesh.triangles() {
            rasterise(&Triangle::new(mesh.corners(triangle).map(|p| self.place(&p))), &mut object);
        }
        object
    }

    /// The voxels that hold a point.
    pub fn points(&self, cloud: &PointCloud) -> Occupancy {
        let mut object = Occupancy::empty(self.dims);
        let sides = <[usize; 3]>::from(self.dims);
        for point in cloud.points() {
            let place = self.place(point);
            if (0..3).all(|axis| (0.0..sides[axis] as f64).contains(&place[axis])) {
                object.fill(place.x as usize, place.y as usize, place.z as usize);
            }
        }
        object
    }
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
pub(super) fn fill_inside(object: &mut Occupancy) {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Up, parse_binvox, parse_off};
    use beo_core::grid::longest_side;
    use proptest::prelude::*;

    /// The 12 triangles of a box.
    fn cuboid(low: [f64; 3], high: [f64; 3]) -> Mesh {
        let vertices = (0..8).map(|c| Point3::from([0, 1, 2].map(|a| if c >> a & 1 == 0 { low[a] } else { high[a] }))).collect();
        let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        Mesh::new(vertices, quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect()).unwrap()
    }

    /// A sphere of latitude and longitude strips around the origin, radius 1; `open` leaves out the strips above z = 0.5.
    fn sphere(open: bool) -> Mesh {
        let n = 96_u32;
        let angle = |i: u32| std::f64::consts::PI * f64::from(i) / f64::from(n);
        let point = |i: u32, j: u32| {
            let ((s, c), (t, d)) = (angle(i).sin_cos(), (2.0 * angle(j)).sin_cos());
            Point3::new(s * d, s * t, c)
        };
        let vertices = (0..=n).flat_map(|i| (0..n).map(move |j| point(i, j))).collect();
        let strips = (0..n).filter(|i| !open || angle(*i).cos() < 0.5);
        let corner = |i: u32, j: u32| i * n + j % n;
        let quads = strips.flat_map(|i| (0..n).map(move |j| [corner(i, j), corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1)]));
        Mesh::new(vertices, quads.flat_map(|[a, b, c, d]| [[a, b, c], [a, c, d]]).collect()).unwrap()
    }

    fn ranges(object: &Occupancy) -> [std::ops::Range<usize>; 3] {
        let dims = object.dims();
        let filled: Vec<_> = object.bits().ones().map(|v| dims.coordinates(v)).collect();
        [0, 1, 2].map(|a| filled.iter().map(|v| v[a]).min().unwrap()..filled.iter().map(|v| v[a]).max().unwrap() + 1)
    }

    #[test]
    fn a_box_fills_exactly_its_voxels_centred_and_scaled() {
        let dims = Dims::cube(30).unwrap();
        let object = voxelise(&cuboid([-7.0, 100.0, 0.01], [-1.0, 112.0, 4.01]), dims, 24);
        // 6 × 12 × 4 units become 12 × 24 × 8 voxels around (15, 15, 15).
        assert_eq!(ranges(&object), [9..21, 3..27, 11..19]);
        assert_eq!(object.count(), 12 * 24 * 8);
    }

    #[test]
    fn in_the_unit_cube_a_mesh_stays_where_it_is() {
        let dims = Dims::cube(20).unwrap();
        let object = voxelise_unit_cube(&cuboid([-0.499, 0.051, -0.049], [-0.251, 0.249, 0.449]), dims);
        assert_eq!(ranges(&object), [0..5, 11..15, 9..19]);
        assert_eq!(object.count(), 5 * 4 * 10);
    }

    #[test]
    fn a_hollow_sphere_is_filled_and_an_open_one_is_not() {
        let dims = Dims::cube(64).unwrap();
        let object = voxelise(&sphere(false), dims, 60);
        // Between the volume of the ball and that of all voxels which touch it (radius + half a voxel's diagonal).
        let volume = |r: f64| 4.0 / 3.0 * std::f64::consts::PI * r.powi(3);
        let expected = volume(30.0)..volume(30.0 + 0.75_f64.sqrt());
        assert!(expected.contains(&(object.count() as f64)), "{} {expected:?}", object.count());
        assert!(object.is_filled(32, 32, 32));

        let open = voxelise(&sphere(true), dims, 60);
        assert!(!open.is_filled(32, 32, 32) && !open.is_filled(32, 32, 20));
        assert_eq!(open, surface(&sphere(true), dims, 60));
    }

    #[test]
    fn shapes_larger_than_the_grid_are_cut_off() {
        let dims = Dims::new(8, 20, 9).unwrap();
        let object = voxelise(&cuboid([0.0; 3], [3.0, 2.0, 1.0]), dims, 30);
        assert_eq!(object.count(), surface(&cuboid([0.0; 3], [3.0, 2.0, 1.0]), dims, 30).count());
        assert!(voxelise(&cuboid([-1.0; 3], [1.0; 3]), Dims::cube(8).unwrap(), 8).count() == 512);
    }

    #[test]
    fn up_y_stands_a_mesh_upright() {
        // A slab that is tall along y and thin along x.
        let mesh = cuboid([0.0; 3], [2.0, 12.0, 6.0]).turned_up(Up::Y);
        assert_eq!(ranges(&voxelise(&mesh, Dims::cube(30).unwrap(), 24)), [13..17, 9..21, 3..27]);
    }

    /// All voxels whose closed box the triangle touches, each tested.
    fn brute_force(corners: [Point3<f64>; 3], dims: Dims) -> Occupancy {
        let triangle = Triangle::new(corners);
        Occupancy::from_fn(dims, |i, j, k| triangle.overlaps(Point3::new(i as f64 + 0.5, j as f64 + 0.5, k as f64 + 0.5)))
    }

    fn rasterised(corners: [Point3<f64>; 3], dims: Dims) -> Occupancy {
        let mut object = Occupancy::empty(dims);
        rasterise(&Triangle::new(corners), &mut object);
        object
    }

    #[test]
    fn faces_on_voxel_borders_touch_both_sides() {
        let dims = Dims::cube(8).unwrap();
        let corners = [[2.0, 2.0, 4.0], [3.0, 2.0, 4.0], [2.0, 3.0, 4.0]].map(Point3::from);
        let object = rasterised(corners, dims);
        assert_eq!(ranges(&object), [1..4, 1..4, 3..5]);
        assert_eq!(object, brute_force(corners, dims));
    }

    #[test]
    fn work_on_huge_triangles_is_bounded() {
        let dims = Dims::cube(256).unwrap();
        let far = 1e90;
        let corners = [[-far, -far, 3.3], [far, -far, 3.4], [0.0, far, 3.5]].map(Point3::from);
        rasterised(corners, dims);
        let mut object = Occupancy::empty(dims);
        for n in 0..200 {
            let tilt = f64::from(n);
            let corners = [[-900.0, -800.0, -tilt], [1e4, -900.0, 100.0 + tilt], [0.0, 2e4, 300.0]].map(Point3::from);
            rasterise(&Triangle::new(corners), &mut object);
        }
        assert!(object.count() > 256 * 256);
    }

    fn corner() -> impl Strategy<Value = Point3<f64>> {
        // Also whole and half numbers, so that triangles lie on borders, and places outside of the grid.
        let coordinate = prop_oneof![-3.0..15.0, (-2..28).prop_map(|n| f64::from(n) / 2.0)];
        [coordinate.clone(), coordinate.clone(), coordinate].prop_map(Point3::from)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(400))]

        #[test]
        fn pruning_loses_no_voxel(corners in [corner(), corner(), corner()]) {
            let dims = Dims::new(10, 12, 9).unwrap();
            prop_assert_eq!(rasterised(corners, dims), brute_force(corners, dims));
        }

        #[test]
        fn slivers_lose_no_voxel(a in corner(), b in corner(), t in -0.5..1.5, off in [-1e-9..1e-9, -1e-9..1e-9, -1e-9..1e-9]) {
            let dims = Dims::new(10, 12, 9).unwrap();
            let corners = [a, b, a + (b - a) * t + Vector3::from(off)];
            prop_assert_eq!(rasterised(corners, dims), brute_force(corners, dims));
            prop_assert_eq!(rasterised([a, b, a], dims), brute_force([a, b, a], dims));
        }

        #[test]
        fn overlap_is_what_sampling_finds(corners in [corner(), corner(), corner()]) {
            let dims = Dims::new(10, 12, 9).unwrap();
            let object = rasterised(corners, dims);
            let [a, b, c] = corners;
            let n = 160;
            let mut near = Occupancy::empty(dims);
            for i in 0..=n {
                for j in 0..=n - i {
                    let p = a + (b - a) * (f64::from(i) / f64::from(n)) + (c - a) * (f64::from(j) / f64::from(n));
                    // The sample's own voxel is filled, unless it is outside of the grid. A sample on a voxel's border is computed
                    // with rounding, so that it need not be a point of the triangle: borders have a test of their own …
                    let place = p.coords.map(|x| x.floor());
                    let is_inside = p.iter().all(|x| (x - x.round()).abs() > 1e-9);
                    if is_inside && place.iter().zip(<[usize; 3]>::from(dims)).all(|(x, side)| (0.0..side as f64).contains(x)) {
                        prop_assert!(object.is_filled(place.x as usize, place.y as usize, place.z as usize), "{p}");
                    }
                    // … and every filled voxel has a sample within the samples' spacing.
                    let reach = 2.0 * 26.0_f64 / f64::from(n);
                    let range = |x: f64, side| voxel_range(x - reach, x + reach, side);
                    for x in range(p.x, dims.x()) {
                        for y in range(p.y, dims.y()) {
                            for z in range(p.z, dims.z()) {
                                near.fill(x, y, z);
                            }
                        }
                    }
                }
            }
            prop_assert!(object.bits().is_subset(near.bits()));
        }

        #[test]
        fn the_inside_is_what_cannot_reach_the_border(voxels in prop::collection::vec(prop::bool::weighted(0.6), 8 * 9 * 10)) {
            let dims = Dims::new(8, 9, 10).unwrap();
            let shell = Occupancy::from_fn(dims, |i, j, k| voxels[dims.index(i, j, k)]);
            let mut object = shell.clone();
            fill_inside(&mut object);
            // The oracle: spread from the border until nothing changes.
            let mut outside = vec![false; dims.voxels()];
            loop {
                let before = outside.clone();
                for v in 0..dims.voxels() {
                    let [i, j, k] = dims.coordinates(v);
                    let is_border = i == 0 || j == 0 || k == 0 || i == 7 || j == 8 || k == 9;
                    let beside = |v: usize| outside[v];
                    let reached = is_border || beside(v - 90) || beside(v + 90) || beside(v - 10) || beside(v + 10) || beside(v - 1) || beside(v + 1);
                    outside[v] |= reached && !shell.is_filled(i, j, k);
                }
                if before == outside {
                    break;
                }
            }
            let expected = Occupancy::from_fn(dims, |i, j, k| !outside[dims.index(i, j, k)]);
            prop_assert_eq!(object, expected);
        }
    }

    /// The official 30³ grids were made by another program (sampled surfaces); they agree in placement and scale.
    #[test]
    fn modelnet_meshes_match_the_official_grids() {
        let folders = (std::env::var_os("BEO_MODELNET10_OFF"), std::env::var_os("BEO_MODELNET10"));
        let (Some(meshes), Some(grids)) = folders else {
            // Past the test runner, which shows what a passing test prints to nobody.
            let _ = std::io::Write::write_fmt(
                &mut std::io::stderr(),
                format_args!("skipped: set BEO_MODELNET10_OFF and BEO_MODELNET10 to folders with bathtub/train/*.off and *.binvox\n"),
            );
            return;
        };
        let meshes = std::path::Path::new(&meshes).join("bathtub/train");
        let (mut compared, mut same_box, mut best) = (0, 0, 0.0_f64);
        for entry in std::fs::read_dir(meshes).unwrap() {
            let path = entry.unwrap().path();
            let name = path.file_stem().unwrap().to_str().unwrap().to_owned();
            let grid = std::path::Path::new(&grids).join("bathtub/train").join(format!("{name}.binvox"));
            let (Ok(text), Ok(grid)) = (std::fs::read(&path), std::fs::read(grid)) else { continue };
            let mesh = parse_off(&text).unwrap();
            let official = parse_binvox(&grid).unwrap();
            let object = voxelise(&mesh, official.dims(), longest_side(official.dims()));
            let both = object.overlap(&official);
            let iou = both as f64 / (object.count() + official.count() - both) as f64;
            println!("{name}: {} voxels, official {}, IoU {iou:.3}", object.count(), official.count());
            // Where both span the same box, scale and centre agree; one of the five was turned before it was voxelised.
            if ranges(&object) == ranges(&official) {
                same_box += 1;
                best = best.max(iou);
            }
            compared += 1;
        }
        assert!(compared > 0, "no mesh with a grid of the same name");
        assert!(same_box * 5 >= compared * 4 && best > 0.95, "{same_box} of {compared} in the same box, best IoU {best}");
    }
}
