//! The paper's evaluation: protocol, figures of merit, tables and plots.

pub mod figures;
pub mod metrics;
pub mod protocol;
mod table;

pub use protocol::{Evaluation, Protocol, evaluate, sample};
pub use table::table;
