//! How far a sample reaches: its length, and where it lies, stand in memory that its sender can write.
//!
//! A sample is bounded by what its sender, as the connection names it, has told the service of its chunks, and by the mapping that it lies
//! in. Both are looked up once for each sender.

use std::collections::VecDeque;
use std::fmt::Debug;
use std::ops::Range;
use std::sync::{Mutex, PoisonError};

use iceoryx2::prelude::{CallbackProgression, PortFactory as _, ZeroCopySend};
use iceoryx2::sample::Sample;
use iceoryx2::service::port_factory::publish_subscribe::PortFactory;

use crate::node::Ipc;

/// Senders that are remembered: several times as many as can be there at a time.
const MOST_SENDERS: usize = 64;

/// The segments of senders, as far as they have been looked up.
#[derive(Debug, Default)]
pub(crate) struct Segments(Mutex<VecDeque<Segment>>);

/// A mapped segment of a sender.
#[derive(Debug, Clone)]
struct Segment {
    sender: u128,
    mapped: Range<usize>,
    /// Bytes of its largest chunk's payload.
    chunk: usize,
}

impl Segments {
    /// Bytes of a sample that its sender can have written; `None` if it lies outside of all that is mapped.
    pub fn bytes<Header>(&self, service: &PortFactory<Ipc, [u8], Header>, sample: &Sample<Ipc, [u8], Header>) -> Option<usize>
    where
        Header: Debug + ZeroCopySend,
    {
        let (header, payload) = (std::ptr::from_ref(sample.header()).addr(), sample.payload().as_ptr().addr());
        let sender = sample.origin().value();
        let find = |mapped: Range<usize>| {
            let mut chunk = usize::MAX;
            service.dynamic_config().list_publishers(|publisher| {
                if publisher.publisher_id.value() == sender {
                    chunk = publisher.max_slice_len;
                    return CallbackProgression::Stop;
                }
                CallbackProgression::Continue
            });
            Segment { sender, mapped, chunk }
        };
        self.within(sender, header, payload, find)
    }

    fn within(&self, sender: u128, header: usize, payload: usize, find: impl FnOnce(Range<usize>) -> Segment) -> Option<usize> {
        // A thread that panicked while it held the lock left whole entries.
        let mut known = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let place = known.iter().position(|segment| segment.sender == sender && segment.mapped.contains(&header));
        let segment = match place {
            Some(place) => known[place].clone(),
            None => {
                let segment = find(mapping_of(header, &std::fs::read_to_string("/proc/self/maps").ok()?)?);
                if known.len() == MOST_SENDERS {
                    known.pop_front();
                }
                known.push_back(segment.clone());
                segment
            }
        };
        // Header and payload in one mapping, the payload behind.
        (header..segment.mapped.end).contains(&payload).then(|| segment.chunk.min(segment.mapped.end - payload))
    }
}

/// The mapping that an address lies in, as /proc/self/maps lists it.
fn mapping_of(address: usize, maps: &str) -> Option<Range<usize>> {
    maps.lines().find_map(|line| {
        let (low, high) = line.split(' ').next()?.split_once('-')?;
        let mapping = usize::from_str_radix(low, 16).ok()?..usize::from_str_radix(high, 16).ok()?;
        mapping.contains(&address).then_some(mapping)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mapping_is_found_by_an_address_in_it() {
        let maps = "7f0000-7f1000 rw-s 00000000 00:1a 5 /dev/shm/iox2_1.data\n7f1000-7f3000 r--p 00000000 00:00 0 \n";
        assert_eq!(
            [0x7f_0000, 0x7f_0fff, 0x7f_1000].map(|at| mapping_of(at, maps).map(|found| found.end)),
            [0x7f_1000, 0x7f_1000, 0x7f_3000].map(Some)
        );
        assert_eq!([0x7e_ffff, 0x7f_3000].map(|at| mapping_of(at, maps)), [None, None]);
        let own = 5_u8;
        let maps = std::fs::read_to_string("/proc/self/maps").unwrap();
        assert!(mapping_of(std::ptr::from_ref(&own).addr(), &maps).is_some());
    }

    #[test]
    fn a_sample_is_bounded_by_its_chunk_and_its_mapping_and_lies_in_it() {
        let segments = Segments::default();
        let segment = |sender, chunk| move |_| Segment { sender, mapped: 1000..2000, chunk };
        // What is looked up is this process's own map, where something of its own lies.
        let own = 5_u8;
        let at = std::ptr::from_ref(&own).addr();
        assert_eq!(segments.within(1, at, at, segment(1, 300)), None, "the payload lies in another mapping than was found");
        let known = || panic!("it is known");
        assert_eq!(segments.within(1, 1100, 1200, |_| known()), Some(300));
        assert_eq!(segments.within(1, 1100, 1900, |_| known()), Some(100), "up to the mapping's end");
        assert_eq!(segments.within(1, 1100, 1099, |_| known()), None, "before its header");
        assert_eq!(segments.within(1, 1100, 2000, |_| known()), None);
        // An address that nothing is mapped at.
        assert_eq!(segments.within(1, 8, 16, |_| known()), None);
        for sender in 2..200 {
            let _ = segments.within(sender, at, at, segment(sender, 1));
        }
        assert_eq!(segments.0.lock().unwrap().len(), MOST_SENDERS);
    }
}
