//! The program `beo`: the command line, the daemon, and what reads and writes files for them.
//!
//! The mathematics is the crate `beo_core`'s, shapes are `beo_shapes`', pictures `beo_picture`'s, depth frames' geometry `beo_camera`'s, the
//! messages in shared memory `beo_ipc`'s, and evaluation and benchmarks `beo_lab`'s. Only [`service`], `recording` and the subcommands of
//! [`cli`] know both the mathematics and the messages. The features `lab` (evaluation, benchmarks, demo), `record` (recordings as MCAP) and
//! `view` (the live view) are on by default; a robot can build without them.

pub mod cli;
pub mod export;
pub mod frames;
#[cfg(feature = "record")]
pub mod recording;
pub mod service;
