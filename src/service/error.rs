//! Why the daemon cannot start or go on.

use beo_core::grid::Dims;
use beo_core::model::ModelError;
use beo_core::perception::PerceiveError;
use beo_ipc::{OpenError, WaitError};
use std::path::PathBuf;

/// The daemon cannot start or go on, or a model cannot be served.
#[derive(Debug, thiserror::Error)]
pub enum ServeError {
    /// The channels cannot be set up.
    #[error(transparent)]
    Open(#[from] OpenError),
    /// The model file cannot be read.
    #[error(transparent)]
    File(#[from] ModelError),
    /// The model cannot be used.
    #[error(transparent)]
    Model(#[from] PerceiveError),
    /// Another model is for other grids than the one that it would replace.
    #[error("{}: the model is for grids of {found}, the daemon's segments are for {served}: restart the daemon with it", path.display())]
    OtherDims {
        /// The model's file.
        path: PathBuf,
        /// Its grids.
        found: Dims,
        /// The grids that are served.
        served: Dims,
    },
    /// The wake-up channel is broken.
    #[error(transparent)]
    Wait(#[from] WaitError),
}
