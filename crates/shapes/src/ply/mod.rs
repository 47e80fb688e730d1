//! PLY (Stanford), text and binary of both byte orders: the elements `vertex` (x, y, z), `face` and `tristrips` (lists `vertex_indices` or
//! `vertex_index`; −1 ends a strip); all else is read over. A file of vertices alone is a point cloud.
//!
//! Coordinates written as text are read in double precision, whatever type the header names.

mod error;
mod header;
mod payload;

use self::error::{FORMAT, error};
use self::header::{Element, Header, Property, Scalar};
use self::payload::{Entries, Values};
use super::content::Content;
use super::polygon::{Place, Surface};
use super::{FormatError, Mesh};
use nalgebra::Point3;

/// Reads a PLY file's bytes as a mesh.
///
/// # Errors
/// [`FormatError`]: a wrong line or byte; a mesh that cannot be used; no face.
pub fn parse_ply(bytes: &[u8]) -> Result<Mesh, FormatError> {
    read_ply(bytes)?.into_mesh()
}

/// Reads a PLY file's bytes.
pub(super) fn read_ply(bytes: &[u8]) -> Result<Content, FormatError> {
    let (header, payload) = Header::read(bytes)?;
    let mut entries = Entries::new(payload);
    let mut vertices: Option<Vec<Point3<f64>>> = None;
    let mut outlines = Outlines::default();
    for element in &header.elements {
        entries.check_room(element)?;
        match element.name.as_str() {
            "vertex" => {
                let axes = axes(element)?;
                let vertices = vertices.get_or_insert_default();
                vertices.reserve_exact(element.count);
                for _ in 0..element.count {
                    let (place, values) = entries.next(element)?;
                    vertices.push(point(values, axes).map_err(|problem| place.error(FORMAT, problem))?);
                }
            }
            "face" | "tristrips" if element.count > 0 => {
                let is_strip = element.name == "tristrips";
                let list = indices(element)?;
                for _ in 0..element.count {
                    let (place, values) = entries.next(element)?;
                    outlines.push(values.list(list), place, is_strip).map_err(|problem| place.error(FORMAT, problem))?;
                }
            }
            _ => {
                for _ in 0..element.count {
                    entries.next(element)?;
                }
            }
        }
    }
    let vertices = vertices.ok_or_else(|| error("there is no element `vertex`: expected the vertices of a mesh or a point cloud"))?;
    let mut surface = Surface::new(FORMAT, vertices)?;
    outlines.lay(&mut surface)?;
    surface.finish()
}

/// Where x, y and z stand among the properties of `vertex`.
fn axes(element: &Element) -> Result<[usize; 3], FormatError> {
    let mut found = [0; 3];
    for (place, axis) in found.iter_mut().zip(["x", "y", "z"]) {
        let is_axis = |property: &Property| property.name == axis && matches!(property.scalar, Scalar::Single(_));
        let missing = || error(format!("element `vertex` has no property `{axis}`: expected a number of each of x, y, z"));
        *place = element.properties.iter().position(is_axis).ok_or_else(missing)?;
    }
    Ok(found)
}

/// Where the list of vertices stands among the properties of `face` or `tristrips`.
fn indices(element: &Element) -> Result<usize, FormatError> {
    let name = &element.name;
    let is_list = |property: &Property| property.name == "vertex_indices" || property.name == "vertex_index";
    match element.properties.iter().position(is_list) {
        Some(place) => match element.properties[place].scalar {
            Scalar::List { item, .. } if item.is_float() => Err(error(format!(
                "`vertex_indices` of `{name}` is a list of floating-point numbers: expected whole numbers, such as `property list uchar int vertex_indices`"
            ))),
            Scalar::List { .. } => Ok(place),
            Scalar::Single(_) => Err(error(format!("`vertex_indices` of `{name}` is one number: expected a list"))),
        },
        None => Err(error(format!("element `{name}` has no list `vertex_indices` or `vertex_index`"))),
    }
}

fn point(values: &Values, axes: [usize; 3]) -> Result<Point3<f64>, String> {
    let point = axes.map(|place| values.single(place));
    match point.iter().all(|c| c.is_finite()) {
        true => Ok(Point3::from(point)),
        false => Err("a coordinate is not a number or infinite: remove the vertex, or export the file again".into()),
    }
}

/// Polygons and strips as the file has them, one after the other; they are laid once the vertices are known.
#[derive(Default)]
struct Outlines {
    corners: Vec<i64>,
    /// End in `corners`, place in the file, whether a strip.
    ends: Vec<(usize, Place, bool)>,
    /// Whether there was an outline of a point or a line, of which nothing is kept.
    any_short: bool,
}

