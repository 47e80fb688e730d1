//! Errors of camera files.

use beo_core::text::printable;
use beo_shapes::FormatError;

const FORMAT: &str = "camera_info";

/// The file as a whole is wrong.
pub(super) fn wrong(problem: impl Into<String>) -> FormatError {
    FormatError::File { format: FORMAT, problem: printable(&problem.into()) }
}

/// A line of it is wrong.
pub(super) fn wrong_line(line: usize, problem: &str) -> FormatError {
    FormatError::Line { format: FORMAT, line, problem: printable(problem) }
}
