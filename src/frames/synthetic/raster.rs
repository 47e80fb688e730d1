//! Scenes of meshes, rendered exactly: every pixel's ray against every triangle that may cover it, the nearest hit counts.
//!
//! A ray d (with d.z = 1) meets the triangle v0 v1 v2 where the triple products wᵢ = d · (vⱼ × vₖ) have one sign, at the depth
//! v0 · (v1 × v2) / (w0 + w1 + w2) (Olano and Greer, "Triangle scan conversion using 2D homogeneous coordinates", 1997): no projection
//! and no clipping, so that lens distortion costs nothing and triangles may reach behind the camera. Candidates are found by tiles of
//! pixels whose rays lie in the triangle's bounds on the plane z = 1.

use super::DepthImage;
use beo_camera::Intrinsics;
use beo_shapes::Mesh;
use nalgebra::{Isometry3, Point3, Vector3};
use rayon::prelude::*;
use std::borrow::Cow;
use std::ops::Range;

/// Pixels along the sides of a tile: few, as most triangles of an object at arm's length cover a few pixels.
const TILE: usize = 4;
/// Triangles nearer than this are not looked up by their bounds, metres.
const NEAREST: f64 = 1e-3;

/// The objects that the camera looks at.
#[derive(Clone, Debug, Default)]
pub struct Scene<'a> {
    items: Vec<Item<'a>>,
}

#[derive(Clone, Debug)]
struct Item<'a> {
    mesh: Cow<'a, Mesh>,
    to_world: Isometry3<f64>,
    label: u16,
}

impl<'a> Scene<'a> {
    /// Nothing.
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds a mesh in metres; both sides of its triangles are seen. `to_world` takes its frame to the scene's.
    pub fn add(&mut self, mesh: &'a Mesh, to_world: Isometry3<f64>, label: u16) {
        self.items.push(Item { mesh: Cow::Borrowed(mesh), to_world, label });
    }

    /// Adds a table top: a rectangle of `size_m` metres about the origin of the plane z = 0 of its frame. `label` may be 0.
    ///
    /// # Panics
    /// If a side is not positive and finite.
    pub fn add_table(&mut self, size_m: [f64; 2], to_world: Isometry3<f64>, label: u16) {
        assert!(size_m.iter().all(|side| side.is_finite() && *side > 0.0), "a table of {size_m:?} m");
        let [x, y] = size_m.map(|side| side / 2.0);
        let corners = [[-x, -y, 0.0], [x, -y, 0.0], [x, y, 0.0], [-x, y, 0.0]].map(Point3::from);
        let mesh = Mesh::new(corners.to_vec(), vec![[0, 1, 2], [0, 2, 3]]).expect("a rectangle");
        self.items.push(Item { mesh: Cow::Owned(mesh), to_world, label });
    }
}

/// A camera with the rays of its pixels.
#[derive(Clone, Debug)]
pub struct SyntheticCamera {
    intrinsics: Intrinsics,
    /// x and y of each pixel's ray where z is 1.
    rays: Vec<[f64; 2]>,
    /// Bounds of the rays of each row of tiles, and of the tiles in each.
    bands: Strip,
    tiles: Vec<Strip>,
}

/// Bounds side by side along one axis.
#[derive(Clone, Debug)]
struct Strip {
    axis: usize,
    bounds: Vec<Bounds>,
    /// Whether they ascend along the axis, as they do unless the distortion folds the image.
    ascends: bool,
}

impl Strip {
    fn new(axis: usize, bounds: Vec<Bounds>) -> Self {
        let ascends = bounds.windows(2).all(|w| w[0].low[axis] <= w[1].low[axis] && w[0].high[axis] <= w[1].high[axis]);
        Self { axis, bounds, ascends }
    }

    /// Those that the bounds of a triangle may meet.
    fn candidates(&self, triangle: &Bounds) -> Range<usize> {
        if !self.ascends {
            return 0..self.bounds.len();
        }
        let first = self.bounds.partition_point(|b| b.high[self.axis] < triangle.low[self.axis]);
        let end = self.bounds.partition_point(|b| b.low[self.axis] <= triangle.high[self.axis]);
        first..end.max(first)
    }
}

