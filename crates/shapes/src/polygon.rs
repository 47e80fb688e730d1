//! Polygons to triangles: convex ones as fans, all others by ear clipping (`earcut`) in the plane that fits best.
//!
//! The plane's normal is Newell's (Sutherland, Sproull & Schumacker 1974): the sum of the cross products of neighbouring corners. A polygon
//! with holes arrives as one outline whose bridges are run along twice, there and back; ear clipping takes it as it is. The triangles must
//! have the polygon's area: where they have not, the outline crosses itself, and the polygon is named.

use super::{FormatError, Mesh, PointCloud};
use crate::content::Content;
use earcut::Earcut;
use nalgebra::{Point3, Vector3};

/// Most corners of a polygon that is not convex: ear clipping may take a time that grows as their square.
const MOST_CORNERS: usize = 1 << 16;
/// A polygon that crosses itself is laid as a fan where it is so small a share of the mesh that no voxel tells.
const NEGLIGIBLE: f64 = 1e-3;
/// Largest difference between the area of the triangles and of the polygon, as a share of the square around it.
const AREA_TOLERANCE: f64 = 1e-6;

/// Where a polygon stands in its file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Place {
    /// On this line, counted from 1.
    Line(usize),
    /// At this byte, counted from 0.
    Byte(usize),
}

impl Place {
    /// The error that names it.
    pub fn error(self, format: &'static str, problem: String) -> FormatError {
        match self {
            Self::Line(line) => FormatError::Line { format, line, problem },
            Self::Byte(byte) => FormatError::Byte { format, byte, problem },
        }
    }
}

/// A polygon that has no triangulation.
struct Crossed {
    place: Place,
    corners: usize,
    too_many: bool,
    bounds: [Point3<f64>; 2],
}

/// Collects vertices and polygons of a file.
pub(super) struct Surface {
    format: &'static str,
    vertices: Vec<Point3<f64>>,
    triangles: Vec<[u32; 3]>,
    faces: usize,
    crossed: Vec<Crossed>,
    ear: Earcut<f64>,
    // Scratch of one polygon.
    corners: Vec<u32>,
    flat: Vec<[f64; 2]>,
    ears: Vec<u32>,
}

impl Surface {
    /// With all vertices of the file, each finite.
    pub fn new(format: &'static str, vertices: Vec<Point3<f64>>) -> Result<Self, FormatError> {
        super::mesh::check_vertices(&vertices)?;
        Ok(Self {
            format,
            vertices,
            triangles: Vec::new(),
            faces: 0,
            crossed: Vec::new(),
            ear: Earcut::new(),
            corners: Vec::new(),
            flat: Vec::new(),
            ears: Vec::new(),
        })
    }

    /// Number of vertices.
    pub fn vertices(&self) -> usize {
        self.vertices.len()
    }

    /// Adds a triangle whose vertices exist.
    pub fn triangle(&mut self, triangle: [u32; 3]) {
        self.faces += 1;
        self.triangles.push(triangle);
    }

