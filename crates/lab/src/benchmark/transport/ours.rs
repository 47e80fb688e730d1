//! Our observation channel, as a camera and the daemon use it.

use super::ends::{Incoming, Outgoing, PATIENCE, Reader, Received, TransportError};
use super::plan::{Wake, Work};
use beo_ipc::clock::monotonic_ns;
use beo_ipc::{InstanceName, ObservationHeader, Producer, Server, ServerOptions};
use std::time::Duration;

pub(super) struct Sending(Producer);

impl Sending {
    /// Joins the receiving end, which may come later.
    pub fn open(instance: &InstanceName, side: u32) -> Result<Self, TransportError> {
        Ok(Self(Producer::open_within(instance, &ObservationHeader::new([side; 3]), PATIENCE)?))
    }
}

impl Outgoing for Sending {
    fn send(&mut self, fill: Option<u8>) -> Result<(), TransportError> {
        let begin = monotonic_ns();
        let mut loan = self.0.loan()?;
        loan.header_mut().sensor_stamp_ns = begin;
        if let Some(byte) = fill {
            loan.voxels_mut().fill(byte);
        }
        loan.send()?;
        Ok(())
    }
}

pub(super) struct Receiving(Server);

impl Receiving {
    /// The daemon's ends for grids of this side; nobody will subscribe to percepts.
    pub fn open(instance: &InstanceName, side: u32) -> Result<Self, TransportError> {
        Ok(Self(Server::open(instance, &ServerOptions { subscribers: 1, ..ServerOptions::new([side; 3]) })?))
    }
}

impl Incoming for Receiving {
    fn receive(&mut self, wake: Wake, work: Work, reader: &mut Reader) -> Result<Received, TransportError> {
        let server = &self.0;
        let observation = reader.wait_for(
            wake,
            || Ok(server.receive()?),
            |longest| {
                server.wait(longest)?;
                Ok(())
            },
        )?;
        let received = reader.work(work, observation.header().sensor_stamp_ns, observation.voxels()?);
        // The wake-up that nobody waited for: the next wait is not to end by it.
        server.wait(Duration::ZERO)?;
        received
    }
}