impl Outlines {
    fn push(&mut self, list: &[f64], place: Place, is_strip: bool) -> Result<(), String> {
        if list.len() < 3 {
            self.any_short = true;
            return Ok(());
        }
        for &value in list {
            if value.fract() != 0.0 || value.abs() > 2_f64.powi(40) {
                return Err(format!("the index {value} is not a whole number: write indices without a point"));
            }
            self.corners.push(value as i64);
        }
        self.ends.push((self.corners.len(), place, is_strip));
        Ok(())
    }

    fn lay(&self, surface: &mut Surface) -> Result<(), FormatError> {
        let (mut start, mut polygon) = (0, Vec::new());
        let vertices = surface.vertices();
        for &(end, place, is_strip) in &self.ends {
            polygon.clear();
            for &corner in &self.corners[start..end] {
                match u32::try_from(corner) {
                    Ok(vertex) if (vertex as usize) < vertices => polygon.push(vertex),
                    _ if is_strip && corner == -1 => {
                        lay_strip(&polygon, surface);
                        polygon.clear();
                    }
                    _ => {
                        let last = vertices.saturating_sub(1);
                        return Err(place.error(FORMAT, format!("an index names vertex {corner}: expected 0 to {last}")));
                    }
                }
            }
            if is_strip {
                lay_strip(&polygon, surface)
            } else {
                surface.polygon(&polygon, place)
            }
            start = end;
        }
        if self.any_short {
            surface.polygon(&[], Place::Byte(0));
        }
        Ok(())
    }
}

