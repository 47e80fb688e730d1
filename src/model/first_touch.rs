//! A large part of a model file as it is read piece by piece: each piece is checked against its checksum once, and the pages that stay
//! in memory are bounded.

use super::mapping;
use memmap2::Mmap;
use std::ops::Range;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

/// Bytes of a piece.
pub const PIECE: usize = 256 << 10;

/// A part of a model file is not what was written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "the model file is damaged: {PIECE} bytes from byte {offset} of its basis on do not match their checksum; train it again or fetch a fresh copy"
)]
pub struct Damaged {
    /// Where, in bytes from the start of the tensor.
    pub offset: usize,
}

/// Checksums by piece, and which have been compared.
#[derive(Debug)]
pub struct FirstTouch {
    checksums: Vec<u32>,
    checked: Vec<AtomicBool>,
    /// Bytes touched since pages were last given back, and the most.
    touched: AtomicUsize,
    most: AtomicUsize,
}

/// CRC-32 of every piece.
pub fn checksums(bytes: &[u8]) -> Vec<u32> {
    bytes.chunks(PIECE).map(crc32fast::hash).collect()
}

impl FirstTouch {
    /// Nothing has been read.
    pub fn new(checksums: Vec<u32>) -> Self {
        let checked = checksums.iter().map(|_| AtomicBool::new(false)).collect();
        Self { checksums, checked, touched: AtomicUsize::new(0), most: AtomicUsize::new(usize::MAX) }
    }

    /// Bounds the pages that stay in memory.
    pub fn bound(&self, bytes: usize) {
        self.most.store(bytes, Ordering::Relaxed);
    }

    /// Checks the pieces that hold the bytes `range` of `tensor`, which lies in `file`, unless they have been.
    pub fn touch(&self, file: &Mmap, tensor: &Range<usize>, range: Range<usize>) -> Result<(), Damaged> {
        let bytes = &file[tensor.clone()];
        for piece in range.start / PIECE..range.end.div_ceil(PIECE) {
            // Two threads may both check a piece: the outcome is the same.
            if self.checked[piece].load(Ordering::Acquire) {
                continue;
            }
            let within = piece * PIECE..((piece + 1) * PIECE).min(bytes.len());
            if crc32fast::hash(&bytes[within.clone()]) != self.checksums[piece] {
                return Err(Damaged { offset: within.start });
            }
            self.checked[piece].store(true, Ordering::Release);
        }
        let most = self.most.load(Ordering::Relaxed);
        if most < usize::MAX && self.touched.fetch_add(range.len(), Ordering::Relaxed) + range.len() > most {
            self.touched.store(0, Ordering::Relaxed);
            mapping::give_back(file, tensor.clone());
        }
        Ok(())
    }
}
