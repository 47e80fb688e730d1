//! A large part of a model file as it is read piece by piece: each piece is checked against its checksum once, and the pages that stay
//! in memory are bounded.

use super::mapping::{self, Mapped};
use half::f16;
use std::ops::Range;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

/// Bytes of a piece.
pub const PIECE: usize = 64 << 10;

/// Bytes that become resident for each byte of a piece, at most or so: the system maps what lies about it too.
const MAPPED_BESIDE: usize = 3;

/// A part of a model file is not what was written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum Damaged {
    /// It does not match its checksum.
    #[error(
        "the model file is damaged: {PIECE} bytes from byte {offset} of its basis on do not match their checksum; train it again or fetch a \
         fresh copy"
    )]
    Checksum {
        /// Where, in bytes from the start of the tensor.
        offset: usize,
    },
    /// It is as it was written, and useless.
    #[error(
        "the model cannot be used: {PIECE} bytes from byte {offset} of its basis on hold a value that is not a number; train it again or \
         fetch a fresh copy"
    )]
    NotANumber {
        /// Where, in bytes from the start of the tensor.
        offset: usize,
    },
    /// The file was rewritten or cut after it was mapped.
    #[error("the model file was changed while it was in use: replace it by renaming another over it, as `mv` does, and reload it")]
    Changed,
}

/// Checksums by piece, and which have been compared.
#[derive(Debug)]
pub struct FirstTouch {
    checksums: Vec<u32>,
    checked: Vec<AtomicBool>,
    /// Pieces that were touched since pages were last given back, how many they are, and how many may be.
    touched: Vec<AtomicBool>,
    count: AtomicUsize,
    most: AtomicUsize,
}

/// CRC-32 of every piece.
pub fn checksums(bytes: &[u8]) -> Vec<u32> {
    bytes.chunks(PIECE).map(crc32fast::hash).collect()
}

/// Whether bytes are half-precision numbers, little-endian, that are finite.
fn is_finite(bytes: &[u8]) -> bool {
    bytes.chunks_exact(2).all(|pair| f16::from_le_bytes([pair[0], pair[1]]).is_finite())
}

impl FirstTouch {
    /// Nothing has been read.
    pub fn new(checksums: Vec<u32>) -> Self {
        let none = || checksums.iter().map(|_| AtomicBool::new(false)).collect();
        Self { checked: none(), touched: none(), count: AtomicUsize::new(0), most: AtomicUsize::new(usize::MAX), checksums }
    }

    /// Bounds the pages that stay in memory.
    pub fn bound(&self, bytes: usize) {
        self.most.store(bytes / (MAPPED_BESIDE * PIECE), Ordering::Relaxed);
    }