/// A rectangle of the plane z = 1.
#[derive(Clone, Copy, Debug)]
struct Bounds {
    low: [f64; 2],
    high: [f64; 2],
}

impl Bounds {
    const NOTHING: Self = Self { low: [f64::INFINITY; 2], high: [f64::NEG_INFINITY; 2] };
    const EVERYTHING: Self = Self { low: [f64::NEG_INFINITY; 2], high: [f64::INFINITY; 2] };

    fn include(&mut self, [x, y]: [f64; 2]) {
        self.low = [self.low[0].min(x), self.low[1].min(y)];
        self.high = [self.high[0].max(x), self.high[1].max(y)];
    }

    fn meets(&self, other: &Self) -> bool {
        (0..2).all(|axis| self.low[axis] <= other.high[axis] && other.low[axis] <= self.high[axis])
    }
}

/// A triangle in the camera frame, with what the test of a ray needs.
struct Triangle {
    sides: [Vector3<f64>; 3],
    volume: f64,
    bounds: Bounds,
    label: u16,
}

impl Triangle {
    fn new(corners: [Point3<f64>; 3], label: u16) -> Option<Self> {
        if corners.iter().all(|p| p.z <= 0.0) {
            return None;
        }
        let [a, b, c] = corners.map(|p| p.coords);
        let sides = [b.cross(&c), c.cross(&a), a.cross(&b)];
        let mut bounds = Bounds::NOTHING;
        if corners.iter().all(|p| p.z > NEAREST) {
            // A little more than the triangle, for what rounding may do to a ray at its edge.
            corners.iter().map(|p| [p.x / p.z, p.y / p.z]).for_each(|[x, y]| {
                let slack = 1e-9 * (1.0 + x.abs().max(y.abs()));
                bounds.include([x - slack, y - slack]);
                bounds.include([x + slack, y + slack]);
            });
        } else {
            bounds = Bounds::EVERYTHING;
        }
        Some(Self { volume: a.dot(&sides[0]), sides, bounds, label })
    }

    /// Depth at which the ray (x, y, 1) meets the triangle.
    #[inline]
    fn depth(&self, [x, y]: [f64; 2]) -> Option<f64> {
        let w = [0, 1, 2].map(|n| x * self.sides[n].x + y * self.sides[n].y + self.sides[n].z);
        let is_inside = w.iter().all(|w| *w >= 0.0) || w.iter().all(|w| *w <= 0.0);
        let depth = self.volume / (w[0] + w[1] + w[2]);
        (is_inside && depth > 0.0 && depth.is_finite()).then_some(depth)
    }
}

impl SyntheticCamera {
    /// A camera: computes the rays of its pixels, once.
    pub fn new(intrinsics: Intrinsics) -> Self {
        let (width, height) = (intrinsics.width() as usize, intrinsics.height() as usize);
        let mut rays = vec![[0.0; 2]; width * height];
        rays.par_chunks_exact_mut(width).enumerate().for_each(|(row, rays)| {
            for (column, ray) in rays.iter_mut().enumerate() {
                let direction = intrinsics.ray([column as f64, row as f64]);
                *ray = [direction.x, direction.y];
            }
        });
        let mut tiles = vec![vec![Bounds::NOTHING; width.div_ceil(TILE)]; height.div_ceil(TILE)];
        let mut bands = vec![Bounds::NOTHING; tiles.len()];
        for (n, ray) in rays.iter().enumerate() {
            let (row, column) = (n / width / TILE, n % width / TILE);
            tiles[row][column].include(*ray);
            bands[row].include(*ray);
        }
        let tiles = tiles.into_iter().map(|bounds| Strip::new(0, bounds)).collect();
        Self { intrinsics, rays, bands: Strip::new(1, bands), tiles }
    }

    /// The camera's numbers.
    pub fn intrinsics(&self) -> &Intrinsics {
        &self.intrinsics
    }

    /// x and y of each pixel's ray where z is 1, row by row.
    pub(super) fn rays(&self) -> &[[f64; 2]] {
        &self.rays
    }

