//! What a cleaner that is killed leaves, and what iceoryx2 by itself never looks at again: the daemon's housekeeping finds it.

use super::crowd::resources;
use super::leftovers;
use super::roles::{Actor, Role};
use crate::harness::{PATIENCE, Running, instance, model, run, serve, text};
use rustix::process::Signal;
use std::os::unix::fs::OpenOptionsExt;
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant, SystemTime};

/// The folders of a process' nodes.
fn folders(pid: u32) -> Vec<PathBuf> {
    leftovers::of(&[pid]).into_iter().filter(|path| path.is_dir()).collect()
}

fn tags(pid: u32) -> Vec<PathBuf> {
    let files = folders(pid).into_iter().flat_map(|folder| std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()));
    files.filter(|path| path.extension().is_some_and(|extension| extension == "port_tag")).collect()
}

/// Until it holds; the daemon goes on.
fn eventually(what: &str, holds: impl Fn() -> bool) {
    let start = Instant::now();
    while !holds() {
        assert!(start.elapsed() < PATIENCE, "{what}");
        std::thread::sleep(Duration::from_millis(50));
    }
}

fn ports(daemon: &Running) -> (usize, usize) {
    let (_, descriptors, segments) = resources(daemon.id());
    (descriptors, segments)
}

#[test]
fn ports_whose_tags_a_killed_cleaner_has_removed_give_their_places_back() {
    let name = instance();
    let daemon = serve(&name);
    let before = ports(&daemon);
    // So that it does not clean up before its time.
    daemon.signal(Signal::STOP);
    let mut killed: Vec<Actor> = (0..beo_ipc::limits::MAX_PRODUCERS).map(|_| Actor::start(Role::Opener, &name)).collect();
    for actor in &mut killed {
        // While it lives: other daemons of the machine clean up after whoever is dead.
        let tags = tags(actor.process.id());
        assert_eq!(tags.len(), 2, "a publisher's and a notifier's: {tags:?}");
        tags.iter().for_each(|tag| std::fs::remove_file(tag).unwrap());
        actor.kill();
    }
    daemon.signal(Signal::CONT);
    let pids: Vec<u32> = killed.iter().map(|actor| actor.process.id()).collect();
    eventually("nothing is left of the killed", || leftovers::of(&pids).is_empty());
    eventually("the daemon lets go of their memory", || ports(&daemon) == before);
    // All places were taken.
    Actor::start(Role::Opener, &name).end();
}

#[test]
fn a_node_whose_tag_was_being_made_is_removed() {
    let name = instance();
    let daemon = serve(&name);
    daemon.signal(Signal::STOP);
    let mut killed = Actor::start(Role::Opener, &name);
    let pid = killed.process.id();
    for (folder, tag) in folders(pid).iter().flat_map(|folder| ["iox2_1.service_tag", "iox2_2.port_tag"].map(|tag| (folder, tag))) {
        std::fs::OpenOptions::new().write(true).create_new(true).mode(0o600).open(folder.join(tag)).unwrap();
    }
    killed.kill();
    daemon.signal(Signal::CONT);
    eventually("nothing is left of the killed", || leftovers::of(&[pid]).is_empty());
}

#[test]
fn a_daemon_that_ends_in_order_leaves_nothing_of_who_died_just_before() {
    let name = instance();
    let mut daemon = serve(&name);
    let mut killed = Actor::start(Role::Idler, &name);
    killed.kill();
    // Most likely before its next housekeeping, which comes once a second.
    daemon.signal(Signal::INT);
    assert!(daemon.wait().success());
    let pids = [killed.process.id(), daemon.id()];
    eventually("nothing is left of both", || leftovers::of(&pids).is_empty());
}

/// A command where iceoryx2's folder is one of its own and shared memory that of all: as for a unit with `PrivateTmp=`, or a container that
/// shares /dev/shm.
fn elsewhere(script: &str) -> Command {
    let mut command = Command::new("unshare");
    command.arg(if rustix::process::geteuid().is_root() { "-m" } else { "-Urm" });
    command.args(["sh", "-c", &format!("mount -t tmpfs tmpfs /tmp/iceoryx2 && {script}"), "sh"]).stdin(Stdio::null());
    command
}

/// The daemon that made a service's memory may be gone, and nobody there sees who describes it.
#[test]
fn a_daemon_in_another_mount_namespace_leaves_the_memory_of_living_ones_alone() {
    let name = instance();
    let mut first = serve(&name);
    if !elsewhere("true").stderr(Stdio::null()).status().is_ok_and(|status| status.success()) {
        eprintln!("left out: another mount namespace needs `unshare`, and root or user namespaces");
        return;
    }
    let mut client = Actor::start(Role::Idler, &name);
    first.signal(Signal::KILL);
    first.wait();
    let _second = serve(&name);
    let of_first = || leftovers::of(&[first.id()]).into_iter().filter(|path| path.extension().is_some_and(|e| e == "dynamic"));
    let services: Vec<PathBuf> = of_first().collect();
    assert!(!services.is_empty(), "the services go on");
    let living: Vec<PathBuf> = leftovers::of(&[client.process.id()]);
    // Old enough for whoever takes them for forgotten ones.
    for path in services.iter().chain(&living).filter(|path| path.starts_with("/dev/shm")) {
        std::fs::File::open(path).unwrap().set_modified(SystemTime::now() - Duration::from_secs(60)).unwrap();
    }
    let stranger = format!("{name}-stranger");
    let mut command = elsewhere("exec \"$@\"");
    command.arg(env!("CARGO_BIN_EXE_beo")).args(["serve", "--instance", &stranger, "--model"]).arg(model());
    let _stranger = Running::start(command);
    // It looks after what is left when it starts and every second.
    std::thread::sleep(Duration::from_secs(4));
    assert_eq!(of_first().collect::<Vec<_>>(), services);
    assert_eq!(leftovers::of(&[client.process.id()]), living);
    let status = run(["status", "--instance", &name]);
    assert!(status.status.success(), "{}", text(&status.stderr));
    client.end();
}
