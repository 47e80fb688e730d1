//! The camera's end: loan a grid, write the voxels in place, send.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::prelude::{Node, PortFactory as _};
use iceoryx2::sample_mut::SampleMut;

use crate::InstanceName;
use crate::channel::{self, LOANS, ObservationService, PerceptService};
use crate::clock::monotonic_ns;
use crate::error::{LoanError, OpenError, SendError, retry_within};
use crate::identity::unique_id;
use crate::joining;
use crate::limits::voxel_count;
use crate::memory::{publisher_bytes, require_shared_memory};
use crate::messages::ObservationHeader;
use crate::node::{self, Ipc};
use crate::peers::Peers;
use crate::shared::with_old_content;

const ROLE: &str = "producer";

/// Writes observations of one size.
///
/// Its segment has `readers × (buffer + 2) + 2` chunks of one grid each, where the daemon says how many readers (2) and how long a buffer
/// (16 at 30³, 2 at 254³): 38 chunks and 1.1 MB at 30³, 10 chunks and 164 MB at 254³. All are touched at opening. When the daemon does not
/// keep up, its oldest observations are replaced; sending never waits.
#[derive(Debug)]
pub struct Producer {
    publisher: Publisher<Ipc, [u8], ObservationHeader>,
    outlet: Arc<Outlet>,
    template: ObservationHeader,
    voxels: usize,
    percept: PerceptService,
    // Dropped last.
    node: Node<Ipc>,
}

/// The part of a producer that a loan needs to be sent.
#[derive(Debug)]
struct Outlet {
    observed: Notifier<Ipc>,
    sent: AtomicU64,
    service: ObservationService,
    readers: Peers,
}

impl Producer {
    /// Joins the running daemon of `instance` as a producer. Every loan starts with a copy of `template`; its `dims` are the size of the
    /// grids, its `producer_id` is replaced by a fresh one.
    ///
    /// # Errors
    /// [`OpenError::NotRunning`] before the daemon runs; see [`OpenError`] for the rest.
    pub fn open(instance: &InstanceName, template: &ObservationHeader) -> Result<Self, OpenError> {
        Self::open_as(instance, &ObservationHeader { producer_id: unique_id(), ..*template }, 0)
    }

    /// As [`Producer::open`], but under the template's `producer_id`, with `sent` observations already counted.
    pub(crate) fn open_as(instance: &InstanceName, template: &ObservationHeader, sent: u64) -> Result<Self, OpenError> {
        joining::open_with_room(ROLE, instance, || Self::join(instance, template, sent))
    }

    fn join(instance: &InstanceName, template: &ObservationHeader, sent: u64) -> Result<Self, OpenError> {
        let voxels = voxel_count(template.dims).ok_or(OpenError::BadDims(template.dims))?;
        let (node, percept) = joining::join_daemon(ROLE, instance)?;
        let observation = channel::open_observation(&node, instance)?;
        let settings = observation.static_config();
        let chunks =
            settings.max_subscribers() * (settings.subscriber_max_buffer_size() + settings.subscriber_max_borrowed_samples()) + LOANS;
        require_shared_memory(publisher_bytes(chunks, voxels))?;
        let publisher = channel::create_slice_publisher(&observation, chunks, voxels)?;
        let observed = channel::create_notifier(&channel::open_event(&node, instance, &instance.observed())?)?;
        Ok(Self {
            publisher,
            outlet: Arc::new(Outlet { observed, sent: AtomicU64::new(sent), service: observation, readers: Peers::default() }),
            template: *template,
            voxels,
            percept,
            node,
        })
    }

    /// As [`Producer::open`], but waits up to `timeout` for the daemon.
    ///
    /// # Errors
    /// As [`Producer::open`].
    pub fn open_within(instance: &InstanceName, template: &ObservationHeader, timeout: Duration) -> Result<Self, OpenError> {
        retry_within(timeout, || Self::open(instance, template))
    }

    /// The identifier of this producer; percepts repeat it.
    pub fn id(&self) -> u64 {
        self.template.producer_id
    }

    /// The size of the grids.
    pub fn dims(&self) -> [u32; 3] {
        self.template.dims
    }

    /// How many observations were sent; the next one gets the sequence number after it.
    pub fn sent(&self) -> u64 {
        self.outlet.sent.load(Ordering::Relaxed)
    }

