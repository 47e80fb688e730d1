//! A camera and a robot's process within the test.

use crate::harness::RESOLUTION;
use beo_ipc::{InstanceName, ObservationHeader, Percept, Producer, Status, Subscriber, SubscriberOptions};
use std::time::{Duration, Instant};

/// Grids of the small model.
pub const DIMS: [u32; 3] = [RESOLUTION as u32; 3];
/// No answer takes longer than this on the slowest machine.
pub const WAIT: Duration = Duration::from_secs(60);

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
        let subscriber = Subscriber::open_within(&instance, &SubscriberOptions { completion: true }, WAIT).unwrap();
        Self { producer: Producer::open_within(&instance, &ObservationHeader::new(DIMS), WAIT).unwrap(), subscriber }
    }

    /// Sends one observation; its number.
    pub fn send(&self, fill: impl FnOnce(&mut ObservationHeader, &mut [u8])) -> u64 {
        let mut loan = self.producer.loan().unwrap();
        let mut header = *loan.header();
        loan.voxels_mut().fill(0);
        fill(&mut header, loan.voxels_mut());
        *loan.header_mut() = header;
        loan.send().unwrap().sequence
    }

    /// The daemon's status as soon as it is as wanted.
    pub fn status(&self, wanted: impl Fn(&Status) -> bool) -> Status {
        let start = Instant::now();
        loop {
            let status = self.subscriber.status().unwrap();
            if let Some(status) = status.filter(&wanted) {
                return status;
            }
            assert!(start.elapsed() < WAIT, "{status:?}");
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    /// Sends one observation and waits for its percept.
    pub fn ask(&self, fill: impl FnOnce(&mut ObservationHeader, &mut [u8])) -> Percept {
        let sequence = self.send(fill);
        let start = Instant::now();
        loop {
            if let Some(percept) = self.subscriber.take_percept().unwrap()
                && percept.sequence == sequence
            {
                return percept;
            }
            assert!(start.elapsed() < WAIT, "no answer");
            self.subscriber.wait(Duration::from_millis(50)).unwrap();
        }
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
