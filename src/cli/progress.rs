//! Progress of long work: a bar on a terminal, nothing otherwise (log lines come with -v).

use indicatif::{ProgressBar, ProgressStyle};
use std::io::IsTerminal;

/// A bar for `total` steps, hidden unless standard error is a terminal.
pub fn bar(total: usize, what: &'static str) -> ProgressBar {
    tracing::info!(total, "{what}");
    if !std::io::stderr().is_terminal() {
        return ProgressBar::hidden();
    }
    let style = ProgressStyle::with_template("{msg:40} {bar:30} {pos}/{len} {elapsed}").expect("a valid template");
    ProgressBar::new(total as u64).with_style(style).with_message(what)
}
