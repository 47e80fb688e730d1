//! Open meshes: whether the inside of one is missing on the grid, and filling it.
//!
//! A surface with a hole lets the outside in, so that flooding from the border leaves the object hollow. Rays tell its inside all the same
//! (ray parity with votes, Nooruddin & Turk 2003, "Simplification and repair of polygonal models using volumetric techniques"): along a ray
//! that crosses the surface an even number of times, what lies behind an odd number of crossings is inside; a ray with an odd number of
//! crossings has gone through a hole and has no vote. A voxel is inside where most rays through it that have a vote say so.
//!
//! The other way to close takes the orthographic visual hull (Laurentini 1994) of the filled voxels: what every ray through it meets.

use super::Mesh;
use super::voxelise::Frame;
use beo_core::grid::{Dims, Occupancy};
use fixedbitset::FixedBitSet;
use nalgebra::{Point3, Vector3};

/// How an open mesh is filled.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Close {
    /// Not at all: it stays hollow. Use this to see what a file holds.
    #[default]
    Not,
    /// By rays: what most of the rays through it find inside, as if a lid lay on each hole. Use this for scans and models without a bottom.
    Holes,
    /// All of the visual hull: dents and hollows that no straight line passes are filled too. Use this for half surfaces and point clouds.
    Hull,
}

/// Directions of rays: the three axes, then others spread evenly over a half sphere.
const DIRECTIONS: usize = 32;
/// An inside that is missing counts from this share of the filled voxels.
const LEAST_SHARE: f64 = 0.02;
/// And from so many voxels.
const LEAST_VOXELS: usize = 8;

/// The voxels inside of an open mesh that are not filled; none if they are too few to matter, or the mesh is closed.
pub(super) fn missing_inside(mesh: &Mesh, frame: &Frame, filled: &Occupancy) -> Option<FixedBitSet> {
    let triangles = open_triangles(mesh)?;
    let places: Vec<Point3<f64>> = mesh.vertices().iter().map(|p| frame.place(p)).collect();
    let dims = filled.dims();
    let (mut voting, mut inside) = (vec![0_u8; dims.voxels()], vec![0_u8; dims.voxels()]);
    for direction in directions() {
        let view = View::new(dims, direction);
        let crossings = view.crossings(&places, &triangles);
        for voxel in filled.bits().zeroes() {
            let (pixel, depth) = view.of_voxel(dims.coordinates(voxel));
            if let Some(is_inside) = crossings.vote(pixel, depth) {
                voting[voxel] += 1;
                inside[voxel] += u8::from(is_inside);
            }
        }
    }
    let mut missing = FixedBitSet::with_capacity(dims.voxels());
    filled.bits().zeroes().filter(|voxel| 2 * inside[*voxel] > voting[*voxel]).for_each(|voxel| missing.insert(voxel));
    let count = missing.count_ones(..);
    (count >= LEAST_VOXELS && count as f64 >= LEAST_SHARE * filled.count() as f64).then_some(missing)
}

/// Fills the visual hull of the filled voxels.
pub(super) fn fill_hull(object: &mut Occupancy) {
    let dims = object.dims();
    let mut hull = object.bits().clone();
    hull.insert_range(..);
    for direction in directions() {
        let view = View::new(dims, direction);
        let mut covered = FixedBitSet::with_capacity(view.side * view.side);
        for voxel in object.bits().ones() {
            view.cover(dims.coordinates(voxel), &mut covered);
        }
        let missed: Vec<usize> = hull.ones().filter(|voxel| !covered.contains(view.of_voxel(dims.coordinates(*voxel)).0)).collect();
        missed.into_iter().for_each(|voxel| hull.set(voxel, false));
    }
    *object = Occupancy::from_bits(dims, hull);
}