    /// The exact depth and labels of a scene; `camera_to_world` takes the optical frame to the scene's. What is nowhere met has depth 0
    /// and label 0. Of surfaces at the same depth the one added first is seen.
    pub fn render(&self, scene: &Scene<'_>, camera_to_world: &Isometry3<f64>) -> DepthImage {
        let triangles: Vec<Triangle> = scene
            .items
            .iter()
            .flat_map(|item| {
                let to_camera = camera_to_world.inverse() * item.to_world;
                let turn = to_camera.to_matrix();
                let corners: Vec<Point3<f64>> = item.mesh.vertices().iter().map(|p| turn.transform_point(p)).collect();
                let triangle = move |t: &[u32; 3]| Triangle::new(t.map(|v| corners[v as usize]), item.label);
                item.mesh.triangles().iter().filter_map(triangle)
            })
            .collect();
        let mut by_band = vec![Vec::new(); self.tiles.len()];
        for (n, triangle) in triangles.iter().enumerate() {
            self.bands.candidates(&triangle.bounds).for_each(|band| by_band[band].push(n as u32));
        }
        let mut image = DepthImage::empty(self.intrinsics);
        let width = self.intrinsics.width() as usize;
        let size = width * TILE;
        let (depth, labels) = image.parts_mut();
        let bands =
            depth.par_chunks_mut(size).zip(labels.par_chunks_mut(size)).zip(self.rays.par_chunks(size)).zip(&self.tiles).zip(&by_band);
        bands.for_each(|((((depth, labels), rays), tiles), candidates)| {
            let mut nearest = vec![f64::INFINITY; depth.len()];
            for triangle in candidates.iter().map(|n| &triangles[*n as usize]) {
                for tile in tiles.candidates(&triangle.bounds).filter(|tile| triangle.bounds.meets(&tiles.bounds[*tile])) {
                    let columns = tile * TILE..((tile + 1) * TILE).min(width);
                    for pixel in (0..depth.len()).step_by(width).flat_map(|line| line + columns.start..line + columns.end) {
                        if let Some(hit) = triangle.depth(rays[pixel]).filter(|hit| *hit < nearest[pixel]) {
                            (nearest[pixel], depth[pixel], labels[pixel]) = (hit, hit as f32, triangle.label);
                        }
                    }
                }
            }
        });
        image
    }
}

#[cfg(test)]
mod tests {
    use super::super::{look_at, orbit};
    use super::*;
    use beo_shapes::household;
    use nalgebra::Translation3;

    fn intrinsics(distortion: [f64; 5]) -> Intrinsics {
        Intrinsics::new(160, 120, [131.0, 133.0], [80.3, 58.9], distortion).unwrap()
    }

    const DISTORTED: [f64; 5] = [-0.25, 0.11, 0.002, -0.003, -0.02];

    /// Every pixel's reading and the ray in the frame of the scene.
    fn readings(camera: &SyntheticCamera, image: &DepthImage, pose: &Isometry3<f64>) -> Vec<(Point3<f64>, Vector3<f64>, f64)> {
        let width = camera.intrinsics().width() as usize;
        let ray = |n: usize| camera.intrinsics().ray([(n % width) as f64, (n / width) as f64]);
        (0..image.depth().len()).map(|n| (Point3::from(pose.translation.vector), pose * ray(n), f64::from(image.depth()[n]))).collect()
    }

    #[test]
    fn a_table_is_seen_where_its_plane_and_edges_are() {
        for distortion in [[0.0; 5], DISTORTED] {
            let camera = SyntheticCamera::new(intrinsics(distortion));
            let pose = orbit(&Point3::origin(), 1.2, 0.7, 0.9);
            let mut scene = Scene::new();
            scene.add_table([0.8, 0.5], Isometry3::identity(), 9);
            let image = camera.render(&scene, &pose);
            let mut seen = 0;
            for (n, (eye, ray, depth)) in readings(&camera, &image, &pose).into_iter().enumerate() {
                let expected = -eye.z / ray.z;
                let at = eye + ray * expected;
                let on_table = expected > 0.0 && at.x.abs() <= 0.4 && at.y.abs() <= 0.25;
                // Pixels on the very edge may go either way.
                if (at.x.abs() - 0.4).abs() > 1e-6 && (at.y.abs() - 0.25).abs() > 1e-6 {
                    assert_eq!(depth > 0.0, on_table);
                    assert_eq!(image.labels()[n], if on_table { 9 } else { 0 });
                    assert!(!on_table || (depth - expected).abs() < 1e-6 * expected, "{depth} {expected}");
                    seen += usize::from(on_table);
                }
            }
            assert!(seen > 3000 && seen < 19_000, "{seen}");
        }
    }

