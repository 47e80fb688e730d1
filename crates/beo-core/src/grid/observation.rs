//! Observation of one object: every voxel is filled, empty or unknown.

use super::{Dims, Occupancy};
use fixedbitset::FixedBitSet;

/// Voxel code: known to be empty.
pub const EMPTY: u8 = 0;
/// Voxel code: known to be filled.
pub const FILLED: u8 = 1;
/// Voxel code: not seen.
pub const UNKNOWN: u8 = 255;

/// A partial voxel grid (w_q and V_q of eq. 13), as two bit sets in C order `[x][y][z]`.
///
/// A filled voxel is always known.
#[derive(Debug, PartialEq, Eq)]
pub struct Observation {
    dims: Dims,
    known: FixedBitSet,
    filled: FixedBitSet,
}

impl Clone for Observation {
    fn clone(&self) -> Self {
        Self { dims: self.dims, known: self.known.clone(), filled: self.filled.clone() }
    }

    /// Reuses the memory of what it replaces.
    fn clone_from(&mut self, source: &Self) {
        self.dims = source.dims;
        self.known.clone_from(&source.known);
        self.filled.clone_from(&source.filled);
    }
}

/// The lowest bit of each of eight bytes.
const LOWEST_BITS: u64 = 0x0101_0101_0101_0101;

/// The lowest bits of eight bytes, side by side; their other bits are 0.
const fn gathered(bytes: u64) -> u8 {
    // Bit 8 i, times 2^(56 - 7 i), is bit 56 + i; no other product reaches the highest byte.
    (bytes.wrapping_mul(0x0102_0408_1020_4080) >> 56) as u8
}

/// Bytes that are not an observation.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ObservationError {
    /// The number of bytes is not the number of voxels.
    #[error("{found} bytes for a grid of {dims}, which has {} voxels of one byte each", dims.voxels())]
    Length {
        /// Bytes given.
        found: usize,
        /// Size of the grid.
        dims: Dims,
    },
    /// A byte is not a voxel code.
    #[error("voxel ({}, {}, {}) holds {code}: write 0 for empty, 1 for filled, 255 for unknown", voxel[0], voxel[1], voxel[2])]
    Code {
        /// The first such voxel (i, j, k).
        voxel: [usize; 3],
        /// Its value.
        code: u8,
    },
}

impl Observation {
    /// An observation in which every voxel is unknown.
    pub fn unknown(dims: Dims) -> Self {
        Self { dims, known: FixedBitSet::with_capacity(dims.voxels()), filled: FixedBitSet::with_capacity(dims.voxels()) }
    }

    /// A complete object, every voxel known.
    pub fn complete(object: &Occupancy) -> Self {
        let mut known = FixedBitSet::with_capacity(object.dims().voxels());
        known.insert_range(..);
        Self { dims: object.dims(), known, filled: object.bits().clone() }
    }

    /// The observation behind a published completion, one byte per voxel each: its certain voxels, 0 or 255 without deviation.
    pub fn of_completion(dims: Dims, occupancy: &[u8], deviation: &[u8]) -> Self {
        assert_eq!((occupancy.len(), deviation.len()), (dims.voxels(), dims.voxels()), "one byte per voxel each");
        let mut observation = Self::unknown(dims);
        for (index, (occupancy, deviation)) in occupancy.iter().zip(deviation).enumerate() {
            if *deviation == 0 && (*occupancy == 0 || *occupancy == 255) {
                observation.set(index, *occupancy == 255);
            }
        }
        observation
    }

    /// An observation with these known voxels, and these of them filled; one bit per voxel each.
    pub fn from_parts(dims: Dims, known: FixedBitSet, filled: FixedBitSet) -> Self {
        assert_eq!((known.len(), filled.len()), (dims.voxels(), dims.voxels()), "one bit per voxel");
        debug_assert!(filled.is_subset(&known), "what is filled is known");
        Self { dims, known, filled }
    }

    /// Reads one byte per voxel: [`EMPTY`], [`FILLED`] or [`UNKNOWN`], C order.
    pub fn from_bytes(dims: Dims, bytes: &[u8]) -> Result<Self, ObservationError> {
        let mut observation = Self::unknown(dims);
        observation.read(bytes)?;
        Ok(observation)
    }

    /// Replaces the content by `bytes`, without allocating; each byte is read once, so a writer that shares them cannot
    /// change what was checked. On an error the content is unspecified.
    pub fn read(&mut self, bytes: &[u8]) -> Result<(), ObservationError> {
        if bytes.len() != self.dims.voxels() {
            return Err(ObservationError::Length { found: bytes.len(), dims: self.dims });
        }
        const WORD: usize = usize::BITS as usize;
        let words = self.known.as_mut_slice().iter_mut().zip(self.filled.as_mut_slice());
        for (w, ((known, filled), chunk)) in words.zip(bytes.chunks(WORD)).enumerate() {
            let mut copy = [UNKNOWN; WORD];
            copy[..chunk.len()].copy_from_slice(chunk);
            let (mut unknown, mut marked, mut wrong) = (0, 0, 0);
            for (eight, codes) in copy.as_chunks::<8>().0.iter().enumerate() {
                let codes = u64::from_le_bytes(*codes);
                // 255 has both of these bits, 1 the first, 0 none; and what is left of another code is not nothing.
                let (first, last) = (codes & LOWEST_BITS, (codes >> 7) & LOWEST_BITS);
                wrong |= codes ^ ((last * 255) | first);
                marked |= (gathered(first) as usize) << (8 * eight);
                unknown |= (gathered(last) as usize) << (8 * eight);
            }
            if wrong != 0 {
                let bit = copy.iter().position(|code| ![EMPTY, FILLED, UNKNOWN].contains(code)).unwrap_or(0);
                return Err(ObservationError::Code { voxel: self.dims.coordinates(w * WORD + bit), code: copy[bit] });
            }
            (*known, *filled) = (!unknown, marked & !unknown);
        }
        Ok(())
    }

