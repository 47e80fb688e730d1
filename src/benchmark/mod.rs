//! Measurements of speed, and what they need to be believed: the machine, who shares a core, what else ran.
//!
//! | file | what |
//! | --- | --- |
//! | `machine` | which machine, and how idle it was |
//! | `cores` | which process runs on which core |
//! | `percentiles` | HdrHistogram percentiles, medians over runs |
//! | `latency` | producer, daemon and readers as separate processes, every stage stamped |
//! | `scale` | how a query grows with classes, components, resolution, hidden voxels, threads, subscribers |

pub mod cores;
pub mod latency;
pub mod machine;
pub mod percentiles;
pub mod scale;
