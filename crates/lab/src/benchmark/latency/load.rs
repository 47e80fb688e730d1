//! When observations are due, and sending them on time.

use beo_ipc::clock::monotonic_ns;
use serde::{Deserialize, Serialize};
use std::time::Duration;

/// Before this long to go the producer sleeps, then it spins: timers are late by a twentieth of a millisecond and more.
const SPIN_NS: u64 = 300_000;

/// In what rhythm observations come.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Load {
    /// One object, the next observation as soon as the last one's answer was read.
    #[serde(rename = "flat-out")]
    FlatOut,
    /// One object, 30 times a second.
    #[serde(rename = "30hz")]
    Steady,
    /// Eight objects in each frame, 30 frames a second.
    #[serde(rename = "8x30hz")]
    Frames,
    /// Sixteen objects at once, four times a second.
    #[serde(rename = "burst")]
    Bursts,
    /// Depth images, carved into as many grids as they show objects by the producer: see [`CameraRate`].
    #[serde(rename = "camera")]
    Camera,
}

/// Objects before the camera of [`Load::Camera`], and its frame rate.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct CameraRate {
    /// Objects on the table, 1 to [`super::MOST_ON_TABLE`].
    pub objects: u32,
    /// Images a second.
    pub rate_hz: f64,
}

impl Default for CameraRate {
    fn default() -> Self {
        Self { objects: 6, rate_hz: 30.0 }
    }
}

impl Load {
    /// All of them.
    pub const ALL: [Self; 5] = [Self::FlatOut, Self::Steady, Self::Frames, Self::Bursts, Self::Camera];

    /// Its name on the command line and in results.
    pub fn name(self) -> &'static str {
        match self {
            Self::FlatOut => "flat-out",
            Self::Steady => "30hz",
            Self::Frames => "8x30hz",
            Self::Bursts => "burst",
            Self::Camera => "camera",
        }
    }

    /// Objects that are observed, each in every frame.
    pub fn objects(self, camera: CameraRate) -> u64 {
        match self {
            Self::FlatOut | Self::Steady => 1,
            Self::Frames => 8,
            Self::Bursts => 16,
            Self::Camera => camera.objects.into(),
        }
    }

    /// Time from frame to frame; `None` if the answers set the pace.
    pub fn interval(self, camera: CameraRate) -> Option<Duration> {
        match self {
            Self::FlatOut => None,
            Self::Steady | Self::Frames => Some(Duration::from_nanos(1_000_000_000 / 30)),
            Self::Bursts => Some(Duration::from_millis(250)),
            Self::Camera => Some(Duration::from_secs_f64(1.0 / camera.rate_hz)),
        }
    }

    /// From when its latencies count, in words.
    pub fn measured_from(self) -> &'static str {
        match self {
            Self::Camera => "when the frame was due, as images in memory (corrected for coordinated omission)",
            Self::Steady | Self::Frames | Self::Bursts => "when the observation was due (corrected for coordinated omission)",
            Self::FlatOut => "when the producer began to write (one client in a loop: nothing is due, so there is nothing to correct)",
        }
    }
}

/// Time, and waiting for it.
pub trait Clock {
    /// Nanoseconds of CLOCK_MONOTONIC.
    fn now(&mut self) -> u64;
    /// Returns at this time, or at once if it has passed.
    fn wait_until(&mut self, time_ns: u64);
}

/// The machine's clock.
pub struct Monotonic;

impl Clock for Monotonic {
    fn now(&mut self) -> u64 {
        monotonic_ns()
    }

    fn wait_until(&mut self, time_ns: u64) {
        loop {
            match time_ns.saturating_sub(monotonic_ns()) {
                0 => return,
                rest if rest > SPIN_NS => std::thread::sleep(Duration::from_nanos(rest - SPIN_NS)),
                _ => std::hint::spin_loop(),
            }
        }
    }
}

