//! The OFF format: vertices, then polygons, as text.
//!
//! Comments start with `#`. Some of ModelNet's files lack the line break after `OFF` (`OFF490 518 0`). Numbers after a polygon
//! (colours) are ignored; a file of vertices without polygons is a point cloud. Written are vertices with nine decimals, and triangles.

use super::content::Content;
use super::lines::{Lines, found, found_index, number, whole, words};
use super::polygon::{Place, Surface};
use super::{FormatError, Mesh};
use nalgebra::Point3;
use std::io::Write;

const FORMAT: &str = "OFF";

fn error(line: usize, problem: impl Into<String>) -> FormatError {
    FormatError::Line { format: FORMAT, line, problem: problem.into() }
}

/// Reads an OFF file's bytes as a mesh.
///
/// # Errors
/// [`FormatError`]: a wrong line, with its number; a mesh that cannot be used; no face.
pub fn parse_off(bytes: &[u8]) -> Result<Mesh, FormatError> {
    read_off(bytes)?.into_mesh()
}

/// Reads an OFF file's bytes.
pub(super) fn read_off(bytes: &[u8]) -> Result<Content, FormatError> {
    // A vertex takes at least 6 bytes ("0 0 0\n"), a polygon 2 ("0\n").
    let (least_vertex, least_face) = (6, 2);
    let mut lines = Lines::of(bytes, FORMAT)?
        .map(|(number, text)| (number, text.split(|b| *b == b'#').next().unwrap_or_default().trim_ascii()))
        .filter(|(_, text)| !text.is_empty())
        .map(|(number, text)| match std::str::from_utf8(text) {
            Ok(text) => Ok((number, text)),
            Err(_) => Err(error(number, "not text: binary OFF files are not read, export it as text (ASCII)")),
        });
    let end = |what: &str| FormatError::File { format: FORMAT, problem: format!("the file ends before {what}: it is incomplete") };

    let (mut line, first) = lines.next().ok_or_else(|| end("its first line, `OFF`"))??;
    // COFF, NOFF and STOFF add colours, normals and texture coordinates to the vertices, which are ignored.
    let name = first.find("OFF").filter(|at| first[..*at].chars().all(|c| "CNST".contains(c)));
    let Some(at) = name else {
        return Err(error(line, format!("expected `OFF`, {}", found(words(first.as_bytes()).next()))));
    };
    let mut counts = first[at + 3..].trim();
    if counts.eq_ignore_ascii_case("binary") {
        return Err(error(line, "binary OFF files are not read, export it as text (ASCII)"));
    }
    if counts.is_empty() {
        (line, counts) = lines.next().ok_or_else(|| end("its counts of vertices and faces"))??;
    }
    let numbers: Vec<usize> = counts.split_whitespace().map_while(|w| w.parse().ok()).collect();
    let (&[vertices, faces] | &[vertices, faces, _]) = &numbers[..] else {
        let word = counts.split_whitespace().nth(numbers.len()).map(str::as_bytes);
        return Err(error(line, format!("expected the counts of vertices, faces and edges, {}", found_index(word))));
    };
    let most = bytes.len() + 1;
    if vertices > most / least_vertex || faces > most / least_face {
        return Err(error(
            line,
            format!("{vertices} vertices and {faces} faces do not fit into a file of {} bytes: it is incomplete", bytes.len()),
        ));
    }

    let mut points = Vec::with_capacity(vertices);
    for _ in 0..vertices {
        let (line, text) = lines.next().ok_or_else(|| end("its vertices do"))??;
        let mut words = words(text.as_bytes());
        let mut coordinate = || {
            let word = words.next();
            word.and_then(number).ok_or_else(|| error(line, format!("expected a vertex: three finite numbers, {}", found(word))))
        };
        points.push(Point3::new(coordinate()?, coordinate()?, coordinate()?));
    }

    let mut surface = Surface::new(FORMAT, points)?;
    let mut polygon = Vec::new();
    for _ in 0..faces {
        let (line, text) = lines.next().ok_or_else(|| end("its faces do"))??;
        let mut words = words(text.as_bytes());
        let word = words.next();
        let corners = word.and_then(whole::<usize>);
        let corners = corners.ok_or_else(|| error(line, format!("expected a face: a count, then indices, {}", found_index(word))))?;
        polygon.clear();
        for _ in 0..corners {
            let word = words.next();
            let Some(corner) = word.and_then(whole::<u32>).filter(|v| (*v as usize) < vertices) else {
                let last = vertices.saturating_sub(1);
                return Err(error(line, format!("expected {corners} indices of vertices from 0 to {last}, {}", found_index(word))));
            };
            polygon.push(corner);
        }
        surface.polygon(&polygon, Place::Line(line));
    }
    surface.finish()
}

