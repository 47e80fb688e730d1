//! `alignment.json`, which `beo align` leaves beside the shapes it has aligned: that they lie in the unit cube as they are meant to, how they came
//! there, and how well they agree.

use super::bytes::read_bytes;
use super::error::{AlignmentFileError, ReadError};
use beo_core::text::printable;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;

/// Its name in the folder of the shapes.
pub const ALIGNMENT_FILE: &str = "alignment.json";
/// What it says of itself.
const FORMAT: &str = "beo alignment";
const VERSION: u32 = 1;

/// The content of `alignment.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Alignment {
    format: String,
    version: u32,
    /// Cells along the unit cube in which the entropies were measured.
    pub resolution: usize,
    /// By name.
    pub classes: BTreeMap<String, AlignedClass>,
}

/// The shapes of one class.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct AlignedClass {
    /// Bits, summed over all cells, of the mean occupancy of the shapes as they came: centred by their boxes, scaled by their longest sides.
    pub entropy_before: f64,
    /// The same along the principal axes of each shape, with one root mean square radius for all.
    pub entropy_normalised: f64,
    /// The same of the shapes as they were aligned.
    pub entropy_after: f64,
    /// In the order of their names.
    pub files: Vec<AlignedFile>,
}

/// How one shape was placed: output = `scale` · `rotation` · input + `translation`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct AlignedFile {
    /// What was read, relative to the folder of the input.
    pub input: String,
    /// What was written, relative to the folder of this file.
    pub output: String,
    /// Unit quaternion x, y, z, w.
    pub rotation_xyzw: [f64; 4],
    /// Units of the input in sides of the cube. Of a voxel file the input is its grid, centred on the origin, the longest side 1.
    pub scale: f64,
    /// In sides of the cube.
    pub translation: [f64; 3],
}

impl Alignment {
    /// Of these classes, measured with so many cells along the cube.
    pub fn new(resolution: usize, classes: BTreeMap<String, AlignedClass>) -> Self {
        Self { format: FORMAT.into(), version: VERSION, resolution, classes }
    }

    /// Reads the file's bytes.
    pub fn parse(bytes: &[u8]) -> Result<Self, String> {
        // What it is comes before what is in it, so that another version is named as such.
        #[derive(Deserialize)]
        struct Header {
            format: String,
            version: u32,
        }
        let header: Header = serde_json::from_slice(bytes).map_err(|error| error.to_string())?;
        match (header.format.as_str(), header.version) {
            (FORMAT, VERSION) => serde_json::from_slice(bytes).map_err(|error| error.to_string()),
            (FORMAT, version) => Err(format!("version {version}, where {VERSION} is read")),
            (format, _) => Err(format!("format `{}`, where `{FORMAT}` is expected", printable(format))),
        }
    }

    /// The alignment of the shapes in a folder, if it has any.
    pub fn of_folder(folder: &Path) -> Result<Option<Self>, AlignmentFileError> {
        let path = folder.join(ALIGNMENT_FILE);
        let error = |problem| AlignmentFileError { path: path.clone(), problem };
        match read_bytes(&path) {
            Err(ReadError::Open { source, .. }) if source.kind() == std::io::ErrorKind::NotFound => Ok(None),
            // A file in the place of a folder has no alignment either.
            Err(ReadError::Open { source, .. }) if source.kind() == std::io::ErrorKind::NotADirectory => Ok(None),
            Err(ReadError::Open { source, .. }) => Err(error(source.to_string())),
            Err(other) => Err(error(other.to_string())),
            Ok(bytes) => Self::parse(&bytes).map(Some).map_err(error),
        }
    }
}

/// Whether the shapes in a folder were placed by `beo align`.
pub fn is_placed(folder: &Path) -> Result<bool, AlignmentFileError> {
    Ok(Alignment::of_folder(folder)?.is_some())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_reads_back_and_what_is_broken_is_named() {
        let file = AlignedFile {
            input: "a.obj".into(),
            output: "a.off".into(),
            rotation_xyzw: [0.0, 0.0, 0.6, 0.8],
            scale: 0.1,
            translation: [0.1, -0.2, 1.0 / 3.0],
        };
        let class = AlignedClass { entropy_before: 3.0, entropy_normalised: 2.0, entropy_after: 1.0, files: vec![file] };
        let alignment = Alignment::new(40, BTreeMap::from([("plier".to_owned(), class)]));
        let text = serde_json::to_string(&alignment).unwrap();
        assert_eq!(Alignment::parse(text.as_bytes()), Ok(alignment));

        let folder = tempfile::tempdir().unwrap();
        assert!(!is_placed(folder.path()).unwrap());
        let path = folder.path().join(ALIGNMENT_FILE);
        let message = |text: &str| {
            std::fs::write(&path, text).unwrap();
            is_placed(folder.path()).unwrap_err().to_string()
        };
        for (text, part) in [
            ("", "EOF"),
            ("{\"format\": \"beo alignment\", \"version\": 2}", "version 2, where 1 is read"),
            ("{\"format\": \"other\", \"version\": 1}", "format `other`"),
            (&text[..text.len() - 2], "EOF"),
            (&text.replace("\"scale\":0.1", "\"scale\":null"), "invalid type"),
        ] {
            let message = message(text);
            assert!(message.contains("alignment.json: ") && message.contains(part) && message.contains("align them anew"), "{message}");
        }
        std::fs::write(&path, text).unwrap();
        assert!(is_placed(folder.path()).unwrap());
    }
}
