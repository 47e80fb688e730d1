//! glTF 2.0 and its binary form GLB: the triangles, or else the points, of the default scene, every node where its transforms put it.
//!
//! Read are positions and indices; materials, textures, skins, morph targets and animations are passed over. Units are metres and y is up, as
//! the format says. Extensions that a file requires and that change geometry (Draco, meshopt) are refused by name.

mod accessor;
mod document;
mod scene;

use self::document::{Beside, Document};
use super::content::Content;
use super::lines::without_mark;
use super::polygon::Surface;
use super::{FormatError, Mesh};
use beo_core::text::printable;

const FORMAT: &str = "glTF";
const MAGIC: &[u8] = b"glTF";
const JSON_CHUNK: u32 = 0x4e4f_534a;
const BINARY_CHUNK: u32 = 0x004e_4942;

fn error(problem: impl AsRef<str>) -> FormatError {
    FormatError::File { format: FORMAT, problem: printable(problem.as_ref()) }
}

fn byte_error(byte: usize, problem: impl Into<String>) -> FormatError {
    FormatError::Byte { format: FORMAT, byte, problem: problem.into() }
}

/// Reads a glTF or GLB file's bytes as a mesh, y up as in the file; all its bytes must be in the file.
///
/// # Errors
/// [`FormatError`]: a document that is none, what it names and does not have, compressed or too many triangles.
pub fn parse_gltf(bytes: &[u8]) -> Result<Mesh, FormatError> {
    let beside = |name: &str| Err(format!("the buffer `{name}` lies in a file of its own, which was not given"));
    read_gltf(bytes, &beside)?.into_mesh()
}

/// Reads a glTF or GLB file's bytes.
pub(super) fn read_gltf(bytes: &[u8], beside: Beside) -> Result<Content, FormatError> {
    let (json, binary) = if bytes.starts_with(MAGIC) { chunks(bytes)? } else { (without_mark(bytes), None) };
    let document: Document = serde_json::from_slice(json).map_err(|cause| match cause.is_data() {
        // Positions in a GLB's JSON are of one line, as it is mostly written.
        _ if bytes.starts_with(MAGIC) => error(format!("the JSON part: {cause}")),
        _ => FormatError::Line { format: FORMAT, line: cause.line(), problem: printable(&format!("not a glTF document: {cause}")) },
    })?;
    document.check().map_err(error)?;
    let buffers = document.buffers(binary, beside).map_err(error)?;
    let in_all = bytes.len() + buffers.iter().map(|buffer| buffer.len()).sum::<usize>();
    let found = scene::geometry(&document, &buffers, in_all).map_err(error)?;
    let mut surface = Surface::new(FORMAT, found.vertices)?;
    if surface.vertices() == 0 {
        return Err(super::MeshError::NoTriangle.into());
    }
    found.triangles.into_iter().for_each(|triangle| surface.triangle(triangle));
    surface.finish()
}

/// The JSON and the binary chunk of a GLB file.
fn chunks(bytes: &[u8]) -> Result<(&[u8], Option<&[u8]>), FormatError> {
    let word = |at: usize| bytes.get(at..at + 4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]));
    let end = || error("the file ends within its GLB header: it is incomplete");
    let version = word(4).ok_or_else(end)?;
    if version != 2 {
        return Err(byte_error(4, format!("GLB version {version}: expected 2; export the mesh as glTF 2.0")));
    }
    let length = word(8).ok_or_else(end)? as usize;
    if length > bytes.len() {
        return Err(byte_error(8, format!("the header says {length} bytes, the file has {}: it is incomplete", bytes.len())));
    }
    let (mut at, mut json, mut binary) = (12, None, None);
    while at + 8 <= length {
        let (size, kind) = (word(at).ok_or_else(end)? as usize, word(at + 4).ok_or_else(end)?);
        let chunk = bytes.get(at + 8..).and_then(|rest| rest.get(..size));
        let chunk = chunk.ok_or_else(|| byte_error(at, format!("a chunk of {size} bytes does not fit into the file: it is incomplete")))?;
        match kind {
            JSON_CHUNK if json.is_none() => json = Some(chunk),
            BINARY_CHUNK if binary.is_none() => binary = Some(chunk),
            _ => {}
        }
        at += 8 + size;
    }
    Ok((json.ok_or_else(|| byte_error(12, "expected a chunk of JSON"))?, binary))
}

#[cfg(test)]
mod tests;
