//! A daemon, producers and readers, and random faults among them.

use super::roles::{Actor, Role};
use super::witness::Witness;
use crate::harness::{PATIENCE, Running, model, run, segments, serve_with, text};
use beo_ipc::{InstanceName, PoseSearch, Status};
use rand::{Rng, RngExt};
use rustix::process::Signal;
use std::collections::{BTreeMap, HashMap};
use std::fs::OpenOptions;
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// One of the faults.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Fault {
    /// SIGKILL, and another one is started.
    KillDaemon,
    KillProducer,
    KillReader,
    /// SIGKILL while it starts.
    KillStarting,
    /// SIGSTOP, and SIGCONT at the next fault.
    FreezeProducer,
    FreezeReader,
    /// The model's file is rewritten in place, as by `cp`: in part, which a reload refuses, and wholly, which it takes.
    RewriteModel,
    /// One more producer, which sends as fast as it can.
    Flood,
    /// One more producer, whose memory is cut while its observations wait in it, before it is killed.
    CutMemory,
}

/// The processes, and what became of what was sent.
pub struct Crowd {
    instance: String,
    /// Served; of this crowd alone, so that it can be rewritten.
    model: PathBuf,
    _folder: tempfile::TempDir,
    pub daemon: Running,
    /// In this process.
    pub witness: Witness,
    producers: Vec<Actor>,
    readers: Vec<Actor>,
    frozen: Vec<u32>,
    every_ms: u64,
    /// Numbers said to be sent, by producer.
    sent: HashMap<u64, u64>,
    /// Percepts that the witness read.
    pub answered: u64,
    /// All processes that were ever started.
    pub pids: Vec<u32>,
    pub faults: BTreeMap<Fault, u64>,
    /// From the moment the next daemon says that it serves to its first percept.
    pub resumed: Vec<Duration>,
}

