//! The daemon's ends of all channels: one per instance.

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use iceoryx2::port::listener::Listener;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber as Reader;
use iceoryx2::prelude::{Node, PayloadHeader as _};
use iceoryx2::sample::Sample;
use iceoryx2::sample_mut::SampleMut;

use crate::InstanceName;
use crate::channel::{self, Limits, OBSERVATION_READERS, ObservationService, observation_buffer};
use crate::clock::monotonic_ns;
use crate::control::{self, ControlPort, ReloadCall};
use crate::error::{LoanError, OpenError, ReceiveError, SendError, WaitError};
use crate::identity::unique_id;
use crate::joining;
use crate::limits::{MAX_PRODUCERS, MAX_SUBSCRIBERS, voxel_count};
use crate::memory::{MEMBER_BYTES, publisher_bytes, require_shared_memory};
use crate::messages::{ABI_VERSION, CompletionHeader, ObservationHeader, Percept, Status};
use crate::node::{self, Ipc};
use crate::registered::{Registered, release_forgotten};
use crate::remains::Places;
use crate::segments::Segments;
use crate::shared::copy_of;
use crate::sweeper::Sweeper;
use crate::validate::{Refusal, validate};

/// Percepts that are kept for a reader that is late.
const PERCEPT_BUFFER: usize = 32;

/// Bytes that the chunks for completions may take before there are fewer than the worst case needs.
const COMPLETION_BUDGET: usize = 64 << 20;

/// Chunks for completions that there are in any case.
const MIN_COMPLETION_CHUNKS: usize = 8;

/// Voxels above which one completion, not two, is kept for a late reader.
const BIG_GRID: usize = 64 * 64 * 64;

/// How a daemon sets up its channels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ServerOptions {
    /// The largest grid that is completed: normally the model's dims. Sizes the segments.
    pub dims: [u32; 3],
    /// Most producers at a time. Default: [`MAX_PRODUCERS`].
    pub producers: usize,
    /// Most subscribers at a time. Default: [`MAX_SUBSCRIBERS`].
    pub subscribers: usize,
}

impl ServerOptions {
    /// The defaults for grids of `dims`.
    pub const fn new(dims: [u32; 3]) -> Self {
        Self { dims, producers: MAX_PRODUCERS, subscribers: MAX_SUBSCRIBERS }
    }
}

/// The daemon's ends of all channels.
///
/// Its segments, all touched at opening, for 16 subscribers: percepts 547 chunks of 1.3 kB; status 51 chunks of 2.4 kB; completions at 30³
/// 67 chunks of 54 kB (3.6 MB), at 254³ 8 chunks of 33 MB (262 MB). Below the worst case (more than two subscribers holding two big
/// completions each) [`Server::loan_completion`] can fail with [`LoanError::NoFreeChunk`]; that grid is then not completed, and everything
/// else goes on.
#[derive(Debug)]
pub struct Server {
    // The percepts' publisher goes first: it is the word that a daemon runs.
    percepts: Publisher<Ipc, Percept, ()>,
    completions: Publisher<Ipc, [u8], CompletionHeader>,
    statuses: Publisher<Ipc, Status, ()>,
    observations: Reader<Ipc, [u8], ObservationHeader>,
    observation: ObservationService,
    segments: Segments,
    observed: Listener<Ipc>,
    perceived: Notifier<Ipc>,
    control: ControlPort,
    /// All but that of observations.
    services: [Box<dyn Registered>; 6],
    completion_len: usize,
    daemon_id: u64,
    /// Percepts sent, or tried to send.
    answers: AtomicU64,
    // Dropped last, with what keeps dropping the others from waiting.
    node: Node<Ipc>,
    #[expect(dead_code, reason = "sweeps until dropped")]
    sweeper: Sweeper,
}

