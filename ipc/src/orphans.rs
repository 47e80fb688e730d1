//! Segments that a process left without a size when it was killed, and which would block everybody else.
//!
//! iceoryx2 makes a segment with `shm_open` (mode 0200) and then `ftruncate`. A process that is killed between the two leaves an empty file
//! in /dev/shm. Who opens it as root, which mode 0200 does not keep from reading, waits for its size for ever: in iceoryx2-cal 0.10.0,
//! `open_impl` in `src/dynamic_storage/posix_shared_memory.rs` (about line 251), the arm for `MappingSizeIsZero` goes round again without a
//! look at the timeout, unlike the arms beside it. The cleanup after dead nodes opens what the dead left, so that creating a node, and all
//! housekeeping, would block in every process.
//!
//! Therefore such files are removed before iceoryx2 cleans up. To do so helps even a process that is already blocked: its loop opens the
//! file by name every millisecond, and ends when the name is gone.
//!
//! Sending and receiving connect to new peers by themselves: clients look here before ([`crate::peers`]), and the daemon, which has the most
//! peers, has a thread that does it ([`crate::sweeper`]).

use std::fs::DirEntry;
use std::io;
use std::os::unix::ffi::OsStrExt;
use std::os::unix::fs::MetadataExt;
use std::path::Path;
use std::time::{Duration, Instant, SystemTime};

use crate::memory::SHARED_MEMORY_DIR;

/// A living process needs microseconds from creating a segment to giving it a size.
const ORPHAN_AGE: Duration = Duration::from_secs(1);

/// How long the opening of a role waits for empty segments to get a size or to become [`ORPHAN_AGE`] old.
const LONGEST_WAIT: Duration = Duration::from_millis(1500);

/// The finding of a look at one file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Finding {
    /// Not an empty segment of this user, or no longer there.
    Harmless,
    /// Empty, and perhaps just being made.
    Young,
    /// Empty, and nobody will give it a size.
    Orphan,
}

/// Removes the empty segments that nobody will give a size. True if no empty segment is left: only then may iceoryx2 clean up
/// or connect ports.
///
/// One pass over the names in /dev/shm; only iceoryx2's are looked at.
pub(crate) fn remove(prefix: &[u8]) -> bool {
    remove_in(Path::new(SHARED_MEMORY_DIR), prefix)
}

/// As [`remove`], but waits for young ones, for a bounded time.
pub(crate) fn remove_and_wait(prefix: &[u8]) -> bool {
    const PAUSE: Duration = Duration::from_millis(10);
    let start = Instant::now();
    loop {
        if remove(prefix) {
            return true;
        }
        if start.elapsed() >= LONGEST_WAIT {
            return false;
        }
        std::thread::sleep(PAUSE);
    }
}

fn remove_in(place: &Path, prefix: &[u8]) -> bool {
    // Without the directory there is no segment to wait for either; opening a service will say what is wrong.
    let Ok(entries) = std::fs::read_dir(place) else { return true };
    let now = SystemTime::now();
    let user = rustix::process::geteuid().as_raw();
    let mut none_left = true;
    for entry in entries.filter_map(Result::ok).filter(|entry| entry.file_name().as_bytes().starts_with(prefix)) {
        none_left &= match finding(&entry, user, now) {
            Finding::Harmless => true,
            Finding::Young => false,
            Finding::Orphan => remove_file(&entry.path()),
        };
    }
    none_left
}

fn finding(entry: &DirEntry, user: u32, now: SystemTime) -> Finding {
    // Of the entry itself: a link is not followed.
    let Ok(status) = entry.metadata() else { return Finding::Harmless };
    if !status.is_file() || status.len() != 0 || status.uid() != user {
        return Finding::Harmless;
    }
    if status.modified().is_ok_and(|made| age(made, now) < ORPHAN_AGE) { Finding::Young } else { Finding::Orphan }
}

