//! Writing to standard output and standard error, without anything that a terminal would obey: names of files may hold it. A reader that goes away (`| head`) ends the command quietly, with everything cleaned up.

use super::failure::Failure;
use beo_core::text::for_terminal;
use std::io::Write;

/// Writes lines to standard output and flushes them.
pub fn write(text: std::fmt::Arguments<'_>) -> Result<(), Failure> {
    let mut out = std::io::stdout().lock();
    writeln!(out, "{}", for_terminal(&text.to_string())).and_then(|()| out.flush()).map_err(|error| match error.kind() {
        std::io::ErrorKind::BrokenPipe => Failure::ReaderGone,
        _ => Failure::Failed(format!("cannot write to standard output: {error}")),
    })
}

/// `println!` that returns from the command instead of panicking when nobody reads any more.
macro_rules! say {
    ($($part:tt)*) => { $crate::cli::output::write(format_args!($($part)*))? };
}

/// Writes lines to standard error. That nobody reads them is no reason to fail.
pub fn write_error(text: std::fmt::Arguments<'_>) {
    let _ = writeln!(std::io::stderr().lock(), "{}", for_terminal(&text.to_string()));
}

/// `eprintln!` for what may repeat names of files and what other processes say.
macro_rules! warn {
    ($($part:tt)*) => { $crate::cli::output::write_error(format_args!($($part)*)) };
}