    /// Adds a polygon whose vertices exist; a point or a line adds nothing.
    pub fn polygon(&mut self, polygon: &[u32], place: Place) {
        self.faces += 1;
        if let &[a, b, c] = polygon {
            return self.triangles.push([a, b, c]);
        }
        simplify(polygon, &self.vertices, &mut self.corners);
        if self.corners.len() <= 3 {
            if let &[a, b, c] = &self.corners[..] {
                self.triangles.push([a, b, c]);
            }
            return;
        }
        let too_many = match project(&self.corners, &self.vertices, &mut self.flat) {
            None => return fan(&self.corners, &mut self.triangles),
            Some(Plane::Convex) => return fan(&self.corners, &mut self.triangles),
            Some(Plane::Other { .. }) if self.corners.len() > MOST_CORNERS => true,
            Some(Plane::Other { area }) => {
                self.ear.earcut(self.flat.iter().copied(), &[], &mut self.ears);
                let triangle_area = |t: &[u32]| {
                    let [a, b, c] = [t[0], t[1], t[2]].map(|corner| self.flat[corner as usize]);
                    ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])).abs() / 2.0
                };
                let covered: f64 = self.ears.chunks_exact(3).map(triangle_area).sum();
                if (covered - area).abs() <= AREA_TOLERANCE {
                    let corners = &self.corners;
                    self.triangles.extend(self.ears.chunks_exact(3).map(|t| [0, 1, 2].map(|n| corners[t[n] as usize])));
                    return;
                }
                false
            }
            Some(Plane::Crossed) => false,
        };
        let bounds = bounds(self.corners.iter().map(|corner| self.vertices[*corner as usize]));
        self.crossed.push(Crossed { place, corners: polygon.len(), too_many, bounds });
        fan(&self.corners, &mut self.triangles);
    }

    /// The mesh; the vertices alone are a point cloud where no polygon was added.
    pub fn finish(self) -> Result<Content, FormatError> {
        if self.faces == 0 && !self.vertices.is_empty() {
            return Ok(Content::Points(PointCloud::new(self.vertices)?));
        }
        let mesh = Mesh::new(self.vertices, self.triangles)?;
        let [low, high] = mesh.bounds();
        let least = (high - low).max() * NEGLIGIBLE;
        let is_seen = |crossed: &&Crossed| (crossed.bounds[1] - crossed.bounds[0]).max() > least;
        let mut seen = self.crossed.iter().filter(is_seen);
        match seen.next() {
            None => Ok(Content::Mesh(mesh)),
            Some(&Crossed { place, corners, too_many, .. }) => {
                let others = seen.count();
                let more = if others > 0 { format!(" (and {others} more)") } else { String::new() };
                let why = match too_many {
                    true => format!("is not convex and has more than {MOST_CORNERS} corners"),
                    false => "cannot be cut into triangles, for its outline crosses itself or lies in no plane".into(),
                };
                let problem = format!("a polygon of {corners} corners {why}{more}: triangulate the mesh in the program that made it");
                Err(place.error(self.format, problem))
            }
        }
    }
}

/// The box around some points.
fn bounds(points: impl Iterator<Item = Point3<f64>>) -> [Point3<f64>; 2] {
    let start = [Point3::from([f64::INFINITY; 3]), Point3::from([f64::NEG_INFINITY; 3])];
    points.fold(start, |[low, high], p| [low.inf(&p), high.sup(&p)])
}

/// The corners without repeated ones and without paths that only lead somewhere and back.
fn simplify(polygon: &[u32], vertices: &[Point3<f64>], corners: &mut Vec<u32>) {
    corners.clear();
    let same = |a: u32, b: u32| a == b || vertices[a as usize] == vertices[b as usize];
    for &corner in polygon {
        match corners[..] {
            [.., last] if same(last, corner) => {}
            [.., before, _] if same(before, corner) => {
                corners.pop();
            }
            _ => corners.push(corner),
        }
    }
    // The same across the seam.
    let mut start = 0;
    loop {
        match corners[start..] {
            [first, .., last] if same(first, last) => {
                corners.pop();
            }
            [first, _, .., before, _] if same(before, first) => {
                corners.truncate(corners.len() - 2);
            }
            [_, second, .., last] if same(last, second) => {
                corners.pop();
                start += 1;
            }
            _ => break,
        }
    }
    corners.drain(..start);
}

/// A polygon in its plane.
enum Plane {
    /// All turns are to one side, and there is one turn in all.
    Convex,
    /// Any other, of this area.
    Other { area: f64 },
    /// It encloses nothing in the sum, though its corners span a plane.
    Crossed,
}

