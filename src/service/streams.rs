//! Observations that wait for an answer: the newest of each (producer, object) stream. Producers take turns, each with the observation whose
//! deadline comes first, else the stream that began to wait first, so that a flood of one, in however many streams, cannot starve another. Whose turn it is goes by where an observation
//! comes from, as the connection says, and not by what its header says: under however many names, a producer has one turn.

use beo_core::grid::{Dims, Observation, ObservationError};
use beo_ipc::ObservationHeader;
use std::collections::VecDeque;

/// Streams that can wait at a time; beyond, the producer with most of them loses the one that has waited longest.
const MOST_STREAMS: usize = 256;

/// An observation copied out of shared memory.
pub struct Waiting {
    /// Its header.
    pub header: ObservationHeader,
    /// Its voxels.
    pub observation: Observation,
    /// When it was taken, CLOCK_MONOTONIC.
    pub received_ns: u64,
    /// Which producer it comes from.
    origin: u128,
}

/// The queue, and a pool of grids so that a warm queue does not allocate.
pub struct Streams {
    dims: Dims,
    /// In the order in which their streams began to wait.
    waiting: VecDeque<Waiting>,
    /// In the order of their turns.
    producers: VecDeque<Share>,
    pool: Vec<Observation>,
}

/// A producer of which something waits.
struct Share {
    origin: u128,
    /// Its waiting streams.
    streams: usize,
}

impl Streams {
    /// An empty queue for grids of one size.
    pub fn new(dims: Dims) -> Self {
        Self {
            dims,
            waiting: VecDeque::with_capacity(MOST_STREAMS),
            producers: VecDeque::with_capacity(MOST_STREAMS),
            pool: vec![Observation::unknown(dims)],
        }
    }

    /// Copies an observation in, checking every voxel as it is copied. Returns how many waiting observations it displaced; none, and nothing
    /// waits, if it was not intact once it had been copied.
    pub fn push(
        &mut self,
        origin: u128,
        header: &ObservationHeader,
        voxels: &[u8],
        received_ns: u64,
        is_intact: impl FnOnce() -> bool,
    ) -> Result<Option<usize>, ObservationError> {
        let mut observation = self.pool.pop().unwrap_or_else(|| Observation::unknown(self.dims));
        let copied = observation.read(voxels);
        let is_intact = is_intact();
        if copied.is_err() || !is_intact {
            self.pool.push(observation);
            return if is_intact { copied.map(|()| None) } else { Ok(None) };
        }
        let fresh = Waiting { header: *header, observation, received_ns, origin };
        let stream = |w: &Waiting| (w.origin, w.header.producer_id, w.header.object_id);
        if let Some(older) = self.waiting.iter_mut().find(|w| stream(w) == stream(&fresh)) {
            let older = std::mem::replace(older, fresh);
            self.pool.push(older.observation);
            return Ok(Some(1));
        }
        let displaced = if self.waiting.len() == MOST_STREAMS { self.give_one_up() } else { 0 };
        match self.producers.iter_mut().find(|share| share.origin == origin) {
            Some(share) => share.streams += 1,
            None => self.producers.push_back(Share { origin, streams: 1 }),
        }
        self.waiting.push_back(fresh);
        Ok(Some(displaced))
    }

    /// Takes from the producer that has most. Returns how many were given up.
    fn give_one_up(&mut self) -> usize {
        let Some(most) = (0..self.producers.len()).max_by_key(|place| self.producers[*place].streams) else { return 0 };
        let origin = self.producers[most].origin;
        self.producers[most].streams -= 1;
        if self.producers[most].streams == 0 {
            self.producers.remove(most);
        }
        self.oldest_of(origin).map_or(0, |oldest| {
            self.pool.push(oldest.observation);
            1
        })
    }

    fn oldest_of(&mut self, origin: u128) -> Option<Waiting> {
        let place = self.waiting.iter().position(|waiting| waiting.origin == origin)?;
        self.waiting.remove(place)
    }

    /// Of what a producer has waiting: what must be answered soonest, then what has no deadline and has waited longest.
    fn most_urgent_of(&mut self, origin: u128) -> Option<Waiting> {
        let deadline = |waiting: &Waiting| if waiting.header.deadline_ns == 0 { u64::MAX } else { waiting.header.deadline_ns };
        let of_it = self.waiting.iter().enumerate().filter(|(_, waiting)| waiting.origin == origin);
        let (place, _) = of_it.min_by_key(|(place, waiting)| (deadline(waiting), *place))?;
        self.waiting.remove(place)
    }

    /// The next observation to answer. Give its grid back with [`Self::recycle`].
    pub fn pop(&mut self) -> Option<Waiting> {
        let Share { origin, streams } = self.producers.pop_front()?;
        if streams > 1 {
            self.producers.push_back(Share { origin, streams: streams - 1 });
        }
        self.most_urgent_of(origin)
    }

