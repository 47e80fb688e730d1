//! The producers and readers that are killed: this test binary once more, in a role given by the environment.

use super::witness::Witness;
use crate::harness::{PATIENCE, RESOLUTION, Running};
use beo_ipc::{InstanceName, OpenError, PoseSearch, ReconnectError, ReconnectingProducer, SendError, SubscriberOptions};
use beo_ipc::{Loan, ObservationHeader, ReconnectingSubscriber, View, Waited};
use std::io::Write;
use std::os::unix::process::parent_id;
use std::process::{Command, Stdio};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

static STOP: AtomicBool = AtomicBool::new(false);

/// The voxels of one observation: pseudo-random, so that a mixture of two is not taken for one.
pub fn voxel(object_id: u64, sequence: u64, index: usize) -> u8 {
    let mixed = (object_id << 40 ^ sequence << 16 ^ index as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    [0, 1, 255, 255][(mixed >> 62) as usize]
}

/// Writes the observation with the next number.
pub fn fill(loan: &mut Loan, object_id: u64, sequence: u64, search: PoseSearch) {
    for (index, byte) in loan.voxels_mut().iter_mut().enumerate() {
        *byte = voxel(object_id, sequence, index);
    }
    let header = loan.header_mut();
    // Said to be from above: the searches for such views are those that robots use, and take milliseconds.
    (header.object_id, header.pose_search, header.view) = (object_id, search.code(), View::TopDown.code());
}

/// The part of another process in a test.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// Sends an observation each so many milliseconds; 0 for as fast as it can.
    Producer { every_ms: u64, search: PoseSearch },
    /// Opens, and does nothing.
    Opener,
    /// Writes a loan and keeps it.
    Holder,
    /// Sends one observation, and does nothing more.
    Sender,
    /// Reads and checks everything.
    Reader,
    /// Subscribes, and does nothing.
    Idler,
    /// Takes as many completions as can be held, and keeps them.
    Hoarder,
}

/// A process in a role.
pub struct Actor {
    pub process: Running,
    /// Its producer's id; 0 for readers.
    pub id: u64,
}

impl Actor {
    /// Starts it, and returns when it is connected.
    pub fn start(role: Role, instance: &str) -> Self {
        let mut actor = Self::begin(role, instance);
        actor.connected();
        actor
    }

    /// Starts it.
    pub fn begin(role: Role, instance: &str) -> Self {
        let mut command = Command::new(std::env::current_exe().unwrap());
        command.args(["--exact", "faults::roles::a_role_in_another_process", "--nocapture"]).stdin(Stdio::null());
        let (every_ms, search) = match role {
            Role::Producer { every_ms, search } => (every_ms, search),
            _ => (0, PoseSearch::Known),
        };
        let name = format!("{role:?}").split(' ').next().unwrap().to_owned();
        command.env("BEO_TEST_ROLE", name).env("BEO_TEST_INSTANCE", instance);
        command.env("BEO_TEST_EVERY_MS", every_ms.to_string()).env("BEO_TEST_SEARCH", search.code().to_string());
        command.env("BEO_TEST_PARENT", std::process::id().to_string());
        Self { process: Running::start(command), id: 0 }
    }

    /// Waits until it is connected.
    pub fn connected(&mut self) {
        self.id = self.hear("open").parse().unwrap();
    }

    /// The rest of the next line that begins with this word.
    pub fn hear(&self, word: &str) -> String {
        loop {
            if let Some(rest) = said(&self.process.line(), word) {
                return rest;
            }
        }
    }

    /// The rest of every line that begins with this word, of those that have come.
    pub fn heard(&self, word: &str) -> Vec<String> {
        self.process.stdout.as_ref().unwrap().try_iter().filter_map(|line| said(&line, word)).collect()
    }

    /// Ends it with SIGKILL.
    pub fn kill(&mut self) {
        self.process.signal(rustix::process::Signal::KILL);
        self.process.wait();
    }

    /// Ends it as by Ctrl-C; it must not have found anything wrong.
    pub fn end(&mut self) {
        self.process.signal(rustix::process::Signal::INT);
        let status = self.process.wait();
        let messages: Vec<String> = self.process.stderr.as_ref().unwrap().try_iter().collect();
        assert!(status.success(), "{}", messages.join("\n"));
    }
}

fn said(line: &str, word: &str) -> Option<String> {
    line.strip_prefix('@')?.strip_prefix(word).map(|rest| rest.trim().to_owned())
}

fn say(line: String) {
    // Marked, and on a line of its own, as the test harness prints lines too.
    let mut out = std::io::stdout().lock();
    let _ = writeln!(out, "\n@{line}").and_then(|()| out.flush());
}

/// Until it is interrupted, or the test that started it is gone.
fn running() -> bool {
    // Not the parent of the first call: the test may be gone before it.
    static PARENT: OnceLock<Option<u32>> = OnceLock::new();
    let parent = PARENT.get_or_init(|| std::env::var("BEO_TEST_PARENT").ok().and_then(|id| id.parse().ok()));
    !STOP.load(Ordering::Relaxed) && *parent == Some(parent_id())
}

