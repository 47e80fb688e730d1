//! A reader that checks everything it reads, whichever daemon it comes from: nothing torn, nothing stale as fresh.

use super::roles::voxel;
use crate::harness::PATIENCE;
use beo_ipc::clock::monotonic_ns;
use beo_ipc::{Completion, InstanceName, Percept, PerceptStatus, ReconnectingSubscriber, Status, SubscriberOptions};
use std::collections::HashMap;
use std::time::{Duration, Instant};

/// Reads percepts and completions.
pub struct Witness {
    subscriber: ReconnectingSubscriber,
    /// The newest sequence number of each producer, of percepts and of completions.
    newest: [HashMap<u64, u64>; 2],
    /// The daemon that is read from, and those before it, of percepts and of completions.
    daemons: [Vec<u64>; 2],
    model: Option<u64>,
    published_ns: u64,
    /// The last status of each daemon.
    pub statuses: HashMap<u64, Status>,
    /// Heartbeats that were read.
    pub heartbeats: u64,
    /// Observations that were refused as their producer's memory was cut.
    pub cut: u64,
    /// The longest time between two heartbeats of one daemon.
    pub longest_silence: Duration,
}

impl Witness {
    /// Subscribes, as soon as there is a daemon.
    pub fn open(instance: &InstanceName) -> Self {
        let subscriber = ReconnectingSubscriber::open_within(instance, &SubscriberOptions { completion: true }, PATIENCE).unwrap();
        Self {
            subscriber,
            newest: Default::default(),
            daemons: Default::default(),
            model: None,
            published_ns: 0,
            statuses: HashMap::new(),
            heartbeats: 0,
            cut: 0,
            longest_silence: Duration::ZERO,
        }
    }

    /// Waits at most this long, and takes what has come.
    pub fn look(&mut self, timeout: Duration) -> Vec<Percept> {
        self.subscriber.wait(Some(timeout)).unwrap();
        let mut percepts = Vec::new();
        while let Some(percept) = self.subscriber.take_percept().unwrap() {
            self.check(&percept);
            percepts.push(percept);
        }
        // At most two can be held, and one is dropped before the next is taken.
        while let Some(completion) = self.subscriber.take_completion().unwrap() {
            self.check_completion(&completion);
        }
        if let Some(status) = self.subscriber.status().unwrap() {
            self.note(status);
        }
        percepts
    }

    /// Reads until the percepts seen satisfy `enough`.
    pub fn until(&mut self, what: &str, mut enough: impl FnMut(&Percept) -> bool) {
        let start = Instant::now();
        loop {
            let fresh = self.look(Duration::from_millis(20));
            // All of them, as `enough` may count.
            if fresh.iter().filter(|percept| enough(percept)).count() > 0 {
                return;
            }
            assert!(start.elapsed() < PATIENCE, "waited in vain: {what}");
        }
    }

    /// Reads `count` more percepts of one producer.
    pub fn hears(&mut self, producer: u64, count: usize) {
        let mut heard = 0;
        self.until("percepts of a producer", |percept| {
            heard += usize::from(percept.producer_id == producer);
            heard >= count
        });
    }

    /// The daemon whose percept was read last.
    pub fn daemon(&self) -> Option<u64> {
        self.daemons[0].last().copied()
    }

    /// The newest number of a producer that was answered.
    pub fn newest(&self, producer: u64) -> u64 {
        self.newest[0].get(&producer).copied().unwrap_or(0)
    }

    fn note(&mut self, status: Status) {
        let last = self.statuses.insert(status.daemon_id, status);
        self.heartbeats += u64::from(last.is_none_or(|last| last.heartbeat_ns != status.heartbeat_ns));
        if let Some(last) = last {
            let silence = Duration::from_nanos(status.heartbeat_ns.checked_sub(last.heartbeat_ns).expect("heartbeats do not go back"));
            self.longest_silence = self.longest_silence.max(silence);
        }
    }

    /// Percepts that it missed, as its subscriber counts them.
    pub fn missed(&self) -> u64 {
        self.subscriber.missed()
    }

    fn check(&mut self, percept: &Percept) {
        let explanation = beo_ipc::text::from_field(&percept.explanation);
        let is_cut = percept.status == PerceptStatus::BadDims.code() && explanation.contains("was cut");
        // Where the header lay is a page of zeros from then on, and says nothing of its producer.
        let is_gone = percept.status == PerceptStatus::UnknownVersion.code() && (percept.producer_id, percept.detail) == (0, 0);
        if is_cut || is_gone {
            self.cut += 1;
            return;
        }
        assert_eq!(percept.status, 0, "{explanation}");
        self.follow(0, percept.daemon_id, percept.model_id);
        self.advance(0, percept.producer_id, percept.sequence);
        assert_eq!(percept.object_id, percept.producer_id, "identifiers of one observation");
        assert!(percept.capture_ns <= percept.written_ns && percept.written_ns <= percept.received_ns, "{percept:?}");
        assert!(percept.received_ns <= percept.published_ns && percept.published_ns <= monotonic_ns(), "{percept:?}");
        assert!(self.published_ns <= percept.published_ns, "a daemon's percepts come in its order");
        self.published_ns = percept.published_ns;
        let sum: f32 = percept.posterior.iter().sum();
        assert!((sum - 1.0).abs() < 1e-4, "{sum}");
    }

    fn check_completion(&mut self, completion: &Completion) {
        let header = completion.header();
        self.follow(1, header.daemon_id, header.model_id);
        self.advance(1, header.producer_id, header.sequence);
        assert_eq!(header.object_id, header.producer_id, "identifiers of one observation");
        // What was observed is kept: the payload belongs to this observation, all of it.
        for (index, (occupancy, deviation)) in completion.occupancy().iter().zip(completion.deviation()).enumerate() {
            match voxel(header.object_id, header.sequence, index) {
                0 => assert_eq!((*occupancy, *deviation), (0, 0), "voxel {index}"),
                1 => assert_eq!((*occupancy, *deviation), (255, 0), "voxel {index}"),
                _ => {}
            }
        }
    }

    /// A daemon that was replaced does not come back.
    fn follow(&mut self, channel: usize, daemon: u64, model: u64) {
        assert_ne!(daemon, 0);
        assert_eq!(*self.model.get_or_insert(model), model);
        let daemons = &mut self.daemons[channel];
        if daemons.last() != Some(&daemon) {
            assert!(!daemons.contains(&daemon), "a daemon that was replaced speaks again");
            daemons.push(daemon);
        }
    }

    /// Numbers only grow, over restarts of the daemon too.
    fn advance(&mut self, channel: usize, producer: u64, sequence: u64) {
        let last = self.newest[channel].insert(producer, sequence).unwrap_or(0);
        assert!(sequence > last, "observation {sequence} of {producer} after {last}: stale, or twice");
    }
}