impl Server {
    /// Creates the services of `instance`, or takes them over from a daemon that is gone; cleans up after one that was killed.
    ///
    /// # Errors
    /// [`OpenError::AlreadyRunning`] if a daemon serves the instance, [`OpenError::OtherSettings`] if clients still hold services with
    /// other limits, [`OpenError::NotEnoughSharedMemory`]; see [`OpenError`] for the rest.
    pub fn open(instance: &InstanceName, options: &ServerOptions) -> Result<Self, OpenError> {
        let voxels = voxel_count(options.dims).ok_or(OpenError::BadDims(options.dims))?;
        let completion_len = 2 * voxels;
        let node = node::create("daemon", instance)?;
        let sweeper =
            Sweeper::start(node.config()).map_err(|error| OpenError::Failed { what: "a thread".to_owned(), cause: error.to_string() })?;
        node::clean_up_and_wait(&node);
        match channel::open_percept(&node, instance) {
            Ok(running) if joining::daemon_runs(&running) => {
                return Err(OpenError::AlreadyRunning { instance: instance.clone(), pid: joining::daemon_pid(&running) });
            }
            Ok(_) | Err(OpenError::NotRunning { .. }) => {}
            Err(error) => return Err(error),
        }

        let nodes = options.producers + options.subscribers + OBSERVATION_READERS + 8;
        let published = |buffer| Limits { publishers: 1, readers: options.subscribers, buffer, history: 1, nodes };
        let percept_limits = published(PERCEPT_BUFFER);
        let completion_limits = published(if voxels > BIG_GRID { 1 } else { 2 });
        let status_limits = published(1);
        let observation_limits =
            Limits { publishers: options.producers, readers: OBSERVATION_READERS, buffer: observation_buffer(voxels), history: 0, nodes };
        let completion_chunks = completion_chunks(completion_limits.chunks(), completion_len);
        require_shared_memory(
            publisher_bytes(percept_limits.chunks(), size_of::<Percept>())
                + publisher_bytes(completion_chunks, completion_len)
                + publisher_bytes(status_limits.chunks(), size_of::<Status>()),
        )?;

        let percept = channel::create_percept(&node, instance, &percept_limits)?;
        let percepts = channel::create_publisher(&percept, percept_limits.chunks()).map_err(|error| match error {
            OpenError::Full { .. } => OpenError::AlreadyRunning { instance: instance.clone(), pid: joining::daemon_pid(&percept) },
            error => error,
        })?;
        let completion = channel::create_completion(&node, instance, &completion_limits)?;
        let completions = channel::create_slice_publisher(&completion, completion_chunks, completion_len)?;
        let status = channel::create_status(&node, instance, &status_limits)?;
        let statuses = channel::create_publisher(&status, status_limits.chunks())?;
        let observation = channel::create_observation(&node, instance, &observation_limits)?;
        let observing = channel::create_event(&node, &instance.observed(), options.producers, OBSERVATION_READERS, nodes)?;
        let observed = channel::create_listener(&observing)?;
        let observations = channel::create_reader(&observation)?;
        let perceiving = channel::create_event(&node, &instance.perceived(), 1, options.subscribers, nodes)?;
        let perceived = channel::create_notifier(&perceiving)?;
        let (control, controlling) = control::create(&node, instance)?;
        Ok(Self {
            percepts,
            completions,
            statuses,
            observations,
            observation,
            segments: Segments::default(),
            observed,
            perceived,
            control,
            services: [
                Box::new(percept),
                Box::new(completion),
                Box::new(status),
                Box::new(observing),
                Box::new(perceiving),
                Box::new(controlling),
            ],
            completion_len,
            daemon_id: unique_id(),
            answers: AtomicU64::new(0),
            node,
            sweeper,
        })
    }

    /// This run of the daemon; everything that is sent carries it.
    pub fn daemon_id(&self) -> u64 {
        self.daemon_id
    }

    /// Waits until a producer has sent something, at most `timeout`: true if one has, false otherwise or when a signal interrupted. Receive
    /// everything before waiting again: one wake-up can stand for several observations.
    ///
    /// # Errors
    /// [`WaitError`] if the event service is broken.
    pub fn wait(&self, timeout: Duration) -> Result<bool, WaitError> {
        Ok(channel::wait(&self.observed, timeout)? == channel::Woken::Notified)
    }

    /// The next observation of any producer; those of one producer come in its order. 16 of each producer wait (fewer if they are big: 2 at
    /// 254³), then the oldest is replaced. At most [`channel::MAX_HELD_SAMPLES`] of one producer can be held.
    ///
    /// # Errors
    /// [`ReceiveError::TooManyHeld`] until an observation taken earlier is dropped.
    // Across crates too: else every look that finds nothing moves the room of a whole observation, a third of a microsecond in all.
    #[inline]
    pub fn receive(&self) -> Result<Option<Observation>, ReceiveError> {
        while let Some(sample) = self.observations.receive().map_err(channel::receive_error)? {
            match Observation::new(sample, &self.segments, &self.observation) {
                Some(observation) => return Ok(Some(observation)),
                None => tracing::warn!("an observation lies outside of its producer's memory: it is passed over"),
            }
        }
        Ok(None)
    }