impl Crowd {
    /// A daemon, three producers that send each so many milliseconds, and two readers beside the witness. The first producer and the first
    /// reader survive, and that reader always reads.
    pub fn gather(instance: &str, every_ms: u64) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let served = folder.path().join("served.safetensors");
        std::fs::copy(model(), &served).unwrap();
        let daemon = serve_with(instance, &served, |command| command);
        let witness = Witness::open(&InstanceName::new(instance).unwrap());
        let mut crowd = Self {
            instance: instance.to_owned(),
            model: served,
            _folder: folder,
            pids: vec![daemon.id()],
            daemon,
            witness,
            producers: Vec::new(),
            readers: Vec::new(),
            frozen: Vec::new(),
            every_ms,
            sent: HashMap::new(),
            answered: 0,
            faults: BTreeMap::new(),
            resumed: Vec::new(),
        };
        (0..3).for_each(|_| crowd.add_producer());
        (0..2).for_each(|_| crowd.add_reader());
        crowd
    }

    /// Reads for this long.
    pub fn pass(&mut self, time: Duration) {
        let start = Instant::now();
        while start.elapsed() < time {
            self.look();
        }
    }

    /// Reads until the daemon, with nobody frozen, has done its housekeeping, which comes once in four heartbeats, at least twice.
    pub fn settle(&mut self) {
        self.thaw();
        let (start, beaten) = (Instant::now(), self.witness.heartbeats);
        while self.witness.heartbeats < beaten + 12 {
            self.look();
            assert!(start.elapsed() < PATIENCE, "the daemon's heart does not beat");
        }
    }

    fn look(&mut self) -> bool {
        let fresh = self.witness.look(Duration::from_millis(20));
        self.answered += fresh.len() as u64;
        for producer in &self.producers {
            note(&mut self.sent, producer);
        }
        for percept in &fresh {
            let sent = self.sent.entry(percept.producer_id).or_default();
            *sent = percept.sequence.max(*sent);
        }
        // Nobody else reads what they say.
        self.readers.iter().for_each(|reader| drop(reader.heard("read")));
        !fresh.is_empty()
    }

    fn add_producer(&mut self) {
        let role = Role::Producer { every_ms: self.every_ms, search: PoseSearch::Known };
        let actor = self.join(role);
        self.producers.push(actor);
    }

    fn add_reader(&mut self) {
        let actor = self.join(Role::Reader);
        self.readers.push(actor);
    }

    fn join(&mut self, role: Role) -> Actor {
        let actor = Actor::start(role, &self.instance);
        self.pids.push(actor.process.id());
        actor
    }

    /// Daemon, and the producer and the reader that no fault kills.
    pub fn survivors(&self) -> [u32; 3] {
        [self.daemon.id(), self.producers[0].process.id(), self.readers[0].process.id()]
    }

    /// Does one of `possible` to someone.
    pub fn fault(&mut self, random: &mut impl Rng, possible: &[Fault]) {
        self.thaw();
        let fault = possible[random.random_range(0..possible.len())];
        *self.faults.entry(fault).or_default() += 1;
        match fault {
            Fault::KillDaemon => self.restart_daemon(),
            Fault::KillProducer => {
                let which = random.random_range(1..self.producers.len());
                let mut killed = self.producers.swap_remove(which);
                killed.kill();
                note(&mut self.sent, &killed);
                self.add_producer();
            }
            Fault::KillReader => {
                let which = random.random_range(1..self.readers.len());
                let mut killed = self.readers.swap_remove(which);
                killed.kill();
                self.add_reader();
            }
            Fault::KillStarting => {
                let role = [Role::Opener, Role::Idler][random.random_range(0..2)];
                let mut killed = Actor::begin(role, &self.instance);
                self.pids.push(killed.process.id());
                // Connected after some ten milliseconds.
                self.pass(Duration::from_micros(random.random_range(0..60_000)));
                killed.kill();
            }
            Fault::FreezeProducer | Fault::FreezeReader => {
                let among = if fault == Fault::FreezeProducer { &self.producers } else { &self.readers[1..] };
                let process = &among[random.random_range(0..among.len())].process;
                process.signal(Signal::STOP);
                self.frozen.push(process.id());
            }
            Fault::RewriteModel => self.rewrite_model(),
            Fault::Flood => {
                let mut flood = self.join(Role::Producer { every_ms: 0, search: PoseSearch::Known });
                self.pass(Duration::from_secs(1));
                flood.end();
                note(&mut self.sent, &flood);
            }
            Fault::CutMemory => self.cut_memory(),
        }
    }

    /// Lets the frozen go on.
    pub fn thaw(&mut self) {
        for pid in std::mem::take(&mut self.frozen) {
            rustix::process::kill_process(rustix::process::Pid::from_raw(pid as i32).unwrap(), Signal::CONT).unwrap();
        }
    }

    fn restart_daemon(&mut self) {
        self.look();
        let before = self.witness.daemon();
        self.daemon.signal(Signal::KILL);
        self.daemon.wait();
        self.daemon = serve_with(&self.instance, &self.model, |command| command);
        self.pids.push(self.daemon.id());
        let start = Instant::now();
        while self.witness.daemon() == before {
            self.look();
            assert!(start.elapsed() < PATIENCE, "no percept of the next daemon");
        }
        self.resumed.push(start.elapsed());
    }

    fn rewrite_model(&mut self) {
        let whole = std::fs::read(&self.model).unwrap();
        for length in [whole.len() / 2, whole.len()] {
            std::fs::write(&self.model, &whole[..length]).unwrap();
            self.look();
            let output = run(["reload", "--instance", &self.instance]);
            let code = i32::from(length < whole.len());
            assert_eq!(output.status.code(), Some(code), "{length} of {} bytes: {}", whole.len(), text(&output.stderr));
        }
    }

    /// What the daemon has not taken yet of that producer is refused, or gone with it.
    fn cut_memory(&mut self) {
        let mut hostile = self.join(Role::Producer { every_ms: 5, search: PoseSearch::Known });
        let start = Instant::now();
        while self.witness.newest(hostile.id) == 0 {
            self.look();
            assert!(start.elapsed() < PATIENCE, "no percept of a new producer");
        }
        self.daemon.signal(Signal::STOP);
        (0..3).for_each(|_| drop(hostile.hear("sent")));
        hostile.process.signal(Signal::STOP);
        for path in segments(hostile.process.id()).iter().filter(|path| path.extension().is_some_and(|e| e == "data")) {
            OpenOptions::new().write(true).open(path).unwrap().set_len(0).unwrap();
        }
        self.daemon.signal(Signal::CONT);
        self.pass(Duration::from_millis(50));
        hostile.kill();
        note(&mut self.sent, &hostile);
    }

    /// Ends producers, waits for the daemon to come to rest, ends all.
    pub fn disperse(mut self) -> Account {
        self.thaw();
        for producer in &mut self.producers {
            producer.end();
            note(&mut self.sent, producer);
        }
        let (start, mut last) = (Instant::now(), self.witness.heartbeats);
        // The last of these heartbeats knows of everything.
        while self.witness.heartbeats < last + 3 {
            if self.look() {
                last = self.witness.heartbeats;
            }
            assert!(start.elapsed() < PATIENCE, "the daemon does not come to rest");
        }
        self.readers.iter_mut().for_each(Actor::end);
        let silence_ms = self.readers[0].heard("silence")[0].parse().unwrap();
        self.daemon.signal(Signal::INT);
        assert!(self.daemon.wait().success());
        let daemons: Vec<Status> = self.witness.statuses.values().copied().collect();
        let count = |of: fn(&Status) -> u64| daemons.iter().map(of).sum();
        Account {
            sent: self.sent.values().sum(),
            answered: self.answered - self.witness.cut,
            missed: self.witness.missed(),
            dropped: count(|status| status.dropped),
            overflowed: count(|status| status.overflowed),
            refused: count(|status| status.refused),
            producers: self.sent.len(),
            daemons: daemons.len(),
            silence_ms,
        }
    }
}

