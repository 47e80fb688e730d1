//! The end of whoever wants to know: percepts, completions and the daemon's status.

use std::os::fd::BorrowedFd;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use iceoryx2::port::listener::Listener;
use iceoryx2::port::subscriber::Subscriber as Reader;
use iceoryx2::prelude::Node;
use iceoryx2::sample::Sample;

use crate::InstanceName;
use crate::channel::{self, CompletionService, PerceptService, StatusService, Woken};
use crate::error::{OpenError, ReceiveError, WaitError, retry_within};
use crate::gaps::Gaps;
use crate::joining;
use crate::limits::voxel_count;
use crate::messages::{CompletionHeader, Percept, Status};
use crate::node::{self, Ipc};
use crate::peers::Peers;
use crate::shared::{copy_of, descriptor_of};

const ROLE: &str = "subscriber";

/// The channels to subscribe to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct SubscriberOptions {
    /// Completions too. Without them the big segment is never mapped. Default: no.
    pub completion: bool,
}

/// Reads what a daemon says. A late one gets the last percept, completion and status at the daemon's next [`crate::Server::maintain`]
/// (about a second), or when it next sends.
///
/// A reader that does not read loses its oldest percepts (32 are kept) and completions (2 are kept, 1 of big grids), and delays nobody. It
/// outlives the daemon: when another one starts with the same settings, percepts go on, with another `daemon_id`.
#[derive(Debug)]
pub struct Subscriber {
    percepts: Reader<Ipc, Percept, ()>,
    completions: Option<Completions>,
    statuses: Reader<Ipc, Status, ()>,
    perceived: Listener<Ipc>,
    last_status: Mutex<Option<Status>>,
    gaps: Mutex<Gaps>,
    /// The changes of daemons after which the statuses of those before were taken.
    drained: AtomicU64,
    service: PerceptService,
    status_service: StatusService,
    /// Who was last received from: percepts, completions, statuses.
    writers: [Peers; 3],
    // Dropped last.
    node: Node<Ipc>,
}

/// The big channel, for those who subscribe to it.
#[derive(Debug)]
struct Completions {
    reader: Reader<Ipc, [u8], CompletionHeader>,
    service: CompletionService,
}

impl Subscriber {
    /// Joins the running daemon of `instance` as a reader.
    ///
    /// # Errors
    /// [`OpenError::NotRunning`] before the daemon runs; see [`OpenError`] for the rest.
    pub fn open(instance: &InstanceName, options: &SubscriberOptions) -> Result<Self, OpenError> {
        joining::open_with_room(ROLE, instance, || Self::join(instance, options))
    }

    fn join(instance: &InstanceName, options: &SubscriberOptions) -> Result<Self, OpenError> {
        let (node, service) = joining::join_daemon(ROLE, instance)?;
        // The listener first: no percept arrives between it and the readers without a wake-up.
        let perceived = channel::create_listener(&channel::open_event(&node, instance, &instance.perceived())?)?;
        let completions = match options.completion {
            true => {
                let service = channel::open_completion(&node, instance)?;
                Some(Completions { reader: channel::create_reader(&service)?, service })
            }
            false => None,
        };
        let percepts = channel::create_reader(&service)?;
        let status_service = channel::open_status(&node, instance)?;
        let statuses = channel::create_reader(&status_service)?;
        let (last_status, gaps, writers) = (Mutex::new(None), Mutex::default(), Default::default());
        let drained = AtomicU64::new(0);
        Ok(Self { percepts, completions, statuses, perceived, last_status, gaps, drained, service, status_service, writers, node })
    }

    /// As [`Subscriber::open`], but waits up to `timeout` for the daemon.
    ///
    /// # Errors
    /// As [`Subscriber::open`].
    pub fn open_within(instance: &InstanceName, options: &SubscriberOptions, timeout: Duration) -> Result<Self, OpenError> {
        retry_within(timeout, || Self::open(instance, options))
    }

    /// Whether a daemon is there. One that was killed counts until someone has cleaned up after it: see [`Subscriber::maintain`].
    pub fn daemon_runs(&self) -> bool {
        joining::daemon_runs(&self.service)
    }

    /// The daemon's process, if there is one and its name says so.
    pub fn daemon_pid(&self) -> Option<u32> {
        joining::daemon_pid(&self.service)
    }

    /// Waits until the daemon has sent something, at most `timeout`: true if it has, false otherwise or when a signal interrupted. Take
    /// everything before waiting again: one wake-up can stand for several percepts.
    ///
    /// # Errors
    /// [`WaitError`] if the event service is broken.
    pub fn wait(&self, timeout: Duration) -> Result<bool, WaitError> {
        Ok(self.wait_for_wake_up(timeout)? == Woken::Notified)
    }

