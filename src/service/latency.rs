//! Percentiles of recent latencies.

/// Latencies that are remembered.
const KEPT: usize = 1024;

/// The last latencies, in nanoseconds.
pub struct Latencies {
    values: Vec<u64>,
    next: usize,
    sorted: Vec<u64>,
}

impl Latencies {
    /// None yet.
    pub fn new() -> Self {
        Self { values: Vec::with_capacity(KEPT), next: 0, sorted: Vec::with_capacity(KEPT) }
    }

    /// Remembers one.
    pub fn record(&mut self, nanoseconds: u64) {
        if self.values.len() < KEPT {
            self.values.push(nanoseconds);
        } else {
            self.values[self.next] = nanoseconds;
        }
        self.next = (self.next + 1) % KEPT;
    }

    /// The 50th, 90th and 99th percentile (nearest rank); 0 before the first.
    pub fn percentiles(&mut self) -> [u64; 3] {
        self.sorted.clear();
        self.sorted.extend_from_slice(&self.values);
        self.sorted.sort_unstable();
        [50, 90, 99].map(|percent| {
            let rank = (self.sorted.len() * percent).div_ceil(100);
            rank.checked_sub(1).map_or(0, |index| self.sorted[index])
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_of_the_last_values() {
        let mut latencies = Latencies::new();
        assert_eq!(latencies.percentiles(), [0; 3]);
        (0..5000).for_each(|_| latencies.record(7));
        (1..=1024).for_each(|i| latencies.record(i));
        assert_eq!(latencies.percentiles(), [512, 922, 1014]);
    }
}
