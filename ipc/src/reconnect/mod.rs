//! Roles that outlive the daemon: they let go of its services when it is gone, and come back when another one serves the instance.
//!
//! A plain [`crate::Subscriber`] or [`crate::Producer`] keeps the services open while no daemon runs, so that a daemon with other settings
//! (a model of other dims, say) could not start. These here close them, and open them again from inside the calls that the client makes
//! anyway: there is no thread behind them.

mod producer;
mod subscriber;

pub use producer::ReconnectingProducer;
pub use subscriber::{ReconnectingSubscriber, Waited};

use std::time::{Duration, Instant};

/// How often the daemon is looked at.
const LOOK: Duration = Duration::from_millis(250);

/// How often one is looked for while none is there: a look costs some tens of microseconds, and what a daemon publishes before it is found
/// is lost but for the last.
const SEARCH: Duration = Duration::from_millis(10);

/// How often what the dead left is cleaned up while the daemon is silent: a pass over all of iceoryx2's nodes.
const CLEAN_UP: Duration = Duration::from_secs(1);

/// Says yes at most once per interval.
#[derive(Debug)]
struct Pace {
    interval: Duration,
    next: Instant,
}

impl Pace {
    fn new(interval: Duration) -> Self {
        Self { interval, next: Instant::now() + interval }
    }

    fn is_due(&mut self) -> bool {
        let now = Instant::now();
        let due = now >= self.next;
        if due {
            self.next = now + self.interval;
        }
        due
    }

    fn left(&self) -> Duration {
        self.next.saturating_duration_since(Instant::now())
    }

    /// Due at once.
    fn hurry(&mut self) {
        self.next = Instant::now();
    }
}
