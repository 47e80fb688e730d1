//! Writing to standard output. A reader that goes away (`| head`) ends the command quietly, with everything cleaned up.

use super::failure::Failure;
use std::io::Write;

/// Writes text to standard output and flushes it.
pub fn write(text: std::fmt::Arguments<'_>) -> Result<(), Failure> {
    let mut out = std::io::stdout().lock();
    out.write_fmt(text).and_then(|()| out.flush()).map_err(|error| match error.kind() {
        std::io::ErrorKind::BrokenPipe => Failure::ReaderGone,
        _ => Failure::Failed(format!("cannot write to standard output: {error}")),
    })
}

/// `println!` that returns from the command instead of panicking when nobody reads any more.
macro_rules! say {
    ($($part:tt)*) => { $crate::cli::output::write(format_args!("{}\n", format_args!($($part)*)))? };
}
