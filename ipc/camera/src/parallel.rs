//! A grid carved by all threads, where the feature `parallel` is on.

use crate::{Carver, GridError};
#[cfg(feature = "parallel")]
use rayon::prelude::*;

/// As [`Carver::carve`], its layers on all threads: which thread takes one does not change the result.
pub fn carve(carver: &Carver<'_>, voxels: &mut [u8]) -> Result<(), GridError> {
    let expected = carver.grid.voxels();
    if voxels.len() != expected {
        return Err(GridError::Length { found: voxels.len(), expected });
    }
    #[cfg(feature = "parallel")]
    let layers = voxels.par_chunks_exact_mut(carver.layer());
    #[cfg(not(feature = "parallel"))]
    let layers = voxels.chunks_exact_mut(carver.layer());
    layers.enumerate().for_each(|(i, layer)| carver.carve_layer(i, layer));
    Ok(())
}
