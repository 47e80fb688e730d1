//! What iceoryx2 0.10.0 leaves of processes that were killed at a bad moment, and never looks at again.
//!
//! It makes a file with no right to read it, or with the right to write it, and takes that right away when the file is whole; what is not
//! whole it does not list, and so does not remove:
//! - the tag of a service or of a port, in the folder of its node: the folder cannot be removed, and everybody who cleans up tries again for
//!   ever ([`Places::remove_half_made_tags`]);
//! - a node of which only the folder, or only some files of its monitor, were there when its process was killed, or of which a killed
//!   cleaner had removed some ([`Places::remove_forgotten`]);
//! - segments and sockets of a port that was not registered yet: their node is cleaned up after, and they stay ([`Places::remove_forgotten`]);
//! - the segment of a service whose description is gone: that of a service that was being made, which counts as damaged and is removed by
//!   its description ([`Places::remove_forgotten`]).
//!
//! A port that stays registered although its node is gone is the matter of [`crate::registered`].

use std::collections::{BTreeMap, HashSet};
use std::fs::{DirEntry, Metadata};
use std::io;
use std::os::unix::fs::{DirBuilderExt as _, MetadataExt as _, OpenOptionsExt as _};
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use iceoryx2::prelude::Config;

use crate::in_use::is_in_use;
use crate::memory::SHARED_MEMORY_DIR;
use crate::orphans::age;

/// A living process needs milliseconds from the first to the last file of a node.
const FORGOTTEN_AGE: Duration = Duration::from_secs(10);

/// The file that says what a monitored process is; made first, whole last, removed last.
const CONTEXT: &str = "_context";

/// Files of one node's monitor: state, context, lock of the owner.
const MONITOR_FILES: [&str; 3] = ["", CONTEXT, "_owner_lock"];

/// Where iceoryx2 keeps things, and how they are named.
#[derive(Debug, Clone)]
pub(crate) struct Places {
    /// Sockets.
    root: PathBuf,
    /// Folders of nodes and the files of their monitors.
    nodes: PathBuf,
    /// Segments.
    shared: PathBuf,
    /// Descriptions of services.
    services: PathBuf,
    prefix: String,
    monitor: String,
    service_tag: String,
    port_tag: String,
    /// Extensions of what belongs to ports.
    ports: [String; 4],
    /// Extension of the segments of services.
    service_segment: String,
}

/// What there is of a node.
#[derive(Debug, Default)]
struct Found {
    folder: bool,
    monitor_files: usize,
    /// Its context is not whole.
    starting: bool,
    youngest: Option<SystemTime>,
}

impl Places {
    pub fn of(config: &Config) -> Self {
        let (global, node, service) = (&config.global, &config.global.node, &config.global.service);
        Self {
            root: global.root_path().to_string().into(),
            nodes: global.node_dir().to_string().into(),
            shared: SHARED_MEMORY_DIR.into(),
            services: global.service_dir().to_string().into(),
            prefix: global.prefix.to_string(),
            monitor: node.monitor_suffix.to_string(),
            service_tag: node.service_tag_suffix.to_string(),
            port_tag: node.port_tag_suffix.to_string(),
            ports: [
                service.data_segment_suffix.to_string(),
                service.connection_suffix.to_string(),
                service.event_connection_suffix.to_string(),
                format!("{}_mgmt", service.event_connection_suffix),
            ],
            service_segment: service.dynamic_config_storage_suffix.to_string(),
        }
    }

    /// Whether iceoryx2 can still find out that this node is dead.
    pub fn is_monitored(&self, node: u128) -> bool {
        self.monitor_file(node, CONTEXT).exists()
    }

    /// Removes the tags of a dead node that were being made when its process was killed.
    pub fn remove_half_made_tags(&self, node: u128) {
        for entry in entries(&self.folder(node)) {
            let name = name_of(&entry);
            let is_tag = name.ends_with(&self.service_tag) || name.ends_with(&self.port_tag);
            // The owner's right to write goes when the tag is whole.
            if is_tag && entry.metadata().is_ok_and(|status| status.mode() & 0o200 != 0) {
                remove("the half-made tag of a killed process", &entry.path());
            }
        }
    }

