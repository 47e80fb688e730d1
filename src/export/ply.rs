//! Surfaces and points as PLY, binary little-endian, by `ply-rs-bw`. Positions are single precision, as viewers expect: of a place a
//! kilometre from the frame's origin a tenth of a millimetre is left.

use super::{Point, Surface, Vertex};
use beo_core::whole_file::write_whole;
use ply_rs_bw::ply::{Addable, ElementDef, Encoding, Header, PropertyAccess, PropertyDef, PropertyType, ScalarType};
use ply_rs_bw::writer::Writer;
use std::path::{Path, PathBuf};

/// A PLY file could not be written.
#[derive(Debug, thiserror::Error)]
#[error("cannot write {}: {source}", path.display())]
pub struct PlyError {
    /// The file.
    path: PathBuf,
    /// What the operating system said.
    source: std::io::Error,
}

/// The elements of the files.
enum Element<'a> {
    Vertex(&'a Vertex),
    Point(&'a Point),
    Face(&'a [u32; 3]),
}

impl PropertyAccess for Element<'_> {
    /// Only for reading, which is done elsewhere.
    fn new() -> Self {
        Self::Face(&[0; 3])
    }

    fn get_float(&self, name: &str) -> Option<f32> {
        let (position, vertex) = match self {
            Self::Vertex(vertex) => (vertex.position_m, Some(vertex)),
            Self::Point(point) => (point.position_m, None),
            Self::Face(_) => return None,
        };
        match name {
            "x" => Some(position[0] as f32),
            "y" => Some(position[1] as f32),
            "z" => Some(position[2] as f32),
            "nx" => vertex.map(|v| v.normal[0]),
            "ny" => vertex.map(|v| v.normal[1]),
            "nz" => vertex.map(|v| v.normal[2]),
            "quality" => vertex.map(|v| v.deviation),
            _ => None,
        }
    }

    fn get_uchar(&self, name: &str) -> Option<u8> {
        let rgb = match self {
            Self::Vertex(vertex) => vertex.rgb,
            Self::Point(point) => point.rgb,
            Self::Face(_) => return None,
        };
        ["red", "green", "blue"].iter().position(|channel| *channel == name).map(|channel| rgb[channel])
    }

    fn get_list_uint(&self, name: &str) -> Option<&[u32]> {
        match self {
            Self::Face(corners) if name == "vertex_indices" => Some(corners.as_slice()),
            _ => None,
        }
    }
}

/// An element of `count` entries with single-precision properties and a colour.
fn coloured(count: usize, floats: &[&str]) -> ElementDef {
    let mut vertex = ElementDef::new("vertex".into());
    vertex.count = count;
    let mut add = |name: &str, kind| vertex.properties.add(PropertyDef::new(name.into(), PropertyType::Scalar(kind)));
    floats.iter().for_each(|name| add(name, ScalarType::Float));
    ["red", "green", "blue"].iter().for_each(|name| add(name, ScalarType::UChar));
    vertex
}

fn encode<'a>(comment: &str, elements: Vec<(ElementDef, Vec<Element<'a>>)>) -> Vec<u8> {
    let mut header = Header::new();
    header.encoding = Encoding::BinaryLittleEndian;
    header.comments.push(comment.into());
    elements.iter().for_each(|(definition, _)| header.elements.add(definition.clone()));
    let (writer, mut bytes) = (Writer::<Element<'a>>::new(), Vec::new());
    let written = writer.write_header(&mut bytes, &header).and_then(|_| {
        elements
            .iter()
            .try_for_each(|(definition, entries)| writer.write_payload_of_element(&mut bytes, entries, definition, &header).map(|_| ()))
    });
    written.expect("memory takes every byte, and every declared property is there");
    bytes
}

/// A surface as PLY: elements `vertex` with x, y, z in metres, nx, ny, nz, quality (the standard deviation of the occupancy) and colour,
/// and `face` with triangles.
pub fn ply_of_surface(surface: &Surface, comment: &str) -> Vec<u8> {
    let vertices = coloured(surface.vertices.len(), &["x", "y", "z", "nx", "ny", "nz", "quality"]);
    let mut faces = ElementDef::new("face".into());
    faces.count = surface.triangles.len();
    faces.properties.add(PropertyDef::new("vertex_indices".into(), PropertyType::List(ScalarType::UChar, ScalarType::UInt)));
    let elements = vec![
        (vertices, surface.vertices.iter().map(Element::Vertex).collect()),
        (faces, surface.triangles.iter().map(Element::Face).collect()),
    ];
    encode(&one_line(comment), elements)
}

/// Points as PLY: element `vertex` with x, y, z in metres and colour.
pub fn ply_of_points(points: &[Point], comment: &str) -> Vec<u8> {
    encode(&one_line(comment), vec![(coloured(points.len(), &["x", "y", "z"]), points.iter().map(Element::Point).collect())])
}

/// The header is ASCII, and a comment ends with its line.
fn one_line(comment: &str) -> String {
    comment.chars().map(|c| if c.is_ascii() && !c.is_ascii_control() { c } else { '?' }).collect()
}

/// Writes a file's bytes; it appears under its name only when it is whole.
///
/// # Errors
/// [`PlyError`] names the file.
pub fn save(path: &Path, bytes: &[u8]) -> Result<(), PlyError> {
    write_whole(path, bytes).map_err(|source| PlyError { path: path.into(), source })
}

#[cfg(test)]
mod tests {
    use super::super::{GridPlacement, surface_of};
    use super::*;
    use beo_core::grid::{Dims, yaw};
    use beo_shapes::parse_ply;

    #[test]
    fn a_surface_reads_back_as_the_same_mesh() {
        let dims = Dims::cube(10).unwrap();
        let filled = |v: usize| dims.coordinates(v).iter().all(|side| (2..8).contains(side));
        let occupancy: Vec<f32> = (0..dims.voxels()).map(|v| if filled(v) { 0.9 } else { 0.1 }).collect();
        let placement = GridPlacement { position_m: [3.0, -2.0, 0.5], orientation: yaw(0.4), voxel_size_m: 0.01 };
        let surface = surface_of(dims, &occupancy, &vec![0.2; dims.voxels()], &placement);
        let mesh = parse_ply(&ply_of_surface(&surface, "a block\nof ½")).unwrap();
        assert_eq!(mesh.triangles(), surface.triangles);
        assert_eq!(mesh.vertices().len(), surface.vertices.len());
        for (read, vertex) in mesh.vertices().iter().zip(&surface.vertices) {
            assert_eq!(<[f64; 3]>::from(*read), vertex.position_m.map(|side| f64::from(side as f32)));
        }
    }

    #[test]
    fn files_are_laid_out_as_their_headers_say() {
        let point = Point { position_m: [1.0, -2.0, 0.5], rgb: [1, 2, 3] };
        let bytes = ply_of_points(&[point, point], "two");
        let header = "ply\nformat binary_little_endian 1.0\ncomment two\nelement vertex 2\nproperty float x\nproperty float y\n\
            property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n";
        let (found, payload) = bytes.split_at(header.len());
        assert_eq!(std::str::from_utf8(found).unwrap(), header);
        let mut expected = [1.0_f32, -2.0, 0.5].iter().flat_map(|side| side.to_le_bytes()).collect::<Vec<u8>>();
        expected.extend([1, 2, 3]);
        assert_eq!(payload, [expected.clone(), expected].concat());
        let vertex = Vertex { position_m: [0.0; 3], normal: [0.0, 0.0, 1.0], deviation: 0.25, rgb: [9; 3] };
        let surface = Surface { vertices: vec![vertex; 3], triangles: vec![[0, 1, 2]] };
        let bytes = ply_of_surface(&surface, "");
        let text = String::from_utf8_lossy(&bytes);
        assert!(text.contains("property float quality\nproperty uchar red"), "{text}");
        assert!(text.contains("element face 1\nproperty list uchar uint vertex_indices\nend_header\n"), "{text}");
        assert!(bytes.ends_with(&[&[3_u8][..], &0_u32.to_le_bytes(), &1_u32.to_le_bytes(), &2_u32.to_le_bytes()].concat()));
        assert_eq!(&bytes[bytes.len() - 13 - 31..][24..28], &0.25_f32.to_le_bytes());
    }

    #[test]
    fn a_file_that_cannot_be_written_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let error = save(&folder.path().join("none/a.ply"), &[]).unwrap_err().to_string();
        assert!(error.starts_with("cannot write") && error.contains("a.ply"), "{error}");
    }
}