/// The outcome of everything that was sent.
#[derive(Debug)]
pub struct Account {
    /// Sent, as the producers said.
    pub sent: u64,
    /// Answered, as the witness read.
    pub answered: u64,
    /// Answered or refused, which the witness said that it missed.
    pub missed: u64,
    /// Replaced by a newer one, as the daemons said with their last heartbeat.
    pub dropped: u64,
    /// Lost in full queues, as the daemons said.
    pub overflowed: u64,
    /// Refused, as the daemons said.
    pub refused: u64,
    /// All producers that ever sent, and all daemons.
    pub producers: usize,
    pub daemons: usize,
    /// The longest time between two heartbeats of one daemon, as the reader that always reads saw them.
    pub silence_ms: u64,
}

impl Account {
    /// In flight when a daemon, or their producer, was killed.
    pub fn lost(&self) -> i64 {
        self.sent as i64 - (self.answered + self.missed + self.dropped + self.overflowed + self.refused) as i64
    }
}

/// The highest number that a producer says it has sent.
fn note(sent: &mut HashMap<u64, u64>, producer: &Actor) {
    let highest = producer.heard("sent").iter().map(|number| number.parse().unwrap()).max().unwrap_or(0);
    let entry = sent.entry(producer.id).or_default();
    *entry = highest.max(*entry);
}

/// Resident memory of a process in kB, its open descriptors, and its mapped segments.
///
/// Of descriptors the fewest in a tenth of a second: not those that are open for a moment only, as while a folder is looked through.
pub fn resources(pid: u32) -> (u64, usize, usize) {
    let status = std::fs::read_to_string(format!("/proc/{pid}/status")).unwrap();
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:")).unwrap();
    let resident = line.split_whitespace().next().unwrap().parse().unwrap();
    let descriptors = (0..5).map(|look| {
        std::thread::sleep(Duration::from_millis(if look == 0 { 0 } else { 25 }));
        std::fs::read_dir(format!("/proc/{pid}/fd")).unwrap().count()
    });
    (resident, descriptors.min().unwrap(), crate::harness::segments(pid).len())
}