    /// Checks the pieces that hold the bytes `range` of `tensor`, which lies in `file`, unless they have been.
    pub fn touch(&self, file: &Mapped, tensor: &Range<usize>, range: Range<usize>) -> Result<(), Damaged> {
        let bytes = &file[tensor.clone()];
        let most = self.most.load(Ordering::Relaxed);
        for piece in range.start / PIECE..range.end.div_ceil(PIECE) {
            // Two threads may both check a piece: the outcome is the same.
            if !self.checked[piece].load(Ordering::Acquire) {
                let within = piece * PIECE..((piece + 1) * PIECE).min(bytes.len());
                // Before, as what was cut raises a signal; after, as what was read would be of another file.
                if !file.is_unchanged() {
                    return Err(Damaged::Changed);
                }
                let (offset, read) = (within.start, &bytes[within]);
                let (checksum, finite) = (crc32fast::hash(read), is_finite(read));
                if !file.is_unchanged() {
                    return Err(Damaged::Changed);
                }
                if checksum != self.checksums[piece] {
                    return Err(Damaged::Checksum { offset });
                }
                if !finite {
                    return Err(Damaged::NotANumber { offset });
                }
                self.checked[piece].store(true, Ordering::Release);
            }
            if most < usize::MAX / (MAPPED_BESIDE * PIECE)
                && !self.touched[piece].swap(true, Ordering::Relaxed)
                && self.count.fetch_add(1, Ordering::Relaxed) >= most
            {
                // What another thread is reading comes back from the file as it goes on.
                mapping::give_back(file, tensor.clone());
                self.touched.iter().for_each(|touched| touched.store(false, Ordering::Relaxed));
                self.count.store(0, Ordering::Relaxed);
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mapped(bytes: &[u8]) -> (tempfile::NamedTempFile, Mapped) {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), bytes).unwrap();
        let map = mapping::map(std::fs::File::open(file.path()).unwrap().into()).unwrap();
        (file, map)
    }

    #[test]
    fn what_is_cut_rewritten_or_no_number_is_found_when_it_is_touched() {
        let mut bytes = vec![0; 4 * PIECE];
        // An infinity, little-endian, as if it had been written.
        bytes[2 * PIECE + 6..2 * PIECE + 8].copy_from_slice(&[0x00, 0x7c]);
        let tensor = 0..bytes.len();
        let (file, map) = mapped(&bytes);
        let first_touch = FirstTouch::new(checksums(&bytes));
        assert_eq!(first_touch.touch(&map, &tensor, 0..PIECE), Ok(()));
        assert_eq!(first_touch.touch(&map, &tensor, 2 * PIECE..3 * PIECE), Err(Damaged::NotANumber { offset: 2 * PIECE }));
        let writer = std::fs::OpenOptions::new().write(true).open(file.path()).unwrap();
        writer.set_len(PIECE as u64).unwrap();
        assert_eq!(first_touch.touch(&map, &tensor, 3 * PIECE..4 * PIECE), Err(Damaged::Changed));
        assert_eq!(first_touch.touch(&map, &tensor, 0..PIECE), Ok(()), "what was read before is not looked at again");
    }

    #[test]
    fn what_is_damaged_is_found_when_it_is_touched_and_not_before() {
        let mut bytes: Vec<u8> = (0..5 * PIECE + 100).map(|i| (i * 7919 % 121) as u8).collect();
        // The tensor lies behind other bytes.
        let tensor = 10..bytes.len();
        let checksums = checksums(&bytes[tensor.clone()]);
        assert_eq!(checksums.len(), 6);
        bytes[10 + 3 * PIECE + 5] ^= 1;
        let (_file, map) = mapped(&bytes);
        let first_touch = FirstTouch::new(checksums);
        for range in [0..0, 0..1, 0..3 * PIECE, 4 * PIECE..5 * PIECE + 90] {
            assert_eq!(first_touch.touch(&map, &tensor, range), Ok(()));
        }
        let damaged = Err(Damaged::Checksum { offset: 3 * PIECE });
        assert_eq!(first_touch.touch(&map, &tensor, 3 * PIECE - 1..3 * PIECE + 1), damaged);
        assert_eq!(first_touch.touch(&map, &tensor, 4 * PIECE - 1..4 * PIECE), damaged);
    }

    #[test]
    fn pages_beyond_the_bound_are_given_back_and_come_again() {
        let bytes: Vec<u8> = (0..64 * PIECE).map(|i| ((i / PIECE * 3 + i) % 121) as u8).collect();
        let (_file, map) = mapped(&bytes);
        let tensor = 0..bytes.len();
        let first_touch = FirstTouch::new(checksums(&bytes));
        first_touch.bound(8 * MAPPED_BESIDE * PIECE);
        for touched in 0..128 {
            let piece = touched % 64;
            // The ninth since the last time gives all back; what has been touched counts once.
            for _ in 0..1 + usize::from(touched % 9 < 8) {
                first_touch.touch(&map, &tensor, piece * PIECE..(piece + 1) * PIECE).unwrap();
                assert_eq!(first_touch.count.load(Ordering::Relaxed), (touched + 1) % 9, "{touched}");
            }
            assert_eq!(map[piece * PIECE + 9], bytes[piece * PIECE + 9]);
        }
    }
}
