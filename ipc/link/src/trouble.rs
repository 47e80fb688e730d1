//! Troubles, each in one line of standard error, and the same one not again and again.

use std::collections::BTreeMap;
use std::fmt::Display;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// A kind of trouble is said again after this time.
const AGAIN: Duration = Duration::from_secs(10);

/// Says troubles.
#[derive(Debug, Default)]
pub struct Troubles {
    /// When each kind was said last, and how often it came since.
    said: Mutex<BTreeMap<&'static str, (Instant, u64)>>,
}

impl Troubles {
    /// Says one, or counts it where one of its kind was said of late.
    pub fn say(&self, kind: &'static str, text: &dyn Display) {
        if let Some(line) = self.line(kind, text, Instant::now()) {
            eprintln!("beo-link: {line}");
        }
    }

    fn line(&self, kind: &'static str, text: &dyn Display, now: Instant) -> Option<String> {
        let mut said = self.said.lock().unwrap_or_else(PoisonError::into_inner);
        match said.get_mut(kind) {
            Some((last, more)) if now.saturating_duration_since(*last) < AGAIN => {
                *more += 1;
                None
            }
            before => {
                let more = before.map_or(0, |(_, more)| *more);
                said.insert(kind, (now, 0));
                let more = if more > 0 { format!(" (and {more} more of this kind before)") } else { String::new() };
                Some(format!("{kind}: {text}{more}"))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_kind_is_said_once_and_what_was_kept_back_is_counted() {
        let (troubles, start) = (Troubles::default(), Instant::now());
        assert_eq!(troubles.line("percept", &"is short", start).unwrap(), "percept: is short");
        assert_eq!(troubles.line("percept", &"is long", start), None);
        assert!(troubles.line("status", &"is short", start).is_some());
        assert_eq!(troubles.line("percept", &"is short", start + AGAIN).unwrap(), "percept: is short (and 1 more of this kind before)");
    }
}
