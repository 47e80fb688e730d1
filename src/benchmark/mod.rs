//! What `beo bench` measures.

pub mod scale;
