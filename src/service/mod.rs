//! The daemon: from shared memory to shared memory. The only place where `beo_ipc` and the mathematics meet.
//!
//! | file | what |
//! | --- | --- |
//! | `streams` | observations that wait, the newest of each stream |
//! | `tracks` | what was last answered of each object |
//! | `asked` | what a header asks for |
//! | `answer` | one observation in, percept and completion out |
//! | `latency` | percentiles of recent latencies |
//! | `daemon` | the loop: receive, answer, heartbeat |

mod answer;
mod asked;
mod daemon;
mod latency;
mod streams;
mod tracks;

pub use asked::ask;
pub use daemon::{Daemon, ServeError, ServeOptions};
