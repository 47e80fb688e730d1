//! Waiting for what other threads and processes do: nothing asserts how long it takes, it only ends after a while.

use std::time::{Duration, Instant};

pub const PATIENCE: Duration = Duration::from_secs(60);

/// What an attempt gives, as soon as it gives something.
pub fn eventually<T>(what: &str, mut attempt: impl FnMut() -> Option<T>) -> T {
    let start = Instant::now();
    loop {
        if let Some(value) = attempt() {
            return value;
        }
        assert!(start.elapsed() < PATIENCE, "waited in vain: {what}");
        std::thread::sleep(Duration::from_millis(5));
    }
}
