//! The paper's evaluation: protocol, figures of merit, baselines, tables and plots.

pub mod baseline;
mod curves;
pub mod figures;
pub mod icp;
pub mod metrics;
pub mod protocol;
pub mod symmetry;
mod table;
mod viewpoint;

pub use baseline::{IcpEvaluation, evaluate_icp};
pub use protocol::{Evaluation, Protocol, evaluate, sample};
pub use table::table;
pub use viewpoint::{Posed, Viewpoint};
