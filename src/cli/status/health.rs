//! Whether a daemon is healthy, by its last status.

use beo_ipc::{DaemonState, Status};
use std::time::Duration;

/// A heartbeat is late after so many times its interval, and not before [`PATIENCE`]: one long query delays it.
const LATE: u64 = 8;
const PATIENCE: Duration = Duration::from_secs(5);

/// Health of a daemon.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Health {
    /// It serves.
    Healthy,
    /// Its heartbeat is late.
    Late,
    /// It failed on the last observation.
    Failing,
    /// It is stopping.
    Stopping,
}

impl Health {
    /// By its status at `now_ns` of the monotonic clock.
    pub fn of(status: &Status, now_ns: u64) -> Self {
        let allowed = status.heartbeat_interval_ns.saturating_mul(LATE).max(PATIENCE.as_nanos() as u64);
        match DaemonState::from_code(status.state) {
            _ if now_ns.saturating_sub(status.heartbeat_ns) > allowed => Health::Late,
            Some(DaemonState::Failing) | None => Health::Failing,
            Some(DaemonState::Stopping) => Health::Stopping,
            Some(DaemonState::Serving | DaemonState::Reloading) => Health::Healthy,
        }
    }

    /// The advice for people; `None` if all is well.
    pub fn complaint(self) -> Option<&'static str> {
        match self {
            Health::Healthy => None,
            Health::Late => Some("its heartbeat is late: is it stopped, or its machine overloaded?"),
            Health::Failing => Some("it failed on the last observation: see its log; another model can be tried with `beo reload --model`"),
            Health::Stopping => Some("it is stopping"),
        }
    }
}
