//! Files that appear under their name only when they are whole.
//!
//! The content goes into a temporary file of its own in the same folder, is brought to the disk, and takes the name by renaming. Whoever
//! reads meanwhile sees the file before, and a full disk, a crash or a second writer of the same name leaves one whole file: the one before,
//! or either writer's.
//!
//! A file that is of use even when it is cut, such as a recording, has a temporary that can be found and that stays.

use std::ffi::{OsStr, OsString};
use std::fs::{File, OpenOptions, Permissions};
use std::io::{self, ErrorKind, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};

/// A file that is being written. Dropped without [`WholeFile::keep`], it leaves nothing, unless it is recoverable.
#[derive(Debug)]
pub struct WholeFile {
    /// The file that is to be replaced: links have been followed.
    path: PathBuf,
    /// Where the content is until then; none where `path` is a pipe or a device, which is written as it is.
    temporary: Option<PathBuf>,
    /// Whether the temporary stays where the file is given up.
    recoverable: bool,
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
        Self::begin(path, false)
    }

    /// Begins a file whose content is of use even when it is cut: until [`WholeFile::keep`] it has the file's own name with `.partial` after
    /// it, and a number where that name is taken, and it stays there if this is dropped or the process is killed.
    ///
    /// # Errors
    /// As [`WholeFile::create`].
    pub fn create_recoverable(path: &Path) -> io::Result<Self> {
        Self::begin(path, true)
    }

    fn begin(path: &Path, recoverable: bool) -> io::Result<Self> {
        let replaced = match std::fs::metadata(path) {
            Ok(metadata) if metadata.is_dir() => return Err(ErrorKind::IsADirectory.into()),
            Ok(metadata) if !metadata.is_file() => {
                let file = OpenOptions::new().write(true).open(path)?;
                return Ok(Self { path: path.into(), temporary: None, recoverable, file, permissions: metadata.permissions() });
            }
            Ok(metadata) => Some(metadata.permissions()),
            Err(error) if error.kind() == ErrorKind::NotFound => None,
            Err(error) => return Err(error),
        };
        let path = if replaced.is_some() { path.canonicalize()? } else { path.to_owned() };
        let Some(name) = path.file_name() else { return Err(io::Error::new(ErrorKind::InvalidInput, "it is no name of a file")) };
        let (temporary, file) = match recoverable {
            true => create_first_free(&path, partial_names(name))?,
            false => create_first_free(&path, hidden_names())?,
        };
        let own = file.metadata().map(|metadata| metadata.permissions());
        let permissions = match replaced.map_or(own, Ok) {
            Ok(permissions) => permissions,
            Err(error) => {
                let _ = std::fs::remove_file(&temporary);
                return Err(error);
            }
        };
        Ok(Self { path, temporary: Some(temporary), recoverable, file, permissions })
    }

    /// Where the content is until the file is whole; none if what stands under the name is a pipe or a device.
    pub fn temporary(&self) -> Option<&Path> {
        self.temporary.as_deref()
    }

    /// Where it is being written, for questions about the file system.
    pub fn file(&self) -> &File {
        &self.file
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

impl Seek for WholeFile {
    fn seek(&mut self, position: SeekFrom) -> io::Result<u64> {
        self.file.seek(position)
    }
}

impl Drop for WholeFile {
    fn drop(&mut self) {
        if let Some(temporary) = self.temporary.as_ref().filter(|_| !self.recoverable) {
            let _ = std::fs::remove_file(temporary);
        }
    }
}

/// Names of temporaries that nobody looks for; this process takes each once.
fn hidden_names() -> impl Iterator<Item = OsString> {
    static COUNT: AtomicU32 = AtomicU32::new(0);
    let pid = std::process::id();
    std::iter::repeat_with(move || format!(".beo-{pid}-{}.partial", COUNT.fetch_add(1, Ordering::Relaxed)).into())
}

/// Names of temporaries that whoever looks for `name` finds: `name.partial`, `name.partial-2`, and so on.
fn partial_names(name: &OsStr) -> impl Iterator<Item = OsString> {
    (1_u64..).map(move |count| {
        let mut partial = name.to_owned();
        partial.push(".partial");
        if count > 1 {
            partial.push(format!("-{count}"));
        }
        partial
    })
}

/// A new file in the folder of `path`, with the first of these names that nothing has.
fn create_first_free(path: &Path, names: impl Iterator<Item = OsString>) -> io::Result<(PathBuf, File)> {
    for name in names {
        let temporary = path.with_file_name(name);
        match OpenOptions::new().write(true).create_new(true).open(&temporary) {
            Ok(file) => return Ok((temporary, file)),
            // Of another writer, or of a process that was killed.
            Err(error) if error.kind() == ErrorKind::AlreadyExists => {}
            Err(error) => return Err(error),
        }
    }
    Err(ErrorKind::AlreadyExists.into())
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
        for file in both {
            file.keep().unwrap();
        }
        assert_eq!((std::fs::read(&path).unwrap(), names(folder.path())), (b"the second".to_vec(), vec!["a".to_owned()]));
    }

    #[test]
    fn what_is_recoverable_stays_where_it_can_be_found_and_takes_no_name_that_is_taken() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.mcap");
        write_whole(&path, b"before").unwrap();
        for cut in ["first", "second"] {
            WholeFile::create_recoverable(&path).unwrap().write_all(cut.as_bytes()).unwrap();
        }
        assert_eq!(names(folder.path()), ["a.mcap", "a.mcap.partial", "a.mcap.partial-2"]);
        let mut whole = WholeFile::create_recoverable(&path).unwrap();
        assert_eq!(whole.temporary().unwrap().file_name().unwrap(), "a.mcap.partial-3");
        whole.write_all(b"third").unwrap();
        whole.seek(SeekFrom::Start(0)).unwrap();
        whole.write_all(b"T").unwrap();
        whole.keep().unwrap();
        let content = |name| std::fs::read_to_string(folder.path().join(name)).unwrap();
        assert_eq!(["a.mcap", "a.mcap.partial", "a.mcap.partial-2"].map(content), ["Third", "first", "second"]);
        assert_eq!(names(folder.path()).len(), 3);
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
