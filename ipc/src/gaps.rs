//! Percepts that a reader has not seen: gaps in the running number of each daemon.

use crate::messages::Percept;

/// Counts the gaps between percepts, in the order in which they are read.
///
/// Numbers begin with 1 in each run of a daemon. What was published before a reader's first percept is none of its gaps; of the next daemon
/// it is: the reader was there.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Gaps {
    /// Daemon and number of the last percept.
    last: Option<(u64, u64)>,
    missed: u64,
}

impl Gaps {
    /// Takes a percept in; how many were missed between the one before and this one.
    pub fn note(&mut self, percept: &Percept) -> u64 {
        let number = percept.answer_number;
        let missed = match self.last {
            None => 0,
            Some((daemon, _)) if daemon != percept.daemon_id => number.saturating_sub(1),
            // One that came before, as history of a channel that was opened again, is no gap.
            Some((_, last)) if number <= last => return 0,
            Some((_, last)) => number - last - 1,
        };
        self.last = Some((percept.daemon_id, number));
        // Whatever a broken daemon counts.
        self.missed = self.missed.saturating_add(missed);
        missed
    }

    /// How many percepts were missed in all.
    pub fn missed(&self) -> u64 {
        self.missed
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaps_are_counted_within_a_daemons_run_and_at_the_begin_of_the_next() {
        let mut gaps = Gaps::default();
        let mut note = |daemon_id, answer_number| gaps.note(&Percept { daemon_id, answer_number, ..Percept::EMPTY });
        assert_eq!([note(1, 100), note(1, 101), note(1, 105), note(1, 104), note(1, 106)], [0, 0, 3, 0, 0]);
        assert_eq!([note(2, 1), note(3, 4), note(3, 4), note(3, 6)], [0, 3, 0, 1]);
        assert_eq!(gaps.missed(), 7);
        let mut note = |daemon_id, answer_number| gaps.note(&Percept { daemon_id, answer_number, ..Percept::EMPTY });
        assert_eq!([note(4, u64::MAX), note(5, u64::MAX), note(5, 0)], [u64::MAX - 1, u64::MAX - 1, 0]);
        assert_eq!(gaps.missed(), u64::MAX);
    }
}
