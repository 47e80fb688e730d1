//! One observation in, one percept out.
mod projection;
pub use projection::ColumnSums;