    /// Writes one byte per voxel. `bytes` has one element per voxel.
    pub fn write(&self, bytes: &mut [u8]) {
        assert_eq!(bytes.len(), self.dims.voxels(), "one byte per voxel");
        let words = self.known.as_slice().iter().zip(self.filled.as_slice());
        for (bytes, (known, filled)) in bytes.chunks_mut(usize::BITS as usize).zip(words) {
            for (bit, byte) in bytes.iter_mut().enumerate() {
                // 255 where the bit of `known` is not set; `filled` is then not set either.
                *byte = ((known >> bit & 1) as u8).wrapping_sub(1) | (filled >> bit & 1) as u8;
            }
        }
    }

    /// The code of the voxel at `index`.
    pub fn code(&self, index: usize) -> u8 {
        match (self.known.contains(index), self.filled.contains(index)) {
            (false, _) => UNKNOWN,
            (true, false) => EMPTY,
            (true, true) => FILLED,
        }
    }

    /// Marks the voxel at `index` as known.
    pub fn set(&mut self, index: usize, filled: bool) {
        self.known.insert(index);
        self.filled.set(index, filled);
    }

    /// Forgets what is known of a voxel.
    pub fn set_unknown(&mut self, index: usize) {
        self.known.remove(index);
        self.filled.remove(index);
    }

    /// Marks a range of voxels as known to be empty.
    pub fn set_empty(&mut self, voxels: std::ops::Range<usize>) {
        self.known.insert_range(voxels.clone());
        self.filled.set_range(voxels, false);
    }

    /// Size of the grid.
    pub fn dims(&self) -> Dims {
        self.dims
    }

    /// One bit per voxel, set where the voxel is known (the selection V_q).
    pub fn known(&self) -> &FixedBitSet {
        &self.known
    }

    /// One bit per voxel, set where the voxel is known to be filled.
    pub fn filled(&self) -> &FixedBitSet {
        &self.filled
    }

    /// The bits of known and of filled voxels, to be written; none may be filled that is not known.
    pub(super) fn parts_mut(&mut self) -> (&mut FixedBitSet, &mut FixedBitSet) {
        (&mut self.known, &mut self.filled)
    }

    /// The visual hull: all that is not known to be empty, that is, filled or unknown.
    pub fn hull(&self) -> Occupancy {
        let mut hull = FixedBitSet::with_capacity(self.dims.voxels());
        hull.insert_range(..);
        hull.difference_with(&self.known);
        hull.union_with(&self.filled);
        Occupancy::from_bits(self.dims, hull)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_wrong_code_names_its_voxel() {
        let dims = Dims::new(8, 9, 10).unwrap();
        let mut bytes = vec![EMPTY; dims.voxels()];
        bytes[214] = 2;
        bytes[500] = 254;
        let error = Observation::from_bytes(dims, &bytes).unwrap_err();
        assert_eq!(error, ObservationError::Code { voxel: [2, 3, 4], code: 2 });
        assert_eq!(error.to_string(), "voxel (2, 3, 4) holds 2: write 0 for empty, 1 for filled, 255 for unknown");
    }

    #[test]
    fn every_other_code_is_refused_wherever_it_stands() {
        let dims = Dims::new(8, 9, 11).unwrap();
        for code in 2..=254 {
            for index in (code as usize..dims.voxels()).step_by(101).chain([dims.voxels() - 1]) {
                let mut bytes: Vec<u8> = (0..dims.voxels()).map(|v| [EMPTY, FILLED, UNKNOWN][v % 3]).collect();
                bytes[index] = code;
                let voxel = dims.coordinates(index);
                assert_eq!(Observation::from_bytes(dims, &bytes), Err(ObservationError::Code { voxel, code }));
            }
        }
    }

    #[test]
    fn what_is_certain_in_a_completion_was_observed() {
        let dims = Dims::cube(8).unwrap();
        let (mut occupancy, mut deviation) = (vec![100; 512], vec![9; 512]);
        for (index, (p, sd)) in [(255, 0), (0, 0), (255, 1), (0, 1), (128, 0)].into_iter().enumerate() {
            (occupancy[index], deviation[index]) = (p, sd);
        }
        let observation = Observation::of_completion(dims, &occupancy, &deviation);
        let codes: Vec<u8> = (0..6).map(|index| observation.code(index)).collect();
        assert_eq!(codes, [FILLED, EMPTY, UNKNOWN, UNKNOWN, UNKNOWN, UNKNOWN]);
    }

    #[test]
    fn a_wrong_length_is_refused() {
        let dims = Dims::cube(8).unwrap();
        assert!(matches!(Observation::from_bytes(dims, &[0; 511]), Err(ObservationError::Length { found: 511, .. })));
    }

    proptest! {
        #[test]
        fn bytes_survive_a_round_trip(codes in prop::collection::vec(prop::sample::select(vec![EMPTY, FILLED, UNKNOWN]), 8 * 9 * 11)) {
            let dims = Dims::new(8, 9, 11).unwrap();
            let observation = Observation::from_bytes(dims, &codes).unwrap();
            let mut bytes = vec![7; codes.len()];
            observation.write(&mut bytes);
            prop_assert_eq!(&bytes, &codes);
            prop_assert_eq!(observation.known().count_ones(..), codes.iter().filter(|c| **c != UNKNOWN).count());
            prop_assert_eq!(observation.hull().count(), codes.iter().filter(|c| **c != EMPTY).count());
        }
    }
}
