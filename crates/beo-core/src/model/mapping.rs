//! Mapping a model file into memory, so that processes share it and only touched pages are resident.
#![allow(unsafe_code)]

use memmap2::Mmap;
use std::fs::File;
use std::ops::Range;

/// Maps a whole file for reading.
pub fn map(file: &File) -> std::io::Result<Mmap> {
    // SAFETY: the map is only read, as plain integers and floats for which every bit pattern is valid, and what is read is
    // checked against checksums. A model file that is truncated by another process while mapped raises SIGBUS, as with any
    // mapped file: models are replaced by renaming a new file over the old one (as `save` does), never rewritten in place.
    unsafe { Mmap::map(file) }
}

/// Has the system map small pages only, so that what is not read does not become resident beside what is; where it knows no such advice,
/// it maps as it likes.
pub fn map_small_pages(map: &Mmap) {
    #[cfg(target_os = "linux")]
    let _ = map.advise(memmap2::Advice::NoHugePage);
    #[cfg(not(target_os = "linux"))]
    let _ = map;
}

/// Takes the pages of a part of a map out of this process's memory; what is read later comes from the file again. Where the system knows
/// no such advice, they stay.
pub fn give_back(map: &Mmap, range: Range<usize>) {
    // SAFETY: the map is of a file and read-only, so its pages hold nothing that the file does not: dropping them changes no value.
    #[cfg(unix)]
    let _ = unsafe { map.unchecked_advise_range(memmap2::UncheckedAdvice::DontNeed, range.start, range.len()) };
    #[cfg(not(unix))]
    let _ = (map, range);
}
