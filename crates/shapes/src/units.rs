//! The unit of length in which shapes are given: from it true sizes are learned.

use super::ReadError;
use beo_core::text::printable;
use std::path::Path;

/// The file in a folder of shapes that says their unit: one word, `m`, `cm`, `mm` or `none`.
pub const UNITS_FILE: &str = "units.txt";

/// The unit of the coordinates in mesh files, and of the `scale` of voxel files.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Units {
    /// Not known: no true sizes are learned.
    #[default]
    None,
    /// Metres.
    Metres,
    /// Centimetres.
    Centimetres,
    /// Millimetres.
    Millimetres,
}

/// A `units.txt` that cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum UnitsError {
    /// It says something else.
    #[error("{path}: `{found}` is no unit: write m, cm, mm or none")]
    Unknown {
        /// The file.
        path: String,
        /// Its content.
        found: String,
    },
    /// It cannot be read.
    #[error(transparent)]
    Read(#[from] ReadError),
}

impl Units {
    /// The word for it, as in `units.txt` and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Metres => "m",
            Self::Centimetres => "cm",
            Self::Millimetres => "mm",
        }
    }

    /// The unit that a word names.
    pub fn of(word: &str) -> Option<Self> {
        [Self::None, Self::Metres, Self::Centimetres, Self::Millimetres].into_iter().find(|unit| unit.name() == word)
    }

    /// Metres in one of it, if it is known.
    pub fn metres(self) -> Option<f64> {
        match self {
            Self::None => None,
            Self::Metres => Some(1.0),
            Self::Centimetres => Some(0.01),
            Self::Millimetres => Some(0.001),
        }
    }

    /// Units of the shapes of a folder, as `units.txt` has them; [`Units::None`] where it has none.
    pub fn of_folder(folder: &Path) -> Result<Self, UnitsError> {
        let path = folder.join(UNITS_FILE);
        if !path.exists() {
            return Ok(Self::None);
        }
        let text = String::from_utf8_lossy(&super::read_bytes(&path)?).trim().to_string();
        let shown = || printable(&text).chars().take(20).collect();
        Self::of(&text).ok_or_else(|| UnitsError::Unknown { path: path.display().to_string(), found: shown() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_says_its_unit_or_has_none() {
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(Units::of_folder(folder.path()).unwrap(), Units::None);
        for (text, expected) in [("m\n", Units::Metres), ("cm", Units::Centimetres), (" mm ", Units::Millimetres), ("none\n", Units::None)]
        {
            std::fs::write(folder.path().join(UNITS_FILE), text).unwrap();
            assert_eq!(Units::of_folder(folder.path()).unwrap(), expected);
        }
        std::fs::write(folder.path().join(UNITS_FILE), "inch").unwrap();
        let message = Units::of_folder(folder.path()).unwrap_err().to_string();
        assert!(message.contains("units.txt: `inch` is no unit: write m, cm, mm or none"), "{message}");
    }
}
