//! The remains in /dev/shm of a process that is killed while it makes a segment: an empty file of mode 0200, which iceoryx2 0.10.0 opens
//! for ever.
//!
//! The file is planted in the place of a segment of a process that is then killed. Everything that could block is done by other processes
//! (this test binary again, see [`a_role_in_another_process`]), and waited for only for a while: a test fails where it would hang. As
//! another user than root iceoryx2 does not block, and the tests show less.

use std::fs::{File, Permissions};
use std::io::{BufRead, BufReader, Write};
use std::os::unix::fs::{MetadataExt, PermissionsExt};
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, SystemTime};

use beo_ipc::{InstanceName, ObservationHeader, Percept, Producer, Server, ServerOptions, Subscriber, SubscriberOptions};
use iceoryx2::prelude::*;
use rustix::process::{Pid, Signal, kill_process};

const DIMS: [u32; 3] = [30; 3];
const PATIENCE: Duration = Duration::from_secs(20);

/// Not a test by itself: what a child process does until it is killed.
#[test]
fn a_role_in_another_process() {
    let (Ok(role), Ok(instance)) = (std::env::var("BEO_IPC_TEST_ROLE"), std::env::var("BEO_IPC_TEST_INSTANCE")) else { return };
    let instance = InstanceName::new(&instance).unwrap();
    match role.as_str() {
        "server" => {
            let server = Server::open(&instance, &ServerOptions::new(DIMS)).unwrap();
            say("serving");
            loop {
                server.wait(Duration::from_millis(20)).unwrap();
                while server.receive().unwrap().is_some() {
                    say("observed");
                }
                server.maintain();
            }
        }
        "producer" => {
            let producer = Producer::open_within(&instance, &ObservationHeader::new(DIMS), PATIENCE).unwrap();
            let mut loan = producer.loan().unwrap();
            loan.voxels_mut().fill(255);
            loan.send().unwrap();
            say("sent");
            loop {
                std::thread::sleep(PATIENCE);
            }
        }
        // Those below never clean up by themselves.
        "bare server" => {
            let server = Server::open(&instance, &ServerOptions::new(DIMS)).unwrap();
            say("serving");
            for round in 1u64.. {
                while server.receive().unwrap().is_some() {}
                server.publish(&Percept { sequence: round, ..Percept::EMPTY }).unwrap();
                say("alive");
            }
        }
        "bare producer" => {
            let producer = Producer::open_within(&instance, &ObservationHeader::new(DIMS), PATIENCE).unwrap();
            loop {
                // An error would say that it did not connect: also no waiting.
                let _ = producer.loan().unwrap().send();
                say("alive");
            }
        }
        "bare subscriber" => {
            let subscriber = Subscriber::open_within(&instance, &SubscriberOptions { completion: true }, PATIENCE).unwrap();
            loop {
                subscriber.take_percept().unwrap();
                subscriber.take_completion().unwrap();
                subscriber.status().unwrap();
                say("alive");
            }
        }
        "another program" => {
            say("creating");
            let node = NodeBuilder::new().config(&Config::default()).create::<ipc_threadsafe::Service>().unwrap();
            say("created");
            drop(node);
        }
        role => panic!("no role {role}"),
    }
}

fn say(word: &str) {
    // Marked, as the test harness prints lines of its own.
    println!("\n@{word}");
    std::io::stdout().flush().unwrap();
    // Whoever says the same again and again need not do so faster than anyone reads.
    std::thread::sleep(Duration::from_millis(5));
}

struct Peer {
    child: Child,
    said: Receiver<String>,
}

impl Peer {
    fn start(role: &str, instance: &InstanceName) -> Self {
        let mut child = Command::new(std::env::current_exe().unwrap())
            .args(["--exact", "a_role_in_another_process", "--nocapture"])
            .env("BEO_IPC_TEST_ROLE", role)
            .env("BEO_IPC_TEST_INSTANCE", instance.as_str())
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let output = BufReader::new(child.stdout.take().unwrap());
        let (sender, said) = channel();
        std::thread::spawn(move || {
            for line in output.lines().map_while(Result::ok) {
                if let Some(word) = line.strip_prefix('@') {
                    let _ = sender.send(word.to_owned());
                }
            }
        });
        Self { child, said }
    }

    fn hear(&self, word: &str) {
        match self.said.recv_timeout(PATIENCE) {
            Ok(said) => assert_eq!(said, word),
            Err(error) => panic!("waited in vain for a process to say `{word}`: {error}"),
        }
    }

    fn signal(&self, signal: Signal) {
        kill_process(Pid::from_child(&self.child), signal).unwrap();
    }

    /// Says nothing more, after what it has said.
    fn freeze(&self) {
        self.signal(Signal::STOP);
        let stat = format!("/proc/{}/stat", self.child.id());
        // After the name in brackets comes the state.
        while !std::fs::read_to_string(&stat).unwrap().rsplit_once(") ").is_some_and(|(_, rest)| rest.starts_with('T')) {
            std::thread::sleep(Duration::from_millis(1));
        }
        while self.said.recv_timeout(Duration::from_millis(50)).is_ok() {}
    }

