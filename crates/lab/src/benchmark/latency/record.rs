//! The stamps of one observation.

use serde::{Deserialize, Serialize};

/// The stages in order, by name. `due` is when the schedule wanted the observation sent; `laid` when, of a depth image, the support plane
/// was found and the grids were laid, and otherwise the same as `due`; the last is stamped by the reader.
pub const STAGES: [&str; 10] = ["due", "laid", "written", "received", "projected", "classified", "posed", "completed", "published", "read"];

/// Place of `written` among the stages.
const WRITTEN: usize = 2;

/// The content of the sensor's own stamp, which the percept repeats: when the grids were laid (0 if they were not), and whether the
/// observation counts.
pub(super) fn to_stamp(laid_ns: u64, counted: bool) -> u64 {
    laid_ns << 1 | u64::from(counted)
}

/// The arguments of [`to_stamp`].
pub(super) fn from_stamp(stamp: u64) -> (u64, bool) {
    (stamp >> 1, stamp & 1 == 1)
}

/// A reader's notes on one percept.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Record {
    /// The observation's number.
    pub sequence: u64,
    /// Whether it came after the warm-up.
    pub counted: bool,
    /// The percept's status.
    pub status: u32,
    /// When each stage was done, CLOCK_MONOTONIC; 0 if it was not.
    pub stamps_ns: [u64; STAGES.len()],
}

impl Record {
    /// From when it was due to when it was read.
    pub fn latency_ns(&self) -> u64 {
        self.between(0, STAGES.len() - 1)
    }

    /// From when it was due to when it was written.
    pub fn until_write_ns(&self) -> u64 {
        self.between(0, WRITTEN)
    }

    /// From when it was written to when it was read: without what was due but could not be written.
    pub fn latency_from_write_ns(&self) -> u64 {
        self.between(WRITTEN, STAGES.len() - 1)
    }

    /// The duration of each stage after the first.
    pub fn stages_ns(&self) -> [u64; STAGES.len() - 1] {
        std::array::from_fn(|stage| self.between(stage, stage + 1))
    }

    /// Whether every stage ran.
    pub fn is_complete(&self) -> bool {
        self.status == 0 && self.stamps_ns.iter().all(|stamp| *stamp != 0)
    }

    /// Whether no stage ended before the one before it.
    pub fn is_in_order(&self) -> bool {
        self.stamps_ns.is_sorted()
    }

    fn between(&self, from: usize, to: usize) -> u64 {
        self.stamps_ns[to].saturating_sub(self.stamps_ns[from])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stages_add_up_to_the_latency() {
        let good = Record { sequence: 1, counted: true, status: 0, stamps_ns: [10, 15, 20, 40, 70, 110, 160, 220, 290, 370] };
        assert_eq!(good.stages_ns(), [5, 5, 20, 30, 40, 50, 60, 70, 80]);
        assert_eq!((good.latency_ns(), good.until_write_ns(), good.latency_from_write_ns()), (360, 10, 350));
        assert_eq!(good.stages_ns().iter().sum::<u64>(), good.latency_ns());
        assert!(good.is_complete() && good.is_in_order());
        let mut other = good;
        other.stamps_ns[7] = 0;
        assert!(!other.is_complete() && !other.is_in_order());
        assert!(!Record { status: 1, ..good }.is_complete());
        assert_eq!((from_stamp(to_stamp(77, true)), from_stamp(to_stamp(0, false))), ((77, true), (0, false)));
    }
}
