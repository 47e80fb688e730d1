//! Errors of reading shapes: what was wrong, where, and what to do.

use beo_core::grid::{Dims, DimsError, ObservationError};
use std::path::PathBuf;

/// The content of a file is not what its format promises. Without the file's name: see [`ReadError`].
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum FormatError {
    /// A line of a text file is wrong.
    #[error("{format}, line {line}: {problem}")]
    Line {
        /// Name of the format.
        format: &'static str,
        /// The first wrong line, counted from 1.
        line: usize,
        /// The fault, and what was expected.
        problem: String,
    },
    /// A byte of a binary file is wrong.
    #[error("{format}, byte {byte}: {problem}")]
    Byte {
        /// Name of the format.
        format: &'static str,
        /// Where it is, counted from 0.
        byte: usize,
        /// The fault, and what was expected.
        problem: String,
    },
    /// The file as a whole is wrong.
    #[error("{format}: {problem}")]
    File {
        /// Name of the format.
        format: &'static str,
        /// The fault, and what was expected.
        problem: String,
    },
    /// The mesh in the file cannot be used.
    #[error("{0}")]
    Mesh(#[from] super::MeshError),
    /// The grid in the file is too small or too large.
    #[error("{0}")]
    Dims(#[from] DimsError),
    /// The grid in the file holds something that is not a voxel code.
    #[error("{0}")]
    Observation(#[from] ObservationError),
}

/// An `alignment.json` that cannot be used.
#[derive(Debug, thiserror::Error)]
#[error("{}: {problem}; it says that the shapes beside it were placed by `beo align`: align them anew, or remove it to have each shape scaled by its own longest side", path.display())]
pub struct AlignmentFileError {
    /// The file.
    pub path: PathBuf,
    /// The fault.
    pub problem: String,
}

/// A file could not be read as a shape. One line, with the file's name.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReadError {
    /// The file cannot be opened or read.
    #[error("cannot read {}: {source}", path.display())]
    Open {
        /// The file.
        path: PathBuf,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// The path is not a file: a folder, a pipe, a device.
    #[error("{} is not a regular file", path.display())]
    NotAFile {
        /// The path.
        path: PathBuf,
    },
    /// The file is larger than any shape or image should be.
    #[error("{} has {bytes} bytes, more than the {limit} that are read: is it the right file? A mesh can be simplified", path.display())]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// Its size.
        bytes: u64,
        /// The most that is read.
        limit: u64,
    },
    /// The extension is not that of a known format.
    #[error("{}: unknown kind of file; known are {known}", path.display())]
    Extension {
        /// The file.
        path: PathBuf,
        /// The extensions that would do here.
        known: &'static str,
    },
    /// The content is not what the format promises.
    #[error("{}: {source}", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// The fault, and where it is.
        source: FormatError,
    },
    /// A voxel file has another size than was asked for.
    #[error("{} is a grid of {found} voxels where {expected} are needed: --resample brings it to that size, or use another --resolution", path.display())]
    OtherDims {
        /// The file.
        path: PathBuf,
        /// Its size.
        found: Dims,
        /// The size that was asked for.
        expected: Dims,
    },
    /// A point cloud, where only shapes with an inside are taken.
    #[error("{} is a point cloud of {points} points without triangles: --point-clouds takes the voxels that hold one, or make a mesh of it", path.display())]
    PointCloud {
        /// The file.
        path: PathBuf,
        /// Its points.
        points: usize,
    },
    /// A point cloud whose holes are to be closed.
    #[error("{} is a point cloud: without a surface it has no holes to close; --close hull fills what its points surround", path.display())]
    NoSurface {
        /// The file.
        path: PathBuf,
    },
    /// An observation without a filled voxel, though some are empty and some unknown.
    #[error(
        "{} holds the values 0 and 255 alone: of an observation these are empty and unknown, and nothing is filled; of a picture's 0 and 255 \
         make a shape with numpy.save(path, (array > 0)) and leave out --view none",
        path.display()
    )]
    NothingFilled {
        /// The file.
        path: PathBuf,
    },
    /// The folder of the file has an `alignment.json` that cannot be used.
    #[error("{0}")]
    Alignment(#[from] AlignmentFileError),
}

impl ReadError {
    /// The error without the file's name where it starts with that, for lines that have named it.
    pub fn without_path(&self) -> String {
        match self {
            Self::Malformed { source, .. } => source.to_string(),
            Self::Open { source, .. } => format!("cannot be read: {source}"),
            Self::NotAFile { .. } => "not a regular file".into(),
            other => {
                let text = other.to_string();
                let path = match other {
                    Self::TooLarge { path, .. }
                    | Self::Extension { path, .. }
                    | Self::OtherDims { path, .. }
                    | Self::PointCloud { path, .. }
                    | Self::NoSurface { path }
                    | Self::NothingFilled { path } => path.display().to_string(),
                    _ => return text,
                };
                text.strip_prefix(&path).map_or(text.clone(), |rest| rest.trim_start_matches([':', ' ']).to_owned())
            }
        }
    }
}
