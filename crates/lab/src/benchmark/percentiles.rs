//! Percentiles of times by HdrHistogram: three significant digits, from a nanosecond to minutes.

use crate::evaluation::metrics::percentile;
use hdrhistogram::Histogram;
use serde::{Deserialize, Serialize};

/// Longest time that is told apart, ten minutes; what is longer counts as this long.
const LONGEST_NS: u64 = 600_000_000_000;

/// The percentiles that are reported, by name.
pub const NAMED: [(&str, f64); 5] = [("p50", 0.5), ("p90", 0.9), ("p99", 0.99), ("p99.9", 0.999), ("p99.99", 0.9999)];

/// Times of one kind.
pub fn histogram(times_ns: impl IntoIterator<Item = u64>) -> Histogram<u64> {
    let mut histogram = Histogram::new_with_bounds(1, LONGEST_NS, 3).expect("valid bounds");
    times_ns.into_iter().for_each(|time| histogram.saturating_record(time));
    histogram
}

/// Percentiles in microseconds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Percentiles {
    /// How many times they are of.
    pub count: u64,
    /// Median.
    pub p50: f64,
    /// 90th percentile.
    pub p90: f64,
    /// 99th percentile.
    pub p99: f64,
    /// 99.9th percentile.
    pub p99_9: f64,
    /// 99.99th percentile.
    pub p99_99: f64,
    /// Longest.
    pub max: f64,
}

impl Percentiles {
    /// Of all that a histogram holds; zeros of an empty one.
    pub fn of(histogram: &Histogram<u64>) -> Self {
        let [p50, p90, p99, p99_9, p99_99] = NAMED.map(|(_, q)| histogram.value_at_quantile(q) as f64 / 1e3);
        Self { count: histogram.len(), p50, p90, p99, p99_9, p99_99, max: histogram.max() as f64 / 1e3 }
    }

    /// Percentiles and maximum, in order.
    pub fn values(&self) -> [f64; 6] {
        [self.p50, self.p90, self.p99, self.p99_9, self.p99_99, self.max]
    }

    /// Of some times in nanoseconds.
    pub fn of_times(times_ns: impl IntoIterator<Item = u64>) -> Self {
        Self::of(&histogram(times_ns))
    }

    /// The median of each over several runs; the counts are added.
    pub fn median(runs: &[Self]) -> Self {
        let of = |field: fn(&Self) -> f64| median(runs.iter().map(field));
        Self {
            count: runs.iter().map(|run| run.count).sum(),
            p50: of(|r| r.p50),
            p90: of(|r| r.p90),
            p99: of(|r| r.p99),
            p99_9: of(|r| r.p99_9),
            p99_99: of(|r| r.p99_99),
            max: of(|r| r.max),
        }
    }
}

/// The median, of an even number the mean of the middle two; 0 of none.
pub fn median(values: impl Iterator<Item = f64>) -> f64 {
    percentile(&values.collect::<Vec<_>>(), 50.0)
}

/// The median over repeats of the ratio of what was measured in the same repeat.
pub fn median_ratio(above: &[f64], below: &[f64]) -> f64 {
    median(above.iter().zip(below).map(|(a, b)| a / b))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_have_three_digits() {
        // Of 100,000 times, the nth from the top is 1 s / n.
        let percentiles = Percentiles::of_times((1..=100_000).map(|n| 1_000_000_000 / n));
        let expected = [50_001, 10_001, 1_001, 101, 11, 1].map(|n| 1e6 / f64::from(n));
        assert_eq!(percentiles.count, 100_000);
        for (value, expected) in percentiles.values().into_iter().zip(expected) {
            assert!((value / expected - 1.0).abs() < 2e-3, "{value} {expected}");
        }
        assert_eq!(Percentiles::of_times([]), Percentiles::default());
    }

    #[test]
    fn ratios_are_of_the_same_repeat() {
        // One repeat that disturbed both, one that disturbed one.
        assert_eq!(median_ratio(&[2.0, 20.0, 2.0], &[1.0, 10.0, 1.0]), 2.0);
        assert_eq!(median_ratio(&[2.0, 2.0, 90.0], &[1.0, 1.0, 1.0]), 2.0);
    }

    #[test]
    fn medians_over_runs() {
        let run = |p50, max| Percentiles { count: 2, p50, max, ..Percentiles::default() };
        let median = Percentiles::median(&[run(1.0, 9.0), run(5.0, 1.0), run(2.0, 2.0)]);
        assert_eq!((median.count, median.p50, median.max), (6, 2.0, 2.0));
        assert_eq!(super::median([1.0, 4.0].into_iter()), 2.5);
        assert_eq!(super::median([].into_iter()), 0.0);
    }
}
