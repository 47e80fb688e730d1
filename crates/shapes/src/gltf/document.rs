//! The parts of a glTF document that geometry needs, and its buffers.

use serde::Deserialize;
use std::borrow::Cow;

/// Gives the bytes of a file beside the document, whose name has been checked to lead nowhere else; in words, why not.
pub(crate) type Beside<'a> = &'a dyn Fn(&str) -> Result<Vec<u8>, String>;

/// Extensions that may be required without changing the geometry that is read.
const HARMLESS: [&str; 4] = ["KHR_mesh_quantization", "KHR_texture_transform", "KHR_materials_", "EXT_texture_webp"];

#[derive(Debug, Deserialize)]
pub(super) struct Document {
    asset: Asset,
    #[serde(default, rename = "extensionsRequired")]
    extensions_required: Vec<String>,
    #[serde(default)]
    buffers: Vec<Buffer>,
    #[serde(default, rename = "bufferViews")]
    pub views: Vec<BufferView>,
    #[serde(default)]
    pub accessors: Vec<Accessor>,
    #[serde(default)]
    pub meshes: Vec<Mesh>,
    #[serde(default)]
    pub nodes: Vec<Node>,
    #[serde(default)]
    pub scenes: Vec<Scene>,
    pub scene: Option<u32>,
}

#[derive(Debug, Deserialize)]
struct Asset {
    version: String,
}

#[derive(Debug, Deserialize)]
struct Buffer {
    #[serde(rename = "byteLength")]
    byte_length: u64,
    uri: Option<String>,
}

#[derive(Debug, Deserialize)]
pub(super) struct BufferView {
    pub buffer: u32,
    #[serde(default, rename = "byteOffset")]
    pub byte_offset: u64,
    #[serde(rename = "byteLength")]
    pub byte_length: u64,
    #[serde(rename = "byteStride")]
    pub byte_stride: Option<u16>,
}

#[derive(Debug, Deserialize)]
pub(super) struct Accessor {
    #[serde(rename = "bufferView")]
    pub view: Option<u32>,
    #[serde(default, rename = "byteOffset")]
    pub byte_offset: u64,
    #[serde(rename = "componentType")]
    pub component_type: u16,
    pub count: u64,
    #[serde(rename = "type")]
    pub kind: Kind,
    #[serde(default)]
    pub normalized: bool,
    pub sparse: Option<Box<Sparse>>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
pub(super) enum Kind {
    #[serde(rename = "SCALAR")]
    Scalar,
    #[serde(rename = "VEC3")]
    Vec3,
    #[serde(other)]
    Other,
}

#[derive(Debug, Deserialize)]
pub(super) struct Sparse {
    pub count: u64,
    pub indices: SparsePart,
    pub values: SparsePart,
}

#[derive(Debug, Deserialize)]
pub(super) struct SparsePart {
    #[serde(rename = "bufferView")]
    pub view: u32,
    #[serde(default, rename = "byteOffset")]
    pub byte_offset: u64,
    #[serde(rename = "componentType")]
    pub component_type: Option<u16>,
}

#[derive(Debug, Deserialize)]
pub(super) struct Mesh {
    #[serde(default)]
    pub primitives: Vec<Primitive>,
}

#[derive(Debug, Deserialize)]
pub(super) struct Primitive {
    #[serde(default)]
    pub attributes: Attributes,
    pub indices: Option<u32>,
    pub mode: Option<u8>,
}

#[derive(Debug, Default, Deserialize)]
pub(super) struct Attributes {
    #[serde(rename = "POSITION")]
    pub position: Option<u32>,
}

#[derive(Debug, Deserialize)]
pub(super) struct Node {
    #[serde(default)]
    pub children: Vec<u32>,
    pub mesh: Option<u32>,
    pub matrix: Option<Box<[f64; 16]>>,
    pub translation: Option<Box<[f64; 3]>>,
    pub rotation: Option<Box<[f64; 4]>>,
    pub scale: Option<Box<[f64; 3]>>,
}

#[derive(Debug, Deserialize)]
pub(super) struct Scene {
    #[serde(default)]
    pub nodes: Vec<u32>,
}

impl Document {
    /// Fails for another version, and for required extensions that change geometry.
    pub fn check(&self) -> Result<(), String> {
        if !self.asset.version.starts_with("2.") {
            return Err(format!("asset version {}: expected 2.0; export the mesh as glTF 2.0", self.asset.version));
        }
        let unknown = self.extensions_required.iter().find(|name| !HARMLESS.iter().any(|known| name.starts_with(known)));
        match unknown.map(String::as_str) {
            None => Ok(()),
            Some(name @ ("KHR_draco_mesh_compression" | "EXT_meshopt_compression" | "KHR_meshopt_compression")) => {
                Err(format!("the mesh is compressed ({name}), which is not read: export it without compression"))
            }
            Some(name) => Err(format!("the file requires the extension {name}, which is not read: export it without")),
        }
    }

