//! Log lines on standard error: as text or as JSON, and no more than a few a second of one kind.

use super::failure::Failure;
use clap::ValueEnum;
use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};
use tracing::{Event, Level, Metadata, Subscriber, callsite::Identifier};
use tracing_subscriber::filter::{LevelFilter, Targets};
use tracing_subscriber::layer::{Context, Layer};
use tracing_subscriber::prelude::*;

/// Warnings and errors of one place in the code that are shown in one [`WINDOW`].
const MOST_OF_A_KIND: u64 = 5;
const WINDOW: Duration = Duration::from_secs(1);
/// The target of the limit's own lines, which are not limited.
const OWN: &str = "beo::log";

/// How log lines are written.
#[derive(Clone, Copy, Debug, PartialEq, ValueEnum)]
pub enum Format {
    /// For people
    Text,
    /// One JSON object a line
    Json,
}

/// The running log.
pub struct Log {
    format: Format,
    limit: Limit,
}

/// Starts the log: warnings, with -v what happens, with -vv everything.
pub fn start(verbose: u8, format: Format) -> Log {
    let level = match verbose {
        0 => LevelFilter::WARN,
        1 => LevelFilter::INFO,
        _ => LevelFilter::DEBUG,
    };
    // iceoryx2 warns of what is meant, such as an explicit configuration: only its errors are passed on unless asked for.
    let iceoryx2 = if verbose > 1 { LevelFilter::DEBUG } else { LevelFilter::ERROR };
    // Viewers that go away without a goodbye, or are none, are no error of this program's.
    let foxglove = if verbose > 0 { level } else { LevelFilter::OFF };
    let targets = Targets::new()
        .with_default(level)
        .with_target("iceoryx2", iceoryx2)
        .with_target("iceoryx2_bb_loggers", iceoryx2)
        .with_target("foxglove", foxglove);
    let limit = Limit::default();
    let lines = tracing_subscriber::fmt::layer().with_writer(std::io::stderr).with_ansi(false);
    let lines = match format {
        Format::Text => lines.boxed(),
        Format::Json => lines.json().flatten_event(true).boxed(),
    };
    let _ = tracing_subscriber::registry().with(targets).with(limit.clone()).with(lines).try_init();
    Log { format, limit }
}

impl Log {
    /// Says why the program fails, in one line.
    pub fn failure(&self, failure: &Failure) {
        match self.format {
            Format::Text => warn!("beo: {failure}"),
            Format::Json => tracing::error!(target: OWN, "{failure}"),
        }
    }
}

impl Drop for Log {
    /// Says what was left out and not yet said.
    fn drop(&mut self) {
        self.limit.report(None);
    }
}

/// Lets a few lines of each place in the code through in each second, and says how many it left out: in the next second in which
/// something is logged, or at the end.
#[derive(Clone, Default)]
struct Limit(Arc<Mutex<HashMap<Identifier, Kind>>>);

/// Lines of one place in the code.
struct Kind {
    place: &'static Metadata<'static>,
    since: Instant,
    shown: u64,
    left_out: u64,
}

impl Limit {
    /// Whether a line of this place is shown.
    fn admits(&self, place: &'static Metadata<'static>, now: Instant) -> bool {
        let mut kinds = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let kind = kinds.entry(place.callsite()).or_insert(Kind { place, since: now, shown: 0, left_out: 0 });
        if now.duration_since(kind.since) >= WINDOW {
            (kind.since, kind.shown) = (now, 0);
        }
        let shown = kind.shown < MOST_OF_A_KIND;
        *(if shown { &mut kind.shown } else { &mut kind.left_out }) += 1;
        shown
    }

    /// The places of which lines were left out and not yet reported, and how many; of windows that are over at `now`, or of all.
    fn take_left_out(&self, now: Option<Instant>) -> Vec<(&'static Metadata<'static>, u64)> {
        let mut kinds = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let over = |kind: &Kind| now.is_none_or(|now| now.duration_since(kind.since) >= WINDOW);
        kinds.values_mut().filter(|kind| kind.left_out > 0 && over(kind)).map(|k| (k.place, std::mem::take(&mut k.left_out))).collect()
    }

    fn report(&self, now: Option<Instant>) {
        for (place, left_out) in self.take_left_out(now) {
            let (file, line) = (place.file().unwrap_or("?"), place.line().unwrap_or(0));
            tracing::warn!(target: OWN, left_out, file, line, "lines of a flood were left out");
        }
    }
}

impl<S: Subscriber> Layer<S> for Limit {
    fn event_enabled(&self, event: &Event<'_>, _: Context<'_, S>) -> bool {
        let place = event.metadata();
        // What is said only when asked for is not limited.
        if place.target() == OWN || *place.level() > Level::WARN {
            return true;
        }
        let now = Instant::now();
        self.report(Some(now));
        self.admits(place, now)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tracing::Callsite;

    /// Two places in the code.
    fn places() -> [&'static Metadata<'static>; 2] {
        let first = tracing::callsite! { name: "first", kind: tracing::metadata::Kind::EVENT, fields: };
        let second = tracing::callsite! { name: "second", kind: tracing::metadata::Kind::EVENT, fields: };
        [first.metadata(), second.metadata()]
    }

    #[test]
    fn a_flood_of_one_place_does_not_hide_another_and_is_counted() {
        let (limit, [first, second]) = (Limit::default(), places());
        let start = Instant::now();
        let shown = (0..100).filter(|_| limit.admits(first, start)).count();
        assert_eq!(shown as u64, MOST_OF_A_KIND);
        assert!(limit.admits(second, start));
        assert!(limit.take_left_out(Some(start)).is_empty(), "its second is not over");
        let next = start + WINDOW;
        assert_eq!(limit.take_left_out(Some(next)), [(first, 100 - MOST_OF_A_KIND)]);
        assert!(limit.take_left_out(None).is_empty(), "it is said once");
        assert!(limit.admits(first, next));
    }

    #[test]
    fn at_the_end_everything_is_said() {
        let (limit, [first, _]) = (Limit::default(), places());
        let start = Instant::now();
        let shown = (0..MOST_OF_A_KIND + 3).filter(|_| limit.admits(first, start)).count();
        assert_eq!(shown as u64, MOST_OF_A_KIND);
        assert_eq!(limit.take_left_out(None), [(first, 3)]);
    }
}
