//! Mapping a model file into memory, so that processes share it and only touched pages are resident.
#![allow(unsafe_code)]

use memmap2::Mmap;
use std::fs::{File, Metadata};
use std::ops::{Deref, Range};
use std::os::unix::fs::MetadataExt;
use std::sync::Arc;

/// A mapped file, and what it was when it was mapped.
#[derive(Debug)]
pub struct Mapped {
    map: Mmap,
    file: Arc<File>,
    identity: Identity,
}

/// Length, and when it was last written: in nanoseconds, since the epoch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Identity {
    length: u64,
    written_ns: (i64, i64),
}

impl Identity {
    fn of(metadata: &Metadata) -> Self {
        Self { length: metadata.len(), written_ns: (metadata.mtime(), metadata.mtime_nsec()) }
    }
}

impl Mapped {
    /// Whether the file is as long as it was, and has not been written since.
    pub fn is_unchanged(&self) -> bool {
        self.file.metadata().is_ok_and(|metadata| Identity::of(&metadata) == self.identity)
    }
}

impl Deref for Mapped {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        &self.map
    }
}

/// Maps a whole file for reading.
pub fn map(file: Arc<File>) -> std::io::Result<Mapped> {
    let identity = Identity::of(&file.metadata()?);
    // SAFETY: the map is only read, as plain integers and floats for which every bit pattern is valid, and what is read is
    // checked against checksums. A file that another process cuts while it is mapped raises SIGBUS where it is read, as any mapped
    // file does. Whoever reads a part for the first time asks before and after whether the file has changed, which leaves parts that were
    // read before: models are replaced by renaming a new file over the old one (as `save` does), never rewritten in place. Only the basis
    // of a grid too large to be searched is mapped at all.
    let map = unsafe { Mmap::map(&*file) }?;
    Ok(Mapped { map, file, identity })
}

/// Has the system map small pages only, so that what is not read does not become resident beside what is; where it knows no such advice,
/// it maps as it likes.
pub fn map_small_pages(Mapped { map, .. }: &Mapped) {
    #[cfg(target_os = "linux")]
    let _ = map.advise(memmap2::Advice::NoHugePage);
    #[cfg(not(target_os = "linux"))]
    let _ = map;
}

/// Takes the pages of a part of a map out of this process's memory; what is read later comes from the file again. Where the system knows
/// no such advice, they stay.
pub fn give_back(Mapped { map, .. }: &Mapped, range: Range<usize>) {
    // SAFETY: the map is of a file and read-only, so its pages hold nothing that the file does not: dropping them changes no value.
    #[cfg(unix)]
    let _ = unsafe { map.unchecked_advise_range(memmap2::UncheckedAdvice::DontNeed, range.start, range.len()) };
    #[cfg(not(unix))]
    let _ = (map, range);
}
