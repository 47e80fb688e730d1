//! Whether anybody has a segment open or mapped, seen from wherever: numbers of processes and files of iceoryx2 say nothing of processes in
//! another process or mount namespace (a unit with `PrivateTmp=`, a container that shares /dev/shm), which are at work all the same.

#![allow(unsafe_code)]

use std::fs::{File, OpenOptions};
use std::io;
use std::os::fd::AsRawFd as _;
use std::path::Path;

/// Whether a file is open or mapped somewhere, or cannot be asked about.
///
/// The system grants a lease for writing, which ends here with the descriptor, of a file that nobody else has open: a mapping counts as that
/// (fcntl(2), "Leases").
pub(crate) fn is_in_use(path: &Path) -> bool {
    // A segment that is only written to may not be read by its owner.
    let open = || File::open(path).or_else(|_| OpenOptions::new().write(true).open(path));
    match open() {
        Ok(file) => lease(&file).is_err(),
        Err(error) => error.kind() != io::ErrorKind::NotFound,
    }
}

/// Which signal says that somebody waits for the end of a lease; `libc` has it for no Linux (asm-generic/fcntl.h).
const F_SETSIG: libc::c_int = 10;

fn lease(file: &File) -> io::Result<()> {
    // Whoever opens the file meanwhile waits, and this process is told by a signal: by SIGIO, which would end it, unless another is chosen.
    // SIGURG is ignored where nobody asks for it.
    for (command, argument) in [(F_SETSIG, libc::SIGURG), (libc::F_SETLEASE, libc::F_WRLCK)] {
        // SAFETY: both commands take an integer, and the descriptor is open for as long as `file` is borrowed.
        if unsafe { libc::fcntl(file.as_raw_fd(), command, argument) } == -1 {
            return Err(io::Error::last_os_error());
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::PermissionsExt as _;
    use std::path::PathBuf;

    use super::*;

    /// A file in the memory that segments are in.
    struct Segment(PathBuf);

    impl Segment {
        fn new(test: &str) -> Self {
            let path = Path::new(crate::memory::SHARED_MEMORY_DIR).join(format!("beo-ipc-in-use-{test}-{}", std::process::id()));
            std::fs::write(&path, [1; 4096]).unwrap();
            Self(path)
        }
    }

    impl Drop for Segment {
        fn drop(&mut self) {
            let _ = std::fs::remove_file(&self.0);
        }
    }

    /// A child that another test forks has what is open here until it runs its program.
    fn comes_out_of_use(path: &Path) -> bool {
        (0..5000).any(|_| {
            std::thread::sleep(std::time::Duration::from_millis(1));
            !is_in_use(path)
        })
    }

    #[test]
    fn a_file_is_in_use_while_it_is_open_and_no_longer() {
        let segment = Segment::new("open");
        let path = &segment.0;
        assert!(comes_out_of_use(path));
        for options in [OpenOptions::new().read(true), OpenOptions::new().write(true)] {
            let open = options.open(path).unwrap();
            assert!(is_in_use(path));
            drop(open);
            assert!(comes_out_of_use(path));
        }
        std::fs::set_permissions(path, std::fs::Permissions::from_mode(0o200)).unwrap();
        assert!(comes_out_of_use(path), "its owner may write to it");
        std::fs::remove_file(path).unwrap();
        assert!(comes_out_of_use(path));
    }

    #[test]
    fn a_mapping_without_a_descriptor_is_a_use() {
        let segment = Segment::new("mapped");
        let path = &segment.0;
        let file = File::open(path).unwrap();
        // SAFETY: a new mapping, wherever the system likes, which nothing refers to.
        let mapped = unsafe { libc::mmap(std::ptr::null_mut(), 4096, libc::PROT_READ, libc::MAP_SHARED, file.as_raw_fd(), 0) };
        assert_ne!(mapped, libc::MAP_FAILED);
        drop(file);
        assert!(is_in_use(path));
        // SAFETY: that mapping, whole.
        assert_eq!(unsafe { libc::munmap(mapped, 4096) }, 0);
        assert!(comes_out_of_use(path));
    }
}
