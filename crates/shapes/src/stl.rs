//! STL, text and binary. All solids make one mesh; equal corners become one vertex. Normals are not used: they are often wrong, or NaN.
//!
//! A file is text if it starts with `solid` and neither has the size of a binary file nor holds a zero byte: many exporters start binary files
//! with `solid` too. In a binary file the count of triangles must be what its size says. Where it is smaller, and the rest is whole triangles,
//! all are read, and [`stl_count_note`] says so.

use super::content::Content;
use super::lines::{Lines, found, number, without_mark, words};
use super::polygon::{Place, Surface};
use super::{FormatError, Mesh, MeshError};
use beo_core::text::printable;
use nalgebra::Point3;
use std::collections::HashMap;

const FORMAT: &str = "STL";
const HEADER: usize = 84;
const TRIANGLE: usize = 50;

fn error(problem: impl Into<String>) -> FormatError {
    FormatError::File { format: FORMAT, problem: printable(&problem.into()) }
}

/// Reads an STL file's bytes.
///
/// # Errors
/// [`FormatError`]: a wrong line, with its number; a count that does not fit the size; a mesh that cannot be used.
pub fn parse_stl(bytes: &[u8]) -> Result<Mesh, FormatError> {
    read_stl(bytes)?.into_mesh()
}

/// Reads an STL file's bytes.
pub(super) fn read_stl(bytes: &[u8]) -> Result<Content, FormatError> {
    if is_text(bytes) { read_text(bytes) } else { read_binary(bytes) }
}

fn is_text(bytes: &[u8]) -> bool {
    let starts_as_text = without_mark(bytes).trim_ascii_start().get(..5).is_some_and(|word| word.eq_ignore_ascii_case(b"solid"));
    starts_as_text && declared(bytes).is_none_or(|count| HEADER + count * TRIANGLE != bytes.len()) && !bytes.contains(&0)
}

/// The count of triangles in a binary header.
fn declared(bytes: &[u8]) -> Option<usize> {
    bytes.get(80..HEADER).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]) as usize)
}

/// That a binary file holds more triangles than its header says, if it does.
pub(super) fn stl_count_note(bytes: &[u8]) -> Option<String> {
    let declared = declared(bytes).filter(|_| !is_text(bytes))?;
    let rest = bytes.len() - HEADER;
    let by_size = rest / TRIANGLE;
    (by_size > declared && rest.is_multiple_of(TRIANGLE))
        .then(|| format!("the header says {declared} triangles, the size of the file {by_size}: all {by_size} were read"))
}

/// Collects corners, each place once.
#[derive(Default)]
struct Corners {
    vertices: Vec<Point3<f64>>,
    known: HashMap<[u64; 3], u32>,
}

impl Corners {
    fn index(&mut self, point: [f64; 3]) -> Result<u32, FormatError> {
        // −0 and 0 are one place.
        let next = u32::try_from(self.vertices.len()).map_err(|_| error("more than 2³² vertices: simplify the mesh"))?;
        let vertices = &mut self.vertices;
        Ok(*self.known.entry(point.map(|c| (c + 0.0).to_bits())).or_insert_with(|| {
            vertices.push(Point3::from(point));
            next
        }))
    }
}

fn read_binary(bytes: &[u8]) -> Result<Content, FormatError> {
    let declared = declared(bytes).ok_or_else(|| {
        error(format!("neither `solid` at the start nor the 84 bytes of a binary header: the file has {} bytes", bytes.len()))
    })?;
    let rest = bytes.len() - HEADER;
    let by_size = rest / TRIANGLE;
    if by_size < declared {
        let needed = HEADER + declared * TRIANGLE;
        let problem = format!("{declared} triangles need {needed} bytes, the file has {}: it is incomplete, or no STL file", bytes.len());
        return Err(FormatError::Byte { format: FORMAT, byte: 80, problem });
    }
    if by_size > declared && !rest.is_multiple_of(TRIANGLE) {
        let problem = format!(
            "the header says {declared} triangles, after which there are {} bytes more: more than trailing bytes, and no whole triangles of \
             {TRIANGLE} bytes; export the mesh again",
            rest - declared * TRIANGLE
        );
        return Err(FormatError::Byte { format: FORMAT, byte: 80, problem });
    }
    let mut corners = Corners::default();
    let mut triangles = Vec::with_capacity(by_size);
    for (t, record) in bytes[HEADER..].chunks_exact(TRIANGLE).enumerate() {
        let coordinate = |at: usize| f64::from(f32::from_le_bytes([record[at], record[at + 1], record[at + 2], record[at + 3]]));
        let mut triangle = [0; 3];
        for (n, corner) in triangle.iter_mut().enumerate() {
            let point = [0, 4, 8].map(|axis| coordinate(12 + 12 * n + axis));
            if !point.iter().all(|c| c.is_finite()) {
                let problem =
                    format!("triangle {t} (counted from 0) has a coordinate that is not a number or infinite: export the mesh again");
                return Err(FormatError::Byte { format: FORMAT, byte: HEADER + t * TRIANGLE + 12 + 12 * n, problem });
            }
            *corner = corners.index(point)?;
        }
        triangles.push(triangle);
    }
    if triangles.is_empty() {
        return Err(MeshError::NoTriangle.into());
    }
    let mut surface = Surface::new(FORMAT, corners.vertices)?;
    triangles.into_iter().for_each(|triangle| surface.triangle(triangle));
    surface.finish()
}

