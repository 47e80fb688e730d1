//! Closed surfaces: boxes, surfaces of stacked rings, tubes along a path.

use super::Mesh;
use nalgebra::{Point3, Vector3};

/// Corners of a ring.
const SEGMENTS: usize = 48;

/// A cross-section at one height: a superellipse |x/a|ⁿ + |y/b|ⁿ = 1 about the z axis.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ring {
    /// Half the extent along x and y, metres; 0 for a point on the axis.
    pub half: [f64; 2],
    /// Metres.
    pub z: f64,
    /// 2: an ellipse; more: nearer to a rectangle.
    pub exponent: f64,
}

impl Ring {
    /// A circle.
    pub fn circle(radius: f64, z: f64) -> Self {
        Self { half: [radius, radius], z, exponent: 2.0 }
    }

    fn point(&self, corner: usize) -> Point3<f64> {
        let (sin, cos) = (2.0 * std::f64::consts::PI * corner as f64 / SEGMENTS as f64).sin_cos();
        // Exact zeros, so that opposite corners are symmetric.
        let bent = |v: f64| if v.abs() < 1e-12 { 0.0 } else { v.signum() * v.abs().powf(2.0 / self.exponent) };
        Point3::new(self.half[0] * bent(cos), self.half[1] * bent(sin), self.z)
    }

    fn is_point(&self) -> bool {
        self.half[0] <= 0.0 || self.half[1] <= 0.0
    }
}

/// Closed surfaces in the making.
#[derive(Default)]
pub(super) struct Solid {
    vertices: Vec<Point3<f64>>,
    triangles: Vec<[u32; 3]>,
}

impl Solid {
    /// A box between two corners.
    pub fn cuboid(&mut self, low: [f64; 3], high: [f64; 3]) {
        let first = self.vertices.len() as u32;
        self.vertices.extend((0..8).map(|c| Point3::from([0, 1, 2].map(|a| if c >> a & 1 == 0 { low[a] } else { high[a] }))));
        let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        for [a, b, c, d] in quads.map(|q: [u32; 4]| q.map(|v| first + v)) {
            self.triangles.extend([[a, b, c], [a, c, d]]);
        }
    }

    /// A prism along x from `ends[0]` to `ends[1]`; `profile` is convex, in the plane of y and z, counter-clockwise about x.
    pub fn prism(&mut self, profile: &[[f64; 2]], ends: [f64; 2]) {
        let rows: Vec<Vec<Point3<f64>>> = ends.iter().map(|x| profile.iter().map(|[y, z]| Point3::new(*x, *y, *z)).collect()).collect();
        self.rows(&rows);
    }

    /// Adds all surfaces of another.
    pub fn append(&mut self, other: Self) {
        let first = self.vertices.len() as u32;
        self.vertices.extend(other.vertices);
        self.triangles.extend(other.triangles.into_iter().map(|t| t.map(|v| first + v)));
    }

    /// The surface through rings from the outside of the bottom: up the outside, and for a vessel down the inside. The first and the
    /// last ring are closed by a disc unless they are points.
    pub fn rings(&mut self, rings: &[Ring]) {
        let rows: Vec<Vec<Point3<f64>>> = rings
            .iter()
            .map(|ring| if ring.is_point() { vec![Point3::new(0.0, 0.0, ring.z)] } else { (0..SEGMENTS).map(|c| ring.point(c)).collect() })
            .collect();
        self.rows(&rows);
    }

    /// A tube with an elliptic cross-section along a path in the plane y = 0: `half` its half thickness in the plane and along y,
    /// metres. The path turns counter-clockwise seen from −y, as from the foot of a handle at +x to its top.
    pub fn tube(&mut self, path: &[[f64; 2]], half: [f64; 2]) {
        let rows: Vec<Vec<Point3<f64>>> = (0..path.len())
            .map(|n| {
                let at = Vector3::new(path[n][0], 0.0, path[n][1]);
                let (before, after) = (path[n.saturating_sub(1)], path[(n + 1).min(path.len() - 1)]);
                let along = Vector3::new(after[0] - before[0], 0.0, after[1] - before[1]).normalize();
                let outwards = Vector3::y().cross(&along) * -1.0;
                let corner = |c: usize| {
                    let (sin, cos) = (2.0 * std::f64::consts::PI * c as f64 / 16.0).sin_cos();
                    Point3::from(at - outwards * (half[0] * cos) + Vector3::y() * (half[1] * sin))
                };
                (0..16).map(corner).collect()
            })
            .collect();
        self.rows(&rows);
    }

    /// Bands between rows of as many corners, or one; counter-clockwise about the direction from row to row.
    fn rows(&mut self, rows: &[Vec<Point3<f64>>]) {
        let starts: Vec<u32> = rows
            .iter()
            .map(|row| {
                let start = self.vertices.len() as u32;
                self.vertices.extend(row);
                start
            })
            .collect();
        let corner = |row: usize, c: usize| starts[row] + (c % rows[row].len()) as u32;
        for row in 1..rows.len() {
            let (below, above) = (rows[row - 1].len(), rows[row].len());
            for c in 0..below.max(above) {
                let [a, b, d, e] = [corner(row - 1, c), corner(row - 1, c + 1), corner(row, c + 1), corner(row, c)];
                if below > 1 {
                    self.triangles.push([a, b, d]);
                }
                if above > 1 {
                    self.triangles.push([a, d, e]);
                }
            }
        }
        // The ends.
        for (row, is_first) in [(0, true), (rows.len() - 1, false)] {
            let n = rows[row].len();
            if n < 3 {
                continue;
            }
            let middle = self.vertices.len() as u32;
            let sum = rows[row].iter().fold(Vector3::zeros(), |sum, p| sum + p.coords);
            self.vertices.push(Point3::from(sum / n as f64));
            for c in 0..n {
                let (a, b) = (corner(row, c), corner(row, c + 1));
                self.triangles.push(if is_first { [middle, b, a] } else { [middle, a, b] });
            }
        }
    }

    /// Moves all that is there by a rigid motion.
    pub fn place(&mut self, motion: impl Fn(Point3<f64>) -> Point3<f64>) {
        self.vertices.iter_mut().for_each(|p| *p = motion(*p));
    }

    /// The mesh of all surfaces.
    pub fn into_mesh(self) -> Mesh {
        Mesh::new(self.vertices, self.triangles).expect("finite corners, indices of their own, and an extent")
    }
}
