//! Messages as bytes, and stamps of one machine's clock as another's: for a relay between machines.
//!
//! Together with [`crate::Loan::forward`], [`crate::Server::forward`] and [`crate::Server::forward_status`], which send what comes from
//! elsewhere as it is: producer, sequence, daemon and stamps stay those of its origin; and with [`forward_reload`] and
//! [`crate::ReloadCall::forward`] for control calls.

pub use crate::control::{ReloadReply, ReloadRequest, forward_reload};
use crate::messages::{CompletionHeader, ObservationHeader, Percept, Status};
pub use crate::shared::Plain;
use crate::shared::{bytes_of, message_of};

/// The bytes of a message, as they lie in shared memory: little-endian, without padding, fields at the published offsets.
pub fn to_bytes<M: Plain>(message: &M) -> &[u8] {
    bytes_of(message)
}

/// The message at the beginning of some bytes, and what follows it; `None` if they are too few. Nothing of it is checked.
pub fn from_bytes<M: Plain>(bytes: &[u8]) -> Option<(M, &[u8])> {
    Some((message_of(bytes)?, &bytes[size_of::<M>()..]))
}

/// A message with stamps of CLOCK_MONOTONIC.
pub trait Stamped {
    /// Adds `offset_ns` to each stamp of CLOCK_MONOTONIC. Stamps of 0, for stages that did not run, stay 0; none becomes less than 1.
    fn move_stamps(&mut self, offset_ns: i64);
}

fn moved(stamp: &mut u64, offset_ns: i64) {
    if *stamp != 0 {
        *stamp = stamp.saturating_add_signed(offset_ns).max(1);
    }
}

impl Stamped for ObservationHeader {
    fn move_stamps(&mut self, offset_ns: i64) {
        [&mut self.capture_ns, &mut self.written_ns, &mut self.deadline_ns].into_iter().for_each(|stamp| moved(stamp, offset_ns));
    }
}

impl Stamped for Percept {
    fn move_stamps(&mut self, offset_ns: i64) {
        let stamps = [
            &mut self.capture_ns,
            &mut self.written_ns,
            &mut self.received_ns,
            &mut self.projected_ns,
            &mut self.classified_ns,
            &mut self.posed_ns,
            &mut self.completed_ns,
            &mut self.published_ns,
        ];
        stamps.into_iter().for_each(|stamp| moved(stamp, offset_ns));
    }
}

impl Stamped for CompletionHeader {
    fn move_stamps(&mut self, offset_ns: i64) {
        [&mut self.capture_ns, &mut self.published_ns].into_iter().for_each(|stamp| moved(stamp, offset_ns));
    }
}

impl Stamped for Status {
    fn move_stamps(&mut self, offset_ns: i64) {
        [&mut self.started_ns, &mut self.heartbeat_ns].into_iter().for_each(|stamp| moved(stamp, offset_ns));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_message_is_its_bytes_at_the_published_offsets() {
        let percept = Percept { sequence: 0x0102_0304_0506_0708, class_index: 7, ..Percept::EMPTY };
        let mut bytes = to_bytes(&percept).to_vec();
        assert_eq!((bytes.len(), &bytes[40..48], bytes[248]), (1280, &[8, 7, 6, 5, 4, 3, 2, 1][..], 7));
        bytes.push(99);
        assert_eq!(from_bytes::<Percept>(&bytes), Some((percept, &[99][..])));
        // From an odd address, and too few.
        let shifted = [&[0], &bytes[..]].concat();
        assert_eq!(from_bytes::<Percept>(&shifted[1..]).map(|(read, _)| read), Some(percept));
        assert_eq!(from_bytes::<Percept>(&bytes[..1279]), None);
        assert_eq!(from_bytes::<Status>(&[]), None);
    }

    #[test]
    fn stamps_move_together_and_those_that_are_none_stay_none() {
        let mut percept = Percept { capture_ns: 100, written_ns: 0, published_ns: 300, sensor_stamp_ns: 5, ..Percept::EMPTY };
        percept.move_stamps(1000);
        assert_eq!((percept.capture_ns, percept.written_ns, percept.published_ns, percept.sensor_stamp_ns), (1100, 0, 1300, 5));
        percept.move_stamps(-1200);
        assert_eq!((percept.capture_ns, percept.published_ns), (1, 100), "before the clock's begin is its begin");
        let mut header = ObservationHeader { deadline_ns: 7, capture_ns: u64::MAX, ..ObservationHeader::new([8; 3]) };
        header.move_stamps(i64::MAX);
        assert_eq!((header.deadline_ns, header.capture_ns, header.written_ns), (i64::MAX as u64 + 7, u64::MAX, 0));
        let mut completion = CompletionHeader { published_ns: 9, ..CompletionHeader::default() };
        completion.move_stamps(1);
        let mut status = Status { heartbeat_ns: 9, started_ns: 8, ..Status::EMPTY };
        status.move_stamps(1);
        assert_eq!((completion.published_ns, status.heartbeat_ns, status.started_ns), (10, 10, 9));
    }
}
