//! Hostile input for everything of beo that parses: what a target may do with any bytes is to return.
//!
//! - `targets`: one function from bytes to nothing per parser, with its seeds and the memory it may use
//! - `mutation`: seeds become hostile
//!
//! The program `drive` runs them on any toolchain; those in `libfuzzer/` are for cargo-fuzz.

pub mod mutation;
pub mod targets;