    /// Puts back the tags of a node's ports: iceoryx2 does not take a port out of a service whose tag is gone.
    pub fn put_back_tags(&self, node: u128, ports: impl IntoIterator<Item = u128>) -> io::Result<()> {
        std::fs::DirBuilder::new().recursive(true).mode(0o750).create(self.folder(node))?;
        for port in ports {
            let tag = self.folder(node).join(format!("{}{port}{}", self.prefix, self.port_tag));
            match std::fs::OpenOptions::new().write(true).create_new(true).mode(0o400).open(tag) {
                Err(error) if error.kind() != io::ErrorKind::AlreadyExists => return Err(error),
                _ => {}
            }
        }
        Ok(())
    }

    /// Removes the folder of a node that has no monitor any more.
    pub fn remove_folder(&self, node: u128) {
        if !self.is_monitored(node) {
            let _ = std::fs::remove_dir_all(self.folder(node));
        }
    }

    /// Removes what is left of nodes that iceoryx2 does not list, of ports whose process has no node, and of services without a description.
    ///
    /// Only what belongs to processes that are gone, and has been so for [`FORGOTTEN_AGE`]: a process in another process namespace, which
    /// looks as if it were gone, has a whole node. Where it has it in files of its own (another mount namespace), its segments are in use.
    pub fn remove_forgotten(&self) {
        // These first: whoever has a port has a node by now, and whoever made a segment for a service has described it before.
        let old: Vec<(String, PathBuf)> = [&self.shared, &self.root]
            .into_iter()
            .flat_map(|place| entries(place))
            .filter(|entry| name_of(entry).starts_with(&self.prefix))
            .filter(|entry| entry.metadata().is_ok_and(|status| is_ours(&status) && is_old(status.modified().ok())))
            .map(|entry| (name_of(&entry), entry.path()))
            .collect();
        let nodes = self.find_nodes();
        for (node, found) in &nodes {
            let whole = found.monitor_files == MONITOR_FILES.len() && !found.starting;
            if !whole && is_old(found.youngest) && process_is_gone(process_of(*node)) {
                if found.folder {
                    remove("the folder of a node that was being made or removed when its process was killed", &self.folder(*node));
                }
                for file in MONITOR_FILES {
                    remove(
                        "the monitor of a node that was being made or removed when its process was killed",
                        &self.monitor_file(*node, file),
                    );
                }
            }
        }
        let with_node: HashSet<u32> = nodes.keys().map(|node| process_of(*node)).collect();
        for (name, path) in old.iter().filter(|(name, _)| self.ports.iter().any(|suffix| name.ends_with(suffix.as_str()))) {
            let mut owners = ids(name).map(process_of).peekable();
            let are_gone = owners.peek().is_some() && owners.all(|owner| !with_node.contains(&owner) && process_is_gone(owner));
            if are_gone && !self.is_segment_in_use(path) {
                remove("what a port of a killed process left", path);
            }
        }
        let mut described = None;
        for (name, path) in old.iter().filter(|(name, _)| name.ends_with(&self.service_segment)) {
            let Some(id) = ids(name).last().filter(|id| process_is_gone(process_of(*id))) else { continue };
            let is_described = described.get_or_insert_with(|| self.descriptions()).iter().any(|text| describes(text, id));
            if !is_described && !self.is_segment_in_use(path) {
                remove("the segment of a service that nobody can find", path);
            }
        }
    }

    /// Sockets, which are not segments, are those of this mount namespace.
    fn is_segment_in_use(&self, path: &Path) -> bool {
        path.starts_with(&self.shared) && is_in_use(path)
    }

    fn descriptions(&self) -> Vec<String> {
        entries(&self.services).into_iter().filter_map(|entry| std::fs::read_to_string(entry.path()).ok()).collect()
    }

    fn find_nodes(&self) -> BTreeMap<u128, Found> {
        let mut nodes: BTreeMap<u128, Found> = BTreeMap::new();
        for entry in entries(&self.nodes) {
            let (name, Ok(status)) = (name_of(&entry), entry.metadata()) else { continue };
            if !is_ours(&status) {
                continue;
            }
            let of_monitor = name.strip_prefix(&self.prefix).and_then(|rest| rest.split_once(self.monitor.as_str()));
            let Ok(node) = of_monitor.map_or(name.as_str(), |(node, _)| node).parse::<u128>() else { continue };
            let found = nodes.entry(node).or_default();
            found.youngest = found.youngest.max(status.modified().ok());
            match of_monitor {
                Some((_, file)) => {
                    found.monitor_files += usize::from(MONITOR_FILES.contains(&file));
                    found.starting |= file == CONTEXT && status.mode() & 0o400 == 0;
                }
                None => found.folder = true,
            }
        }
        nodes
    }