fn read_text(bytes: &[u8]) -> Result<Content, FormatError> {
    let mut corners = Corners::default();
    let mut facets: Vec<(usize, [u32; 3])> = Vec::new();
    // Facets of more than three corners, which the format does not allow, but which say what they mean.
    let mut polygons: Vec<(usize, Vec<u32>)> = Vec::new();
    let mut facet: Vec<u32> = Vec::new();
    let (mut is_complete, mut last) = (false, 0);
    for (line, text) in Lines::of(bytes, FORMAT)? {
        last = line;
        let wrong = |problem: String| FormatError::Line { format: FORMAT, line, problem };
        let mut words = words(text);
        while let Some(word) = words.next() {
            let mut keyword = word.to_ascii_lowercase();
            if keyword == b"end" {
                // `end solid` is `endsolid`.
                keyword.extend(words.next().unwrap_or_default().to_ascii_lowercase());
            }
            match &keyword[..] {
                // A name follows.
                b"solid" => break,
                b"endsolid" => {
                    is_complete = true;
                    break;
                }
                b"facet" => {
                    // `normal` and three numbers, which are not used.
                    words.by_ref().take(4).for_each(drop);
                }
                b"outer" => match words.next() {
                    Some(word) if word.eq_ignore_ascii_case(b"loop") => {}
                    word => return Err(wrong(format!("expected `outer loop`, {}", found(word)))),
                },
                b"vertex" => {
                    let mut point = [0.0; 3];
                    for coordinate in &mut point {
                        let word = words.next();
                        let problem = || wrong(format!("expected `vertex` and three finite numbers, {}", found(word)));
                        *coordinate = word.and_then(number).ok_or_else(problem)?;
                    }
                    facet.push(corners.index(point)?);
                }
                b"endloop" => {}
                b"endfacet" => {
                    match facet[..] {
                        [a, b, c] => facets.push((line, [a, b, c])),
                        [_, _, _, _, ..] => polygons.push((line, facet.clone())),
                        _ => return Err(wrong(format!("a facet of {} vertices: expected three lines `vertex`", facet.len()))),
                    }
                    facet.clear();
                }
                _ => {
                    return Err(wrong(format!(
                        "expected solid, facet, outer loop, vertex, endloop, endfacet or endsolid, {}",
                        found(Some(word))
                    )));
                }
            }
        }
    }
    if !is_complete || !facet.is_empty() {
        let problem = "the file ends before `endsolid`: it is incomplete".into();
        return Err(FormatError::Line { format: FORMAT, line: last, problem });
    }
    if facets.is_empty() && polygons.is_empty() {
        return Err(MeshError::NoTriangle.into());
    }
    let mut surface = Surface::new(FORMAT, corners.vertices)?;
    facets.into_iter().for_each(|(_, triangle)| surface.triangle(triangle));
    polygons.iter().for_each(|(line, polygon)| surface.polygon(polygon, Place::Line(*line)));
    surface.finish()
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
        assert_eq!(text.vertices().len(), 4);
        let triangles = [[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 2.0, 3.0], [0.0, 0.0, 0.0, 0.0, 2.0, 3.0, 4.0, 5.0, 6.0]];
        for header in [&b"made by hand"[..], b"solid that is binary"] {
            let good = binary(header, 2, &triangles);
            assert_eq!(parse_stl(&good).as_ref(), Ok(&text));
            assert_eq!(stl_count_note(&good), None);
            // Some bytes at the end, fewer than a triangle's.
            assert_eq!(parse_stl(&[&good[..], &[1; 49]].concat()).as_ref(), Ok(&text));
            // The size decides.
            for count in [0, 1] {
                let short = binary(header, count, &triangles);
                assert_eq!(parse_stl(&short).as_ref(), Ok(&text));
                let note = stl_count_note(&short).unwrap();
                assert_eq!(note, format!("the header says {count} triangles, the size of the file 2: all 2 were read"));
            }
        }
        for text_variant in [
            TEXT.replace('\n', "\r"),
            TEXT.replace("endsolid", "end solid"),
            TEXT.replace("endloop", "END LOOP"),
            format!("\u{feff}{TEXT}"),
            TEXT.replace("\nendsolid second", " endsolid").replace('\n', "\r\n"),
        ] {
            assert_eq!(parse_stl(text_variant.as_bytes()).as_ref(), Ok(&text), "{text_variant:?}");
            assert_eq!(stl_count_note(text_variant.as_bytes()), None);
        }
    }

    #[test]
    fn malformed_files_are_refused() {
        let message = |bytes: &[u8]| parse_stl(bytes).unwrap_err().to_string();
        assert!(message(b"").contains("84 bytes"));
        assert!(message(&binary(b"", u32::MAX, &[[1.0; 9]])).contains("4294967295 triangles need 214748364834 bytes"));
        assert!(message(&binary(b"", 1, &[[f32::NAN; 9]])).starts_with("STL, byte 96: triangle 0"));
        assert!(message(&binary(b"", 0, &[])).contains("no triangle"));
        let mut odd = binary(b"", 0, &[[1.0; 9]]);
        odd.push(0);
        assert!(message(&odd).contains("the header says 0 triangles, after which there are 51 bytes more"));
        assert!(message(b"solid\nfacet normal 0 0 0\n").contains("ends before `endsolid`"));
        assert!(
            message(b"solid\nfacet normal 0 0 0\nouter loop\nvertex 0 0 inf\nendsolid")
                .contains("line 4: expected `vertex` and three finite")
        );
        assert!(message(b"solid\nfacet normal 0 0 0\nouter loop\nvertex 0 0\nendsolid").contains("found nothing more"));
        assert!(
            message(b"solid\nfacet normal 0 0 0\nouter loop\nvertex 0 0 1\nendloop\nendfacet\nendsolid")
                .contains("line 6: a facet of 1 vertices")
        );
        assert!(message(b"solid\nfacets\nendsolid").contains("line 2: expected solid, facet"));
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
