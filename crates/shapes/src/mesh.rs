//! Triangle meshes, checked when they are made.

use nalgebra::Point3;

/// A triangle mesh in the units of its file. Every triangle's vertices exist, every coordinate is finite, and the triangles
/// span some space.
#[derive(Debug, Clone, PartialEq)]
pub struct Mesh {
    vertices: Vec<Point3<f64>>,
    triangles: Vec<[u32; 3]>,
    bounds: [Point3<f64>; 2],
}

/// Which axis of a mesh points up.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Up {
    /// z is up, as in ModelNet, ROS and the grids. Use this when in doubt.
    #[default]
    Z,
    /// y is up, as in most OBJ files and in ShapeNet: the mesh is turned by 90° about x, so that y becomes z and z becomes −y.
    Y,
}

/// A mesh that cannot be used.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum MeshError {
    /// Nothing to voxelise.
    #[error("the mesh has no triangle: is it the right file, and was a surface exported?")]
    NoTriangle,
    /// Points without triangles.
    #[error("a point cloud of {0} points without triangles, where a mesh is needed: make a mesh of it")]
    PointCloud(usize),
    /// More vertices than an index can name.
    #[error("the mesh has {0} vertices, more than 2³² − 1")]
    TooManyVertices(usize),
    /// A triangle names a vertex that does not exist.
    #[error("triangle {triangle} names vertex {vertex}, but the mesh has {vertices} vertices (both counted from 0)")]
    Index {
        /// The first such triangle.
        triangle: usize,
        /// The vertex it names.
        vertex: u32,
        /// Number of vertices.
        vertices: usize,
    },
    /// A coordinate is not a number, infinite, or beyond ±1e100.
    #[error("vertex {vertex} (counted from 0) has a coordinate that is not a number or is beyond ±1e100: export the mesh again")]
    Coordinate {
        /// The first such vertex.
        vertex: usize,
    },
    /// All triangles lie in one point.
    #[error("all triangles of the mesh lie in one point: it has no size")]
    NoExtent,
}

/// Largest coordinate taken: squares and sums of it stay finite.
const LARGEST: f64 = 1e100;

impl Mesh {
    /// A mesh of `triangles`, three indices into `vertices` each.
    pub fn new(vertices: Vec<Point3<f64>>, triangles: Vec<[u32; 3]>) -> Result<Self, MeshError> {
        if triangles.is_empty() {
            return Err(MeshError::NoTriangle);
        }
        check_vertices(&vertices)?;
        let mut bounds = [Point3::from([f64::INFINITY; 3]), Point3::from([f64::NEG_INFINITY; 3])];
        for (triangle, corners) in triangles.iter().enumerate() {
            for &vertex in corners {
                let Some(p) = vertices.get(vertex as usize) else {
                    return Err(MeshError::Index { triangle, vertex, vertices: vertices.len() });
                };
                bounds = [bounds[0].inf(p), bounds[1].sup(p)];
            }
        }
        if (bounds[1] - bounds[0]).max() <= 0.0 {
            return Err(MeshError::NoExtent);
        }
        Ok(Self { vertices, triangles, bounds })
    }

    /// The vertices, in the units of the file.
    pub fn vertices(&self) -> &[Point3<f64>] {
        &self.vertices
    }

    /// Three indices into the vertices each.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// Lower and upper corner of the box around all triangles (vertices without a triangle do not count).
    pub fn bounds(&self) -> [Point3<f64>; 2] {
        self.bounds
    }

    /// The corners of one triangle.
    pub fn corners(&self, triangle: [u32; 3]) -> [Point3<f64>; 3] {
        triangle.map(|v| self.vertices[v as usize])
    }

    /// The same triangles with every vertex somewhere else.
    pub fn mapped(&self, map: impl Fn(&Point3<f64>) -> Point3<f64>) -> Result<Self, MeshError> {
        Self::new(self.vertices.iter().map(map).collect(), self.triangles.clone())
    }

    /// The mesh turned so that its `up` axis is z.
    pub fn turned_up(mut self, up: Up) -> Self {
        up.turn(&mut self.vertices, &mut self.bounds);
        self
    }
}