    /// The next call for another model; to be looked for now and then, as it comes without a wake-up.
    ///
    /// # Errors
    /// [`ReceiveError::Failed`] if iceoryx2 could not receive it.
    pub fn receive_reload(&self) -> Result<Option<ReloadCall>, ReceiveError> {
        control::receive(&self.control)
    }

    /// Sends a percept, stamped with this daemon's id, the next `answer_number` and `published_ns`, and wakes the subscribers. The number
    /// of one that could not be delivered is not given again: readers see the gap.
    ///
    /// # Errors
    /// [`SendError::Failed`] if iceoryx2 could not deliver it.
    pub fn publish(&self, percept: &Percept) -> Result<(), SendError> {
        let answer_number = self.answers.fetch_add(1, Ordering::Relaxed) + 1;
        self.forward(&Percept {
            abi_version: ABI_VERSION,
            daemon_id: self.daemon_id,
            answer_number,
            published_ns: monotonic_ns(),
            ..*percept
        })
    }

    /// Sends a percept as it is, and wakes the subscribers: for a relay, which passes on those of a daemon on another machine.
    ///
    /// # Errors
    /// As [`Server::publish`].
    pub fn forward(&self, percept: &Percept) -> Result<(), SendError> {
        let loan = self.percepts.loan_uninit().map_err(|error| channel::loan_error(error, size_of::<Percept>(), size_of::<Percept>()))?;
        loan.write_payload(*percept).send().map_err(channel::send_error)?;
        self.notify();
        Ok(())
    }

    /// Memory for the completion of an observation, to be written in place. Its header repeats the observation's identifiers, placement and
    /// dims. Send it before its percept: the percept's wake-up then finds both.
    ///
    /// # Errors
    /// [`LoanError::TooLarge`] if the observation has more voxels than the options', [`LoanError::NoFreeChunk`] if subscribers hold
    /// everything.
    pub fn loan_completion(&self, observation: &ObservationHeader) -> Result<CompletionLoan, LoanError> {
        let len = voxel_count(observation.dims)
            .map(|voxels| 2 * voxels)
            .ok_or(LoanError::TooLarge { asked: usize::MAX, possible: self.completion_len })?;
        let sample = self.completions.loan_slice_uninit(len).map_err(|error| channel::loan_error(error, len, self.completion_len))?;
        let mut sample = crate::shared::with_old_content(sample);
        *sample.user_header_mut() = CompletionHeader { daemon_id: self.daemon_id, ..CompletionHeader::answering(observation) };
        Ok(CompletionLoan { sample })
    }

    /// Sends a status, stamped with this daemon's id, process, last `answer_number` and `heartbeat_ns`. Wakes nobody.
    ///
    /// # Errors
    /// [`SendError::Failed`] if iceoryx2 could not deliver it.
    pub fn publish_status(&self, status: &Status) -> Result<(), SendError> {
        self.forward_status(&Status {
            abi_version: ABI_VERSION,
            daemon_id: self.daemon_id,
            pid: std::process::id(),
            answer_number: self.answers.load(Ordering::Relaxed),
            heartbeat_ns: monotonic_ns(),
            ..*status
        })
    }

    /// Sends a status as it is: for a relay, which passes on those of a daemon on another machine. Wakes nobody.
    ///
    /// # Errors
    /// As [`Server::publish_status`].
    pub fn forward_status(&self, status: &Status) -> Result<(), SendError> {
        let loan = self.statuses.loan_uninit().map_err(|error| channel::loan_error(error, size_of::<Status>(), size_of::<Status>()))?;
        loan.write_payload(*status).send().map_err(channel::send_error)?;
        Ok(())
    }

    /// Wakes the subscribers. [`Server::publish`] does it; needed only after a completion that is sent later than its percept.
    pub fn notify(&self) {
        channel::wake(&self.perceived);
    }

    /// Housekeeping, to be called about once a second: late subscribers get the last percept, completion and status; what dead processes
    /// left is removed.
    pub fn maintain(&self) {
        if !node::clean_up(&self.node) {
            return;
        }
        let places = Places::of(self.node.config());
        for service in self.services.iter().map(|service| &**service).chain([&self.observation as &dyn Registered]) {
            release_forgotten(service, self.node.config(), &places);
        }
        // Connecting to who came since takes room.
        if let Err(error) = require_shared_memory(MEMBER_BYTES) {
            return tracing::warn!(%error, "nobody can be connected");
        }
        channel::update_connections(&self.percepts);
        channel::update_connections(&self.completions);
        channel::update_connections(&self.statuses);
        channel::update_connections(&self.observations);
    }
}

