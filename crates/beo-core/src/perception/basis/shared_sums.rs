//! Sums over the rows of W' that an observation selects.

use fixedbitset::FixedBitSet;

/// Sums over the part of W' that one observation selects; reused from query to query.
#[derive(Clone, Debug, Default)]
pub struct SharedSums {
    /// Gram matrix of [W', 1] over the unknown voxels, packed lower triangle.
    pub unknown: Vec<f64>,
    /// Sum of the rows of [W', 1] over the filled voxels.
    pub filled: Vec<f64>,
    /// Unknown and filled voxels inside the footprint.
    pub(super) unknown_bits: FixedBitSet,
    pub(super) filled_bits: FixedBitSet,
}
