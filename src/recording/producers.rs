//! The numbers of producers in a recording.

use std::collections::VecDeque;

/// Producers that are remembered: several times as many as can be there at a time.
const MOST: usize = 64;

/// Producers are numbered in the order of their first message. Beyond [`MOST`], the one that was heard of longest ago is forgotten, as
/// producers come and go for as long as a recording lasts, and gets another number if it comes again.
#[derive(Debug, Default)]
pub struct Producers {
    /// Their ids and numbers, from the one heard of longest ago on.
    heard: VecDeque<(u64, u64)>,
    /// How many numbers were given.
    given: u64,
}

impl Producers {
    /// The number of the producer with this id, counted from 1.
    pub fn number(&mut self, id: u64) -> u64 {
        let known = self.heard.iter().position(|(other, _)| *other == id).and_then(|place| self.heard.remove(place));
        let (_, number) = known.unwrap_or_else(|| {
            self.given += 1;
            (id, self.given)
        });
        if self.heard.len() == MOST {
            self.heard.pop_front();
        }
        self.heard.push_back((id, number));
        number
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn producers_keep_their_numbers_and_memory_is_bounded() {
        let mut producers = Producers::default();
        assert_eq!([7, 9, 7, 8, 9].map(|id| producers.number(id)), [1, 2, 1, 3, 2]);
        // One that is heard of now and then stays, whoever else comes.
        for id in 100..10_000 {
            assert_eq!(producers.number(id), id - 96);
            assert_eq!(producers.number(7), 1);
        }
        assert_eq!(producers.heard.len(), MOST);
        assert_eq!(producers.number(9), 9904, "forgotten");
    }
}