/// Calls `send(clock, frame, due_ns)` for frame after frame until `frames` are done or it returns false. Each is due at its own time after
/// `start_ns`; a late one shifts none of those after it, which are then sent without waiting.
///
/// # Errors
/// Whatever `send` returns.
pub fn drive<C: Clock, E>(
    clock: &mut C,
    start_ns: u64,
    interval: Duration,
    frames: u64,
    mut send: impl FnMut(&mut C, u64, u64) -> Result<bool, E>,
) -> Result<(), E> {
    for frame in 0..frames {
        let due_ns = start_ns + frame * interval.as_nanos() as u64;
        clock.wait_until(due_ns);
        if !send(clock, frame, due_ns)? {
            break;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::benchmark::latency::record::{Record, STAGES};
    use crate::benchmark::percentiles::{Percentiles, histogram};

    const MS: u64 = 1_000_000;

    /// A clock that only moves when it is waited for or work is done.
    struct Simulated(u64);

    impl Clock for Simulated {
        fn now(&mut self) -> u64 {
            self.0
        }

        fn wait_until(&mut self, time_ns: u64) {
            self.0 = self.0.max(time_ns);
        }
    }

    /// 1000 observations, one each 10 ms, of a service that answers within 1 ms, but is stalled for 1 s when the 500th comes, and with it
    /// the producer.
    fn stalled() -> Vec<Record> {
        let mut records = Vec::new();
        drive(&mut Simulated(7 * MS), 10 * MS, Duration::from_millis(10), 1000, |clock, frame, due_ns| {
            let written = clock.now();
            clock.0 += if frame == 500 { 1000 * MS } else { MS };
            let mut stamps_ns = [written; STAGES.len()];
            (stamps_ns[0], stamps_ns[STAGES.len() - 1]) = (due_ns, clock.now());
            records.push(Record { sequence: frame, counted: true, status: 0, stamps_ns });
            Ok::<_, ()>(true)
        })
        .unwrap();
        records
    }

    #[test]
    fn a_stall_counts_for_everything_that_was_due_meanwhile() {
        let records = stalled();
        assert_eq!(records.len(), 1000);
        // The schedule does not shift.
        assert!(records.iter().enumerate().all(|(n, r)| r.stamps_ns[0] == (10 + 10 * n as u64) * MS));
        // After the stall, at 1000 ms late, each of those due takes 1 ms and comes 10 ms after the one before: 9 ms are caught up each time.
        // Latencies are 1000, 991, 982, …, 10 and then 1 ms: 111 are above 1 ms.
        let corrected: Vec<u64> = records.iter().map(Record::latency_ns).collect();
        let late: Vec<u64> = corrected.iter().map(|ns| ns / MS).filter(|ms| *ms > 1).collect();
        assert_eq!(late, (0..111).map(|n| 1000 - 9 * n).collect::<Vec<_>>());
        let of = |times: Vec<u64>| Percentiles::of(&histogram(times)).values().map(|us| us / 1e3);
        let near = |values: [f64; 6], expected: [f64; 6]| values.iter().zip(expected).all(|(v, e)| (v / e - 1.0).abs() < 2e-3);
        // Ranks 500, 900, 990, 999 and 1000 of 1000: the 12th, 102nd, … from the top of the 111 late ones.
        let p90 = 1000.0 - 9.0 * 100.0;
        let p99 = 1000.0 - 9.0 * 10.0;
        assert!(near(of(corrected.clone()), [1.0, p90, p99, 991.0, 1000.0, 1000.0]), "{:?}", of(corrected));
        // From when each was written, the same stall is one slow observation.
        let from_write = records.iter().map(Record::latency_from_write_ns).collect();
        assert!(near(of(from_write), [1.0, 1.0, 1.0, 1.0, 1000.0, 1000.0]));
    }

    #[test]
    fn driving_ends_when_it_is_told_to() {
        let mut sent = Vec::new();
        drive(&mut Simulated(0), 0, Duration::from_millis(1), 10, |clock, frame, due| {
            sent.push((frame, due, clock.now()));
            Ok::<_, ()>(frame < 2)
        })
        .unwrap();
        assert_eq!(sent, [(0, 0, 0), (1, MS, MS), (2, 2 * MS, 2 * MS)]);
        assert_eq!(drive(&mut Simulated(0), 0, Duration::ZERO, 2, |_, frame, _| Err(frame)), Err(0));
    }

    #[test]
    fn the_real_clock_waits_no_less_than_asked() {
        let due = Monotonic.now() + 2 * MS;
        Monotonic.wait_until(due);
        assert!(Monotonic.now() >= due);
    }
}
