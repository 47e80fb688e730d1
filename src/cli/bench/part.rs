//! Processes that a benchmark starts besides its own: what they are to do comes on a line of standard input.

use crate::cli::failure::Failure;
use serde::de::DeserializeOwned;
use std::io::BufRead;

/// The plan of a part of `benchmark`, which ends with the process that started it.
///
/// # Errors
/// [`Failure::Usage`] if someone else has started it.
pub fn plan<T: DeserializeOwned>(benchmark: &str, input: &mut impl BufRead) -> Result<T, Failure> {
    // Whoever started this process may be gone before it is done.
    rustix::process::set_parent_process_death_signal(Some(rustix::process::Signal::INT))?;
    let mut line = String::new();
    input.read_line(&mut line)?;
    serde_json::from_str(&line).map_err(|error| not_planned(benchmark, &error.to_string()))
}

/// The plan says what no part of `benchmark` could do.
pub fn not_planned(benchmark: &str, reason: &str) -> Failure {
    Failure::Usage(format!("this is a part of `beo bench {benchmark}`, which says on standard input what to do: {reason}"))
}
