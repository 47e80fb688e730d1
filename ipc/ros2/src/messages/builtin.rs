//! `builtin_interfaces` and `std_msgs`: stamps, durations, headers.

super::messages! {
    /// A point in time: seconds and nanoseconds since 1970, or of the simulation.
    Time { sec: i32, nanosec: u32 }
    /// A length of time.
    Duration { sec: i32, nanosec: u32 }
    /// When, and in which frame.
    Header { stamp: Time, frame_id: String }
}

impl Time {
    /// The time of day now.
    pub fn now() -> Self {
        let since = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap_or_default();
        // Seconds end in the year 2038, as the message has them.
        Self { sec: i32::try_from(since.as_secs()).unwrap_or(i32::MAX), nanosec: since.subsec_nanos() }
    }

    /// Nanoseconds; below 0 before 1970.
    pub fn nanoseconds(&self) -> i64 {
        i64::from(self.sec) * 1_000_000_000 + i64::from(self.nanosec)
    }
}
