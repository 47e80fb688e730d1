//! The paper's evaluation: protocol, figures of merit, baselines, tables and plots.

pub mod baseline;
mod curves;
pub mod figures;
pub mod icp;
pub mod leave_one_out;
pub mod metrics;
mod on_tables;
pub mod protocol;
pub mod rotations;
pub mod symmetry;
mod table;
mod viewpoint;

pub use baseline::{IcpEvaluation, evaluate_icp};
pub use leave_one_out::{LeaveOneOutError, LeftOut, OneView, Outcome, leave_one_out};
pub use on_tables::{Resting, TableFigures, TableProtocol, on_tables};
pub use protocol::{Evaluation, Protocol, evaluate, sample, sample_places};
pub use table::table;
pub use viewpoint::{Posed, Viewpoint};