/// The triangles of a mesh, those that lie on each other once; none if every edge has an even number of them, so that nothing is open.
fn open_triangles(mesh: &Mesh) -> Option<Vec<[u32; 3]>> {
    // Vertices at one place are one, −0 being 0.
    let vertices = mesh.vertices();
    let place = |v: u32| vertices[v as usize].map(|c| c + 0.0);
    let compare = |a: &u32, b: &u32| {
        let (p, q) = (place(*a), place(*b));
        p.x.total_cmp(&q.x).then(p.y.total_cmp(&q.y)).then(p.z.total_cmp(&q.z))
    };
    let mut order: Vec<u32> = (0..vertices.len() as u32).collect();
    order.sort_unstable_by(compare);
    let mut merged = vec![0; vertices.len()];
    for same in order.chunk_by(|a, b| place(*a) == place(*b)) {
        same.iter().for_each(|vertex| merged[*vertex as usize] = same[0]);
    }
    let mut triangles: Vec<[u32; 3]> = mesh.triangles().iter().map(|t| t.map(|v| merged[v as usize])).collect();
    triangles.iter_mut().for_each(|t| t.sort_unstable());
    triangles.retain(|[a, b, c]| a != b && b != c);
    triangles.sort_unstable();
    triangles.dedup();
    let mut edges: Vec<[u32; 2]> = triangles.iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [a, c]]).collect();
    edges.sort_unstable();
    let is_open = edges.chunk_by(|a, b| a == b).any(|edge| edge.len() % 2 == 1);
    is_open.then_some(triangles)
}

/// Unit vectors.
fn directions() -> impl Iterator<Item = Vector3<f64>> {
    let golden = std::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
    let spread = (0..DIRECTIONS - 3).map(move |n| {
        let z = (n as f64 + 0.5) / (DIRECTIONS - 3) as f64;
        let (sin, cos) = (golden * n as f64).sin_cos();
        let radius = (1.0 - z * z).sqrt();
        Vector3::new(radius * cos, radius * sin, z)
    });
    [Vector3::x(), Vector3::y(), Vector3::z()].into_iter().chain(spread)
}

/// A grid seen along a direction, orthographically: pixels as large as voxels, and voxels of depth. Along an axis, pixels and voxels match.
struct View {
    /// Across, across, along.
    axes: [Vector3<f64>; 3],
    /// Whole voxels, so that nothing of the grid lies below zero.
    shift: Vector3<f64>,
    /// Pixels, and steps of depth, along each side.
    side: usize,
    /// Half the extent of a voxel across.
    reach: [f64; 2],
}

impl View {
    fn new(dims: Dims, direction: Vector3<f64>) -> Self {
        // For an axis this gives the other two.
        let least = direction.iamin();
        let across = Vector3::ith(least, 1.0);
        let across = (across - direction * direction.dot(&across)).normalize();
        let axes = [across, direction.cross(&across), direction];
        let corner = |c: usize| {
            Vector3::new(dims.x() as f64, dims.y() as f64, dims.z() as f64)
                .map_with_location(|a, _, n| if c >> a & 1 == 1 { n } else { 0.0 })
        };
        let (mut low, mut high) = (Vector3::zeros(), Vector3::zeros());
        for corner in (0..8).map(corner) {
            let seen = Vector3::from(axes.map(|axis| axis.dot(&corner)));
            (low, high) = (low.inf(&seen), high.sup(&seen));
        }
        let shift = low.map(|c| 1.0 - c.floor());
        let side = (high + shift).max().ceil() as usize + 2;
        let reach = [0, 1].map(|n| 0.5 * axes[n].abs().sum() - 1e-6);
        Self { axes, shift, side, reach }
    }

    /// Where a place is seen: across, across, along, in pixels.
    fn see(&self, place: &Point3<f64>) -> Vector3<f64> {
        Vector3::from(self.axes.map(|axis| axis.dot(&place.coords))) + self.shift
    }

    fn centre([i, j, k]: [usize; 3]) -> Point3<f64> {
        Point3::new(i as f64 + 0.5, j as f64 + 0.5, k as f64 + 0.5)
    }