/// Every three corners in a row are a triangle, every second one turned; those with a repeated corner only lead on.
fn lay_strip(strip: &[u32], surface: &mut Surface) {
    for (n, corners) in strip.windows(3).enumerate() {
        let [a, b, c] = [corners[0], corners[1], corners[2]];
        if a != b && b != c && c != a {
            surface.triangle(if n % 2 == 0 { [a, b, c] } else { [b, a, c] });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn header(encoding: &str, indices: &str) -> String {
        format!(
            "ply\nformat {encoding} 1.0\ncomment made by hand\nelement vertex 4\nproperty float x\nproperty double y\nproperty short z\n\
             property uchar red\nelement edge 1\nproperty int a\nelement face 2\nproperty list uchar {indices}\nend_header\n"
        )
    }

    const VERTICES: [(f32, f64, i16, u8); 4] = [(0.5, 0.0, 0, 9), (1.0, 0.25, -1, 8), (1.0, 2.0, 0, 7), (0.0, 2.0, 3, 6)];
    const FACES: [&[i32]; 2] = [&[0, 1, 2, 3], &[3, 1, 0]];

    fn ascii() -> Vec<u8> {
        let mut text = header("ascii", "int vertex_indices");
        VERTICES.iter().for_each(|(x, y, z, red)| text += &format!("{x} {y} {z} {red}\n"));
        text += "77\n";
        FACES.iter().for_each(|f| text += &format!("{} {}\n", f.len(), f.iter().map(|v| v.to_string()).collect::<Vec<_>>().join(" ")));
        text.into_bytes()
    }

    fn binary(is_big: bool) -> Vec<u8> {
        let encoding = if is_big { "binary_big_endian" } else { "binary_little_endian" };
        let mut bytes = header(encoding, "int vertex_index").into_bytes();
        let mut put = |little: &[u8]| if is_big { bytes.extend(little.iter().rev()) } else { bytes.extend(little) };
        for (x, y, z, red) in VERTICES {
            put(&x.to_le_bytes());
            put(&y.to_le_bytes());
            put(&z.to_le_bytes());
            put(&[red]);
        }
        put(&77_i32.to_le_bytes());
        for face in FACES {
            put(&[face.len() as u8]);
            face.iter().for_each(|v| put(&v.to_le_bytes()));
        }
        bytes
    }

    #[test]
    fn text_and_both_byte_orders_give_the_same_mesh() {
        let expected = Mesh::new(
            [[0.5, 0.0, 0.0], [1.0, 0.25, -1.0], [1.0, 2.0, 0.0], [0.0, 2.0, 3.0]].map(Point3::from).to_vec(),
            vec![[0, 1, 2], [0, 2, 3], [3, 1, 0]],
        );
        assert_eq!(parse_ply(&ascii()), expected.map_err(Into::into));
        assert_eq!(parse_ply(&binary(false)), parse_ply(&ascii()));
        assert_eq!(parse_ply(&binary(true)), parse_ply(&ascii()));
    }

    #[test]
    fn malformed_files_are_refused() {
        let message = |text: &str| parse_ply(text.as_bytes()).unwrap_err().to_string();
        assert!(message("OFF\n").contains("PLY, line 1"));
        assert!(message("ply\nformat ascii 1.0\n").contains("ends before `end_header`"));
        let huge = "ply\nformat binary_little_endian 1.0\nelement vertex 999999999999\nproperty float x\nproperty float y\nproperty float z\nend_header\n";
        assert!(message(huge).contains("999999999999 entries of `vertex` do not fit"));
        let endless = "ply\nformat binary_little_endian 1.0\nelement nothing 999999999999\nend_header\n";
        assert!(message(endless).contains("has no properties"));
        assert!(message("ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n1\n").contains("no property `y`"));
        let one = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nelement face 1\n\
            property list int int vertex_indices\nend_header\n1 2 3\n";
        assert!(message(&format!("{one}3 0 0 -1\n")).contains("PLY, line 11: an index names vertex -1: expected 0 to 0"));
        assert!(
            message(&format!("{one}3 0.0 0.0 0.0\n"))
                .contains("line 11: expected 3 whole numbers of `vertex_indices`, found `0.0`, which is not")
        );
        assert!(message(&format!("{}3 0 0 0\n", one.replace("int int", "int float"))).contains("a list of floating-point numbers"));
        assert!(message(&format!("{one}3 0 0 0 0\n")).contains("line 11: more values than"));
        assert!(message(&format!("{one}\n\n3 0 0 7\n")).contains("PLY, line 13: an index names vertex 7"));
        assert!(message("ply\nformat ascii 1.0\nelement face 0\nend_header\n").contains("no element `vertex`"));
        assert!(message(&format!("{one}999999999 0\n")).contains("PLY, line 11: a list of 999999999 entries"));
        assert!(message(&format!("{one}2 0 0\n")).contains("no triangle"));
        assert!(!message(one).contains('\n'));
    }

    #[test]
    fn line_ends_marks_and_blank_lines_change_nothing() {
        let text = String::from_utf8(ascii()).unwrap();
        let expected = parse_ply(text.as_bytes()).unwrap();
        let blank = text.replace("end_header\n", "end_header\n\n").replace("\n77\n", "\n\n77\n  \n");
        for variant in [text.replace('\n', "\r"), text.replace('\n', "\r\n"), format!("\u{feff}{text}"), blank] {
            assert_eq!(parse_ply(variant.as_bytes()).as_ref(), Ok(&expected), "{variant:?}");
        }
        // The payload of a binary file starts right after the header's last line end, of whatever kind.
        let bytes = binary(false);
        let at = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
        for end in ["\r", "\r\n"] {
            let header = String::from_utf8(bytes[..at].to_vec()).unwrap().replace('\n', end);
            assert_eq!(parse_ply(&[header.as_bytes(), &bytes[at..]].concat()).as_ref(), Ok(&expected));
        }
    }

    #[test]
    fn strips_are_cut_into_triangles_turned_alike() {
        let text = "ply\nformat ascii 1.0\nelement vertex 5\nproperty float x\nproperty float y\nproperty float z\nelement tristrips 1\n\
            property list int int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n1 1 0\n0 0 1\n9 0 1 2 3 -1 0 2 4 4\n";
        assert_eq!(parse_ply(text.as_bytes()).unwrap().triangles(), [[0, 1, 2], [2, 1, 3], [0, 2, 4]]);
    }

    #[test]
    fn text_is_read_in_double_precision_whatever_the_type() {
        let text = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\nend_header\n\
            4583200.123456 0 0\n1 2 3\n";
        let Content::Points(cloud) = read_ply(text.as_bytes()).unwrap() else { panic!() };
        assert_eq!(cloud.points()[0].x, 4583200.123456);
        assert!(parse_ply(text.as_bytes()).unwrap_err().to_string().contains("point cloud"));
    }

    proptest! {
        #[test]
        fn damaged_files_do_not_panic(at in 0..400_usize, byte in any::<u8>()) {
            for mut bytes in [ascii(), binary(false), binary(true)] {
                let at = at % bytes.len();
                bytes[at] = byte;
                let _ = parse_ply(&bytes);
                let _ = parse_ply(&bytes[..at]);
            }
        }
    }
}
