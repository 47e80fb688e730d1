//! Surfaces and points as PLY, binary little-endian. Positions are single precision, as viewers expect: of a place a
//! kilometre from the frame's origin a tenth of a millimetre is left.

use super::{Point, Surface, Vertex};
use beo_core::whole_file::write_whole;
use std::path::{Path, PathBuf};

/// A PLY file could not be written.
#[derive(Debug, thiserror::Error)]
#[error("cannot write {}: {source}", path.display())]
pub struct PlyError {
    /// The file.
    path: PathBuf,
    /// The operating system's words.
    source: std::io::Error,
}

/// The header up to its vertices: these have single-precision properties, and a colour after them.
fn header(comment: &str, vertices: usize, floats: &[&str]) -> String {
    let mut header = format!("ply\nformat binary_little_endian 1.0\ncomment {}\nelement vertex {vertices}\n", one_line(comment));
    floats.iter().for_each(|name| header += &format!("property float {name}\n"));
    ["red", "green", "blue"].iter().for_each(|name| header += &format!("property uchar {name}\n"));
    header
}

fn push_floats(bytes: &mut Vec<u8>, values: impl IntoIterator<Item = f32>) {
    values.into_iter().for_each(|value| bytes.extend(value.to_le_bytes()));
}

/// A surface as PLY: elements `vertex` with x, y, z in metres, nx, ny, nz, quality (the standard deviation of the occupancy) and colour,
/// and `face` with triangles.
pub fn ply_of_surface(surface: &Surface, comment: &str) -> Vec<u8> {
    let Surface { vertices, triangles } = surface;
    let mut header = header(comment, vertices.len(), &["x", "y", "z", "nx", "ny", "nz", "quality"]);
    header += &format!("element face {}\nproperty list uchar uint vertex_indices\nend_header\n", triangles.len());
    let mut bytes = header.into_bytes();
    for Vertex { position_m, normal, deviation, rgb } in vertices {
        push_floats(&mut bytes, position_m.map(|side| side as f32).into_iter().chain(*normal).chain([*deviation]));
        bytes.extend(rgb);
    }
    for corners in triangles {
        bytes.push(corners.len() as u8);
        corners.iter().for_each(|corner| bytes.extend(corner.to_le_bytes()));
    }
    bytes
}

/// Points as PLY: element `vertex` with x, y, z in metres and colour.
pub fn ply_of_points(points: &[Point], comment: &str) -> Vec<u8> {
    let mut bytes = (header(comment, points.len(), &["x", "y", "z"]) + "end_header\n").into_bytes();
    for Point { position_m, rgb } in points {
        push_floats(&mut bytes, position_m.map(|side| side as f32));
        bytes.extend(rgb);
    }
    bytes
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