    /// As [`Subscriber::wait`], but tells a timeout from a signal.
    pub(crate) fn wait_for_wake_up(&self, timeout: Duration) -> Result<Woken, WaitError> {
        channel::wait(&self.perceived, timeout)
    }

    /// For the caller's own `poll` or `epoll`: readable once the daemon has sent something, until [`Subscriber::wait`] has taken the
    /// wake-up. Closed with this subscriber.
    pub fn file_descriptor(&self) -> BorrowedFd<'_> {
        descriptor_of(&self.perceived)
    }

    /// The oldest percept not yet taken.
    ///
    /// # Errors
    /// [`ReceiveError::Failed`] if iceoryx2 could not receive it.
    pub fn take_percept(&self) -> Result<Option<Percept>, ReceiveError> {
        if !self.writers[0].ready_to_receive(&self.service) {
            return Ok(None);
        }
        let changes = self.writers[0].changes();
        if self.drained.swap(changes, Ordering::Relaxed) != changes {
            // What a daemon that is gone said last keeps its connection, and the file of it, until it is taken.
            self.status()?;
        }
        let Some(sample) = self.percepts.receive().map_err(channel::receive_error)? else { return Ok(None) };
        let percept = copy_of(sample.payload());
        self.gaps.lock().unwrap_or_else(PoisonError::into_inner).note(&percept);
        Ok(Some(percept))
    }

    /// How many percepts were published between those that were taken, and lost here: more came than are kept for a reader.
    pub fn missed(&self) -> u64 {
        self.gaps.lock().unwrap_or_else(PoisonError::into_inner).missed()
    }

    /// The oldest completion not yet taken, where it lies; `None` also if completions were not subscribed to. At most
    /// [`channel::MAX_HELD_SAMPLES`] can be held.
    ///
    /// # Errors
    /// [`ReceiveError::TooManyHeld`] until a completion taken earlier is dropped, [`ReceiveError::Broken`] if header and payload contradict
    /// each other.
    pub fn take_completion(&self) -> Result<Option<Completion>, ReceiveError> {
        let Some(Completions { reader, service }) = &self.completions else { return Ok(None) };
        if !self.writers[1].ready_to_receive(service) {
            return Ok(None);
        }
        let Some(sample) = reader.receive().map_err(channel::receive_error)? else { return Ok(None) };
        let header = copy_of(sample.user_header());
        let (expected, found) = (2 * voxel_count(header.dims).unwrap_or(0), sample.payload().len());
        if expected == 0 || expected != found {
            return Err(ReceiveError::Broken { expected, found });
        }
        Ok(Some(Completion { header, sample }))
    }

    /// The newest status that the daemon sent, `None` before the first.
    ///
    /// # Errors
    /// [`ReceiveError::Failed`] if iceoryx2 could not receive it.
    pub fn status(&self) -> Result<Option<Status>, ReceiveError> {
        // A thread that panicked while it held the lock left a whole status.
        let mut last = self.last_status.lock().unwrap_or_else(PoisonError::into_inner);
        if !self.writers[2].ready_to_receive(&self.status_service) {
            return Ok(*last);
        }
        while let Some(sample) = self.statuses.receive().map_err(channel::receive_error)? {
            *last = Some(copy_of(sample.payload()));
        }
        Ok(*last)
    }

    /// Housekeeping for when the daemon's heartbeat is missed: cleans up after processes that died, and connects to a daemon that came
    /// since.
    pub fn maintain(&self) {
        if !node::clean_up(&self.node) {
            return;
        }
        channel::update_connections(&self.percepts);
        channel::update_connections(&self.statuses);
        if let Some(completions) = &self.completions {
            channel::update_connections(&completions.reader);
        }
    }
}

/// A completed grid where it lies in shared memory; held until dropped.
#[derive(Debug)]
pub struct Completion {
    header: CompletionHeader,
    sample: Sample<Ipc, [u8], CompletionHeader>,
}

impl Completion {
    /// The observation that it answers, and where the grid lies.
    pub fn header(&self) -> &CompletionHeader {
        &self.header
    }

    /// Probability of being filled × 255, one byte per voxel, C order `[x][y][z]`.
    pub fn occupancy(&self) -> &[u8] {
        let payload = self.sample.payload();
        &payload[..payload.len() / 2]
    }

    /// Standard deviation of that probability × 255, one byte per voxel, C order `[x][y][z]`.
    pub fn deviation(&self) -> &[u8] {
        let payload = self.sample.payload();
        &payload[payload.len() / 2..]
    }
}