/// Points of a surface without triangles, as scanners give them. There is at least one, every coordinate is finite, and they span some space.
#[derive(Debug, Clone, PartialEq)]
pub struct PointCloud {
    points: Vec<Point3<f64>>,
    bounds: [Point3<f64>; 2],
}

impl PointCloud {
    /// A cloud of `points`.
    pub fn new(points: Vec<Point3<f64>>) -> Result<Self, MeshError> {
        check_vertices(&points)?;
        let start = [Point3::from([f64::INFINITY; 3]), Point3::from([f64::NEG_INFINITY; 3])];
        let bounds = points.iter().fold(start, |[low, high], p| [low.inf(p), high.sup(p)]);
        let spans_space = (bounds[1] - bounds[0]).max() > 0.0;
        if spans_space { Ok(Self { points, bounds }) } else { Err(MeshError::NoExtent) }
    }

    /// The points, in the units of the file.
    pub fn points(&self) -> &[Point3<f64>] {
        &self.points
    }

    /// Lower and upper corner of the box around them.
    pub fn bounds(&self) -> [Point3<f64>; 2] {
        self.bounds
    }

    /// The cloud turned so that its `up` axis is z.
    pub fn turned_up(mut self, up: Up) -> Self {
        up.turn(&mut self.points, &mut self.bounds);
        self
    }
}

impl Up {
    /// Turns points, and the box around them, so that this axis becomes z.
    fn turn(self, points: &mut [Point3<f64>], bounds: &mut [Point3<f64>; 2]) {
        if self == Self::Y {
            let turn = |p: Point3<f64>| Point3::new(p.x, -p.z, p.y);
            points.iter_mut().for_each(|p| *p = turn(*p));
            let [a, b] = bounds.map(turn);
            *bounds = [a.inf(&b), a.sup(&b)];
        }
    }
}

/// Fails if there are more vertices than an index can name, or one that is not a place.
pub(super) fn check_vertices(vertices: &[Point3<f64>]) -> Result<(), MeshError> {
    if vertices.len() > u32::MAX as usize {
        return Err(MeshError::TooManyVertices(vertices.len()));
    }
    let is_place = |p: &Point3<f64>| p.iter().all(|c| c.abs() <= LARGEST);
    match vertices.iter().position(|p| !is_place(p)) {
        Some(vertex) => Err(MeshError::Coordinate { vertex }),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tetrahedron() -> (Vec<Point3<f64>>, Vec<[u32; 3]>) {
        let vertices = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 3.0]].map(Point3::from).to_vec();
        (vertices, vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    }

    #[test]
    fn unusable_meshes_are_refused_by_name() {
        let (vertices, triangles) = tetrahedron();
        assert_eq!(Mesh::new(vertices.clone(), vec![]), Err(MeshError::NoTriangle));
        assert_eq!(Mesh::new(vertices.clone(), vec![[0, 1, 4]]), Err(MeshError::Index { triangle: 0, vertex: 4, vertices: 4 }));
        assert_eq!(Mesh::new(vertices.clone(), vec![[2, 2, 2]]), Err(MeshError::NoExtent));
        for wrong in [f64::NAN, f64::INFINITY, -1e101] {
            let mut vertices = vertices.clone();
            vertices[2].y = wrong;
            assert_eq!(Mesh::new(vertices, triangles.clone()), Err(MeshError::Coordinate { vertex: 2 }));
        }
    }

    #[test]
    fn y_up_turns_y_to_z_without_mirroring() {
        let (vertices, triangles) = tetrahedron();
        let volume = |m: &Mesh| -> f64 {
            m.triangles().iter().map(|t| m.corners(*t).map(|p| p.coords)).map(|[a, b, c]| a.dot(&b.cross(&c)) / 6.0).sum()
        };
        let mesh = Mesh::new(vertices, triangles).unwrap();
        let turned = mesh.clone().turned_up(Up::Y);
        assert_eq!(turned.vertices()[2], Point3::new(0.0, 0.0, 2.0));
        assert_eq!(turned.bounds(), [Point3::new(0.0, -3.0, 0.0), Point3::new(1.0, 0.0, 2.0)]);
        assert!((volume(&mesh) - 1.0).abs() < 1e-12 && (volume(&turned) - 1.0).abs() < 1e-12);
    }
}