fn rest() {
    while running() {
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// Not a test by itself: what another process does until it is killed or interrupted.
#[test]
fn a_role_in_another_process() {
    let variable = |name: &str| std::env::var(format!("BEO_TEST_{name}"));
    let (Ok(role), Ok(instance)) = (variable("ROLE"), variable("INSTANCE")) else { return };
    let instance = InstanceName::new(&instance).unwrap();
    let every = Duration::from_millis(variable("EVERY_MS").unwrap().parse().unwrap());
    let search = PoseSearch::from_code(variable("SEARCH").unwrap().parse().unwrap()).unwrap();
    ctrlc::set_handler(|| STOP.store(true, Ordering::Relaxed)).unwrap();
    let producer = || {
        let producer = ReconnectingProducer::open_within(&instance, &ObservationHeader::new([RESOLUTION as u32; 3]), PATIENCE).unwrap();
        say(format!("open {}", producer.id()));
        producer
    };
    match role.as_str() {
        "Producer" => produce(producer(), &instance, every, search),
        "Opener" => {
            let _producer = producer();
            rest();
        }
        "Holder" => {
            let mut producer = producer();
            let mut loan = producer.loan().unwrap();
            fill(&mut loan, producer.id(), 1, search);
            say("holding".to_owned());
            rest();
        }
        "Sender" => {
            let mut producer = producer();
            let mut loan = producer.loan().unwrap();
            fill(&mut loan, producer.id(), 1, search);
            loan.send().unwrap();
            say("sent 1".to_owned());
            rest();
        }
        "Reader" => {
            let mut witness = Witness::open(&instance);
            say("open 0".to_owned());
            let mut read = 0u64;
            while running() {
                let fresh = witness.look(Duration::from_millis(20)).len();
                if fresh > 0 {
                    read += fresh as u64;
                    say(format!("read {read}"));
                }
            }
            say(format!("silence {}", witness.longest_silence.as_millis()));
        }
        "Idler" => {
            let _subscriber = ReconnectingSubscriber::open_within(&instance, &SubscriberOptions { completion: true }, PATIENCE).unwrap();
            say("open 0".to_owned());
            rest();
        }
        "Hoarder" => {
            let mut subscriber = ReconnectingSubscriber::open_within(&instance, &SubscriberOptions { completion: true }, PATIENCE).unwrap();
            say("open 0".to_owned());
            let mut held = Vec::new();
            while running() && held.len() < beo_ipc::channel::MAX_HELD_SAMPLES {
                if subscriber.wait(Some(Duration::from_millis(50))).unwrap() == Waited::Sent {
                    held.extend(subscriber.take_completion().unwrap());
                }
            }
            say("holding".to_owned());
            rest();
        }
        role => panic!("no role {role}"),
    }
}

/// Sends observation after observation, whichever daemon is there.
fn produce(mut producer: ReconnectingProducer, instance: &InstanceName, every: Duration, search: PoseSearch) {
    let mut sequence = 0;
    if every.is_zero() {
        sequence = 1;
        settle(&mut producer, instance, search, sequence);
    }
    let mut next = Instant::now();
    let mut told = Instant::now();
    while running() {
        let mut loan = match producer.loan() {
            Ok(loan) => loan,
            Err(ReconnectError::Open(OpenError::NotRunning { .. })) => {
                std::thread::sleep(Duration::from_millis(2));
                continue;
            }
            Err(error) => panic!("{error}"),
        };
        fill(&mut loan, producer.id(), sequence + 1, search);
        match loan.send() {
            // Only what was ready to be sent has used its number.
            Err(SendError::PeerInTheWay) => {}
            Err(_) => sequence += 1,
            Ok(sent) => {
                sequence += 1;
                assert_eq!(sent.sequence, sequence);
            }
        }
        if !every.is_zero() || told.elapsed() > Duration::from_millis(10) {
            say(format!("sent {sequence}"));
            told = Instant::now();
        }
        next = (next + every).max(Instant::now());
        std::thread::sleep(next.saturating_duration_since(Instant::now()));
    }
    sequence += 1;
    settle(&mut producer, instance, search, sequence);
    say(format!("sent {sequence}"));
}

/// Sends one more and waits until it is answered: what was sent before it has then been taken, or counted as missed.
///
/// Before a flood, the daemon has to have seen the producer to count what it misses; and what the daemon has not taken yet goes with the
/// producer.
fn settle(producer: &mut ReconnectingProducer, instance: &InstanceName, search: PoseSearch, sequence: u64) {
    let mut subscriber = ReconnectingSubscriber::open_within(instance, &SubscriberOptions::default(), PATIENCE).unwrap();
    let mut loan = producer.loan().unwrap();
    fill(&mut loan, producer.id(), sequence, search);
    assert_eq!(loan.send().unwrap().sequence, sequence);
    let start = Instant::now();
    let answered = |subscriber: &ReconnectingSubscriber| {
        let mut percepts = std::iter::from_fn(|| subscriber.take_percept().unwrap());
        percepts.any(|percept| (percept.producer_id, percept.sequence) == (producer.id(), sequence))
    };
    while !answered(&subscriber) {
        assert!(start.elapsed() < PATIENCE, "observation {sequence} is not answered");
        subscriber.wait(Some(Duration::from_millis(20))).unwrap();
    }
}
