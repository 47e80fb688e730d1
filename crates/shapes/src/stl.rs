//! STL, text and binary, by `stl_io`.
//!
//! What is binary is told by the size: many exporters start binary files with `solid` too. Text is brought into the one form
//! that `stl_io` takes: keywords in lower case, one solid, normals (which are not used, and often NaN) zero.

use super::{FormatError, Mesh};
use beo_core::text::printable;
use nalgebra::Point3;
use std::io::Cursor;

const HEADER: usize = 84;
const TRIANGLE: usize = 50;

fn error(problem: impl Into<String>) -> FormatError {
    FormatError::File { format: "STL", problem: printable(&problem.into()) }
}

/// Reads an STL file's bytes; all solids make one mesh.
pub fn parse_stl(bytes: &[u8]) -> Result<Mesh, FormatError> {
    let declared = bytes.get(80..HEADER).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]) as usize);
    let expected = declared.map(|n| HEADER + n * TRIANGLE);
    let starts_as_text = bytes.trim_ascii_start().get(..5).is_some_and(|word| word.eq_ignore_ascii_case(b"solid"));
    let mesh = if starts_as_text && expected != Some(bytes.len()) {
        stl_io::read_stl(&mut Cursor::new(plain_text(bytes)?))
    } else {
        let expected = expected.ok_or_else(|| error("neither `solid` at the start nor the 84 bytes of a binary header"))?;
        if bytes.len() < expected {
            let triangles = declared.unwrap_or_default();
            return Err(error(format!("{triangles} triangles need {expected} bytes, the file has {}", bytes.len())));
        }
        // The header's text is blanked, so that stl_io does not take the file for text.
        let mut binary = bytes[..expected].to_vec();
        binary[..80].fill(0);
        stl_io::read_stl(&mut Cursor::new(binary))
    };
    let mesh = mesh.map_err(|e| error(e.to_string()))?;
    let vertices = mesh.vertices.iter().map(|v| Point3::new(v[0], v[1], v[2]).cast::<f64>()).collect();
    if mesh.vertices.len() > u32::MAX as usize {
        return Err(error("more than 2³² vertices"));
    }
    Ok(Mesh::new(vertices, mesh.faces.iter().map(|f| f.vertices.map(|v| v as u32)).collect())?)
}

fn plain_text(bytes: &[u8]) -> Result<String, FormatError> {
    let mut out = String::from("solid mesh\n");
    let mut is_complete = false;
    for line in bytes.split(|b| *b == b'\n') {
        let line = String::from_utf8_lossy(line).to_ascii_lowercase();
        match line.split_whitespace().next() {
            None | Some("solid") => {}
            Some("endsolid") => is_complete = true,
            Some("facet") => out.push_str("facet normal 0 0 0\n"),
            Some(_) => {
                out.push_str(line.trim());
                out.push('\n');
            }
        }
    }
    if !is_complete {
        return Err(error("the file ends before `endsolid`"));
    }
    out.push_str("endsolid mesh\n");
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const TEXT: &str = "SOLID\n facet normal nan nan nan\n  outer loop\n   vertex 0 0 0\n   vertex 1e0 0 0\n   vertex 0 2.0 3\n  endloop\n \
        endfacet\nendsolid\nsolid second part\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 0 2 3\nvertex 4 5 6\nendloop\nendfacet\nendsolid second\n";

    fn binary(header: &[u8], count: u32, triangles: &[[f32; 9]]) -> Vec<u8> {
        let mut bytes = header.to_vec();
        bytes.resize(80, b' ');
        bytes.extend(count.to_le_bytes());
        for t in triangles {
            bytes.extend([0.0_f32; 3].iter().chain(t).flat_map(|c| c.to_le_bytes()));
            bytes.extend([0, 0]);
        }
        bytes
    }

    #[test]
    fn text_and_binary_give_the_same_mesh() {
        let text = parse_stl(TEXT.as_bytes()).unwrap();
        let corners: Vec<_> = text.triangles().iter().map(|t| text.corners(*t).map(|p| [p.x, p.y, p.z])).collect();
        assert_eq!(corners, [[[0.0; 3], [1.0, 0.0, 0.0], [0.0, 2.0, 3.0]], [[0.0; 3], [0.0, 2.0, 3.0], [4.0, 5.0, 6.0]]]);
        let triangles = [[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 2.0, 3.0], [0.0, 0.0, 0.0, 0.0, 2.0, 3.0, 4.0, 5.0, 6.0]];
        for header in [&b"made by hand"[..], b"solid that is binary"] {
            assert_eq!(parse_stl(&binary(header, 2, &triangles)).as_ref(), Ok(&text));
        }
    }

    #[test]
    fn malformed_files_are_refused() {
        let message = |bytes: &[u8]| parse_stl(bytes).unwrap_err().to_string();
        assert!(message(b"").contains("84 bytes"));
        assert!(message(&binary(b"", u32::MAX, &[[1.0; 9]])).contains("4294967295 triangles need 214748364834 bytes"));
        assert!(message(&binary(b"", 1, &[[f32::NAN; 9]])).contains("not a number"));
        assert!(message(&binary(b"", 0, &[])).contains("no triangle"));
        assert!(message(b"solid\nfacet normal 0 0 0\n").contains("ends before `endsolid`"));
        assert!(message(b"solid\nfacet normal 0 0 0\nouter loop\nvertex 0 0 inf\nendsolid").contains("finite"));
        assert!(message(b"solid\nfacet normal 0 0 0\nouter loop\nvertex 0 0\nendsolid").contains("vertex"));
    }

    proptest! {
        #[test]
        fn damaged_files_do_not_panic(at in 0..TEXT.len(), byte in any::<u8>()) {
            let mut bytes = TEXT.as_bytes().to_vec();
            bytes[at] = byte;
            let _ = parse_stl(&bytes);
            let _ = parse_stl(&bytes[..at]);
            let mut bytes = binary(b"", 2, &[[1.0; 9]]);
            let at = at % bytes.len();
            bytes[at] = byte;
            let _ = parse_stl(&bytes);
        }
    }
}
