//! Observations that were lost before the daemon took them, seen from gaps in their producers' numbers.

/// Producers whose last number is remembered: several times as many as can be there at a time. Beyond, the one that was heard of
/// longest ago is forgotten.
const MOST_PRODUCERS: usize = 64;
/// A greater gap is no loss (a century at 300 a second would be needed for it): the producer counts anew.
const GREATEST_GAP: u64 = 1 << 40;

/// The last number of each producer.
#[derive(Default)]
pub struct Sequences {
    /// Producer, its last number, and when it was heard of, in calls.
    last: Vec<(u64, u64, u64)>,
    calls: u64,
}

impl Sequences {
    /// None heard of yet.
    pub fn new() -> Self {
        Self { last: Vec::with_capacity(MOST_PRODUCERS), calls: 0 }
    }

    /// How many numbers of a producer are missing before this one. What it sent before the first that is seen here is not known: it
    /// may have been for an earlier daemon.
    pub fn missing_before(&mut self, producer: u64, sequence: u64) -> u64 {
        self.calls += 1;
        if let Some((_, last, heard)) = self.last.iter_mut().find(|(id, _, _)| *id == producer) {
            *heard = self.calls;
            let before = std::mem::replace(last, sequence);
            // A number that does not grow says nothing: the producer is broken, or counts anew.
            return sequence.checked_sub(before).and_then(|step| step.checked_sub(1)).filter(|gap| *gap < GREATEST_GAP).unwrap_or(0);
        }
        let entry = (producer, sequence, self.calls);
        match self.last.len() {
            MOST_PRODUCERS => {
                if let Some(oldest) = self.last.iter_mut().min_by_key(|(_, _, heard)| *heard) {
                    *oldest = entry;
                }
            }
            _ => self.last.push(entry),
        }
        0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaps_are_counted_for_each_producer() {
        let mut sequences = Sequences::new();
        let seen = [(1, 5), (2, 1), (1, 6), (1, 9), (2, 2), (2, 12), (1, 10)];
        let missing = seen.map(|(producer, sequence)| sequences.missing_before(producer, sequence));
        assert_eq!(missing, [0, 0, 0, 2, 0, 9, 0]);
    }

    #[test]
    fn numbers_that_lie_are_no_loss() {
        let mut sequences = Sequences::new();
        let missing = [7, 7, 3, 4, u64::MAX, 0, 1].map(|sequence| sequences.missing_before(1, sequence));
        assert_eq!(missing, [0; 7]);
    }

    #[test]
    fn memory_is_bounded_and_the_oldest_is_forgotten() {
        let mut sequences = Sequences::new();
        let missing: u64 = (0..MOST_PRODUCERS as u64).map(|producer| sequences.missing_before(producer, 1)).sum();
        assert_eq!(missing, 0);
        sequences.missing_before(0, 2);
        sequences.missing_before(1000, 1);
        assert_eq!(sequences.last.len(), MOST_PRODUCERS);
        assert_eq!((sequences.missing_before(0, 4), sequences.missing_before(1, 4)), (1, 0));
    }
}
