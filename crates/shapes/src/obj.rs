//! Wavefront OBJ, by `tobj`. Only vertices and faces are read: no materials, normals or texture coordinates.

use super::{FormatError, Mesh};
use beo_core::text::printable;
use nalgebra::Point3;

fn error(problem: impl Into<String>) -> FormatError {
    FormatError::File { format: "OBJ", problem: printable(&problem.into()) }
}

/// Reads an OBJ file's bytes; all objects and groups make one mesh.
pub fn parse_obj(bytes: &[u8]) -> Result<Mesh, FormatError> {
    let text = geometry(bytes)?;
    // ignore_lines and ignore_points drop faces of fewer than three corners.
    let options = tobj::LoadOptions { triangulate: true, ignore_points: true, ignore_lines: true, ..Default::default() };
    let no_materials = |_: &std::path::Path| Ok(Default::default());
    let (models, _) = tobj::load_obj_buf(&mut text.as_bytes(), &options, no_materials).map_err(|e| error(e.to_string()))?;
    let mut vertices = Vec::new();
    let mut triangles = Vec::new();
    for model in &models {
        let first = vertices.len();
        vertices.extend(model.mesh.positions.chunks_exact(3).map(|p| Point3::new(p[0], p[1], p[2]).cast::<f64>()));
        for t in model.mesh.indices.chunks_exact(3) {
            let vertex = |v: u32| u32::try_from(first + v as usize).map_err(|_| error("more than 2³² vertices"));
            triangles.push([vertex(t[0])?, vertex(t[1])?, vertex(t[2])?]);
        }
    }
    Ok(Mesh::new(vertices, triangles)?)
}

/// The lines that matter, as `tobj` reads them: `v` with three numbers and `f`, continued lines joined.
fn geometry(bytes: &[u8]) -> Result<String, FormatError> {
    let mut out = String::with_capacity(bytes.len() / 2);
    let mut joined = String::new();
    for (number, line) in bytes.split(|b| *b == b'\n').enumerate() {
        let line = String::from_utf8_lossy(line);
        let line = line.split('#').next().unwrap_or_default().trim();
        if let Some(part) = line.strip_suffix('\\') {
            joined.push_str(part);
            joined.push(' ');
            continue;
        }
        joined.push_str(line);
        let mut words = joined.split_whitespace();
        match words.next() {
            Some("v") => {
                out.push('v');
                for _ in 0..3 {
                    let number_ok = |w: &&str| w.parse::<f32>().is_ok_and(f32::is_finite);
                    let word = words.next().filter(number_ok).ok_or_else(|| FormatError::Line {
                        format: "OBJ",
                        line: number + 1,
                        problem: "expected `v` and three finite numbers".into(),
                    })?;
                    out.push(' ');
                    out.push_str(word);
                }
                out.push('\n');
            }
            Some("f") => {
                out.push('f');
                words.for_each(|corner| {
                    out.push(' ');
                    out.push_str(corner.split('/').next().unwrap_or_default());
                });
                out.push('\n');
            }
            _ => {}
        }
        joined.clear();
    }
    Ok(out)
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
    }

    #[test]
    fn malformed_files_are_refused() {
        let message = |text: &str| parse_obj(text.as_bytes()).unwrap_err().to_string();
        assert_eq!(message("\nv 0 0 nan\n"), "OBJ, line 2: expected `v` and three finite numbers");
        assert!(message("v 0 0 0\nf 1 2 3\n").contains("out of bounds"));
        assert!(message("v 0 0 0\nf 0 0 0\n").contains("out of bounds"));
        assert!(message("v 0 0 0\nf -9 1 1\n").contains("out of bounds"));
        assert!(message("v 0 0 0\nf -9223372036854775808 1 1\n").contains("out of bounds"));
        assert!(message("v 0 0 0\nf a b c\n").contains("face parse error"));
        assert!(message("").contains("no triangle"));
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
