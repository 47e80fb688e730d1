//! Errors of model files.

use super::FORMAT_VERSION;
use std::path::PathBuf;

/// A model file cannot be used or written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ModelError {
    /// The file cannot be read or written.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The system's own message.
        source: std::io::Error,
    },
    /// The file is not a model, or is damaged.
    #[error("{}: not a usable model: {reason}; train it again or fetch a fresh copy", path.display())]
    Invalid {
        /// The file.
        path: PathBuf,
        /// The fault.
        reason: String,
    },
    /// There is no room for the file.
    #[error("{}: a model of about {needed} bytes does not fit there, {free} are free: free some, or write it elsewhere", path.display())]
    NoRoom {
        /// The file.
        path: PathBuf,
        /// Bytes it would have.
        needed: u64,
        /// Bytes that are free.
        free: u64,
    },
    /// The file was written in another format.
    #[error("{}: model format {found}, this program reads format {FORMAT_VERSION}: train the model again with this version", path.display())]
    Format {
        /// The file.
        path: PathBuf,
        /// Its format.
        found: u64,
    },
}
