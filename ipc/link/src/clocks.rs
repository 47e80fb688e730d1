//! The offset between the monotonic clocks of two machines, by round trips.
//!
//! A question leaves at t₀ and its answer, the other clock's stamp s, is here at t₁: the other clock is ahead by s − (t₀ + t₁) / 2, to within
//! (t₁ − t₀) / 2 whichever way was the longer. Clocks run apart by at most [`DRIFT`], so that an old round trip becomes less sure; the surest
//! of the last ones counts.

use std::collections::VecDeque;

/// How far two clocks run apart: 100 µs in a second, several times what quartz does.
const DRIFT: f64 = 100e-6;
/// Round trips that are kept.
const KEPT: usize = 16;

/// How far the other clock is ahead, and how sure that is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Offset {
    /// Nanoseconds to be added to a stamp of this machine.
    pub ahead_ns: i64,
    /// The truth is within this, nanoseconds.
    pub error_ns: u64,
}

/// The last round trips.
#[derive(Debug, Default)]
pub struct Clocks {
    /// When the answer came, and what it said.
    trips: VecDeque<(u64, Offset)>,
}

impl Clocks {
    /// A round trip that began and ended here, with the other clock's stamp in between.
    pub fn trip(&mut self, begun_ns: u64, there_ns: u64, ended_ns: u64) {
        let half = ended_ns.saturating_sub(begun_ns) / 2;
        let ahead_ns = there_ns.wrapping_sub(begun_ns.saturating_add(half)) as i64;
        let offset = Offset { ahead_ns, error_ns: half + 1 };
        // What contradicts the trips before is another machine, or one that was started anew.
        if let Some(known) = self.at(ended_ns)
            && known.ahead_ns.abs_diff(ahead_ns) > known.error_ns + offset.error_ns
        {
            self.trips.clear();
        }
        self.trips.push_back((ended_ns, offset));
        if self.trips.len() > KEPT {
            self.trips.pop_front();
        }
    }

    /// The offset now; none before the first trip.
    pub fn at(&self, now_ns: u64) -> Option<Offset> {
        let aged = self.trips.iter().map(|(at, offset)| {
            let drift = now_ns.saturating_sub(*at) as f64 * DRIFT;
            Offset { error_ns: offset.error_ns.saturating_add(drift as u64), ..*offset }
        });
        aged.min_by_key(|offset| offset.error_ns)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DAY: u64 = 86_400_000_000_000;

    #[test]
    fn the_shortest_of_the_late_trips_counts_and_the_truth_is_within_its_error() {
        let mut clocks = Clocks::default();
        assert_eq!(clocks.at(5), None);
        // The other clock is a day ahead. There 3 µs, back 1 µs; then 1 ms each way.
        clocks.trip(1_000_000, DAY + 1_003_000, 1_004_000);
        let first = clocks.at(1_004_000).unwrap();
        assert_eq!(first, Offset { ahead_ns: DAY as i64 + 1000, error_ns: 2001 });
        assert!(first.ahead_ns.abs_diff(DAY as i64) <= first.error_ns);
        clocks.trip(2_000_000, DAY + 3_000_000, 4_000_000);
        assert_eq!(clocks.at(4_000_000).unwrap().ahead_ns, first.ahead_ns);
        // A minute later the long one is no surer, but both are less so.
        assert_eq!(clocks.at(60_000_000_000 + 1_004_000).unwrap().error_ns, 2001 + 6_000_000);
    }

    #[test]
    fn behind_is_less_than_nothing_and_a_clock_that_begins_anew_counts_at_once() {
        let mut clocks = Clocks::default();
        clocks.trip(DAY, 1000, DAY + 2000);
        assert_eq!(clocks.at(DAY + 2000).unwrap().ahead_ns, -(DAY as i64));
        clocks.trip(DAY + 5000, 900_000_000, DAY + 9000);
        assert_eq!(clocks.at(DAY + 9000).unwrap().ahead_ns, 900_000_000 - DAY as i64 - 7000);
        for n in 0..100 {
            clocks.trip(2 * DAY + n, n, 2 * DAY + n);
        }
        assert_eq!(clocks.trips.len(), KEPT);
    }
}
