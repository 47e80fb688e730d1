//! The end of a recorder: reads observations beside the daemon. There is one place for it ([`channel::OBSERVATION_READERS`]).

use iceoryx2::port::subscriber::Subscriber as Reader;
use iceoryx2::prelude::Node;

use crate::InstanceName;
use crate::channel::{self, ObservationService};
use crate::error::{OpenError, ReceiveError};
use crate::joining;
use crate::messages::ObservationHeader;
use crate::node::{self, Ipc};
use crate::peers::Peers;
use crate::segments::Segments;
use crate::server::Observation;

/// Reads the observations that producers send to the daemon. One that does not read loses the oldest (as many are kept as wait for the
/// daemon), and delays nobody.
#[derive(Debug)]
pub struct ObservationReader {
    observations: Reader<Ipc, [u8], ObservationHeader>,
    service: ObservationService,
    producers: Peers,
    segments: Segments,
    // Dropped last.
    node: Node<Ipc>,
}

impl ObservationReader {
    /// Joins the running daemon of `instance`.
    ///
    /// # Errors
    /// [`OpenError::NotRunning`] before the daemon runs, [`OpenError::Full`] if another recorder has the place; see [`OpenError`] for the
    /// rest.
    pub fn open(instance: &InstanceName) -> Result<Self, OpenError> {
        const ROLE: &str = "recorder";
        joining::open_with_room(ROLE, instance, || {
            let (node, _) = joining::join_daemon(ROLE, instance)?;
            let service = channel::open_observation(&node, instance)?;
            let observations = channel::create_reader(&service)?;
            Ok(Self { observations, service, producers: Peers::default(), segments: Segments::default(), node })
        })
    }

    /// The next observation of any producer; those of one producer come in its order. At most [`channel::MAX_HELD_SAMPLES`] of one producer
    /// can be held.
    ///
    /// # Errors
    /// [`ReceiveError::TooManyHeld`] until an observation taken earlier is dropped.
    pub fn take_observation(&self) -> Result<Option<Observation>, ReceiveError> {
        if !self.producers.ready_to_receive(&self.service) {
            return Ok(None);
        }
        while let Some(sample) = self.observations.receive().map_err(channel::receive_error)? {
            if let Some(observation) = Observation::new(sample, &self.segments, &self.service) {
                return Ok(Some(observation));
            }
        }
        Ok(None)
    }

    /// Housekeeping, about once a second: cleans up after processes that died, and connects to producers that came since.
    pub fn maintain(&self) {
        if node::clean_up(&self.node) {
            channel::update_connections(&self.observations);
        }
    }
}
