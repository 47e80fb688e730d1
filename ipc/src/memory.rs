//! Is there room in POSIX shared memory? A full /dev/shm is not an error at creation but a bus error at the first write.

use crate::error::OpenError;

/// Where POSIX shared memory lies on Linux.
pub const SHARED_MEMORY_DIR: &str = "/dev/shm";

/// The bytes of a chunk beside its payload: iceoryx2's header, ours (at most 320 bytes), and rounding up.
const CHUNK_OVERHEAD: u64 = 512;

/// The bytes of a publisher beside its chunks: management, and the connections to its readers.
const PUBLISHER_OVERHEAD: u64 = 256 * 1024;

/// Shared memory of a process that joins an instance, beside its publishers: its connections to the others and its wake-ups, of which each
/// begins a page. A subscriber was seen to take 16 kB, a caller 28 kB.
pub(crate) const MEMBER_BYTES: u64 = 64 * 1024;

/// Bytes of shared memory of a publisher with `chunks` chunks of `payload` bytes; rounded up, so that what it says is enough is enough.
pub(crate) fn publisher_bytes(chunks: usize, payload: usize) -> u64 {
    (chunks as u64).saturating_mul(payload as u64 + CHUNK_OVERHEAD).saturating_add(PUBLISHER_OVERHEAD)
}

/// Fails unless `needed` bytes are free in shared memory.
pub fn require_shared_memory(needed: u64) -> Result<(), OpenError> {
    require_in(SHARED_MEMORY_DIR, needed)
}

fn require_in(place: &str, needed: u64) -> Result<(), OpenError> {
    let statistics = rustix::fs::statvfs(place).map_err(|error| OpenError::Failed { what: place.to_owned(), cause: error.to_string() })?;
    let available = statistics.f_bavail.saturating_mul(statistics.f_frsize);
    if available < needed {
        return Err(OpenError::NotEnoughSharedMemory { place: place.to_owned(), needed, available });
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn too_little_shared_memory_is_said_with_both_sizes() {
        require_shared_memory(1).unwrap();
        let error = require_shared_memory(u64::MAX).unwrap_err();
        let OpenError::NotEnoughSharedMemory { needed, available, .. } = &error else { panic!("{error}") };
        assert_eq!(*needed, u64::MAX);
        assert!(*available > 0);
        let text = error.to_string();
        assert!(text.contains(&needed.to_string()) && text.contains(&available.to_string()) && text.contains("/dev/shm"), "{text}");
    }

    #[test]
    fn a_missing_directory_is_an_error_that_names_it() {
        let error = require_in("/nonexistent-shared-memory", 1).unwrap_err();
        assert!(error.to_string().contains("/nonexistent-shared-memory"), "{error}");
    }
}