    fn folder(&self, node: u128) -> PathBuf {
        self.nodes.join(node.to_string())
    }

    fn monitor_file(&self, node: u128, file: &str) -> PathBuf {
        self.nodes.join(format!("{}{node}{}{file}", self.prefix, self.monitor))
    }
}

/// Whether no process of this number is there. One in another process namespace seems to be gone.
pub(crate) fn process_is_gone(pid: u32) -> bool {
    let pid = rustix::process::Pid::from_raw(pid.cast_signed());
    pid.is_some_and(|pid| matches!(rustix::process::test_kill_process(pid), Err(rustix::io::Errno::SRCH)))
}

/// The process that made an id of iceoryx2: from the lowest, 32 bits each, seconds, nanoseconds, process and counter.
fn process_of(id: u128) -> u32 {
    (id >> 64) as u32
}

/// The ids in a name. Hashes are hexadecimal and have 40 digits; ids are decimal and have at most 39.
fn ids(name: &str) -> impl Iterator<Item = u128> {
    name.split(['_', '.']).filter(|part| part.len() > 20).filter_map(|part| part.parse().ok())
}

/// Whether the description of a service (TOML) is that of the one with this id.
fn describes(text: &str, id: u128) -> bool {
    let says = |key: &str, half: u64| text.lines().any(|line| line == format!("{key} = {half}"));
    says("payload_value", id as u64) && says("unique_value", (id >> 64) as u64)
}

fn entries(place: &Path) -> Vec<DirEntry> {
    std::fs::read_dir(place).map_or(Vec::new(), |entries| entries.filter_map(Result::ok).collect())
}

fn name_of(entry: &DirEntry) -> String {
    entry.file_name().to_string_lossy().into_owned()
}

fn is_ours(status: &Metadata) -> bool {
    status.uid() == rustix::process::geteuid().as_raw()
}

/// Of a time that the file system tells; none is no age at all.
fn is_old(changed: Option<SystemTime>) -> bool {
    changed.is_some_and(|changed| age(changed, SystemTime::now()) >= FORGOTTEN_AGE)
}

fn remove(what: &str, path: &Path) {
    let result = if path.is_dir() { std::fs::remove_dir_all(path) } else { std::fs::remove_file(path) };
    match result {
        Ok(()) => tracing::info!(path = %path.display(), "removed {what}"),
        // Another process was faster, or there was none.
        Err(error) if error.kind() == io::ErrorKind::NotFound => {}
        Err(error) => tracing::warn!(path = %path.display(), %error, "cannot remove {what}"),
    }
}

#[cfg(test)]
mod tests {
    use std::fs::{File, Permissions};
    use std::os::unix::fs::PermissionsExt as _;

    use super::*;

    /// Folders of their own in the form of iceoryx2's, in the file system in which segments are.
    struct Place(Places, PathBuf);

    impl Place {
        fn new(test: &str) -> Self {
            let at = Path::new(SHARED_MEMORY_DIR).join(format!("beo-ipc-remains-{test}-{}", std::process::id()));
            let [nodes, shared, services] = ["nodes", "shm", "services"].map(|name| at.join(name));
            [&nodes, &shared, &services].into_iter().for_each(|place| std::fs::create_dir_all(place).unwrap());
            let places = Places { root: at.clone(), nodes, shared, services, ..Places::of(&crate::node::config()) };
            Self(places, at)
        }

        /// A file that was last changed so many seconds ago.
        fn file(&self, path: &Path, mode: u32, age_s: u64) -> PathBuf {
            let file = File::create(path).unwrap();
            file.set_modified(SystemTime::now() - Duration::from_secs(age_s)).unwrap();
            file.set_permissions(Permissions::from_mode(mode)).unwrap();
            path.to_owned()
        }

