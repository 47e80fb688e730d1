//! Measurements of speed, and what they need to be believed: the machine and its limits, who shares a core, what else ran.
//!
//! | file | what |
//! | --- | --- |
//! | `machine` | which machine, and how idle it was |
//! | `limits` | what no computation on it exceeds |
//! | `cores` | which process runs on which core |
//! | `wake` | how a process learns that something has come |
//! | `percentiles` | HdrHistogram percentiles, medians over runs |
//! | `latency` | producer, daemon and readers as separate processes, every stage stamped |
//! | `transport` | grids handed from process to process, by our channels and by others |
//! | `query` | the compute of queries alone, beside peers that do the same work |
//! | `large` | queries of large grids, beside a plain read of the basis |
//! | `scale` | how queries and learning grow |
//!
//! All sides of a comparison are measured in one run, in turns: other work on the machine slows all of it alike.

pub mod cores;
pub mod large;
pub mod latency;
pub mod limits;
pub mod machine;
pub mod percentiles;
pub mod query;
pub mod scale;
pub mod transport;
pub mod wake;