    /// Takes a grid back for reuse.
    pub fn recycle(&mut self, observation: Observation) {
        self.pool.push(observation);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn header(producer_id: u64, object_id: u64, sequence: u64) -> ObservationHeader {
        ObservationHeader { producer_id, object_id, sequence, ..ObservationHeader::new([8; 3]) }
    }

    #[test]
    fn only_the_newest_of_a_stream_waits_and_streams_keep_their_turn() {
        let mut streams = Streams::new(Dims::cube(8).unwrap());
        let voxels = vec![255; 512];
        let mut push = |producer: u64, object, sequence| {
            streams.push(producer.into(), &header(producer, object, sequence), &voxels, 0, || true).unwrap().unwrap()
        };
        assert_eq!([push(1, 1, 1), push(2, 1, 1), push(1, 1, 2), push(1, 2, 3), push(1, 1, 4)], [0, 0, 1, 0, 1]);
        let mut order = Vec::new();
        while let Some(waiting) = streams.pop() {
            order.push((waiting.header.producer_id, waiting.header.object_id, waiting.header.sequence));
            streams.recycle(waiting.observation);
        }
        assert_eq!(order, [(1, 1, 4), (2, 1, 1), (1, 2, 3)]);
    }

    #[test]
    fn a_flood_of_streams_neither_displaces_another_producer_nor_goes_before_it() {
        let mut streams = Streams::new(Dims::cube(8).unwrap());
        // The first producer gives itself many names: its turns are as many as those of one.
        let mut push = |origin: u64, object| {
            let named = if origin == 1 { 1000 + object % 7 } else { origin };
            streams.push(origin.into(), &header(named, object, 1), &[0; 512], 0, || true).unwrap().unwrap()
        };
        let flood = 3 * MOST_STREAMS as u64;
        let displaced: usize = (0..flood).map(|object| push(1, object)).sum::<usize>() + push(2, 7) + push(3, 7);
        let displaced = displaced + (0..flood).map(|object| push(1, flood + object)).sum::<usize>();
        assert_eq!(displaced, 2 * flood as usize + 2 - MOST_STREAMS);
        let order: Vec<u128> = std::iter::from_fn(|| streams.pop()).map(|waiting| waiting.origin).collect();
        assert_eq!((order.len(), &order[..5]), (MOST_STREAMS, &[1, 2, 3, 1, 1][..]));
        assert!(streams.producers.is_empty());
    }

    #[test]
    fn of_a_producer_what_has_a_deadline_goes_first_and_other_producers_keep_their_turns() {
        let mut streams = Streams::new(Dims::cube(8).unwrap());
        let mut push = |origin: u64, object, deadline_ns| {
            let header = ObservationHeader { deadline_ns, ..header(origin, object, 1) };
            streams.push(origin.into(), &header, &[0; 512], 0, || true).unwrap().unwrap();
        };
        [(1, 1, 0), (1, 2, 900), (2, 1, 0), (1, 3, 500), (1, 4, 0)].into_iter().for_each(|(origin, object, due)| push(origin, object, due));
        let order: Vec<(u64, u64)> =
            std::iter::from_fn(|| streams.pop()).map(|waiting| (waiting.header.producer_id, waiting.header.object_id)).collect();
        assert_eq!(order, [(1, 3), (2, 1), (1, 2), (1, 1), (1, 4)]);
    }

    #[test]
    fn a_producer_of_which_nothing_waits_has_no_turn() {
        let mut streams = Streams::new(Dims::cube(8).unwrap());
        let push = |streams: &mut Streams, origin: u64, object| {
            streams.push(origin.into(), &header(origin, object, 1), &[0; 512], 0, || true).unwrap().unwrap();
        };
        (0..3).for_each(|_| push(&mut streams, 1, 0));
        assert!(streams.pop().is_some() && streams.pop().is_none());
        push(&mut streams, 2, 0);
        push(&mut streams, 1, 0);
        (1..4).for_each(|object| push(&mut streams, 2, object));
        let order: Vec<u128> = (0..5).map(|_| streams.pop().expect("no turn is empty").origin).collect();
        assert_eq!(order, [2, 1, 2, 2, 2]);
        assert!(streams.pop().is_none());
    }

    #[test]
    fn the_queue_is_bounded_and_bad_voxels_do_not_enter_it() {
        let mut streams = Streams::new(Dims::cube(8).unwrap());
        let displaced: usize =
            (0..MOST_STREAMS as u64 + 5).map(|i| streams.push(1, &header(1, i, i), &[0; 512], 0, || true).unwrap().unwrap()).sum();
        assert_eq!(displaced, 5);
        assert_eq!(streams.pop().unwrap().header.object_id, 5);
        let waiting = streams.waiting.len();
        assert!(streams.push(9, &header(9, 9, 9), &[7; 512], 0, || true).is_err());
        // What was cut while it was copied does not wait, and displaces nothing, whatever was read of it.
        for code in [7, 0] {
            assert_eq!(streams.push(1, &header(1, 6, 9), &[code; 512], 0, || false), Ok(None));
        }
        assert_eq!(streams.waiting.len(), waiting);
    }
}