        /// Looks until these are gone, for a bounded time: a child that another test forks has what is open here until it runs its program.
        fn removes(&self, paths: &[PathBuf]) -> bool {
            (0..5000).any(|_| {
                self.0.remove_forgotten();
                std::thread::sleep(Duration::from_millis(1));
                paths.iter().all(|path| !path.exists())
            })
        }

        fn monitor(&self, node: u128, files: &[&str], context_mode: u32, age_s: u64) {
            for file in files {
                self.file(&self.0.monitor_file(node, file), if *file == CONTEXT { context_mode } else { 0o600 }, age_s);
            }
        }

        fn folder(&self, node: u128, age_s: u64) -> PathBuf {
            let folder = self.0.folder(node);
            std::fs::create_dir(&folder).unwrap();
            self.file(&folder.join("iox2_node.details"), 0o400, age_s);
            File::open(&folder).unwrap().set_modified(SystemTime::now() - Duration::from_secs(age_s)).unwrap();
            folder
        }
    }

    impl Drop for Place {
        fn drop(&mut self) {
            let _ = std::fs::remove_dir_all(&self.1);
        }
    }

    /// An id of a process with this number.
    fn id(process: u32, counter: u32) -> u128 {
        u128::from(counter) << 96 | u128::from(process) << 64 | 123_456_789 << 32 | 987_654
    }

    /// The number of a process that has ended.
    fn ended() -> u32 {
        let mut child = std::process::Command::new("true").spawn().unwrap();
        child.wait().unwrap();
        child.id()
    }

    #[test]
    fn nodes_of_ended_processes_that_are_not_whole_go_when_they_are_old() {
        let place = Place::new("nodes");
        let (gone, here) = (ended(), std::process::id());
        let not_whole: [(&[&str], u32); 5] =
            [(&[], 0), (&[CONTEXT], 0o200), (&MONITOR_FILES, 0o200), (&[CONTEXT], 0o400), (&[CONTEXT, "_owner_lock"], 0o400)];
        for (counter, (files, mode)) in (0..).zip(not_whole) {
            for (process, age_s) in [(gone, 20), (gone, 1), (here, 20)] {
                let node = id(process, 100 * u32::from(age_s == 1) + counter);
                place.monitor(node, files, mode, age_s);
                place.folder(node, age_s);
            }
        }
        let whole = id(gone, 50);
        place.monitor(whole, &MONITOR_FILES, 0o400, 20);
        place.folder(whole, 20);
        place.0.remove_forgotten();
        let left: Vec<u128> = place.0.find_nodes().into_keys().collect();
        let mut expected: Vec<u128> = (0..5).flat_map(|counter| [id(gone, 100 + counter), id(here, counter)]).chain([whole]).collect();
        expected.sort_unstable();
        assert_eq!(left, expected);
        assert!(expected.iter().all(|node| place.0.folder(*node).exists()));
    }

    #[test]
    fn files_of_ports_go_with_the_last_process_that_they_name() {
        let place = Place::new("ports");
        let (gone, cleaned, here) = (ended(), ended(), std::process::id());
        // What a node of this process left is its cleaner's to remove.
        place.monitor(id(cleaned, 0), &MONITOR_FILES, 0o400, 20);
        let name = |ids: &[u128], suffix: &str| {
            let ids: Vec<String> = ids.iter().map(u128::to_string).collect();
            format!("iox2_b9fc73e5c1f646968758453273c6c65cb372831b_{}{suffix}", ids.join("_"))
        };
        let shared = |ids: &[u128], suffix: &str, age_s| place.file(&place.0.shared.join(name(ids, suffix)), 0o600, age_s);
        let goes = [
            shared(&[id(gone, 1)], ".data", 20),
            shared(&[id(gone, 1), id(gone, 2)], ".connection", 20),
            shared(&[id(gone, 3)], ".event_mgmt", 20),
            place.file(&place.0.root.join(format!("iox2_{}.event", id(gone, 3))), 0o600, 20),
        ];
        let stays = [
            shared(&[id(gone, 4)], ".data", 1),
            shared(&[id(here, 1)], ".data", 20),
            shared(&[id(cleaned, 1)], ".data", 20),
            shared(&[id(gone, 1), id(here, 2)], ".connection", 20),
            shared(&[id(gone, 5)], ".data", 20),
            place.file(&place.0.shared.join("iox2_nothing.data"), 0o600, 20),
            place.file(&place.0.shared.join("other.data"), 0o600, 20),
        ];
        // The process is gone by its number alone: somebody has its segment.
        let somebody = File::open(&stays[4]).unwrap();
        assert!(place.removes(&goes));
        assert_eq!(stays.clone().map(|path| path.exists()), [true; 7]);
        drop(somebody);
        assert!(place.removes(&stays[4..5]));
    }

