//! The laboratory: [`evaluation`] after the paper's section IV, and [`benchmark`]s through real processes, which [`process`] starts. The
//! program builds without it (`--no-default-features`) where only perception is needed.

pub mod benchmark;
pub mod evaluation;
pub mod process;