    /// Nearest depth at which a ray enters an axis-aligned box.
    fn enters(low: [f64; 3], high: [f64; 3], eye: &Point3<f64>, ray: &Vector3<f64>) -> Option<f64> {
        let (mut from, mut to) = (0.0_f64, f64::INFINITY);
        for axis in 0..3 {
            let (a, b) = ((low[axis] - eye[axis]) / ray[axis], (high[axis] - eye[axis]) / ray[axis]);
            (from, to) = (from.max(a.min(b)), to.min(a.max(b)));
        }
        (from <= to).then_some(from)
    }

    #[test]
    fn a_box_is_as_deep_as_its_slabs_say() {
        let (low, high) = ([-0.1, -0.05, 0.0], [0.1, 0.05, 0.3]);
        let corners = (0..8).map(|c| Point3::from([0, 1, 2].map(|a| if c >> a & 1 == 0 { low[a] } else { high[a] }))).collect();
        let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let mesh = Mesh::new(corners, quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect()).unwrap();
        for distortion in [[0.0; 5], DISTORTED] {
            let camera = SyntheticCamera::new(intrinsics(distortion));
            // Also from so near that the box reaches behind the camera.
            for pose in [
                orbit(&Point3::new(0.0, 0.0, 0.15), 0.8, 0.4, 0.5),
                look_at(&Point3::new(-0.4, -0.06, 0.1), &Point3::new(1.0, -0.06, 0.1), &Vector3::z()),
            ] {
                let mut scene = Scene::new();
                scene.add(&mesh, Isometry3::identity(), 3);
                let image = camera.render(&scene, &pose);
                let mut hits = 0;
                for (eye, ray, depth) in readings(&camera, &image, &pose) {
                    // Boxes slightly larger and smaller, for pixels on the very edge.
                    let grown = |by: f64| enters(low.map(|v| v - by), high.map(|v| v + by), &eye, &ray);
                    let Some(expected) = grown(0.0) else {
                        assert!(depth == 0.0 || grown(1e-7).is_some());
                        continue;
                    };
                    assert!((depth - expected).abs() < 1e-6 || grown(-1e-7).is_none(), "{depth} {expected}");
                    hits += 1;
                }
                assert!(hits > 1000);
            }
        }
    }