impl Drop for Server {
    /// Who died since the last housekeeping would keep the services from being removed, and there may be nobody after this.
    fn drop(&mut self) {
        node::clean_up(&self.node);
    }
}

/// As many chunks as the worst case needs, or as many as the budget allows where that is less.
fn completion_chunks(worst_case: usize, len: usize) -> usize {
    worst_case.min((COMPLETION_BUDGET / len).max(MIN_COMPLETION_CHUNKS))
}

/// An observation where it lies in shared memory; held until dropped.
///
/// The header is a copy. The voxels are not: the producer could still change them. Copy them once, check them while copying, and never use
/// as an index what is still shared.
#[derive(Debug)]
pub struct Observation {
    header: ObservationHeader,
    payload_len: usize,
    sample: Sample<Ipc, [u8], ObservationHeader>,
}

impl Observation {
    /// `None` if it lies where no memory of its producer is.
    #[inline]
    pub(crate) fn new(sample: Sample<Ipc, [u8], ObservationHeader>, segments: &Segments, service: &ObservationService) -> Option<Self> {
        let possible = segments.bytes(service, &sample)?;
        let header = copy_of(sample.user_header());
        let payload_len = usize::try_from(sample.header().number_of_elements()).unwrap_or(usize::MAX).min(possible);
        Some(Self { header, payload_len, sample })
    }

    /// Which producer it comes from, as the connection says: nothing in the message can forge it.
    pub fn origin(&self) -> u128 {
        self.sample.origin().value()
    }

    /// The header, copied once.
    pub fn header(&self) -> &ObservationHeader {
        &self.header
    }

    /// The voxels: one byte each, C order `[x][y][z]`, after header and payload have been checked against each other. That each is 0, 1 or
    /// 255 is not checked.
    ///
    /// # Errors
    /// [`Refusal`]: what is wrong with the header or the payload's length.
    #[inline]
    pub fn voxels(&self) -> Result<&[u8], Refusal> {
        let voxels = validate(&self.header, self.payload_len)?;
        // iceoryx2 reads the length from shared memory anew: a producer could have changed it since.
        let payload = self.sample.payload();
        payload.get(..voxels).ok_or(Refusal::WrongLength { dims: self.header.dims, payload_len: payload.len() })
    }
}

/// A completion on its way: written in place, then sent or dropped.
#[derive(Debug)]
pub struct CompletionLoan {
    sample: SampleMut<Ipc, [u8], CompletionHeader>,
}

impl CompletionLoan {
    /// The header; `published_ns` is set by [`CompletionLoan::send`].
    pub fn header_mut(&mut self) -> &mut CompletionHeader {
        self.sample.user_header_mut()
    }

    /// Occupancy probability × 255 and its standard deviation × 255, one byte per voxel each, C order `[x][y][z]`. They hold whatever was
    /// in the memory before: write all of them.
    pub fn occupancy_and_deviation_mut(&mut self) -> (&mut [u8], &mut [u8]) {
        let payload = self.sample.payload_mut();
        let voxels = payload.len() / 2;
        payload.split_at_mut(voxels)
    }

    /// Sends it, stamped with `published_ns`. Wakes nobody: the percept does.
    ///
    /// # Errors
    /// [`SendError::Failed`] if iceoryx2 could not deliver it.
    pub fn send(mut self) -> Result<(), SendError> {
        self.sample.user_header_mut().published_ns = monotonic_ns();
        self.forward()
    }

    /// Sends it as it is: for a relay, which passes on those of a daemon on another machine. Wakes nobody.
    ///
    /// # Errors
    /// As [`CompletionLoan::send`].
    pub fn forward(self) -> Result<(), SendError> {
        self.sample.send().map_err(channel::send_error)?;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn segments_are_small_at_30_and_reasonable_at_254() {
        let options = ServerOptions::new([30; 3]);
        let small = Limits { publishers: 1, readers: options.subscribers, buffer: 2, history: 1, nodes: 1 };
        assert_eq!(completion_chunks(small.chunks(), 2 * 27_000), 67);
        let big = Limits { buffer: 1, ..small };
        assert_eq!(completion_chunks(big.chunks(), 2 * 128 * 128 * 128), 16);
        assert_eq!(completion_chunks(big.chunks(), 2 * 254 * 254 * 254), 8);
    }
}
