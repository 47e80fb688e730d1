//! How much memory a model takes, so that it is asked for before it is used: without it, the system would end some process, perhaps this one,
//! in the middle.

use super::PerceiveError;
use super::basis::projection::ColumnSums;
use super::camera::CameraScores;
use super::densities::whitening::Whitening;
use super::evidence::subspace::ClassSubspace;
use crate::memory::Available;
use crate::model::{Outline, levels_of};
use std::path::Path;

/// Bytes that [`super::Perceiver::new`] derives from a model: prefix sums of W', class bases over voxels with their Gram matrices, factors
/// of the hull densities; of one with smaller grids, those of the grids.
pub fn derived_bytes(outline: &Outline) -> usize {
    let Outline { metadata, rank, levels, .. } = outline;
    let (dims, views, m) = (metadata.dims, metadata.settings.views.len(), metadata.classes.len());
    let densities = views * (m + 1) * Whitening::bytes(*rank);
    if is_read_in_place(outline) {
        return densities + levels.iter().map(derived_bytes).sum::<usize>();
    }
    let classes: usize = metadata.classes.iter().map(|c| ClassSubspace::bytes(dims, c.basis_size)).sum();
    // At most as many features as the training learns.
    let cameras = if metadata.settings.camera_elevations_deg.is_empty() { 0 } else { CameraScores::bytes(64) };
    classes + ColumnSums::bytes(dims, *rank) + densities + cameras
}

/// Bytes that one [`super::Workspace`] and its answers take at most: observations, the voxels of them, and completions.
pub fn workspace_bytes(outline: &Outline) -> usize {
    let voxels = outline.metadata.dims.voxels();
    // Of a voxel: where it comes from in a turned grid (4 bytes), a completion that is being turned (2), and bits of observations.
    voxels * 7 + outline.levels.iter().map(workspace_bytes).sum::<usize>()
}

/// Whether W' is read where it lies, without tables made of it.
fn is_read_in_place(outline: &Outline) -> bool {
    !levels_of(outline.metadata.dims).is_empty()
}

/// Fails if fewer bytes are available than are needed.
pub(super) fn require(path: &Path, needed: u64, available: Option<Available>) -> Result<(), PerceiveError> {
    match available {
        Some(Available { bytes, limit }) if bytes < needed => {
            Err(PerceiveError::Memory { path: path.to_owned(), needed, available: bytes, limit })
        }
        _ => Ok(()),
    }
}
