//! A complete object: every voxel is filled or empty. Bit-packed.

use super::Dims;
use fixedbitset::FixedBitSet;

/// A complete object on a grid, one bit per voxel in C order `[x][y][z]`.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Occupancy {
    dims: Dims,
    filled: FixedBitSet,
}

impl Occupancy {
    /// An object without a filled voxel.
    pub fn empty(dims: Dims) -> Self {
        Self { dims, filled: FixedBitSet::with_capacity(dims.voxels()) }
    }

    /// The object whose voxel (i, j, k) is filled where `filled(i, j, k)` holds.
    pub fn from_fn(dims: Dims, mut filled: impl FnMut(usize, usize, usize) -> bool) -> Self {
        let mut object = Self::empty(dims);
        for i in 0..dims.x() {
            for j in 0..dims.y() {
                for k in 0..dims.z() {
                    if filled(i, j, k) {
                        object.fill(i, j, k);
                    }
                }
            }
        }
        object
    }

    /// The object whose filled voxels are the set bits; the set's length must be the number of voxels.
    pub fn from_bits(dims: Dims, filled: FixedBitSet) -> Self {
        assert_eq!(filled.len(), dims.voxels(), "one bit per voxel");
        Self { dims, filled }
    }

    /// Size of the grid.
    pub fn dims(&self) -> Dims {
        self.dims
    }

    /// Whether voxel (i, j, k) is filled; voxels outside the grid are not.
    pub fn is_filled(&self, i: usize, j: usize, k: usize) -> bool {
        i < self.dims.x() && j < self.dims.y() && k < self.dims.z() && self.filled.contains(self.dims.index(i, j, k))
    }

    /// Fills voxel (i, j, k).
    pub fn fill(&mut self, i: usize, j: usize, k: usize) {
        self.filled.insert(self.dims.index(i, j, k));
    }

    /// One bit per voxel, set where filled.
    pub fn bits(&self) -> &FixedBitSet {
        &self.filled
    }

    /// Number of filled voxels.
    pub fn count(&self) -> usize {
        self.filled.count_ones(..)
    }

    /// The box about the filled voxels: lower corner, and upper corner (exclusive); `None` where none is filled.
    pub fn bounds(&self) -> Option<[[usize; 3]; 2]> {
        self.filled.ones().map(|voxel| self.dims.coordinates(voxel)).fold(None, |bounds, at| {
            let [low, high] = bounds.unwrap_or([at; 2]);
            Some([std::array::from_fn(|a| low[a].min(at[a])), std::array::from_fn(|a| high[a].max(at[a] + 1))])
        })
    }

    /// Number of voxels filled in both objects: the inner product of the two binary vectors.
    pub fn overlap(&self, other: &Self) -> usize {
        let pairs = self.filled.as_slice().iter().zip(other.filled.as_slice());
        pairs.map(|(a, b)| (a & b).count_ones() as usize).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn overlap_is_the_inner_product(a in prop::collection::vec(any::<bool>(), 512), b in prop::collection::vec(any::<bool>(), 512)) {
            let dims = Dims::cube(8).unwrap();
            let object = |v: &[bool]| Occupancy::from_fn(dims, |i, j, k| v[dims.index(i, j, k)]);
            let expected = a.iter().zip(&b).filter(|(a, b)| **a && **b).count();
            prop_assert_eq!(object(&a).overlap(&object(&b)), expected);
            prop_assert_eq!(object(&a).count(), a.iter().filter(|v| **v).count());
        }
    }
}
