//! Files that dead processes left in shared memory and in iceoryx2's folder.
//!
//! iceoryx2 names everything after ids of 128 bits, in decimal: from the lowest, 32 bits each, seconds, nanoseconds, process and counter.

use std::path::{Path, PathBuf};

/// Where iceoryx2 keeps sockets and nodes.
const ROOT: &str = "/tmp/iceoryx2";

/// Everything whose name says that one of these processes made it.
pub fn of(pids: &[u32]) -> Vec<PathBuf> {
    let folders = ["/dev/shm".to_owned(), ROOT.to_owned(), format!("{ROOT}/nodes")];
    let mut found: Vec<PathBuf> = folders.iter().flat_map(|folder| inside(Path::new(folder))).collect();
    found.retain(|path| owners(path).iter().any(|pid| pids.contains(pid)));
    found.sort();
    found
}

/// Of these, what iceoryx2 0.10.0 itself may forget when several processes die at once, and what is not memory for messages: sockets and
/// their state of 63 bytes, empty locks, descriptions of nodes.
pub fn is_small(path: &Path) -> bool {
    let extension = path.extension().unwrap_or_default().to_string_lossy().into_owned();
    matches!(extension.as_str(), "event" | "event_mgmt") || path.starts_with(format!("{ROOT}/nodes"))
}

fn inside(folder: &Path) -> Vec<PathBuf> {
    std::fs::read_dir(folder).map_or(Vec::new(), |entries| entries.filter_map(Result::ok).map(|entry| entry.path()).collect())
}

/// The processes of the ids in a name.
fn owners(path: &Path) -> Vec<u32> {
    let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    // Hashes are hexadecimal and 40 digits; ids have at most 39.
    let ids = name.split(['_', '.']).filter(|part| part.len() > 20).filter_map(|part| part.parse::<u128>().ok());
    ids.map(|id| (id >> 64) as u32).collect()
}

#[test]
fn names_tell_who_made_what() {
    let path = Path::new("/dev/shm/iox2_33c1ac61b54bf6edd0a0a8390f0c2fd7cf74d745_713053522950621964180129850869.event_mgmt");
    assert_eq!(owners(path), [3270]);
    assert!(is_small(path) && !is_small(Path::new("/dev/shm/iox2_0354_79228281551243746632647327628.data")));
    let connection =
        Path::new("iox2_b9fc73e5c1f646968758453273c6c65cb372831b_79228281551243746632647327628_554597256692482190825983328140.connection");
    assert_eq!(owners(connection).len(), 2);
}
