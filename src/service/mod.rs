//! The daemon: from shared memory to shared memory. The only place where `beo_ipc` and the mathematics meet.
//!
//! | file | what |
//! | --- | --- |
//! | `streams` | observations that wait, the newest of each stream |
//! | `sequences` | what was overwritten before it was taken |
//! | `tracks` | what was last answered of each object |
//! | `answer` | one observation in, percept and completion out |
//! | `latency` | percentiles of recent latencies |
//! | `daemon` | the loop: receive, answer, heartbeat |

mod answer;
mod daemon;
mod latency;
mod sequences;
mod streams;
mod tracks;

pub use daemon::{Daemon, ServeError, ServeOptions};