    #[test]
    fn the_segment_of_a_service_goes_where_no_description_leads_to_it() {
        let place = Place::new("services");
        let (gone, here) = (ended(), std::process::id());
        let segment = |id: u128, age_s| place.file(&place.0.shared.join(format!("iox2_112437a14a36c452_{id}.dynamic")), 0o600, age_s);
        let describe = |id: u128| {
            let text = format!("[unique_service_id]\npayload_value = {}\nunique_value = {}\n", id as u64, (id >> 64) as u64);
            std::fs::write(place.0.services.join(format!("iox2_{id:x}.service")), text).unwrap();
        };
        describe(id(gone, 2));
        let [own, foreign] = [segment(id(gone, 1), 20), segment(id(gone, 5), 20)];
        let stay = [segment(id(gone, 2), 20), segment(id(gone, 3), 1), segment(id(here, 4), 20)];
        // It is described where this process does not see it, in another mount namespace, and at work there.
        let at_work = File::open(&foreign).unwrap();
        assert!(place.removes(&[own]) && foreign.exists());
        assert_eq!(stay.map(|path| path.exists()), [true; 3]);
        drop(at_work);
        assert!(place.removes(&[foreign]));
    }

    /// As iceoryx2 writes it, of a service of this process.
    #[test]
    fn descriptions_are_read_as_iceoryx2_writes_them() {
        let instance = crate::InstanceName::new(&format!("remains-{}", std::process::id())).unwrap();
        let node = crate::node::create("test", &instance).unwrap();
        let _service = crate::channel::create_event(&node, &instance.observed(), 1, 1, 2).unwrap();
        let places = Places::of(node.config());
        let is_ours = |text: &&String| text.contains(&format!("service_name = \"{}\"", instance.observed()));
        let descriptions = places.descriptions();
        let text = descriptions.iter().find(is_ours).expect("it is described");
        let segments =
            entries(&places.shared).into_iter().map(|entry| name_of(&entry)).filter(|name| name.ends_with(&places.service_segment));
        let of_this = |name: &String| ids(name).last().is_some_and(|id| describes(text, id));
        let found: Vec<String> = segments.filter(of_this).collect();
        assert_eq!(found.len(), 1, "{found:?}");
        assert_eq!(process_of(ids(&found[0]).last().unwrap()), std::process::id());
    }

    #[test]
    fn only_tags_that_are_not_whole_are_removed() {
        let place = Place::new("tags");
        let node = id(ended(), 1);
        let folder = place.folder(node, 0);
        let half = [folder.join("iox2_5.port_tag"), folder.join("iox2_a.service_tag")].map(|path| place.file(&path, 0o600, 0));
        let whole = place.file(&folder.join("iox2_6.port_tag"), 0o400, 0);
        let other = place.file(&folder.join("iox2_b.other"), 0o600, 0);
        place.0.remove_half_made_tags(node);
        assert_eq!(half.map(|path| path.exists()), [false; 2]);
        assert!(whole.exists() && other.exists());
    }

    #[test]
    fn tags_are_put_back_whole_and_go_with_their_folder() {
        let place = Place::new("back");
        let node = id(ended(), 1);
        place.0.put_back_tags(node, [7, 8]).unwrap();
        place.0.put_back_tags(node, [8]).unwrap();
        for port in [7, 8] {
            assert_eq!(place.0.folder(node).join(format!("iox2_{port}.port_tag")).metadata().unwrap().mode() & 0o777, 0o400);
        }
        place.monitor(node, &[CONTEXT], 0o400, 0);
        place.0.remove_folder(node);
        assert!(place.0.folder(node).exists(), "it is monitored");
        std::fs::remove_file(place.0.monitor_file(node, CONTEXT)).unwrap();
        place.0.remove_folder(node);
        assert!(!place.0.folder(node).exists());
    }
}