    /// Whether a daemon is there to read. One that was killed counts until someone has cleaned up after it: see [`Producer::maintain`].
    pub fn daemon_runs(&self) -> bool {
        joining::daemon_runs(&self.percept)
    }

    /// Whether the daemon's process is gone without having said so.
    pub(crate) fn daemon_seems_dead(&self) -> bool {
        joining::daemon_seems_dead(&self.percept)
    }

    /// Memory for one grid, to be written in place. Its header is the template with `capture_ns` set to now.
    ///
    /// Two loans at a time are possible whatever the readers do. A loan that is dropped without being sent is gone without a trace.
    ///
    /// # Errors
    /// [`LoanError::NoFreeChunk`] if more loans are held than there is memory for.
    #[inline]
    pub fn loan(&self) -> Result<Loan, LoanError> {
        let sample = self.publisher.loan_slice_uninit(self.voxels).map_err(|error| channel::loan_error(error, self.voxels, self.voxels))?;
        let mut sample = with_old_content(sample);
        let header = sample.user_header_mut();
        // The template first: its cache lines come from the reader's core while the clock is read.
        *header = self.template;
        header.capture_ns = monotonic_ns();
        Ok(Loan { sample, outlet: self.outlet.clone() })
    }

    /// Housekeeping for when the daemon's heartbeat is missed: cleans up after processes that died, and connects to a daemon that came
    /// since.
    pub fn maintain(&self) {
        if !node::clean_up(&self.node) {
            return;
        }
        channel::update_connections(&self.publisher);
    }
}

/// A grid on its way: written in place, then sent or dropped.
#[derive(Debug)]
pub struct Loan {
    sample: SampleMut<Ipc, [u8], ObservationHeader>,
    outlet: Arc<Outlet>,
}

/// The outcome of sending an observation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Sent {
    /// Its number, which its percept repeats; counted from 1.
    pub sequence: u64,
    /// How many readers it reached: 0 when no daemon is there.
    pub readers: usize,
}

impl Loan {
    /// The voxels: one byte each, 0 empty, 1 filled, 255 unknown; C order `[x][y][z]`, z fastest. They hold whatever was in the memory
    /// before: write all of them.
    #[inline]
    pub fn voxels_mut(&mut self) -> &mut [u8] {
        self.sample.payload_mut()
    }

    /// The header that travels with the voxels.
    pub fn header(&self) -> &ObservationHeader {
        self.sample.user_header()
    }

    /// The header that travels with the voxels, to be changed; `sequence` and `written_ns` are set by [`Loan::send`].
    #[inline]
    pub fn header_mut(&mut self) -> &mut ObservationHeader {
        self.sample.user_header_mut()
    }

    /// Sends the grid and wakes the daemon. Never waits for a reader.
    ///
    /// # Errors
    /// [`SendError::ProducerGone`] if the producer was dropped since; [`SendError::PeerInTheWay`] if what a killed reader left cannot be
    /// removed; [`SendError::Failed`] if iceoryx2 could not deliver it.
    #[inline]
    pub fn send(mut self) -> Result<Sent, SendError> {
        let written_ns = monotonic_ns();
        if !self.outlet.readers.ready_to_send(&self.outlet.service, written_ns) {
            return Err(SendError::PeerInTheWay);
        }
        let sequence = self.outlet.sent.fetch_add(1, Ordering::Relaxed) + 1;
        let header = self.sample.user_header_mut();
        (header.sequence, header.written_ns) = (sequence, written_ns);
        self.deliver()
    }

    /// As [`Loan::send`], but with the header's `sequence` and `written_ns` as they stand: for a relay, which passes on the observations of
    /// one producer of another machine.
    ///
    /// # Errors
    /// As [`Loan::send`].
    pub fn forward(self) -> Result<Sent, SendError> {
        if !self.outlet.readers.ready_to_send(&self.outlet.service, monotonic_ns()) {
            return Err(SendError::PeerInTheWay);
        }
        self.outlet.sent.store(self.header().sequence, Ordering::Relaxed);
        self.deliver()
    }

    #[inline]
    fn deliver(self) -> Result<Sent, SendError> {
        let sequence = self.header().sequence;
        let readers = self.sample.send().map_err(channel::send_error)?;
        channel::wake(&self.outlet.observed);
        Ok(Sent { sequence, readers })
    }
}
