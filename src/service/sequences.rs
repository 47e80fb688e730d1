//! Observations that were lost before the daemon took them, seen from gaps in their producers' numbers.

/// Producers whose last number is remembered: several times as many as can be there at a time. Beyond, the one that was heard of longest
/// ago is forgotten.
const MOST_PRODUCERS: usize = 64;
/// No producer sends two observations within less.
const SHORTEST_INTERVAL_NS: u64 = 100;
/// Observations that may have waited together, whatever the time between taking one and the next.
const MOST_WAITING: u64 = 256;

/// The last number of each producer. They are what producers say of themselves: one that lies makes its losses wrong, by no more than
/// could have been sent since it was last heard of.
#[derive(Default)]
pub struct Sequences {
    last: Vec<Heard>,
}

/// The last sequence number of a producer.
struct Heard {
    producer: u64,
    sequence: u64,
    /// When, CLOCK_MONOTONIC.
    at_ns: u64,
}

impl Sequences {
    /// None heard yet.
    pub fn new() -> Self {
        Self { last: Vec::with_capacity(MOST_PRODUCERS) }
    }

    /// How many numbers of a producer are missing before this one. What it sent before the first that is seen here is not known: it
    /// may have been for an earlier daemon.
    pub fn missing_before(&mut self, producer: u64, sequence: u64, now_ns: u64) -> u64 {
        let now = Heard { producer, sequence, at_ns: now_ns };
        if let Some(heard) = self.last.iter_mut().find(|heard| heard.producer == producer) {
            let before = std::mem::replace(heard, now);
            // A number that does not grow says nothing: the producer is broken, or counts anew.
            let missing = sequence.saturating_sub(before.sequence).saturating_sub(1);
            let possible = now_ns.saturating_sub(before.at_ns) / SHORTEST_INTERVAL_NS + MOST_WAITING;
            // So does one that grows by more than can have been sent.
            return if missing <= possible { missing } else { 0 };
        }
        match self.last.len() {
            MOST_PRODUCERS => {
                if let Some(oldest) = self.last.iter_mut().min_by_key(|heard| heard.at_ns) {
                    *oldest = now;
                }
            }
            _ => self.last.push(now),
        }
        0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECOND: u64 = 1_000_000_000;

    #[test]
    fn gaps_are_counted_for_each_producer() {
        let mut sequences = Sequences::new();
        let seen = [(1, 5), (2, 1), (1, 6), (1, 9), (2, 2), (2, 12), (1, 10)];
        let missing = seen.map(|(producer, sequence)| sequences.missing_before(producer, sequence, SECOND));
        assert_eq!(missing, [0, 0, 0, 2, 0, 9, 0]);
    }

    #[test]
    fn numbers_that_lie_are_no_loss() {
        let mut sequences = Sequences::new();
        let missing = [7, 7, 3, 4, u64::MAX, 0, 1].map(|sequence| sequences.missing_before(1, sequence, SECOND));
        assert_eq!(missing, [0; 7]);
    }

    #[test]
    fn no_more_is_lost_than_can_have_been_sent() {
        let mut sequences = Sequences::new();
        let mut missing = |sequence, seconds: u64| sequences.missing_before(1, sequence, seconds * SECOND);
        // A million in the ten seconds in which the daemon was stopped; then as many at once.
        assert_eq!([missing(1, 100), missing(1_000_002, 110), missing(2_000_003, 110), missing(2_000_004, 110)], [0, 1_000_000, 0, 0]);
        // A clock that goes back does no harm either.
        assert_eq!([missing(2_000_006, 1), missing(u64::MAX, u64::MAX / SECOND)], [1, 0]);
    }

    #[test]
    fn memory_is_bounded_and_the_oldest_is_forgotten() {
        let mut sequences = Sequences::new();
        let producers = MOST_PRODUCERS as u64;
        let missing: u64 = (0..producers).map(|producer| sequences.missing_before(producer, 1, producer)).sum();
        assert_eq!(missing, 0);
        sequences.missing_before(0, 2, producers);
        sequences.missing_before(1000, 1, producers + 1);
        assert_eq!(sequences.last.len(), MOST_PRODUCERS);
        assert_eq!([0, 1].map(|producer| sequences.missing_before(producer, 4, producers + 2)), [1, 0]);
    }
}
