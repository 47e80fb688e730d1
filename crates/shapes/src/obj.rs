//! Wavefront OBJ. Only vertices and faces are read: no materials, normals, texture coordinates or lines. All objects and groups make one
//! mesh; a file of vertices without faces is a point cloud.

use super::content::Content;
use super::lines::{Lines, found, found_index, number, whole, words};
use super::polygon::{Place, Surface};
use super::{FormatError, Mesh, MeshError};
use nalgebra::Point3;

const FORMAT: &str = "OBJ";

fn error(line: usize, problem: impl Into<String>) -> FormatError {
    FormatError::Line { format: FORMAT, line, problem: problem.into() }
}

/// Reads an OBJ file's bytes as a mesh.
///
/// # Errors
/// [`FormatError`]: a wrong line, with its number; a mesh that cannot be used; no face.
pub fn parse_obj(bytes: &[u8]) -> Result<Mesh, FormatError> {
    read_obj(bytes)?.into_mesh()
}

/// Reads an OBJ file's bytes.
pub(super) fn read_obj(bytes: &[u8]) -> Result<Content, FormatError> {
    // Twice, since faces may name vertices that come after them.
    let mut vertices = Vec::new();
    each_statement(bytes, |line, text| {
        let mut words = words(text);
        if words.next() == Some(b"v") {
            let mut coordinate = || {
                let word = words.next();
                word.and_then(number).ok_or_else(|| error(line, format!("expected `v` and three finite numbers, {}", found(word))))
            };
            vertices.push(Point3::new(coordinate()?, coordinate()?, coordinate()?));
        }
        Ok(())
    })?;
    let mut surface = Surface::new(FORMAT, vertices)?;
    let (mut so_far, mut polygon) = (0, Vec::new());
    each_statement(bytes, |line, text| {
        let mut words = words(text);
        match words.next() {
            Some(b"v") => so_far += 1,
            Some(b"f" | b"fo") => {
                polygon.clear();
                for corner in words {
                    polygon.push(vertex(corner, so_far, surface.vertices()).map_err(|problem| error(line, problem))?);
                }
                if polygon.is_empty() {
                    return Err(error(line, "expected `f` and the indices of at least three vertices, found nothing more"));
                }
                surface.polygon(&polygon, Place::Line(line));
            }
            _ => {}
        }
        Ok(())
    })?;
    if surface.vertices() == 0 {
        return Err(MeshError::NoTriangle.into());
    }
    surface.finish()
}

/// The vertex, counted from 0, that a corner `v`, `v/vt`, `v//vn` or `v/vt/vn` names; below zero from the last vertex so far.
fn vertex(corner: &[u8], so_far: usize, vertices: usize) -> Result<u32, String> {
    let word = corner.split(|b| *b == b'/').next().unwrap_or_default();
    let outside = || {
        let word = String::from_utf8_lossy(word);
        format!(
            "a face names vertex {word}: out of bounds, expected 1 to {vertices}, or -1 to -{so_far} counted back from the last vertex so far"
        )
    };
    match whole::<i64>(word) {
        None => Err(format!("expected the index of a vertex, {}", found_index(Some(word)))),
        Some(index) if index > 0 && index as usize <= vertices => Ok((index - 1) as u32),
        Some(index) if index < 0 && index.unsigned_abs() as usize <= so_far => Ok((so_far - index.unsigned_abs() as usize) as u32),
        Some(_) => Err(outside()),
    }
}

/// Calls `take` with each line, comments cut off and continued lines joined, and the number of its last part.
fn each_statement(bytes: &[u8], mut take: impl FnMut(usize, &[u8]) -> Result<(), FormatError>) -> Result<(), FormatError> {
    let mut joined: Vec<u8> = Vec::new();
    let mut last = 1;
    for (number, line) in Lines::of(bytes, FORMAT)? {
        last = number;
        let line = line.split(|b| *b == b'#').next().unwrap_or_default().trim_ascii();
        if let Some(part) = line.strip_suffix(b"\\") {
            joined.extend(part);
            joined.push(b' ');
        } else if joined.is_empty() {
            take(number, line)?;
        } else {
            joined.extend(line);
            take(number, &joined)?;
            joined.clear();
        }
    }
    if joined.is_empty() { Ok(()) } else { take(last, &joined) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const TEXT: &str = "# made by hand\nmtllib none.mtl\no body\nv 0 0 0\nv 1 0 0 0.2 0.3 0.4\nv 1 2 0\nv 0 2 0\nvn 0 0 1\nvt 0.5\n\
        usemtl\ng base\nf 1//1 2//1 3//1 4//1\ng tip\nv 0 0 3\nf -5/1 -4/1 \\\n -1/1\nl 1 2\nf 1 2\n";

    #[test]
    fn polygons_groups_and_relative_indices_make_one_mesh() {
        let mesh = parse_obj(TEXT.as_bytes()).unwrap();
        let corners: Vec<_> = mesh.triangles().iter().map(|t| mesh.corners(*t).map(|p| [p.x, p.y, p.z])).collect();
        let (o, a, b, c, tip) = ([0.0; 3], [1.0, 0.0, 0.0], [1.0, 2.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 3.0]);
        assert_eq!(corners, [[o, a, b], [o, b, c], [o, a, tip]]);
        for text in [TEXT.replace('\n', "\r"), TEXT.replace('\n', "\r\n"), format!("\u{feff}{TEXT}")] {
            assert_eq!(parse_obj(text.as_bytes()).as_ref(), Ok(&mesh));
        }
    }

    #[test]
    fn faces_may_come_before_their_vertices() {
        let mesh = parse_obj(b"f 1 2 3\nv 0 0 0\nv 1 0 0\nv 0 1 0\n").unwrap();
        assert_eq!(mesh.triangles(), [[0, 1, 2]]);
    }

    #[test]
    fn coordinates_are_read_in_double_precision() {
        let mesh = parse_obj(b"v 4583200.123456 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
        assert_eq!(mesh.vertices()[0].x, 4583200.123456);
    }

    #[test]
    fn malformed_files_are_refused() {
        let message = |text: &str| parse_obj(text.as_bytes()).unwrap_err().to_string();
        assert_eq!(message("\nv 0 0 nan\n"), "OBJ, line 2: expected `v` and three finite numbers, found `nan` (not a finite number)");
        assert!(message("v 0 0\n").contains("found nothing more"));
        assert!(message("v 0 0 0\n\nf 1 2 3\n").starts_with("OBJ, line 3: a face names vertex 2: out of bounds, expected 1 to 1"));
        assert!(message("v 0 0 0\nf 0 0 0\n").contains("out of bounds"));
        assert!(message("v 0 0 0\nf -9 1 1\n").contains("out of bounds"));
        assert!(message("v 0 0 0\nf -9223372036854775808 1 1\n").contains("out of bounds"));
        assert!(message("v 0 0 0\nf a b c\n").contains("expected the index of a vertex, found `a`"));
        assert!(message("v 0 0 0\nf 1.0 1.0 1.0\n").contains("found `1.0`, which is not a whole number"));
        assert!(message("").contains("no triangle"));
        assert!(message("v 0 0 0\nv 0 0 1\n").contains("point cloud"));
    }

    proptest! {
        #[test]
        fn damaged_files_do_not_panic(at in 0..TEXT.len(), byte in any::<u8>()) {
            let mut bytes = TEXT.as_bytes().to_vec();
            bytes[at] = byte;
            let _ = parse_obj(&bytes);
            let _ = parse_obj(&bytes[..at]);
        }
    }
}
