//! The daemon: from shared memory to shared memory. The only place where `beo_ipc` and the mathematics meet.
//!
//! | file | what |
//! | --- | --- |
//! | `streams` | observations that wait, the newest of each stream, by turns |
//! | `tracks` | what is believed of each object after its last answer |
//! | `asked` | what a header asks for |
//! | `answer` | one observation in, percept and completion out |
//! | `bus_errors` | shared memory that a peer cuts while it is mapped |
//! | `recipe` | from a model file to what answers |
//! | `reload` | another model, loaded while the one before serves |
//! | `sequences` | observations that were lost before they were taken |
//! | `latency` | percentiles of the last minute's latencies |
//! | `notify` | how it goes, for the service manager |
//! | `daemon` | the loop: receive, answer, heartbeat |

mod answer;
mod asked;
mod bus_errors;
mod daemon;
mod error;
mod latency;
mod notify;
mod recipe;
mod reload;
mod sequences;
mod streams;
mod tracks;

pub use answer::Answerer;
pub use asked::ask;
pub use bus_errors::outlive as outlive_bus_errors;
pub use daemon::{Daemon, ServeOptions, Signals};
pub use error::ServeError;
pub use recipe::{Prior, Recipe};
