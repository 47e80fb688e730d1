//! What `beo bench` measures, beside the machine's own limits and peers that do the same work.
//!
//! Every figure is a ratio of things measured in one run, in turns: other work on the machine slows all of them alike.

pub mod machine;
pub mod percentiles;
pub mod query;
pub mod transport;
