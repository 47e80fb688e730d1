//! Where W' is not zero: what a query needs to read it in place.

use fixedbitset::FixedBitSet;

/// The voxels that any training shape fills, and the Gram matrix of W' over them. Every column of W' is a combination of training shapes,
/// so its rows elsewhere are zero.
#[derive(Clone, Debug, PartialEq)]
pub struct Footprint {
    /// One bit per voxel.
    pub voxels: FixedBitSet,
    /// Gram matrix of [W', 1] over all voxels, as W' is rounded: (a + 1) × (a + 1), the lower triangle, row after row.
    pub gram: Vec<f64>,
}

impl Footprint {
    /// The bits as bytes, least significant bit first; a multiple of eight.
    pub(super) fn bytes(&self) -> Vec<u8> {
        self.voxels.as_slice().iter().flat_map(|word| (*word as u64).to_le_bytes()).collect()
    }

    /// Bytes that [`Self::bytes`] gives for so many voxels.
    pub(super) fn length(voxels: usize) -> usize {
        voxels.div_ceil(64) * 8
    }

    /// The bits of such bytes.
    pub(super) fn bits(voxels: usize, bytes: &[u8]) -> FixedBitSet {
        let words = bytes.as_chunks::<8>().0.iter().map(|word| u64::from_le_bytes(*word) as usize);
        FixedBitSet::with_capacity_and_blocks(voxels, words)
    }
}
