//! Percept and completion handed to many subscribers, as the daemon does, timed.

use super::error::ScaleError;
use super::queries::microseconds;
use beo_ipc::{InstanceName, ObservationHeader, Percept, Server, ServerOptions, Subscriber, SubscriberOptions};
use std::time::{Duration, Instant};

/// The separate phases: sending, and then reading by all subscribers, one after the other.
pub const STAGES: [&str; 2] = ["sent", "read by all"];

/// Longest wait of a subscriber for the daemon's end, which is there before it.
const PATIENCE: Duration = Duration::from_secs(10);

/// The daemon's end of the channels, and subscribers, all in this process.
pub struct Published {
    // Subscribers go before the services do.
    subscribers: Vec<Subscriber>,
    server: Server,
    header: ObservationHeader,
}

impl Published {
    /// Opens an instance of its own with this many subscribers, for completions of `dims`.
    pub fn open(subscribers: usize, dims: [u32; 3]) -> Result<Self, ScaleError> {
        let name = InstanceName::new(&format!("bench-scale-{}-{subscribers}", std::process::id()))?;
        let server = Server::open(&name, &ServerOptions::new(dims))?;
        let open = |_| Subscriber::open_within(&name, &SubscriberOptions { completion: true }, PATIENCE);
        let subscribers = (0..subscribers).map(open).collect::<Result<_, _>>()?;
        Ok(Self { subscribers, server, header: ObservationHeader::new(dims) })
    }

    /// Microseconds of each of [`STAGES`].
    pub fn once(&mut self) -> Result<Vec<f64>, ScaleError> {
        self.header.sequence += 1;
        let start = Instant::now();
        let mut loan = self.server.loan_completion(&self.header)?;
        let (occupancy, deviation) = loan.occupancy_and_deviation_mut();
        occupancy.fill(128);
        deviation.fill(3);
        loan.send()?;
        self.server.publish(&Percept { sequence: self.header.sequence, ..Percept::EMPTY })?;
        let sent = Instant::now();
        for subscriber in &self.subscribers {
            subscriber.wait(PATIENCE)?;
            let percept = subscriber.take_percept()?.map(|percept| percept.sequence);
            let completion = subscriber.take_completion()?.map(|completion| completion.header().sequence);
            if (percept, completion) != (Some(self.header.sequence), Some(self.header.sequence)) {
                return Err(ScaleError::Lost { sequence: self.header.sequence });
            }
        }
        let read = Instant::now();
        Ok(vec![microseconds(start, sent), microseconds(sent, read)])
    }
}
