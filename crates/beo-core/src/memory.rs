//! How much memory this process may still take: the machine's, its control group's, and its own limit, whichever is least.

use rustix::process::{Resource, getrlimit};
use std::path::{Path, PathBuf};

/// Memory that may still be taken, and whose limit it is.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Available {
    /// Bytes.
    pub bytes: u64,
    /// Whose limit it is, for people.
    pub limit: &'static str,
}

/// Memory that may still be taken; `None` where the system does not say.
pub fn available() -> Option<Available> {
    let read = |path: &str| std::fs::read_to_string(path).unwrap_or_default();
    let machine = machine(&read("/proc/meminfo")).map(|bytes| Available { bytes, limit: "the machine" });
    let group = control_groups(&read("/proc/self/cgroup"), Path::new("/sys/fs/cgroup"))
        .into_iter()
        .filter_map(|folder| left_in(&folder))
        .min()
        .map(|bytes| Available { bytes, limit: "the control group" });
    let own = getrlimit(Resource::As).current.and_then(|limit| {
        let pages: u64 = read("/proc/self/statm").split_whitespace().next()?.parse().ok()?;
        let threads = rayon::current_num_threads() as u64 + 1;
        let kept = threads * kept_by_a_thread(&read("/sys/devices/system/cpu/cpu0/cache/index3/size"));
        let bytes = limit.saturating_sub(pages * rustix::param::page_size() as u64).saturating_sub(kept);
        Some(Available { bytes, limit: "the process (`ulimit -v`)" })
    });
    [machine, group, own].into_iter().flatten().min_by_key(|available| available.bytes)
}

/// Address space that each thread takes which multiplies matrices: twice the third cache, given its size as the system writes it. faer keeps
/// room of that size for the two factors, which is never all touched: it counts against a limit of addresses alone.
fn kept_by_a_thread(third_cache: &str) -> u64 {
    const USUAL_KB: u64 = 32 * 1024;
    let size_kb = third_cache.trim().strip_suffix('K').and_then(|size| size.parse().ok()).unwrap_or(USUAL_KB);
    2 * 1024 * size_kb
}

/// `MemAvailable` of /proc/meminfo.
fn machine(text: &str) -> Option<u64> {
    let line = text.lines().find_map(|line| line.strip_prefix("MemAvailable:"))?;
    line.split_whitespace().next()?.parse::<u64>().ok()?.checked_mul(1024)
}

/// The folders of the groups that a process with this /proc/self/cgroup is in, of both versions, up to their roots. Inside a container
/// the paths may be those outside, but the root is there.
fn control_groups(text: &str, root: &Path) -> Vec<PathBuf> {
    let mut folders = Vec::new();
    for line in text.lines() {
        let mut parts = line.splitn(3, ':');
        let (Some(_), Some(controllers), Some(path)) = (parts.next(), parts.next(), parts.next()) else { continue };
        let base = match controllers {
            "" => root.to_owned(),
            _ if controllers.split(',').any(|name| name == "memory") => root.join("memory"),
            _ => continue,
        };
        let inner = base.join(path.trim_start_matches('/'));
        folders.extend(inner.ancestors().take_while(|folder| folder.starts_with(&base)).map(Path::to_owned));
    }
    folders
}

/// Memory that a group may still take: its limit less what it uses, of which unused pages of files do not count.
fn left_in(folder: &Path) -> Option<u64> {
    let read = |name: &str| std::fs::read_to_string(folder.join(name)).ok();
    let number = |name: &str| read(name)?.trim().parse::<u64>().ok();
    let limit = number("memory.max").or_else(|| number("memory.limit_in_bytes"))?;
    let used = number("memory.current").or_else(|| number("memory.usage_in_bytes"))?;
    let statistics = read("memory.stat").unwrap_or_default();
    let of = |name: &str| statistics.lines().find_map(|line| line.strip_prefix(name)?.trim().parse::<u64>().ok());
    let reclaimable = of("total_inactive_file ").or_else(|| of("inactive_file ")).unwrap_or(0);
    Some(limit.saturating_sub(used.saturating_sub(reclaimable)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_machine_says_what_is_available() {
        assert_eq!(machine("MemTotal:  9 kB\nMemFree:  1 kB\nMemAvailable:   123456 kB\n"), Some(123_456 * 1024));
        assert_eq!(machine("MemTotal: 9 kB\n"), None);
        assert_eq!(machine("MemAvailable: many kB"), None);
        assert!(available().is_some_and(|available| available.bytes > 0), "on the machine that runs the tests");
    }

    #[test]
    fn a_thread_that_multiplies_keeps_twice_the_third_cache() {
        assert_eq!(kept_by_a_thread("32768K\n"), 64 << 20);
        assert_eq!(kept_by_a_thread("2048K\n"), 4 << 20);
        assert_eq!(kept_by_a_thread(""), 64 << 20, "where the system does not say");
    }

    #[test]
    fn groups_of_both_versions_are_found_up_to_their_roots() {
        let found = control_groups("5:cpu,memory:/a/b\n1:cpu:/c\n0::/d\nnonsense\n", Path::new("/r"));
        let wanted = ["/r/memory/a/b", "/r/memory/a", "/r/memory", "/r/d", "/r"];
        assert_eq!(found, wanted.map(PathBuf::from));
    }

    #[test]
    fn a_group_leaves_its_limit_less_what_is_in_use() {
        let folder = tempfile::tempdir().unwrap();
        let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
        assert_eq!(left_in(folder.path()), None, "no group");
        write("memory.limit_in_bytes", "1000\n");
        write("memory.usage_in_bytes", "900\n");
        assert_eq!(left_in(folder.path()), Some(100));
        write("memory.stat", "cache 5\ntotal_inactive_file 300\ninactive_file 1\n");
        assert_eq!(left_in(folder.path()), Some(400));
        write("memory.max", "2000\n");
        write("memory.current", "5000\n");
        assert_eq!(left_in(folder.path()), Some(0));
        write("memory.max", "max\n");
        write("memory.limit_in_bytes", "nothing\n");
        assert_eq!(left_in(folder.path()), None, "no limit");
    }
}