    #[test]
    fn a_sphere_of_triangles_is_as_deep_as_a_sphere() {
        let n = 64_u32;
        let point = |i: u32, j: u32| {
            let ((s, c), (t, d)) = (
                (std::f64::consts::PI * f64::from(i) / f64::from(n)).sin_cos(),
                (2.0 * std::f64::consts::PI * f64::from(j) / f64::from(n)).sin_cos(),
            );
            Point3::new(0.1 * s * d, 0.1 * s * t, 0.1 * c)
        };
        let vertices = (0..=n).flat_map(|i| (0..n).map(move |j| point(i, j))).collect();
        let corner = |i: u32, j: u32| i * n + j % n;
        let quads = (0..n).flat_map(|i| (0..n).map(move |j| [corner(i, j), corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1)]));
        let mesh = Mesh::new(vertices, quads.flat_map(|[a, b, c, d]| [[a, b, c], [a, c, d]]).collect()).unwrap();
        let camera = SyntheticCamera::new(intrinsics(DISTORTED));
        let middle = Point3::new(0.3, -0.2, 0.1);
        let pose = orbit(&(middle + Vector3::new(0.02, 0.03, 0.01)), 0.7, 2.0, 0.3);
        let mut scene = Scene::new();
        scene.add(&mesh, Isometry3::from_parts(Translation3::from(middle.coords), Default::default()), 1);
        let image = camera.render(&scene, &pose);
        let mut hits = 0;
        for (eye, ray, depth) in readings(&camera, &image, &pose) {
            let (a, b) = (ray.norm_squared(), ray.dot(&(eye - middle)));
            let square = |radius: f64| b * b - a * ((eye - middle).norm_squared() - radius * radius);
            // Facets lie up to 0.1 (1 − cos(π/64)) = 0.12 mm below the surface.
            let inner = 0.1 - 0.000_25;
            if square(inner) > 0.0 {
                let (outer, inner) = ((-b - square(0.1).sqrt()) / a, (-b - square(inner).sqrt()) / a);
                assert!((outer - 1e-6..=inner + 1e-6).contains(&depth), "{outer} {depth} {inner}");
                hits += 1;
            } else {
                assert!(square(0.1) > 0.0 || depth == 0.0);
            }
        }
        assert!(hits > 500, "{hits}");
    }

    #[test]
    fn closed_surfaces_have_no_holes_and_the_nearer_object_hides_the_farther() {
        let camera = SyntheticCamera::new(intrinsics(DISTORTED));
        // Neither so small that few pixels show it, nor so large that it hides the other.
        let middling = |class: &str| {
            let mut made = (0..).map(|seed| household::mesh(class, seed).unwrap());
            made.find(|mesh| (0.09..0.16).contains(&mesh.bounds()[1].z) && mesh.bounds()[1].x > 0.03).unwrap()
        };
        let (can, carton) = (middling("can"), middling("box"));
        let mut scene = Scene::new();
        scene.add_table([1.0, 1.0], Isometry3::identity(), 7);
        scene.add(&can, Isometry3::translation(0.12, 0.0, 0.0), 1);
        scene.add(&carton, Isometry3::translation(-0.12, 0.0, 0.0), 2);
        let pose = orbit(&Point3::new(0.0, 0.0, 0.05), 0.6, 0.3, 0.6);
        let image = camera.render(&scene, &pose);
        // What is seen alone, if nearer, is seen in the scene.
        let mut parts = DepthImage::empty(*camera.intrinsics());
        for only in 0..3 {
            let part = Scene { items: vec![scene.items[only].clone()] };
            parts.merge(&camera.render(&part, &pose));
        }
        assert_eq!(parts, image);
        assert!([1, 2, 7].iter().all(|label| image.labels().iter().filter(|l| *l == label).count() > 200));
        // No pixel of the table shines through the middle of an object's silhouette row.
        for row in image.labels().chunks(160) {
            for label in [1, 2] {
                let (first, last) = (row.iter().position(|l| *l == label), row.iter().rposition(|l| *l == label));
                if let (Some(first), Some(last)) = (first, last) {
                    assert!(row[first..=last].iter().all(|l| *l != 7 && *l != 0));
                }
            }
        }
    }

    #[test]
    fn the_number_of_threads_changes_nothing() {
        let camera = SyntheticCamera::new(intrinsics(DISTORTED));
        let mug = household::mesh("mug", 1).unwrap();
        let mut scene = Scene::new();
        scene.add_table([0.6, 0.6], Isometry3::identity(), 0);
        scene.add(&mug, Isometry3::identity(), 1);
        let pose = orbit(&Point3::origin(), 0.5, 1.0, 0.6);
        let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        assert_eq!(alone.install(|| camera.render(&scene, &pose)), camera.render(&scene, &pose));
    }

    #[test]
    #[ignore = "prints the time of a view"]
    fn time_of_a_view() {
        let camera = SyntheticCamera::new(Intrinsics::new(640, 480, [525.0; 2], [319.5, 239.5], DISTORTED).unwrap());
        let meshes: Vec<Mesh> = household::CLASSES.iter().map(|class| household::mesh(class, 1).unwrap()).collect();
        let mut scene = Scene::new();
        scene.add_table([1.0, 1.0], Isometry3::identity(), 100);
        for (n, mesh) in meshes.iter().enumerate() {
            let angle = n as f64 * 0.9;
            scene.add(mesh, Isometry3::translation(0.25 * angle.cos(), 0.25 * angle.sin(), 0.0), n as u16 + 1);
        }
        let triangles: usize = meshes.iter().map(|m| m.triangles().len()).sum();
        for n in 0..std::env::var("BEO_VIEWS").map_or(5, |n| n.parse().unwrap()) {
            let start = std::time::Instant::now();
            let mut image = camera.render(&scene, &orbit(&Point3::origin(), 0.8, f64::from(n), 0.6));
            let rendered = start.elapsed();
            super::super::NoiseModel::default().apply(&camera, &mut image, 1);
            println!("{triangles} triangles: rendered in {rendered:?}, noise in {:?}", start.elapsed() - rendered);
        }
    }
}
