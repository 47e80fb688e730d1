//! A camera and a robot's process within the test.

use crate::harness::{PATIENCE, RESOLUTION};
use beo_ipc::{InstanceName, ObservationHeader, Percept, Producer, Status, Subscriber, SubscriberOptions};
use std::time::{Duration, Instant};

/// Grids of the small model.
pub const DIMS: [u32; 3] = [RESOLUTION as u32; 3];

/// A camera and a robot's process in one.
pub struct Client {
    /// The camera.
    pub producer: Producer,
    /// The robot.
    pub subscriber: Subscriber,
}

impl Client {
    /// Joins a daemon.
    pub fn new(name: &str) -> Self {
        let instance = InstanceName::new(name).unwrap();
        let subscriber = Subscriber::open_within(&instance, &SubscriberOptions { completion: true }, PATIENCE).unwrap();
        Self { producer: Producer::open_within(&instance, &ObservationHeader::new(DIMS), PATIENCE).unwrap(), subscriber }
    }

    /// Sends one observation; its producer as its header says, and its number.
    pub fn send(&self, fill: impl FnOnce(&mut ObservationHeader, &mut [u8])) -> (u64, u64) {
        let mut loan = self.producer.loan().unwrap();
        let mut header = *loan.header();
        loan.voxels_mut().fill(0);
        fill(&mut header, loan.voxels_mut());
        *loan.header_mut() = header;
        (header.producer_id, loan.send().unwrap().sequence)
    }

    /// The daemon's status as soon as it is as wanted.
    pub fn status(&self, wanted: impl Fn(&Status) -> bool) -> Status {
        let start = Instant::now();
        loop {
            let status = self.subscriber.status().unwrap();
            if let Some(status) = status.filter(&wanted) {
                return status;
            }
            let counters = status.map(|s| (s.received, s.answered, s.refused, s.dropped, s.overflowed, s.failed, s.state));
            assert!(start.elapsed() < PATIENCE, "received, answered, refused, dropped, overflowed, failed, state: {counters:?}");
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    /// The percept of an observation of this producer and number, as soon as there is one.
    pub fn percept(&self, (producer, sequence): (u64, u64)) -> Percept {
        self.first(|percept| (percept.producer_id, percept.sequence) == (producer, sequence))
    }

    /// The next percept of this producer, which may overtake some of its observations by newer ones.
    pub fn percept_of(&self, producer: u64) -> Percept {
        self.first(|percept| percept.producer_id == producer)
    }

    fn first(&self, wanted: impl Fn(&Percept) -> bool) -> Percept {
        let start = Instant::now();
        loop {
            match self.subscriber.take_percept().unwrap() {
                Some(percept) if wanted(&percept) => return percept,
                Some(_) => {}
                None => {
                    assert!(start.elapsed() < PATIENCE, "no answer");
                    self.subscriber.wait(Duration::from_millis(50)).unwrap();
                }
            }
        }
    }

    /// Sends one observation and waits for its percept.
    pub fn ask(&self, fill: impl FnOnce(&mut ObservationHeader, &mut [u8])) -> Percept {
        self.percept(self.send(fill))
    }
}

/// A solid block seen from above.
pub fn block(voxels: &mut [u8]) {
    let n = RESOLUTION;
    for column in 0..n * n {
        if (3..n - 3).contains(&(column / n)) && (4..n - 4).contains(&(column % n)) {
            voxels[column * n + 8] = 1;
            voxels[column * n..column * n + 8].fill(255);
        }
    }
}

/// Why an observation was refused.
pub fn explanation(percept: &Percept) -> &str {
    beo_ipc::text::from_field(&percept.explanation)
}
