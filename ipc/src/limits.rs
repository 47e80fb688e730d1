//! The fixed sizes of the messages and the bounds of what may be asked for.

/// Most classes a model can have; [`crate::Percept::posterior`] has this many entries.
pub const MAX_CLASSES: usize = 64;

/// Most pose hypotheses in one percept.
pub const MAX_HYPOTHESES: usize = 8;

/// Bytes of a class name or frame name in a message: UTF-8, padded with NUL, not necessarily NUL-terminated.
pub const NAME_LEN: usize = 32;

/// Bytes of the explanation that accompanies a refused observation: UTF-8, padded with NUL.
pub const EXPLANATION_LEN: usize = 128;

/// Fewest voxels along an axis.
pub const MIN_DIM: u32 = 8;

/// Most voxels along an axis.
pub const MAX_DIM: u32 = 256;

/// Most processes that can write observations at the same time, unless the daemon was configured otherwise.
pub const MAX_PRODUCERS: usize = 16;

/// Most processes that can read percepts at the same time, unless the daemon was configured otherwise.
pub const MAX_SUBSCRIBERS: usize = 16;

/// The number of voxels of a grid, or `None` if an axis is outside [`MIN_DIM`]`..=`[`MAX_DIM`].
pub const fn voxel_count(dims: [u32; 3]) -> Option<usize> {
    let mut product: usize = 1;
    let mut axis = 0;
    while axis < 3 {
        if dims[axis] < MIN_DIM || dims[axis] > MAX_DIM {
            return None;
        }
        // At most 256³ = 2²⁴: no overflow, even where usize has 32 bits.
        product *= dims[axis] as usize;
        axis += 1;
    }
    Some(product)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dims_outside_the_limits_have_no_voxel_count() {
        assert_eq!(voxel_count([8, 9, 10]), Some(720));
        assert_eq!(voxel_count([256, 256, 256]), Some(1 << 24));
        for dims in [[0, 30, 30], [7, 30, 30], [30, 257, 30], [30, 30, u32::MAX], [u32::MAX; 3], [1 << 22, 1 << 22, 1 << 22]] {
            assert_eq!(voxel_count(dims), None, "{dims:?}");
        }
    }
}
