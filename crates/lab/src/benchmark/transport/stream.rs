//! Streams of bytes: each grid is its sender's stamp and its voxels, written and read whole.

use super::ends::{Incoming, Outgoing, Reader, Received, TransportError, system};
use super::plan::{Wake, Work};
use beo_ipc::clock::monotonic_ns;
use std::io::{Read, Write};

/// Bytes of the stamp.
const STAMP: usize = size_of::<u64>();

pub(super) struct Sending<Stream> {
    stream: Stream,
    frame: Vec<u8>,
}

impl<Stream: Write> Sending<Stream> {
    /// Sends grids of `len` bytes.
    pub fn new(stream: Stream, len: usize) -> Self {
        Self { stream, frame: vec![0; STAMP + len] }
    }
}

impl<Stream: Write> Outgoing for Sending<Stream> {
    fn send(&mut self, fill: Option<u8>) -> Result<(), TransportError> {
        self.frame[..STAMP].copy_from_slice(&monotonic_ns().to_le_bytes());
        if let Some(byte) = fill {
            self.frame[STAMP..].fill(byte);
        }
        self.stream.write_all(&self.frame).and_then(|()| self.stream.flush()).map_err(system("write to the other process"))
    }
}

pub(super) struct Receiving<Stream> {
    stream: Stream,
    frame: Vec<u8>,
}

impl<Stream: Read> Receiving<Stream> {
    /// Receives grids of `len` bytes.
    pub fn new(stream: Stream, len: usize) -> Self {
        Self { stream, frame: vec![0; STAMP + len] }
    }
}

impl<Stream: Read> Incoming for Receiving<Stream> {
    /// Reading blocks until a whole grid is there: a stream wakes its reader itself.
    fn receive(&mut self, _: Wake, work: Work, reader: &mut Reader) -> Result<Received, TransportError> {
        self.stream.read_exact(&mut self.frame).map_err(system("read from the other process"))?;
        let (stamp, payload) = self.frame.split_at(STAMP);
        reader.work(work, u64::from_le_bytes(stamp.try_into().unwrap_or_default()), payload)
    }
}
