//! Stamps of CLOCK_MONOTONIC, which the messages in shared memory carry, as time of day, which recordings are sorted by.

use beo_ipc::clock::monotonic_ns;
use foxglove::messages::Timestamp;
use std::time::{SystemTime, UNIX_EPOCH};

/// The offset between the two clocks, fixed when recording starts, so that a step of the time of day tears nothing apart.
#[derive(Clone, Copy, Debug)]
pub struct Clock {
    /// Nanoseconds since 1970 when CLOCK_MONOTONIC was 0.
    offset_ns: u64,
}

impl Clock {
    /// The clocks as they are now.
    pub fn now() -> Self {
        let day_ns = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_nanos() as u64);
        Self { offset_ns: day_ns.saturating_sub(monotonic_ns()) }
    }

    /// Nanoseconds since 1970 when CLOCK_MONOTONIC was 0: added to a stamp, it gives the time of day.
    pub fn offset_ns(self) -> u64 {
        self.offset_ns
    }

    /// Nanoseconds since 1970 of a stamp.
    pub fn day_ns(self, stamp_ns: u64) -> u64 {
        self.offset_ns.saturating_add(stamp_ns)
    }

    /// The same as Foxglove writes it.
    pub(super) fn timestamp(self, stamp_ns: u64) -> Timestamp {
        let day_ns = self.day_ns(stamp_ns);
        // Seconds end in the year 2106: what a producer wrote need not make sense.
        Timestamp::new(u32::try_from(day_ns / 1_000_000_000).unwrap_or(u32::MAX), (day_ns % 1_000_000_000) as u32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stamps_become_time_of_day_whatever_they_are() {
        let clock = Clock { offset_ns: 1_700_000_000_000_000_000 };
        let stamp = clock.timestamp(2_500_000_001);
        assert_eq!((stamp.sec(), stamp.nsec()), (1_700_000_002, 500_000_001));
        assert_eq!(clock.timestamp(u64::MAX).sec(), u32::MAX);
        let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap().as_nanos() as u64;
        assert!(Clock::now().day_ns(monotonic_ns()) >= now);
    }
}