/// Writes a mesh as an OFF file.
pub fn write_off(out: &mut impl Write, mesh: &Mesh) -> std::io::Result<()> {
    writeln!(out, "OFF\n{} {} 0", mesh.vertices().len(), mesh.triangles().len())?;
    for p in mesh.vertices() {
        writeln!(out, "{:.9} {:.9} {:.9}", p.x, p.y, p.z)?;
    }
    for [a, b, c] in mesh.triangles() {
        writeln!(out, "3 {a} {b} {c}")?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const BODY: &str = "\n0 0 0\n1 0 0 # a comment\n\n1 2 0\n0 2 0\n0 0 3\n4 0 1 2 3 0.9 0.1 0.1\n3 0 1 4\n";

    #[test]
    fn headers_good_and_broken_give_the_same_mesh() {
        let good = parse_off(format!("OFF\n5 2 0{BODY}").as_bytes()).unwrap();
        assert_eq!(good.triangles(), [[0, 1, 2], [0, 2, 3], [0, 1, 4]]);
        assert_eq!(good.vertices()[2], Point3::new(1.0, 2.0, 0.0));
        for header in [
            "OFF5 2 0",
            "OFF 5 2 0",
            "# made by hand\nOFF\n# counts\n5 2",
            "OFF\r\n5 2 0\r",
            "COFF\n5 2 0",
            "\u{feff}OFF\n5 2 0",
            "OFF\r5 2 0",
        ] {
            assert_eq!(parse_off(format!("{header}{BODY}").as_bytes()).as_ref(), Ok(&good), "{header}");
        }
    }

    #[test]
    fn malformed_files_are_refused_with_the_line() {
        let message = |text: &str| parse_off(text.as_bytes()).unwrap_err().to_string();
        assert_eq!(message("ply\n"), "OFF, line 1: expected `OFF`, found `ply`");
        assert!(
            message("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0.0 1.0 2.0\n")
                .contains("line 6: expected 3 indices of vertices from 0 to 2, found `0.0`, which is not a whole")
        );
        assert!(message("OFF BINARY\n").contains("binary OFF files are not read"));
        assert!(message("OFF\n2 0 0\n0 0 0\n1 0 0\n").contains("point cloud"));
        assert!(message("OFF").contains("ends before its counts"));
        assert!(message("OFF\n99999999999 1 0\n").contains("line 2: 99999999999 vertices"));
        assert!(message("OFF\n2 99999999999999999999999 0\n").contains("line 2: expected the counts"));
        assert!(message("OFF\n1 0 0\n0 nan 0\n").contains("line 3: expected a vertex"));
        assert!(message("OFF\n1 1 0\n0 0 0\n3 0 0 1\n").contains("line 4: expected 3 indices of vertices from 0 to 0"));
        assert!(message("OFF\n1 1 0\n0 0 0\n99999999999 0 0 0\n").contains("line 4: expected 99999999999 indices"));
        assert!(message("OFF\n1 2 0\n0 0 0\n3 0 0 0\n").contains("ends before its faces"));
        assert!(message("OFF\n1 1 0\n0 0 0\n2 0 0\n").contains("no triangle"));
        assert!(parse_off(b"OFF\n\xff\n").unwrap_err().to_string().contains("line 2: not text"));
    }

    #[test]
    fn a_written_mesh_reads_back() {
        let mesh = parse_off(format!("OFF\n5 2 0{BODY}").as_bytes()).unwrap();
        let mut bytes = Vec::new();
        write_off(&mut bytes, &mesh).unwrap();
        assert!(bytes.starts_with(b"OFF\n5 3 0\n0.000000000 0.000000000 0.000000000\n"));
        assert_eq!(parse_off(&bytes).unwrap(), mesh);
    }

    proptest! {
        #[test]
        fn damaged_files_do_not_panic(at in 0..80_usize, byte in any::<u8>()) {
            let mut bytes = format!("OFF\n5 2 0{BODY}").into_bytes();
            let at = at % bytes.len();
            bytes[at] = byte;
            let _ = parse_off(&bytes);
            let _ = parse_off(&bytes[..at]);
        }
    }
}