/// Lays the corners into the plane of Newell's normal, the largest extent scaled to 1; none if they lie on a line.
fn project(corners: &[u32], vertices: &[Point3<f64>], flat: &mut Vec<[f64; 2]>) -> Option<Plane> {
    let at = |n: usize| vertices[corners[n % corners.len()] as usize];
    let [low, high] = bounds((0..corners.len()).map(at));
    let extent = (high - low).max();
    let local = |n: usize| (at(n) - at(0)) / extent;
    let sum: Vector3<f64> = (0..corners.len()).map(|n| local(n).cross(&local(n + 1))).sum();
    let area = sum.norm() / 2.0;
    if area <= 1e-9 {
        let far = (0..corners.len()).map(local).max_by(|a, b| a.norm().total_cmp(&b.norm()))?.normalize();
        let is_line = (0..corners.len()).all(|n| local(n).cross(&far).norm() <= 1e-9);
        return if is_line { None } else { Some(Plane::Crossed) };
    }
    let normal = sum / (2.0 * area);
    // Any axis across the normal will do.
    let least = normal.iamin();
    let across = normal.cross(&Vector3::ith(least, 1.0)).normalize();
    let along = normal.cross(&across);
    flat.clear();
    flat.extend((0..corners.len()).map(|n| [local(n).dot(&across), local(n).dot(&along)]));
    Some(if is_convex(flat) { Plane::Convex } else { Plane::Other { area } })
}

/// Whether a polygon of positive area turns to the left only, and once.
fn is_convex(flat: &[[f64; 2]]) -> bool {
    let edge = |n: usize| {
        let ([ax, ay], [bx, by]) = (flat[n % flat.len()], flat[(n + 1) % flat.len()]);
        [bx - ax, by - ay]
    };
    let mut reversals = 0;
    let is_right = |[x, y]: [f64; 2]| x > 0.0 || x == 0.0 && y > 0.0;
    for n in 0..flat.len() {
        let (a, b) = (edge(n), edge(n + 1));
        if a[0] * b[1] - a[1] * b[0] < -1e-9 {
            return false;
        }
        reversals += usize::from(is_right(a) != is_right(b));
    }
    reversals <= 2
}

