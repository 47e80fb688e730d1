//! Convex hull of points in space, by adding one after the other to a tetrahedron (Clarkson and Shor's incremental construction, without
//! its conflict lists: of the few hundred outermost points that come in question, each is compared with all faces).

use nalgebra::{Point3, Unit, Vector3};
use std::collections::HashMap;

/// Directions in which the outermost point is looked for.
const DIRECTIONS: usize = 600;
/// A point is outside of a face if it is farther than this, in the unit of the points.
const OUTSIDE: f64 = 1e-7;

/// A closed surface of triangles, counter-clockwise seen from outside.
pub struct Hull {
    points: Vec<Point3<f64>>,
    /// Corners of each face.
    pub faces: Vec<[usize; 3]>,
    /// Unit normals outwards.
    pub normals: Vec<Unit<Vector3<f64>>>,
    /// The face across each edge, from its first corner to its second.
    across: HashMap<(usize, usize), usize>,
}

/// The hull of the points, up to what lies between the directions that are looked at; `None` where they lie in one plane.
pub fn convex_hull(points: &[Point3<f64>]) -> Option<Hull> {
    let points = outermost(points);
    let first = tetrahedron(&points)?;
    let inside = Point3::from(first.iter().map(|n| points[*n].coords).sum::<Vector3<f64>>() / 4.0);
    let mut faces: Vec<[usize; 3]> = Vec::new();
    for left_out in 0..4 {
        let corners: Vec<usize> = (0..4).filter(|n| *n != left_out).map(|n| first[n]).collect();
        faces.push(outwards([corners[0], corners[1], corners[2]], &points, &inside));
    }
    for n in 0..points.len() {
        let is_seen = |face: &[usize; 3]| normal(face, &points).is_some_and(|normal| normal.dot(&(points[n] - points[face[0]])) > OUTSIDE);
        let (seen, kept): (Vec<[usize; 3]>, Vec<[usize; 3]>) = faces.iter().partition(|face| is_seen(face));
        if seen.is_empty() {
            continue;
        }
        // The horizon: edges of faces that are seen whose twin is not.
        let edges = |face: &[usize; 3]| [(face[0], face[1]), (face[1], face[2]), (face[2], face[0])];
        let of_seen: std::collections::BTreeSet<(usize, usize)> = seen.iter().flat_map(edges).collect();
        faces = kept;
        faces.extend(of_seen.iter().filter(|(a, b)| !of_seen.contains(&(*b, *a))).map(|(a, b)| [*a, *b, n]));
    }
    faces.retain(|face| normal(face, &points).is_some());
    let normals = faces.iter().filter_map(|face| normal(face, &points)).collect();
    let mut across = HashMap::new();
    for (n, [a, b, c]) in faces.iter().enumerate() {
        for (from, to) in [(*a, *b), (*b, *c), (*c, *a)] {
            across.insert((to, from), n);
        }
    }
    Some(Hull { points, faces, normals, across })
}

/// Points that are outermost in some direction, each once.
fn outermost(points: &[Point3<f64>]) -> Vec<Point3<f64>> {
    let mut found = std::collections::BTreeSet::new();
    for n in 0..DIRECTIONS {
        let z = 1.0 - 2.0 * (n as f64 + 0.5) / DIRECTIONS as f64;
        let (sin, cos) = (std::f64::consts::PI * (1.0 + 5.0_f64.sqrt()) * (n as f64 + 0.5)).sin_cos();
        let radius = (1.0 - z * z).sqrt();
        let direction = Vector3::new(radius * cos, radius * sin, z);
        let best = (0..points.len()).max_by(|a, b| direction.dot(&points[*a].coords).total_cmp(&direction.dot(&points[*b].coords)));
        found.extend(best);
    }
    found.into_iter().map(|n| points[n]).collect()
}

/// Four points that do not lie in one plane.
fn tetrahedron(points: &[Point3<f64>]) -> Option<[usize; 4]> {
    let most = |value: &dyn Fn(&Point3<f64>) -> f64| (0..points.len()).max_by(|a, b| value(&points[*a]).total_cmp(&value(&points[*b])));
    let a = most(&|p| p.x)?;
    let b = most(&|p| (p - points[a]).norm())?;
    let c = most(&|p| (p - points[a]).cross(&(points[b] - points[a])).norm())?;
    let across = (points[b] - points[a]).cross(&(points[c] - points[a]));
    let d = most(&|p| (p - points[a]).dot(&across).abs())?;
    let volume = (points[d] - points[a]).dot(&across).abs();
    (volume > 1e-6).then_some([a, b, c, d])
}

fn normal([a, b, c]: &[usize; 3], points: &[Point3<f64>]) -> Option<Unit<Vector3<f64>>> {
    Unit::try_new((points[*b] - points[*a]).cross(&(points[*c] - points[*a])), 1e-9)
}

fn outwards(face: [usize; 3], points: &[Point3<f64>], inside: &Point3<f64>) -> [usize; 3] {
    let [a, b, c] = face;
    let across = (points[b] - points[a]).cross(&(points[c] - points[a]));
    if across.dot(&(points[a] - inside)) < 0.0 { [a, c, b] } else { face }
}

impl Hull {
    /// The corners of a face.
    pub fn corners(&self, face: usize) -> [Point3<f64>; 3] {
        self.faces[face].map(|n| self.points[n])
    }

    /// To which face a body with that centre of mass topples from a face that it lies on; `None` if it stays.
    pub fn topples(&self, face: usize, centre: &Point3<f64>) -> Option<usize> {
        let [a, b, c] = self.faces[face];
        let normal = self.normals[face];
        // How far the centre of mass is beyond each edge; from faces in one plane it moves on to the one that it is above.
        let beyond = |(from, to): (usize, usize)| {
            let edge = self.points[to] - self.points[from];
            (centre - self.points[from]).dot(&edge.cross(&normal).normalize())
        };
        let (edge, distance) = [(a, b), (b, c), (c, a)].map(|edge| (edge, beyond(edge))).into_iter().max_by(|x, y| x.1.total_cmp(&y.1))?;
        if distance <= 1e-9 { None } else { self.across.get(&edge).copied() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_points_lie_within_and_the_surface_is_closed() {
        // A ball of lattice points.
        let range = || -6..=6_i32;
        let points: Vec<Point3<f64>> = range()
            .flat_map(|x| range().flat_map(move |y| range().map(move |z| (x, y, z))))
            .filter(|(x, y, z)| x * x + y * y + z * z <= 36)
            .map(|(x, y, z)| Point3::new(f64::from(x), f64::from(y), f64::from(z)))
            .collect();
        let hull = convex_hull(&points).unwrap();
        // Euler: a closed triangulated surface of n corners has 2 n − 4 faces.
        let corners: std::collections::BTreeSet<usize> = hull.faces.iter().flatten().copied().collect();
        assert_eq!(hull.faces.len(), 2 * corners.len() - 4);
        for (n, normal) in hull.normals.iter().enumerate() {
            let base = hull.corners(n)[0];
            assert!(points.iter().all(|p| normal.dot(&(p - base)) < 1e-6));
        }
        assert_eq!(hull.across.len(), 3 * hull.faces.len());
    }

    #[test]
    fn points_in_a_plane_have_no_hull() {
        let points: Vec<Point3<f64>> = (0..100).map(|n| Point3::new(f64::from(n % 10), f64::from(n / 10), 2.0)).collect();
        assert!(convex_hull(&points).is_none());
        assert!(convex_hull(&[]).is_none());
    }
}
