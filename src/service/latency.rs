//! Percentiles of the last minute's latencies, in fixed memory: histograms of ten seconds each, and their sum.

use hdrhistogram::Histogram;

/// Time that one histogram covers.
const SLOT_NS: u64 = 10_000_000_000;
/// The last minute, and what has passed of the current ten seconds.
const SLOTS: usize = 7;
/// Latencies that are told apart: from a microsecond to ten minutes, to within 1 %. What is outside counts as the nearest.
const RANGE_NS: (u64, u64) = (1_000, 600_000_000_000);

/// The latencies of the last sixty to seventy seconds.
pub struct Latencies {
    slots: [Histogram<u32>; SLOTS],
    /// The sum of the slots, so that nothing is added up when percentiles are asked for.
    total: Histogram<u32>,
    /// The current slot, counted from the clock's start.
    current: u64,
}

/// Percentiles and maximum, nanoseconds; zeros of none.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Summary {
    /// How many latencies they are of.
    pub count: u64,
    /// Median.
    pub p50: u64,
    /// 90th percentile.
    pub p90: u64,
    /// 99th percentile.
    pub p99: u64,
    /// 99.9th percentile.
    pub p999: u64,
    /// Longest.
    pub max: u64,
}

impl Latencies {
    /// None yet.
    pub fn new() -> Self {
        let empty = || Histogram::new_with_bounds(RANGE_NS.0, RANGE_NS.1, 2).expect("valid bounds");
        Self { slots: std::array::from_fn(|_| empty()), total: empty(), current: 0 }
    }

    /// Remembers a latency that ended at `now_ns` of a clock that does not go back.
    pub fn record(&mut self, now_ns: u64, latency_ns: u64) {
        self.forget_before(now_ns);
        self.slots[(self.current % SLOTS as u64) as usize].saturating_record(latency_ns);
        self.total.saturating_record(latency_ns);
    }

    /// Of the last minute before `now_ns`.
    pub fn summary(&mut self, now_ns: u64) -> Summary {
        self.forget_before(now_ns);
        if self.total.is_empty() {
            return Summary::default();
        }
        let max = self.total.max();
        // A histogram gives the upper end of the bucket, which can lie above the longest.
        let [p50, p90, p99, p999] = [0.5, 0.9, 0.99, 0.999].map(|q| self.total.value_at_quantile(q).min(max));
        Summary { count: self.total.len(), p50, p90, p99, p999, max }
    }

    /// Empties the slots whose time has passed.
    fn forget_before(&mut self, now_ns: u64) {
        let now = now_ns / SLOT_NS;
        let passed = now.saturating_sub(self.current).min(SLOTS as u64);
        for back in 0..passed {
            let slot = &mut self.slots[((now - back) % SLOTS as u64) as usize];
            self.total.subtract(&*slot).expect("part of the sum");
            slot.reset();
        }
        self.current = self.current.max(now);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECOND: u64 = 1_000_000_000;

    fn close(found: u64, expected: u64) -> bool {
        found.abs_diff(expected) * 100 <= expected
    }

    #[test]
    fn percentiles_are_within_one_percent() {
        let mut latencies = Latencies::new();
        assert_eq!(latencies.summary(5), Summary::default());
        (1..=10_000).for_each(|i| latencies.record(100 * SECOND, i * 1_000));
        let summary = latencies.summary(100 * SECOND);
        assert_eq!(summary.count, 10_000);
        for (found, expected) in [(summary.p50, 5_000), (summary.p90, 9_000), (summary.p99, 9_900), (summary.p999, 9_990)] {
            assert!(close(found, expected * 1_000), "{summary:?}");
        }
        assert!(close(summary.max, 10_000_000) && summary.p999 <= summary.max);
    }

    #[test]
    fn a_minute_is_remembered_and_no_more() {
        let mut latencies = Latencies::new();
        let start = 12_345 * SECOND;
        // One a second, as long as the second is late.
        (0..300).for_each(|second| latencies.record(start + second * SECOND, second * SECOND / 1_000));
        let last = start + 299 * SECOND;
        let summary = latencies.summary(last);
        assert!((60..=70).contains(&summary.count), "{summary:?}");
        assert!(close(summary.max, 299_000_000) && close(summary.p50, (299 - summary.count / 2) * 1_000_000), "{summary:?}");
        assert_eq!(latencies.summary(last + 40 * SECOND).max, summary.max);
        assert!(latencies.summary(last + 40 * SECOND).count < summary.count);
        assert_eq!(latencies.summary(last + 80 * SECOND), Summary::default());
        latencies.record(last + 1_000_000 * SECOND, 5_000);
        assert_eq!(latencies.summary(last + 1_000_000 * SECOND).count, 1);
    }

    #[test]
    fn what_is_out_of_range_counts_as_the_nearest() {
        let mut latencies = Latencies::new();
        latencies.record(0, 0);
        latencies.record(0, u64::MAX);
        let summary = latencies.summary(0);
        assert_eq!(summary.count, 2);
        assert!(close(summary.max, RANGE_NS.1) && summary.p50 < 2_000, "{summary:?}");
    }
}
