//! Mapping a model file into memory, so that processes share it and only touched pages are resident.
#![allow(unsafe_code)]

use memmap2::Mmap;
use std::fs::File;

/// Maps a whole file for reading.
pub fn map(file: &File) -> std::io::Result<Mmap> {
    // SAFETY: the map is only read, as plain integers and floats for which every bit pattern is valid, and what is read is
    // checked against checksums. A model file that is truncated by another process while mapped raises SIGBUS, as with any
    // mapped file: models are replaced by renaming a new file over the old one (as `save` does), never rewritten in place.
    unsafe { Mmap::map(file) }
}