/// How old what was made or changed then is now. A file from the future was made before the clock was put back.
pub(crate) fn age(made: SystemTime, now: SystemTime) -> Duration {
    now.duration_since(made).unwrap_or_else(|error| error.duration())
}

fn remove_file(path: &Path) -> bool {
    match std::fs::remove_file(path) {
        Ok(()) => {
            tracing::warn!(segment = %path.display(), "removed an empty segment of a process that was killed while it made it");
            true
        }
        // Another process was faster.
        Err(error) if error.kind() == io::ErrorKind::NotFound => true,
        Err(error) => {
            tracing::warn!(segment = %path.display(), %error, "cannot remove an empty segment: nothing can be cleaned up until it is gone");
            false
        }
    }
}

#[cfg(test)]
mod tests {
    use std::fs::{File, Permissions};
    use std::os::unix::fs::PermissionsExt;
    use std::path::PathBuf;

    use super::*;

    struct Place(PathBuf);

    impl Place {
        fn new(test: &str) -> Self {
            let place = std::env::temp_dir().join(format!("beo-ipc-orphans-{test}-{}", std::process::id()));
            std::fs::create_dir_all(&place).unwrap();
            Self(place)
        }

        fn file(&self, name: &str, made: SystemTime) -> PathBuf {
            let path = self.0.join(name);
            let file = File::create(&path).unwrap();
            file.set_modified(made).unwrap();
            file.set_permissions(Permissions::from_mode(0o200)).unwrap();
            path
        }
    }

    impl Drop for Place {
        fn drop(&mut self) {
            let _ = std::fs::remove_dir_all(&self.0);
        }
    }

    #[test]
    fn old_empty_segments_go_and_everything_else_stays() {
        let place = Place::new("old");
        let now = SystemTime::now();
        let old = now - Duration::from_secs(2);
        let orphan = place.file("iox2_1.connection", old);
        let from_the_future = place.file("iox2_2.dynamic", now + Duration::from_secs(3600));
        let others = place.file("something_else", old);
        let with_content = place.0.join("iox2_3.data");
        std::fs::write(&with_content, [0]).unwrap();
        File::options().write(true).open(&with_content).unwrap().set_modified(old).unwrap();
        let directory = place.0.join("iox2_4");
        std::fs::create_dir(&directory).unwrap();
        let link = place.0.join("iox2_5");
        std::os::unix::fs::symlink(&others, &link).unwrap();
        assert!(remove_in(&place.0, b"iox2_"));
        assert!(!orphan.exists() && !from_the_future.exists());
        assert!(others.exists() && with_content.exists() && directory.exists() && link.exists());
    }

    #[test]
    fn a_young_empty_segment_stays_and_is_reported_until_it_is_old_or_has_a_size() {
        let place = Place::new("young");
        let young = place.file("iox2_1.connection", SystemTime::now());
        assert!(!remove_in(&place.0, b"iox2_"));
        assert!(young.exists());
        File::options().write(true).open(&young).map(|file| file.set_len(1).unwrap()).unwrap();
        assert!(remove_in(&place.0, b"iox2_"));
        assert!(young.exists());
        let young = place.file("iox2_2.connection", SystemTime::now() - ORPHAN_AGE);
        assert!(remove_in(&place.0, b"iox2_"));
        assert!(!young.exists());
    }

    #[test]
    fn another_users_segment_is_left_alone() {
        let place = Place::new("user");
        place.file("iox2_1.connection", SystemTime::UNIX_EPOCH);
        let entry = std::fs::read_dir(&place.0).unwrap().next().unwrap().unwrap();
        let user = rustix::process::geteuid().as_raw();
        assert_eq!(finding(&entry, user, SystemTime::now()), Finding::Orphan);
        assert_eq!(finding(&entry, user + 1, SystemTime::now()), Finding::Harmless);
    }

    #[test]
    fn a_missing_directory_holds_nothing_up() {
        assert!(remove_in(Path::new("/nonexistent-shared-memory"), b"iox2_"));
    }
}
