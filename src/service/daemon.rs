//! The loop: wait, receive, answer, heartbeat.

use super::answer::{Answerer, unsupported};
use super::latency::Latencies;
use super::sequences::Sequences;
use super::streams::Streams;
use crate::grid::ObservationError;
use crate::perception::{Method, PerceiveError, Perceiver, Query};
use beo_ipc::clock::monotonic_ns;
use beo_ipc::text::to_field;
use beo_ipc::{InstanceName, OpenError, Percept, ReceiveError, Refusal, Server, ServerOptions, Status, WaitError};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Time between two heartbeats.
const HEARTBEAT: Duration = Duration::from_millis(250);
/// Longest sleep: after this long a request to stop is seen even if no signal interrupts the wait.
const LONGEST_WAIT: Duration = Duration::from_millis(50);
/// Observations taken between two answers: all that can wait at a time, 16 of each of 16 producers. Without a bound, producers that send
/// faster than they are read would keep the daemon reading.
const MOST_AT_ONCE: usize = 256;
/// Time between two rounds of housekeeping.
const HOUSEKEEPING_NS: u64 = 1_000_000_000;

/// The daemon cannot start or go on.
#[derive(Debug, thiserror::Error)]
pub enum ServeError {
    /// The channels cannot be set up.
    #[error(transparent)]
    Open(#[from] OpenError),
    /// The model cannot be used.
    #[error(transparent)]
    Model(#[from] PerceiveError),
    /// The wake-up channel is broken.
    #[error(transparent)]
    Wait(#[from] WaitError),
    /// The observation channel is broken.
    #[error(transparent)]
    Receive(#[from] ReceiveError),
}

/// What a daemon serves.
pub struct ServeOptions {
    /// Its instance.
    pub instance: InstanceName,
    /// How it answers.
    pub query: Query,
    /// The model's name, for people.
    pub model_name: String,
    /// Whether it looks for observations again and again instead of sleeping until one comes.
    pub poll: bool,
}

/// A running daemon.
pub struct Daemon {
    server: Server,
    answerer: Answerer,
    streams: Streams,
    sequences: Sequences,
    latencies: Latencies,
    status: Status,
    dims: [u32; 3],
    method: Method,
    poll: bool,
}

impl Daemon {
    /// Sets up the channels of an instance. Observations that arrive from now on are answered once [`Self::run`] runs.
    pub fn open(perceiver: Perceiver, options: &ServeOptions) -> Result<Self, ServeError> {
        let model = Arc::clone(perceiver.model());
        let dims = <[usize; 3]>::from(model.dims()).map(|side| side as u32);
        let server = Server::open(&options.instance, &ServerOptions::new(dims))?;
        let mut status = Status {
            model_id: model.id,
            started_ns: monotonic_ns(),
            heartbeat_interval_ns: HEARTBEAT.as_nanos() as u64,
            dims,
            class_count: model.classes.len() as u32,
            model_name: to_field(&options.model_name),
            ..Status::EMPTY
        };
        for (field, name) in status.class_names.iter_mut().zip(model.class_names()) {
            *field = to_field(name);
        }
        let mut daemon = Self {
            server,
            streams: Streams::new(model.dims()),
            sequences: Sequences::new(),
            answerer: Answerer::new(perceiver, options.query.clone()),
            latencies: Latencies::new(),
            status,
            dims,
            method: options.query.method,
            poll: options.poll,
        };
        daemon.publish_status();
        Ok(daemon)
    }

    /// This run's identity.
    pub fn id(&self) -> u64 {
        self.server.daemon_id()
    }

    /// What it has done so far.
    pub fn status(&self) -> &Status {
        &self.status
    }

    /// Serves until `stop` is set. What already waits is then answered before returning.
    pub fn run(&mut self, stop: &AtomicBool) -> Result<(), ServeError> {
        let (mut heartbeat, mut housekeeping) = (0, 0);
        loop {
            self.receive()?;
            while let Some(waiting) = self.streams.pop() {
                let percept = self.answerer.answer(&self.server, &waiting);
                if percept.status == 0 {
                    self.status.answered += 1
                } else {
                    self.status.refused += 1
                }
                self.publish(&percept);
                self.latencies.record(monotonic_ns().saturating_sub(waiting.received_ns));
                self.streams.recycle(waiting.observation);
                self.receive()?;
                self.keep_up(&mut heartbeat, &mut housekeeping)?;
            }
            if stop.load(Ordering::Relaxed) {
                self.publish_status();
                return Ok(());
            }
            self.keep_up(&mut heartbeat, &mut housekeeping)?;
            if self.poll {
                // Gives way to whoever shares the core, and returns within a microsecond if nobody does.
                std::thread::yield_now();
            } else {
                self.server.wait(LONGEST_WAIT)?;
            }
        }
    }

    /// Copies what has arrived into the queue; what cannot be answered is refused at once.
    fn receive(&mut self) -> Result<(), ServeError> {
        for _ in 0..MOST_AT_ONCE {
            let observation = match self.server.receive() {
                Ok(Some(observation)) => observation,
                Ok(None) => return Ok(()),
                // Of a producer that vanished meanwhile; the next one is received all the same.
                Err(error) => {
                    tracing::warn!(%error, "an observation could not be received");
                    return Ok(());
                }
            };
            let received_ns = monotonic_ns();
            let header = observation.header();
            // What the producer has overwritten since was replaced by a newer one too.
            let missed = self.sequences.missed(header.producer_id, header.sequence);
            self.status.received += 1 + missed;
            self.status.dropped += missed;
            let outcome = observation.voxels().and_then(|voxels| match unsupported(header, self.dims, self.method) {
                Some(refusal) => Err(refusal),
                None => self.streams.push(header, voxels, received_ns).map_err(|error| refusal(&error, header)),
            });
            match outcome {
                Ok(displaced) => self.status.dropped += displaced as u64,
                Err(refusal) => {
                    tracing::debug!(producer = header.producer_id, sequence = header.sequence, %refusal, "refused");
                    self.status.refused += 1;
                    let percept = Percept { received_ns, model_id: self.status.model_id, ..Percept::refusing(header, &refusal) };
                    self.publish(&percept);
                }
            }
        }
        Ok(())
    }

    fn publish(&self, percept: &Percept) {
        if let Err(error) = self.server.publish(percept) {
            tracing::warn!(%error, sequence = percept.sequence, "a percept could not be sent");
        }
    }

    /// Heartbeat and housekeeping when their time has come.
    fn keep_up(&mut self, heartbeat: &mut u64, housekeeping: &mut u64) -> Result<(), ServeError> {
        let now = monotonic_ns();
        if now.saturating_sub(*heartbeat) >= HEARTBEAT.as_nanos() as u64 {
            *heartbeat = now;
            self.publish_status();
            if self.poll {
                // Wake-ups that nobody waits for would fill their queue.
                self.server.wait(Duration::ZERO)?;
            }
        }
        if now.saturating_sub(*housekeeping) >= HOUSEKEEPING_NS {
            *housekeeping = now;
            self.server.maintain();
        }
        Ok(())
    }

    fn publish_status(&mut self) {
        let [p50, p90, p99] = self.latencies.percentiles();
        (self.status.latency_p50_ns, self.status.latency_p90_ns, self.status.latency_p99_ns) = (p50, p90, p99);
        if let Err(error) = self.server.publish_status(&self.status) {
            tracing::warn!(%error, "the status could not be sent");
        }
    }
}

fn refusal(error: &ObservationError, header: &beo_ipc::ObservationHeader) -> Refusal {
    match error {
        ObservationError::Code { voxel: [i, j, k], code } => {
            let [_, ny, nz] = header.dims.map(|side| side as usize);
            Refusal::BadVoxel { index: (i * ny + j) * nz + k, value: *code }
        }
        ObservationError::Length { found, .. } => Refusal::WrongLength { dims: header.dims, payload_len: *found },
    }
}
