//! The paper's evaluation: protocol, figures of merit, tables and plots.

pub mod figures;
pub mod icp;
pub mod metrics;
pub mod protocol;
pub mod symmetry;
mod table;

pub use protocol::{Evaluation, Protocol, evaluate, sample};
pub use table::table;
