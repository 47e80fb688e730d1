//! Hostile input for everything of beo that parses: what a target may do with any bytes is to return.
//!
//! - `targets`: one function from bytes to nothing per parser, with its seeds and the memory it may use
//! - `mutation`: seeds become hostile
//!
//! The program `drive` runs them on any toolchain; those in `libfuzzer/` are for cargo-fuzz.

// The messages of `beo-ros2`, a program whose workspace this is not: without its transport.
#[allow(dead_code, unused_imports, missing_docs, reason = "of the messages, those that come from the graph are read here")]
#[path = "../../ipc/ros2/src/messages/mod.rs"]
mod messages;
pub mod mutation;
pub mod targets;