    /// Kills the process, and leaves its segments whose names end in `suffix` as if it had been killed while it made them.
    fn kill_while_making(mut self, suffix: &str) -> Vec<PathBuf> {
        let maps = std::fs::read_to_string(format!("/proc/{}/maps", self.child.id())).unwrap();
        let mut segments: Vec<PathBuf> = maps
            .lines()
            .filter(|line| line.ends_with(suffix))
            .filter_map(|line| line.find("/dev/shm/").map(|at| line[at..].into()))
            .collect();
        segments.sort();
        segments.dedup();
        assert!(!segments.is_empty(), "{maps}");
        for segment in &segments {
            std::fs::remove_file(segment).unwrap();
            File::create_new(segment).unwrap().set_permissions(Permissions::from_mode(0o200)).unwrap();
        }
        self.child.kill().unwrap();
        self.child.wait().unwrap();
        segments
    }
}

impl Drop for Peer {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// One test at a time, as each removes what it finds; and none leaves anything to the next, even if it fails.
struct Turn(#[expect(dead_code, reason = "held")] MutexGuard<'static, ()>);

impl Turn {
    fn take() -> Self {
        static TURN: Mutex<()> = Mutex::new(());
        Self(TURN.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

impl Drop for Turn {
    fn drop(&mut self) {
        if std::thread::panicking() {
            orphans().iter().for_each(|segment| drop(std::fs::remove_file(segment)));
        }
    }
}

fn orphans() -> Vec<PathBuf> {
    let entries = std::fs::read_dir("/dev/shm").unwrap().filter_map(Result::ok);
    entries
        .filter(|entry| entry.file_name().to_string_lossy().starts_with("iox2_"))
        .filter(|entry| entry.metadata().is_ok_and(|status| status.len() == 0 && status.mode() & 0o777 == 0o200))
        .map(|entry| entry.path())
        .collect()
}

fn instance(test: &str) -> InstanceName {
    InstanceName::new(&format!("test-{test}-{}", std::process::id())).unwrap()
}

fn make_older(segments: &[PathBuf]) {
    for segment in segments {
        File::options().write(true).open(segment).unwrap().set_modified(SystemTime::now() - Duration::from_secs(60)).unwrap();
    }
}

#[test]
fn a_producer_killed_while_it_connected_blocks_neither_the_daemon_nor_the_next_producer() {
    let _turn = Turn::take();
    let instance = instance("half-a-connection");
    let server = Peer::start("server", &instance);
    server.hear("serving");
    let killed = Peer::start("producer", &instance);
    killed.hear("sent");
    server.hear("observed");
    let planted = killed.kill_while_making(".connection");
    let next = Peer::start("producer", &instance);
    next.hear("sent");
    server.hear("observed");
    assert!(planted.iter().all(|segment| !segment.exists()), "{planted:?}");
}

#[test]
fn a_daemon_killed_while_it_made_its_services_does_not_block_the_next() {
    let _turn = Turn::take();
    for age in ["young", "old"] {
        let instance = instance(&format!("half-a-service-{age}"));
        let killed = Peer::start("server", &instance);
        killed.hear("serving");
        let planted = killed.kill_while_making(".dynamic");
        if age == "old" {
            make_older(&planted);
        }
        let next = Peer::start("server", &instance);
        next.hear("serving");
        let producer = Peer::start("producer", &instance);
        producer.hear("sent");
        next.hear("observed");
    }
}

#[test]
fn housekeeping_frees_another_program_that_is_already_blocked() {
    let _turn = Turn::take();
    let instance = instance("freed");
    let server = Peer::start("server", &instance);
    server.hear("serving");
    let killed = Peer::start("producer", &instance);
    killed.hear("sent");
    server.hear("observed");
    killed.kill_while_making(".connection");
    let blocked = Peer::start("another program", &instance);
    blocked.hear("creating");
    blocked.hear("created");
}

/// Freezes `role` while `peer` starts and is killed making its connections; then nobody but `role` itself can free it.
fn goes_on_after_half_a_connection(role: &str, peer: &str) {
    let _turn = Turn::take();
    let instance = instance(&format!("half-{}", role.replace(' ', "-")));
    let first = (role != "bare server").then(|| Peer::start("bare server", &instance));
    if let Some(first) = &first {
        first.hear("serving");
    }
    let frozen = Peer::start(role, &instance);
    if first.is_none() {
        frozen.hear("serving");
    }
    frozen.hear("alive");
    frozen.freeze();
    // The daemon's successor, where the frozen one is its client.
    drop(first);
    let killed = Peer::start(peer, &instance);
    killed.hear(if peer == "bare server" { "serving" } else { "alive" });
    let planted = killed.kill_while_making(".connection");
    frozen.signal(Signal::CONT);
    for _ in 0..20 {
        frozen.hear("alive");
    }
    // Made anew where the frozen one connected before anyone cleaned up after the dead.
    assert!(planted.iter().all(|segment| segment.metadata().map_or(true, |status| status.len() > 0)), "{planted:?}");
}

#[test]
fn a_daemon_that_meets_half_a_connection_of_a_killed_producer_goes_on_by_itself() {
    goes_on_after_half_a_connection("bare server", "bare producer");
}

#[test]
fn a_daemon_that_meets_half_a_connection_of_a_killed_subscriber_goes_on_by_itself() {
    goes_on_after_half_a_connection("bare server", "bare subscriber");
}

#[test]
fn a_producer_that_meets_half_a_connection_of_a_killed_daemon_goes_on_by_itself() {
    goes_on_after_half_a_connection("bare producer", "bare server");
}

#[test]
fn a_subscriber_that_meets_half_a_connection_of_a_killed_daemon_goes_on_by_itself() {
    goes_on_after_half_a_connection("bare subscriber", "bare server");
}
