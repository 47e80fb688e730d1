//! Reasons why a query cannot be answered.

use crate::grid::Dims;
use crate::linear::LinearError;
use crate::model::{Damaged, ModelError};
use std::path::PathBuf;

/// An observation or a model cannot be used for a query.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PerceiveError {
    /// The grid has another size than the model's.
    #[error(
        "the observation is a grid of {found}, the model was trained for {expected}: send grids of that size, or train with --resolution"
    )]
    Dims {
        /// Size of the observation.
        found: Dims,
        /// Size that the model answers.
        expected: Dims,
    },
    /// Pose, size or place are asked for, and the model was learned without what they are searched with.
    #[error("the model was learned for known poses alone: ask with pose, size and place known, or train with poses")]
    KnownPoseOnly,
    /// A matrix of the model cannot be factorised.
    #[error("the model cannot be used: {0}")]
    Model(#[from] LinearError),
    /// The model file cannot be used.
    #[error(transparent)]
    File(#[from] ModelError),
    /// A part of the model file that was read for the first time is damaged.
    #[error(transparent)]
    Damaged(#[from] Damaged),
    /// There is too little memory for the model.
    #[error(
        "{}: the model needs about {} MB of memory, {limit} has {} MB left: end other processes, or train with a lower --resolution or --most",
        path.display(), needed.div_ceil(MB), available / MB
    )]
    Memory {
        /// The file.
        path: PathBuf,
        /// Bytes that loading and preparing it take.
        needed: u64,
        /// Bytes that may be taken.
        available: u64,
        /// Who allows no more.
        limit: &'static str,
    },
    /// More memory is needed than was allowed.
    #[error("{}: the model needs about {} MB of memory, {} MB are allowed: allow more, or train with a lower --resolution", path.display(), needed.div_ceil(MB), most / MB)]
    Bound {
        /// The file.
        path: PathBuf,
        /// Bytes that loading and preparing it take.
        needed: u64,
        /// Bytes that were allowed.
        most: u64,
    },
}

const MB: u64 = 1_000_000;
