//! Bytes of a file that is not too large.

use super::error::ReadError;
use std::io::Read;
use std::path::Path;

/// Largest file that is read.
const LARGEST: u64 = 1 << 30;

/// The content of a file that is not too large.
///
/// # Errors
/// [`ReadError`]: it cannot be opened, is no file, or is too large.
pub fn read_bytes(path: &Path) -> Result<Vec<u8>, ReadError> {
    let open = |source| ReadError::Open { path: path.into(), source };
    // Asked before opening: opening a pipe waits for its writer.
    let metadata = std::fs::metadata(path).map_err(open)?;
    if !metadata.is_file() {
        return Err(ReadError::NotAFile { path: path.into() });
    }
    let too_large = |bytes| ReadError::TooLarge { path: path.into(), bytes, limit: LARGEST };
    if metadata.len() > LARGEST {
        return Err(too_large(metadata.len()));
    }
    let mut bytes = Vec::with_capacity(metadata.len() as usize);
    std::fs::File::open(path).and_then(|file| file.take(LARGEST + 1).read_to_end(&mut bytes)).map_err(open)?;
    if bytes.len() as u64 > LARGEST { Err(too_large(bytes.len() as u64)) } else { Ok(bytes) }
}