    /// The bytes of each buffer.
    pub fn buffers<'a>(&'a self, binary: Option<&'a [u8]>, beside: Beside) -> Result<Vec<Cow<'a, [u8]>>, String> {
        let read = |(n, buffer): (usize, &'a Buffer)| {
            let bytes: Cow<[u8]> = match (&buffer.uri, binary) {
                (Some(uri), _) if uri.starts_with("data:") => {
                    let (_, text) = uri.split_once(";base64,").ok_or_else(|| format!("buffer {n}: expected a data URI in base64"))?;
                    Cow::Owned(base64(text).ok_or_else(|| format!("buffer {n}: its data URI is not base64"))?)
                }
                (Some(uri), _) => Cow::Owned(beside(&local_name(uri)?)?),
                (None, Some(binary)) if n == 0 => Cow::Borrowed(binary),
                (None, _) => return Err(format!("buffer {n} has neither a URI nor the binary chunk of a GLB file")),
            };
            match bytes.len() as u64 >= buffer.byte_length {
                true => Ok(bytes),
                false => Err(format!("buffer {n} has {} bytes, expected {}: it is incomplete", bytes.len(), buffer.byte_length)),
            }
        };
        self.buffers.iter().enumerate().map(read).collect()
    }
}

/// The name of a file in the document's folder or below, percent signs resolved.
fn local_name(uri: &str) -> Result<String, String> {
    let mut bytes = Vec::with_capacity(uri.len());
    let mut rest = uri.as_bytes();
    while let Some((&byte, after)) = rest.split_first() {
        let code =
            (byte == b'%').then(|| after.get(..2).and_then(|hex| u8::from_str_radix(std::str::from_utf8(hex).ok()?, 16).ok())).flatten();
        bytes.push(code.unwrap_or(byte));
        rest = if code.is_some() { &after[2..] } else { after };
    }
    let name = String::from_utf8(bytes).map_err(|_| "the name of a buffer's file is not UTF-8")?;
    let is_local = !name.is_empty() && !name.contains([':', '\\', '\0']) && name.split('/').all(|part| !part.is_empty() && part != "..");
    match is_local {
        true => Ok(name),
        false => Err(format!("the buffer `{name}` does not lie in the folder of the file: only files there are read")),
    }
}

/// Decodes base64, with or without padding.
fn base64(text: &str) -> Option<Vec<u8>> {
    let text = text.trim_end_matches('=').as_bytes();
    let mut bytes = Vec::with_capacity(text.len() / 4 * 3 + 3);
    for group in text.chunks(4) {
        let mut bits = 0_u32;
        for (n, letter) in group.iter().enumerate() {
            let value = match letter {
                b'A'..=b'Z' => letter - b'A',
                b'a'..=b'z' => letter - b'a' + 26,
                b'0'..=b'9' => letter - b'0' + 52,
                b'+' | b'-' => 62,
                b'/' | b'_' => 63,
                _ => return None,
            };
            bits |= u32::from(value) << (18 - 6 * n);
        }
        let decoded = [(bits >> 16) as u8, (bits >> 8) as u8, bits as u8];
        bytes.extend(&decoded[..group.len().checked_sub(1).filter(|n| *n > 0)?]);
    }
    Some(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_is_decoded_as_rfc_4648_says() {
        for (text, expected) in
            [("", ""), ("Zg==", "f"), ("Zm8=", "fo"), ("Zm9v", "foo"), ("Zm9vYg==", "foob"), ("Zm9vYmE", "fooba"), ("Zm9vYmFy", "foobar")]
        {
            assert_eq!(base64(text).unwrap(), expected.as_bytes());
        }
        assert!(base64("Zm9vY").is_none() && base64("Zm$=").is_none());
    }

    #[test]
    fn only_files_beside_the_document_are_named() {
        assert_eq!(local_name("my%20mesh.bin").unwrap(), "my mesh.bin");
        assert_eq!(local_name("buffers/a.bin").unwrap(), "buffers/a.bin");
        for elsewhere in ["../a.bin", "/etc/passwd", "a/../../b", "http://x/y.bin", "%2e%2e/a", "C:\\a", ""] {
            assert!(local_name(elsewhere).is_err(), "{elsewhere}");
        }
    }
}
