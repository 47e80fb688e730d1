//! The work of a reader's process: take every percept and its completion, and note when.

use super::producer::OPEN;
use super::record::{Record, from_stamp};
use super::{LatencyError, Wake};
use beo_ipc::clock::monotonic_ns;
use beo_ipc::{InstanceName, Percept, Subscriber, SubscriberOptions};
use serde::{Deserialize, Serialize};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Percepts in a second for which memory is there beforehand.
const MOST_PER_SECOND: f64 = 20_000.0;
/// Longest sleep before it is seen that the end has come.
const LONGEST_WAIT: Duration = Duration::from_millis(50);

/// The settings of a reader.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct ReaderPlan {
    /// The daemon's instance.
    pub instance: String,
    /// How it learns that something has come.
    pub wake: Wake,
    /// About how long the producer sends.
    pub seconds: f64,
}

/// Calls `ready` when subscribed, then reads until `stop` is set.
///
/// # Errors
/// The errors of the channels or of `ready`.
pub fn read(plan: &ReaderPlan, stop: &AtomicBool, ready: impl FnOnce() -> std::io::Result<()>) -> Result<Vec<Record>, LatencyError> {
    let subscriber = Subscriber::open_within(&InstanceName::new(&plan.instance)?, &SubscriberOptions { completion: true }, OPEN)?;
    let mut records = Vec::with_capacity((plan.seconds * MOST_PER_SECOND) as usize);
    ready()?;
    loop {
        // What comes before the end is said is read after it.
        let last_round = stop.load(Ordering::Relaxed);
        while let Some(percept) = subscriber.take_percept()? {
            // A completion was sent before its percept: both are in hand when the time is noted.
            while subscriber.take_completion()?.is_some() {}
            records.push(record(&percept, monotonic_ns()));
        }
        match plan.wake {
            _ if last_round => return Ok(records),
            Wake::Event => drop(subscriber.wait(LONGEST_WAIT)?),
            Wake::Polling => std::thread::yield_now(),
        }
    }
}

fn record(percept: &Percept, read_ns: u64) -> Record {
    let (laid_ns, counted) = from_stamp(percept.sensor_stamp_ns);
    let stamps_ns = [
        percept.capture_ns,
        if laid_ns == 0 { percept.capture_ns } else { laid_ns },
        percept.written_ns,
        percept.received_ns,
        percept.projected_ns,
        percept.classified_ns,
        percept.posed_ns,
        percept.completed_ns,
        percept.published_ns,
        read_ns,
    ];
    Record { sequence: percept.sequence, counted, status: percept.status, stamps_ns }
}
