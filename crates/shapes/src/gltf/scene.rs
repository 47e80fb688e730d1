//! The nodes of a glTF scene: each mesh where the transforms of its node and of the nodes above put it.

use super::accessor::Reader;
use super::document::{Document, Node, Primitive};
use nalgebra::{Matrix4, Point3, Quaternion, UnitQuaternion, Vector3};
use std::borrow::Cow;

/// Triangles, strips and fans; points.
const POINTS: u8 = 0;
const TRIANGLES: u8 = 4;
const STRIP: u8 = 5;
const FAN: u8 = 6;

/// A mesh is placed as often as nodes name it. So many vertices and triangles are taken in all for each byte of the file, and so many more:
/// beyond, a small file could fill the memory.
const MOST_PER_BYTE: usize = 1;
const MOST_MORE: usize = 1 << 15;

/// Geometry of a scene.
#[derive(Debug, Default)]
pub(super) struct Geometry {
    pub vertices: Vec<Point3<f64>>,
    pub triangles: Vec<[u32; 3]>,
}

/// Collects the triangles of the default scene, or of all nodes where there is none; the points where it has no triangles.
pub(super) fn geometry(document: &Document, buffers: &[Cow<[u8]>], bytes: usize) -> Result<Geometry, String> {
    let most = MOST_PER_BYTE * bytes + MOST_MORE;
    let mut walk = Walk {
        reader: Reader { document, buffers, most: bytes },
        most,
        found: Geometry::default(),
        seen: vec![false; document.nodes.len()],
    };
    let placed = walk.placed()?;
    walk.place(&placed, |mode| matches!(mode, TRIANGLES | STRIP | FAN))?;
    if walk.found.triangles.is_empty() {
        walk.found.vertices.clear();
        walk.place(&placed, |mode| mode == POINTS)?;
    }
    Ok(walk.found)
}

struct Walk<'a> {
    reader: Reader<'a>,
    most: usize,
    found: Geometry,
    seen: Vec<bool>,
}

/// A node's own transform.
fn local(node: &Node) -> Matrix4<f64> {
    if let Some(matrix) = &node.matrix {
        return Matrix4::from_column_slice(&matrix[..]);
    }
    let translation = node.translation.as_deref().map_or(Vector3::zeros(), |t| Vector3::from(*t));
    let rotation = node.rotation.as_deref().map_or(Quaternion::identity(), |[x, y, z, w]| Quaternion::new(*w, *x, *y, *z));
    let scale = node.scale.as_deref().map_or(Vector3::repeat(1.0), |s| Vector3::from(*s));
    let rotation = UnitQuaternion::try_new(rotation, 1e-12).unwrap_or_default();
    Matrix4::new_translation(&translation) * rotation.to_homogeneous() * Matrix4::new_nonuniform_scaling(&scale)
}

impl Walk<'_> {
    /// The meshes of the scene, with where each lies.
    fn placed(&mut self) -> Result<Vec<(u32, Matrix4<f64>)>, String> {
        let document = self.reader.document;
        let scene = document.scene.unwrap_or(0) as usize;
        let roots: Vec<u32> = match document.scenes.get(scene) {
            Some(scene) => scene.nodes.clone(),
            None if document.scene.is_some() => return Err(format!("scene {scene} does not exist")),
            // Without scenes every node that is nobody's child.
            None => {
                let mut is_child = vec![false; document.nodes.len()];
                for child in document.nodes.iter().flat_map(|node| &node.children) {
                    if let Some(entry) = is_child.get_mut(*child as usize) {
                        *entry = true;
                    }
                }
                (0..document.nodes.len() as u32).filter(|n| !is_child[*n as usize]).collect()
            }
        };
        // A library of meshes without nodes: each as it is.
        if document.nodes.is_empty() {
            return Ok((0..document.meshes.len() as u32).map(|mesh| (mesh, Matrix4::identity())).collect());
        }
        let mut placed = Vec::new();
        let mut open: Vec<(u32, Matrix4<f64>)> = roots.into_iter().rev().map(|root| (root, Matrix4::identity())).collect();
        while let Some((index, above)) = open.pop() {
            let node = document.nodes.get(index as usize).ok_or_else(|| format!("node {index} does not exist"))?;
            if std::mem::replace(&mut self.seen[index as usize], true) {
                return Err(format!("node {index} has two parents or is its own: expected a tree"));
            }
            let transform = above * local(node);
            placed.extend(node.mesh.map(|mesh| (mesh, transform)));
            open.extend(node.children.iter().rev().map(|child| (*child, transform)));
        }
        Ok(placed)
    }

    /// Adds the primitives of the wanted modes.
    fn place(&mut self, placed: &[(u32, Matrix4<f64>)], is_wanted: impl Fn(u8) -> bool) -> Result<(), String> {
        let document = self.reader.document;
        for (mesh, transform) in placed {
            let found = document.meshes.get(*mesh as usize).ok_or_else(|| format!("mesh {mesh} does not exist"))?;
            for (n, primitive) in found.primitives.iter().enumerate() {
                let mode = primitive.mode.unwrap_or(TRIANGLES);
                if is_wanted(mode) {
                    self.add(primitive, mode, transform).map_err(|problem| format!("mesh {mesh}, primitive {n}: {problem}"))?;
                }
            }
        }
        Ok(())
    }

    fn add(&mut self, primitive: &Primitive, mode: u8, transform: &Matrix4<f64>) -> Result<(), String> {
        let Some(position) = primitive.attributes.position else { return Ok(()) };
        let count = self.reader.count(position)?;
        let first = self.found.vertices.len();
        let too_many =
            |what: &str, most: usize| format!("more than {most} {what} in all, its nodes placing the same meshes often: simplify the mesh");
        if first + count > self.most {
            return Err(too_many("vertices", self.most));
        }
        self.found.vertices.reserve(count);
        let (vertices, mut outside) = (&mut self.found.vertices, false);
        self.reader.positions(position, |p| {
            let place = transform.transform_point(&Point3::from(p));
            outside |= !place.iter().all(|c| c.is_finite());
            vertices.push(place);
        })?;
        if outside {
            return Err("its node's transform is not a number or puts it infinitely far".into());
        }
        if mode == POINTS {
            return Ok(());
        }
        let indices = match primitive.indices {
            Some(indices) => self.reader.indices(indices, count)?,
            None => (0..count as u32).collect(),
        };
        let corners: Box<dyn Iterator<Item = [u32; 3]>> = match mode {
            TRIANGLES if indices.len() % 3 != 0 => return Err(format!("{} indices: expected three for each triangle", indices.len())),
            TRIANGLES => Box::new(indices.chunks_exact(3).map(|t| [t[0], t[1], t[2]])),
            STRIP => {
                Box::new(indices.windows(3).enumerate().map(|(n, t)| if n % 2 == 0 { [t[0], t[1], t[2]] } else { [t[1], t[0], t[2]] }))
            }
            _ => Box::new(indices.windows(2).skip(1).map(|pair| [indices[0], pair[0], pair[1]])),
        };
        for [a, b, c] in corners {
            if a == b || b == c || c == a {
                continue;
            }
            if self.found.triangles.len() >= 2 * self.most {
                return Err(too_many("triangles", 2 * self.most));
            }
            self.found.triangles.push([a, b, c].map(|v| v + first as u32));
        }
        Ok(())
    }
}