    /// The pixel of a voxel's centre, and its depth.
    fn of_voxel(&self, voxel: [usize; 3]) -> (usize, usize) {
        let seen = self.see(&Self::centre(voxel));
        (seen.y as usize * self.side + seen.x as usize, seen.z as usize)
    }

    /// Marks the pixels that a voxel may cover.
    fn cover(&self, voxel: [usize; 3], covered: &mut FixedBitSet) {
        let seen = self.see(&Self::centre(voxel));
        for row in (seen.y - self.reach[1]) as usize..=(seen.y + self.reach[1]) as usize {
            for column in (seen.x - self.reach[0]) as usize..=(seen.x + self.reach[0]) as usize {
                covered.insert(row * self.side + column);
            }
        }
    }

    /// Crossings of the rays through all pixels' centres with the triangles.
    fn crossings(&self, places: &[Point3<f64>], triangles: &[[u32; 3]]) -> Crossings {
        let words = self.side / 64 + 1;
        let mut crossings = Crossings { parity: vec![0; self.side * self.side * words], words };
        for triangle in triangles {
            self.cross(triangle.map(|v| self.see(&places[v as usize])), &mut crossings);
        }
        crossings
    }

    /// Notes the rays that cross a triangle. A ray through an edge of two triangles crosses one of them: ranges are half open, and an edge is
    /// cut in the same order of its ends whichever triangle has it.
    fn cross(&self, corners: [Vector3<f64>; 3], crossings: &mut Crossings) {
        let [a, b, c] = corners;
        let normal = (b - a).cross(&(c - a));
        let range = |axis: usize| {
            let (low, high) = (a[axis].min(b[axis]).min(c[axis]), a[axis].max(b[axis]).max(c[axis]));
            ((low - 0.5).ceil().max(0.0) as usize, (high - 0.5).ceil().clamp(0.0, self.side as f64) as usize, low, high)
        };
        let (first_row, end_row, ..) = range(1);
        let (_, _, nearest, farthest) = range(2);
        for row in first_row..end_row {
            let y = row as f64 + 0.5;
            let (mut from, mut to) = (f64::INFINITY, f64::NEG_INFINITY);
            for (p, q) in [(a, b), (b, c), (c, a)] {
                let (p, q) = if (p.y, p.x) <= (q.y, q.x) { (p, q) } else { (q, p) };
                if (p.y > y) != (q.y > y) {
                    let x = p.x + (y - p.y) / (q.y - p.y) * (q.x - p.x);
                    (from, to) = (from.min(x), to.max(x));
                }
            }
            let columns = (from - 0.5).ceil().max(0.0) as usize..(to - 0.5).ceil().clamp(0.0, self.side as f64) as usize;
            for column in columns {
                let x = column as f64 + 0.5;
                let depth = a.z - (normal.x * (x - a.x) + normal.y * (y - a.y)) / normal.z;
                crossings.note(row * self.side + column, depth.clamp(nearest, farthest), self.side);
            }
        }
    }
}

/// For each pixel and each step of depth, whether an odd number of crossings lies before the step's middle.
struct Crossings {
    parity: Vec<u64>,
    words: usize,
}

impl Crossings {
    fn note(&mut self, pixel: usize, depth: f64, side: usize) {
        let first = (depth - 0.5).ceil().clamp(0.0, side as f64) as usize;
        let row = &mut self.parity[pixel * self.words..(pixel + 1) * self.words];
        row[first / 64] ^= u64::MAX << (first % 64);
        row[first / 64 + 1..].iter_mut().for_each(|word| *word = !*word);
    }

    /// Whether the ray finds the voxel inside; none if it has no vote.
    fn vote(&self, pixel: usize, depth: usize) -> Option<bool> {
        let row = &self.parity[pixel * self.words..(pixel + 1) * self.words];
        let total = row[self.words - 1] >> 63 & 1;
        (total == 0).then(|| row[depth / 64] >> (depth % 64) & 1 == 1)
    }
}
