//! Percentiles of times, and their medians over repeats.

use crate::evaluation::metrics::percentile;
use hdrhistogram::Histogram;
use serde::{Deserialize, Serialize};

/// Longest time that is told from a longer one, nanoseconds.
const LONGEST_NS: u64 = 600_000_000_000;

/// Times in a histogram with three significant digits.
pub struct Times(Histogram<u64>);

/// Percentiles, nanoseconds.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Percentiles {
    /// Median.
    pub p50: f64,
    /// 90th percentile.
    pub p90: f64,
    /// 99th percentile.
    pub p99: f64,
}

impl Default for Times {
    fn default() -> Self {
        Self(Histogram::new_with_bounds(1, LONGEST_NS, 3).expect("bounds that a histogram can have"))
    }
}

impl Times {
    /// Adds one time.
    pub fn record(&mut self, nanoseconds: u64) {
        self.0.saturating_record(nanoseconds.max(1));
    }

    /// The percentiles; zeros without times.
    pub fn percentiles(&self) -> Percentiles {
        let at = |quantile| self.0.value_at_quantile(quantile) as f64;
        Percentiles { p50: at(0.5), p90: at(0.9), p99: at(0.99) }
    }
}

impl Percentiles {
    /// The median of each percentile over repeats.
    pub fn median(repeats: &[Self]) -> Self {
        let of = |value: fn(&Self) -> f64| median(repeats.iter().map(value));
        Self { p50: of(|p| p.p50), p90: of(|p| p.p90), p99: of(|p| p.p99) }
    }
}

/// The median; 0 without values.
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
    fn percentiles_are_those_of_the_times_to_three_digits() {
        let mut times = Times::default();
        (1..=1000).for_each(|i| times.record(i * 1000));
        times.record(u64::MAX);
        let found = times.percentiles();
        for (value, expected) in [(found.p50, 501e3), (found.p90, 901e3), (found.p99, 991e3)] {
            assert!((value / expected - 1.0).abs() < 2e-3, "{value} {expected}");
        }
        assert_eq!(Times::default().percentiles().p50, 0.0);
    }

    #[test]
    fn ratios_are_of_the_same_repeat() {
        // One repeat that disturbed both, one that disturbed one.
        assert_eq!(median_ratio(&[2.0, 20.0, 2.0], &[1.0, 10.0, 1.0]), 2.0);
        assert_eq!(median_ratio(&[2.0, 2.0, 90.0], &[1.0, 1.0, 1.0]), 2.0);
    }
}
