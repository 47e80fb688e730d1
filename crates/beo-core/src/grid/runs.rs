//! Runs: the maximal vertical stretches of set voxels. A sum over many voxels becomes two rows of prefix sums per run.

use super::Dims;
use fixedbitset::FixedBitSet;
use std::ops::Range;

const WORD: usize = usize::BITS as usize;

/// Calls `run(start, end)` for every maximal stretch `start..end` of set bits inside one column, columns in order.
///
/// `bits` has one bit per voxel of `dims`.
#[inline]
pub fn for_each_run(bits: &FixedBitSet, dims: Dims, columns: Range<usize>, mut run: impl FnMut(usize, usize)) {
    let words = bits.as_slice();
    for column in columns {
        let (mut at, end) = (column * dims.z(), (column + 1) * dims.z());
        loop {
            let start = next(words, at, end, 0);
            if start == end {
                break;
            }
            at = next(words, start, end, usize::MAX);
            run(start, at);
        }
    }
}

/// The first index in `at..end` whose bit differs from that of `flip`, or `end`.
fn next(words: &[usize], at: usize, end: usize, flip: usize) -> usize {
    let mut index = at;
    while index < end {
        let rest = (words[index / WORD] ^ flip) >> (index % WORD);
        if rest != 0 {
            return (index + rest.trailing_zeros() as usize).min(end);
        }
        index += WORD - index % WORD;
    }
    end
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn runs_cover_exactly_the_set_bits_and_stay_in_their_column(voxels in prop::collection::vec(prop::bool::weighted(0.7), 8 * 9 * 70)) {
            let dims = Dims::new(8, 9, 70).unwrap();
            let bits: FixedBitSet = voxels.iter().enumerate().filter(|(_, set)| **set).map(|(i, _)| i).collect();
            let mut bits = bits;
            bits.grow(dims.voxels());
            let mut covered = vec![false; voxels.len()];
            for_each_run(&bits, dims, 0..dims.columns(), |start, end| {
                assert!(start < end && start / 70 == (end - 1) / 70);
                assert!(start % 70 == 0 || !voxels[start - 1], "runs are maximal");
                assert!(end % 70 == 0 || !voxels[end], "runs are maximal");
                covered[start..end].fill(true);
            });
            prop_assert_eq!(covered, voxels);
        }
    }
}