/// The corners as triangles about the first.
fn fan(corners: &[u32], triangles: &mut Vec<[u32; 3]>) {
    triangles.extend(corners.windows(2).skip(1).map(|pair| [corners[0], pair[0], pair[1]]));
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn triangulated(outline: &[[f64; 3]], polygon: &[u32]) -> Result<Mesh, FormatError> {
        let mut surface = Surface::new("X", outline.iter().copied().map(Point3::from).collect()).unwrap();
        surface.polygon(polygon, Place::Line(7));
        match surface.finish()? {
            Content::Mesh(mesh) => Ok(mesh),
            other => panic!("{other:?}"),
        }
    }

    /// How many triangles cover a point of the plane z = 0.
    fn cover(mesh: &Mesh, x: f64, y: f64) -> usize {
        let inside = |t: &&[u32; 3]| {
            let corners = mesh.corners(**t);
            let side = |n: usize| {
                let (a, b) = (corners[n], corners[(n + 1) % 3]);
                (b.x - a.x) * (y - a.y) - (b.y - a.y) * (x - a.x)
            };
            let sides = [side(0), side(1), side(2)];
            sides.iter().all(|s| *s > 0.0) || sides.iter().all(|s| *s < 0.0)
        };
        mesh.triangles().iter().filter(inside).count()
    }

    #[test]
    fn convex_polygons_become_fans_and_points_and_lines_nothing() {
        let square = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
        assert_eq!(triangulated(&square, &[0, 1, 2, 3]).unwrap().triangles(), [[0, 1, 2], [0, 2, 3]]);
        assert_eq!(triangulated(&square, &[0, 1, 1, 2, 3, 0]).unwrap().triangles(), [[0, 1, 2], [0, 2, 3]]);
        for polygon in [&[0, 1][..], &[0], &[], &[0, 1, 0, 1], &[0, 1, 0, 2]] {
            assert!(triangulated(&square, polygon).unwrap_err().to_string().contains("no triangle"), "{polygon:?}");
        }
    }

    #[test]
    fn holes_behind_bridges_stay_open() {
        // A square of 10 with two square holes, each on a bridge.
        let points = [
            [0.0, 0.0],
            [10.0, 0.0],
            [10.0, 10.0],
            [0.0, 10.0],
            [2.0, 2.0],
            [2.0, 4.0],
            [4.0, 4.0],
            [4.0, 2.0],
            [6.0, 6.0],
            [6.0, 8.0],
            [8.0, 8.0],
            [8.0, 6.0],
        ]
        .map(|[x, y]| [x, y, 0.0]);
        let polygon = [0, 4, 5, 6, 8, 9, 10, 11, 8, 6, 7, 4, 0, 1, 2, 3];
        for start in 0..polygon.len() {
            let mut turned = polygon;
            turned.rotate_left(start);
            for reversed in [false, true] {
                if reversed {
                    turned.reverse();
                }
                let mesh = triangulated(&points, &turned).unwrap();
                for (x, y, expected) in [(3.1, 2.9, 0), (7.1, 6.9, 0), (1.0, 5.1, 1), (9.0, 1.1, 1), (5.1, 5.3, 1), (3.1, 8.9, 1)] {
                    assert_eq!(cover(&mesh, x, y), expected, "start {start}, {x} {y}");
                }
            }
        }
    }

    #[test]
    fn outlines_that_cross_themselves_are_named_unless_nobody_sees_them() {
        let crossed = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 1.0, 0.0], [2.0, 1.5, 0.0]];
        let message = triangulated(&crossed, &[0, 1, 2, 3]).unwrap_err().to_string();
        assert!(message.starts_with("X, line 7: a polygon of 4 corners cannot be cut into triangles"), "{message}");
        let even = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 1.0, 0.0], [2.0, 1.0, 0.0]];
        assert!(triangulated(&even, &[0, 1, 2, 3]).is_err());
        let star: Vec<[f64; 3]> =
            (0..5).map(|n| (f64::from(n) * 4.0 * std::f64::consts::PI / 5.0).sin_cos()).map(|(s, c)| [s, c, 0.0]).collect();
        assert!(triangulated(&star, &[0, 1, 2, 3, 4]).is_err());

        let mut surface =
            Surface::new("X", crossed.iter().chain(&[[1e4, 0.0, 0.0], [0.0, 1e4, 0.0]]).copied().map(Point3::from).collect()).unwrap();
        surface.polygon(&[0, 1, 2, 3], Place::Byte(7));
        surface.triangle([0, 4, 5]);
        assert!(matches!(surface.finish(), Ok(Content::Mesh(_))));
    }

    proptest! {
        /// A comb of teeth of any heights, in any plane, from any corner, far away or not: covered once inside, nowhere outside.
        #[test]
        fn concave_polygons_are_covered_once(
            heights in prop::collection::vec(1.0..5.0_f64, 3..9),
            start in 0..100_usize,
            tilt in [-2.0..2.0_f64, -2.0..2.0, -2.0..2.0],
            far in prop_oneof![Just(0.0), Just(5e6)],
            reversed: bool,
        ) {
            // Teeth of width 1 at x = 2n, joined by a back of height 0.5 below them.
            let mut outline = vec![[0.0, -0.5], [2.0 * heights.len() as f64 - 1.0, -0.5]];
            for (n, height) in heights.iter().enumerate().rev() {
                let x = 2.0 * n as f64;
                outline.extend([[x + 1.0, 0.0], [x + 1.0, *height], [x, *height], [x, 0.0]]);
            }
            let turn = nalgebra::Rotation3::new(Vector3::from(tilt));
            let shift = Vector3::repeat(far);
            let vertices = outline.iter().map(|[x, y]| Point3::from(turn * Vector3::new(*x, *y, 0.0) + shift)).collect();
            let mut polygon: Vec<u32> = (0..outline.len() as u32).collect();
            polygon.rotate_left(start % outline.len());
            if reversed {
                polygon.reverse();
            }
            let mut surface = Surface::new("X", vertices).unwrap();
            surface.polygon(&polygon, Place::Line(1));
            let Content::Mesh(mesh) = surface.finish().unwrap() else { panic!() };
            let back = mesh.mapped(|p| Point3::from(turn.inverse() * (p.coords - shift))).unwrap();
            for (n, height) in heights.iter().enumerate() {
                let x = 2.0 * n as f64;
                prop_assert_eq!(cover(&back, x + 0.513, height - 0.1), 1);
                prop_assert_eq!(cover(&back, x + 1.487, 0.1), 0);
                prop_assert_eq!(cover(&back, x + 0.513, -0.237), 1);
            }
        }
    }
}
