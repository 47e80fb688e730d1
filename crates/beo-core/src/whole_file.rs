//! Files that appear under their name only when they are whole.
//!
//! The content goes into a temporary file of its own in the same folder, is brought to the disk, and takes the name by renaming. Whoever
//! reads meanwhile sees the file before, and a full disk, a crash or a second writer of the same name leaves one whole file: the one before,
//! or either writer's.

use std::fs::{File, OpenOptions, Permissions};
use std::io::{self, ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};

/// A file that is being written. Dropped without [`WholeFile::keep`], it leaves nothing.
#[derive(Debug)]
pub struct WholeFile {
    /// What is to be replaced: links have been followed.
    path: PathBuf,
    /// Where the content is until then; none where `path` is a pipe or a device, which is written as it is.
    temporary: Option<PathBuf>,
    file: File,
    /// Those that the whole file gets: the replaced file's, or else a new file's.
    permissions: Permissions,
}

impl WholeFile {
    /// Begins a file. What stands under its name stays until [`WholeFile::keep`].
    ///
    /// # Errors
    /// The system's own: no such folder, no rights in it, a folder of that name.
    pub fn create(path: &Path) -> io::Result<Self> {
        let replaced = match std::fs::metadata(path) {
            Ok(metadata) if metadata.is_dir() => return Err(ErrorKind::IsADirectory.into()),
            Ok(metadata) if !metadata.is_file() => {
                let file = OpenOptions::new().write(true).open(path)?;
                return Ok(Self { path: path.into(), temporary: None, file, permissions: metadata.permissions() });
            }
            Ok(metadata) => Some(metadata.permissions()),
            Err(error) if error.kind() == ErrorKind::NotFound => None,
            Err(error) => return Err(error),
        };
        let path = if replaced.is_some() { path.canonicalize()? } else { path.to_owned() };
        if path.file_name().is_none() {
            return Err(io::Error::new(ErrorKind::InvalidInput, "it is no name of a file"));
        }
        let (temporary, file) = create_beside(&path)?;
        let own = file.metadata().map(|metadata| metadata.permissions());
        let permissions = match replaced.map_or(own, Ok) {
            Ok(permissions) => permissions,
            Err(error) => {
                let _ = std::fs::remove_file(&temporary);
                return Err(error);
            }
        };
        Ok(Self { path, temporary: Some(temporary), file, permissions })
    }

    /// Where the content is until the file is whole; none if what stands under the name is a pipe or a device.
    pub fn temporary(&self) -> Option<&Path> {
        self.temporary.as_deref()
    }

    /// Where it is being written, for questions about the file system.
    pub fn file(&self) -> &File {
        &self.file
    }

    /// Takes up a file that someone else has put in the place of the temporary one.
    ///
    /// # Errors
    /// The system's own.
    pub fn take_up(&mut self) -> io::Result<()> {
        if let Some(temporary) = &self.temporary {
            self.file = OpenOptions::new().write(true).open(temporary)?;
        }
        Ok(())
    }

    /// Brings the content to the disk and gives it the name.
    ///
    /// # Errors
    /// The system's own; what stood under the name is still there.
    pub fn keep(mut self) -> io::Result<()> {
        let Some(temporary) = &self.temporary else { return self.file.flush() };
        self.file.set_permissions(self.permissions.clone())?;
        self.file.sync_all()?;
        std::fs::rename(temporary, &self.path)?;
        self.temporary = None;
        // The name itself. Not every file system can sync a folder; its content is there in any case.
        let folder = self.path.parent().filter(|folder| *folder != Path::new("")).unwrap_or(Path::new("."));
        let _ = File::open(folder).and_then(|folder| folder.sync_all());
        Ok(())
    }
}

impl Write for WholeFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.file.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

impl Drop for WholeFile {
    fn drop(&mut self) {
        if let Some(temporary) = &self.temporary {
            let _ = std::fs::remove_file(temporary);
        }
    }
}

/// A new file in the folder of `path`, with a name that nothing has.
fn create_beside(path: &Path) -> io::Result<(PathBuf, File)> {
    static COUNT: AtomicU32 = AtomicU32::new(0);
    loop {
        let name = format!(".beo-{}-{}.partial", std::process::id(), COUNT.fetch_add(1, Ordering::Relaxed));
        let temporary = path.with_file_name(name);
        match OpenOptions::new().write(true).create_new(true).open(&temporary) {
            Ok(file) => return Ok((temporary, file)),
            // Of a process that had the same number and was killed.
            Err(error) if error.kind() == ErrorKind::AlreadyExists => {}
            Err(error) => return Err(error),
        }
    }
}

/// Writes a whole file.
///
/// # Errors
/// The system's own; what stood under the name is still there.
pub fn write_whole(path: &Path, content: &[u8]) -> io::Result<()> {
    let mut file = WholeFile::create(path)?;
    file.write_all(content)?;
    file.keep()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::{PermissionsExt, symlink};

    fn names(folder: &Path) -> Vec<String> {
        let mut names: Vec<String> =
            std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    #[test]
    fn the_file_before_stays_until_the_next_is_whole_and_what_is_given_up_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.partial");
        write_whole(&path, b"one").unwrap();
        let mut next = WholeFile::create(&path).unwrap();
        next.write_all(b"cut").unwrap();
        assert_eq!((std::fs::read(&path).unwrap(), names(folder.path()).len()), (b"one".to_vec(), 2));
        drop(next);
        assert_eq!((std::fs::read(&path).unwrap(), names(folder.path())), (b"one".to_vec(), vec!["a.partial".to_owned()]));
    }

    #[test]
    fn writers_of_one_name_do_not_meet() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        let mut both = [0, 1].map(|_| WholeFile::create(&path).unwrap());
        both[0].write_all(b"first").unwrap();
        both[1].write_all(b"the second").unwrap();
        both.map(|file| file.keep().unwrap());
        assert_eq!((std::fs::read(&path).unwrap(), names(folder.path())), (b"the second".to_vec(), vec!["a".to_owned()]));
    }

    #[test]
    fn permissions_and_links_stay_as_they_are() {
        let folder = tempfile::tempdir().unwrap();
        let [path, link] = ["a", "link"].map(|name| folder.path().join(name));
        std::fs::write(&path, "before").unwrap();
        std::fs::set_permissions(&path, Permissions::from_mode(0o640)).unwrap();
        symlink(&path, &link).unwrap();
        write_whole(&link, b"after").unwrap();
        assert!(link.is_symlink());
        assert_eq!(std::fs::read(&path).unwrap(), b"after");
        assert_eq!(path.metadata().unwrap().permissions().mode() & 0o777, 0o640);
    }

    #[test]
    fn devices_are_written_and_folders_refused() {
        write_whole(Path::new("/dev/null"), b"gone").unwrap();
        assert!(!std::fs::metadata("/dev/null").unwrap().is_file(), "it is still the device");
        let folder = tempfile::tempdir().unwrap();
        assert!(write_whole(folder.path(), b"").is_err());
        assert!(write_whole(&folder.path().join("none/a"), b"").is_err());
        assert!(write_whole(Path::new("/dev/full"), b"x").is_err());
    }
}
