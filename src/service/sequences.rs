//! Observations that never arrived: overwritten by their producer before the daemon took them, and told from gaps in its numbers.

/// Producers that are remembered; beyond, the one that was silent longest is forgotten.
const MOST_PRODUCERS: usize = 256;

/// A gap that is larger is no overload but a producer that numbers as it likes.
const LARGEST_GAP: u64 = 1_000_000;

/// The last number of each producer, the one that spoke last at the end.
pub struct Sequences {
    last: Vec<(u64, u64)>,
}

impl Sequences {
    /// Nothing heard yet.
    pub fn new() -> Self {
        Self { last: Vec::with_capacity(MOST_PRODUCERS) }
    }

    /// How many observations of this producer were missed since the one before; 0 for its first, whose predecessors were another daemon's.
    pub fn missed(&mut self, producer: u64, sequence: u64) -> u64 {
        let Some(place) = self.last.iter().position(|(known, _)| *known == producer) else {
            if self.last.len() == MOST_PRODUCERS {
                self.last.remove(0);
            }
            self.last.push((producer, sequence));
            return 0;
        };
        let (_, before) = self.last.remove(place);
        self.last.push((producer, sequence));
        match sequence.saturating_sub(before).saturating_sub(1) {
            gap if gap <= LARGEST_GAP => gap,
            _ => 0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaps_are_counted_per_producer_and_nonsense_is_not() {
        let mut sequences = Sequences::new();
        let mut missed = |producer, sequence| sequences.missed(producer, sequence);
        assert_eq!([missed(1, 7), missed(1, 8), missed(2, 1), missed(1, 12), missed(2, 2)], [0, 0, 0, 3, 0]);
        assert_eq!([missed(1, 5), missed(1, u64::MAX), missed(1, 0), missed(1, 1)], [0, 0, 0, 0]);
    }

    #[test]
    fn only_so_many_producers_are_remembered() {
        let mut sequences = Sequences::new();
        (0..=MOST_PRODUCERS as u64).for_each(|producer| assert_eq!(sequences.missed(producer, 1), 0));
        assert_eq!(sequences.last.len(), MOST_PRODUCERS);
        assert_eq!([sequences.missed(0, 9), sequences.missed(2, 9)], [0, 7]);
    }
}
