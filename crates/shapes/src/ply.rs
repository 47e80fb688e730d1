//! PLY (Stanford), text and binary of both byte orders, by `ply-rs-bw`: the elements `vertex` (x, y, z) and `face`
//! (`vertex_indices` or `vertex_index`); all else is read over.

use super::mesh::Fans;
use super::{FormatError, Mesh};
use beo_core::text::printable;
use nalgebra::Point3;
use ply_rs_bw::parser::{ParseError, Parser, Reader};
use ply_rs_bw::ply::{Encoding, Property, PropertyAccess, PropertyAccessResult};

fn error(problem: impl Into<String>) -> FormatError {
    FormatError::File { format: "PLY", problem: printable(&problem.into()) }
}

fn located(e: &ParseError) -> FormatError {
    let text = e.to_string();
    // The crate's messages run over several lines and repeat the input.
    let problem: String = printable(text.lines().next().unwrap_or_default()).chars().take(160).collect();
    match e.line() {
        Some(line) => {
            let problem = problem.strip_prefix(&format!("Line {line}: ")).unwrap_or(&problem).to_owned();
            FormatError::Line { format: "PLY", line, problem }
        }
        None => error(problem),
    }
}

struct Vertex([f64; 3]);

impl PropertyAccess for Vertex {
    fn new() -> Self {
        Self([f64::NAN; 3])
    }

    fn set_property(&mut self, name: &str, value: Property) -> PropertyAccessResult {
        let axis = match name {
            "x" => 0,
            "y" => 1,
            "z" => 2,
            _ => return PropertyAccessResult::Ignored,
        };
        self.0[axis] = match value {
            Property::Char(v) => v.into(),
            Property::UChar(v) => v.into(),
            Property::Short(v) => v.into(),
            Property::UShort(v) => v.into(),
            Property::Int(v) => v.into(),
            Property::UInt(v) => v.into(),
            Property::Float(v) => v.into(),
            Property::Double(v) => v,
            _ => return PropertyAccessResult::UnsupportedType,
        };
        PropertyAccessResult::Set
    }
}

/// The corners of one polygon; an index below zero becomes one that no mesh has.
struct Face(Vec<u32>);

impl PropertyAccess for Face {
    fn new() -> Self {
        Self(Vec::new())
    }

    fn set_property(&mut self, name: &str, value: Property) -> PropertyAccessResult {
        if name != "vertex_indices" && name != "vertex_index" {
            return PropertyAccessResult::Ignored;
        }
        fn corners<T: TryInto<u32>>(list: Vec<T>) -> Vec<u32> {
            list.into_iter().map(|v| v.try_into().unwrap_or(u32::MAX)).collect()
        }
        self.0 = match value {
            Property::ListChar(v) => corners(v),
            Property::ListUChar(v) => corners(v),
            Property::ListShort(v) => corners(v),
            Property::ListUShort(v) => corners(v),
            Property::ListInt(v) => corners(v),
            Property::ListUInt(v) => v,
            _ => return PropertyAccessResult::UnsupportedType,
        };
        PropertyAccessResult::Set
    }
}

/// An element of another kind: read over.
struct Other;

impl PropertyAccess for Other {
    fn new() -> Self {
        Self
    }
}

/// Reads a PLY file's bytes.
pub fn parse_ply(bytes: &[u8]) -> Result<Mesh, FormatError> {
    let mut reader = Reader::new(bytes);
    let header = Parser::<Other>::new().read_header(&mut reader).map_err(|e| located(&e))?;
    let mut vertices = Vec::new();
    let mut fans = Fans::default();
    for element in header.elements.values() {
        // Every entry takes at least one byte; without this a binary element without properties could be any number long.
        if element.properties.is_empty() && header.encoding != Encoding::Ascii && element.count > 0 {
            return Err(error(format!("element `{}` has no properties", element.name)));
        }
        let left = reader.get_ref().len();
        if element.count > left {
            return Err(error(format!("{} entries of `{}` do not fit into the {left} bytes left", element.count, element.name)));
        }
        match element.name.as_str() {
            "vertex" => {
                if let Some(axis) = ["x", "y", "z"].into_iter().find(|axis| !element.properties.contains_key(*axis)) {
                    return Err(error(format!("element `vertex` has no property `{axis}`")));
                }
                let entries = Parser::<Vertex>::new().read_payload_for_element(&mut reader, element, &header);
                vertices.extend(entries.map_err(|e| located(&e))?.into_iter().map(|v| Point3::from(v.0)));
            }
            "face" => {
                let entries = Parser::<Face>::new().read_payload_for_element(&mut reader, element, &header);
                entries.map_err(|e| located(&e))?.iter().for_each(|face| fans.push(&face.0));
            }
            _ => {
                Parser::<Other>::new().read_payload_for_element(&mut reader, element, &header).map_err(|e| located(&e))?;
            }
        }
    }
    Ok(Mesh::new(vertices, fans.0)?)
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
        assert!(message("ply\nformat ascii 1.0\n").contains("end of file"));
        let huge = "ply\nformat binary_little_endian 1.0\nelement vertex 999999999999\nproperty float x\nproperty float y\nproperty float z\nend_header\n";
        assert!(message(huge).contains("999999999999 entries of `vertex` do not fit"));
        let endless = "ply\nformat binary_little_endian 1.0\nelement nothing 999999999999\nend_header\n";
        assert!(message(endless).contains("has no properties"));
        assert!(message("ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n1\n").contains("no property `y`"));
        let one = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nelement face 1\n\
            property list int int vertex_indices\nend_header\n1 2 3\n";
        assert!(message(&format!("{one}3 0 0 -1\n")).contains("names vertex 4294967295"));
        assert!(message(&format!("{one}999999999 0\n")).contains("PLY, line 11"));
        assert!(message(&format!("{one}2 0 0\n")).contains("no triangle"));
        assert!(!message(one).contains('\n'));
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
