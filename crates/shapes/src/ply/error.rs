//! Errors of PLY files as a whole.

use crate::FormatError;

/// Name of the format in messages.
pub(super) const FORMAT: &str = "PLY";

/// The file as a whole is wrong.
pub(super) fn error(problem: impl Into<String>) -> FormatError {
    FormatError::File { format: FORMAT, problem: beo_core::text::printable(&problem.into()) }
}
