//! How the node does: counts, the last trouble, and both as diagnostics of ROS.

use crate::messages::{DiagnosticArray, DiagnosticStatus, Header, KeyValue, Time};
use beo_ipc::Status;
use beo_ipc::text::from_field;
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// The same trouble is said again after this time.
const AGAIN: Duration = Duration::from_secs(10);
/// Trouble older than this is over.
const OVER: Duration = Duration::from_secs(2);

/// The events that are counted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Count {
    /// Depth images that came.
    Images,
    /// Images whose camera_info had not come.
    WithoutCamera,
    /// Images or segmentations without a partner.
    Unpaired,
    /// Images that a newer one replaced before they were looked at.
    Replaced,
    /// Images that could not be used.
    Bad,
    /// Objects that were sent to the daemon.
    Sent,
    /// Objects without a grid.
    NoGrid,
    /// Objects whose grid could not be sent.
    NotSent,
    /// Objects that the daemon answered.
    Answered,
    /// Objects that the daemon refused.
    Refused,
    /// Messages that a reliable reader did not take in time.
    Unpublished,
}

const NAMES: [&str; 11] = [
    "images",
    "images without camera_info",
    "images without a partner",
    "images replaced by newer ones",
    "images that cannot be used",
    "objects sent",
    "objects without a grid",
    "objects not sent",
    "objects answered",
    "objects refused",
    "messages not published",
];

/// Counts and troubles; shared by all threads.
#[derive(Debug, Default)]
pub struct Health {
    counts: [AtomicU64; NAMES.len()],
    troubles: Mutex<BTreeMap<&'static str, Trouble>>,
}

#[derive(Clone, Debug)]
struct Trouble {
    text: String,
    said: Instant,
    last: Instant,
}

impl Health {
    /// One more.
    pub fn count(&self, what: Count) {
        self.counts[what as usize].fetch_add(1, Ordering::Relaxed);
    }

    /// So many in all.
    pub fn set(&self, what: Count, all: u64) {
        self.counts[what as usize].store(all, Ordering::Relaxed);
    }

    /// Says a trouble of a kind in one line of standard error; the same one not more often than every ten seconds.
    pub fn trouble(&self, kind: &'static str, text: &dyn std::fmt::Display) {
        let (text, now) = (text.to_string(), Instant::now());
        let mut troubles = self.troubles.lock().unwrap_or_else(PoisonError::into_inner);
        let known = troubles.get(kind).filter(|known| known.text == text && now - known.said < AGAIN);
        let said = known.map_or(now, |known| known.said);
        if known.is_none() {
            eprintln!("beo-ros2: {kind}: {text}");
        }
        troubles.insert(kind, Trouble { text, said, last: now });
    }

    /// The message for `/diagnostics`: the daemon's health, and this node's.
    pub fn diagnostics(&self, node: &str, status: Option<&Status>) -> DiagnosticArray {
        let status = vec![daemon(node, status), self.own(node)];
        DiagnosticArray { header: Header { stamp: Time::now(), frame_id: String::new() }, status }
    }

    fn own(&self, node: &str) -> DiagnosticStatus {
        let troubles = self.troubles.lock().unwrap_or_else(PoisonError::into_inner);
        let present: Vec<_> = troubles.iter().filter(|(_, trouble)| trouble.last.elapsed() < OVER).collect();
        let message: Vec<_> = present.iter().map(|(kind, trouble)| format!("{kind}: {}", trouble.text)).collect();
        let values = NAMES.iter().zip(&self.counts).map(|(key, count)| value(key, count.load(Ordering::Relaxed)));
        DiagnosticStatus {
            level: if present.is_empty() { DiagnosticStatus::OK } else { DiagnosticStatus::WARN },
            name: format!("{node}: images"),
            message: if present.is_empty() { "ok".to_owned() } else { message.join("; ") },
            hardware_id: String::new(),
            values: values.collect(),
        }
    }
}

fn value(key: &str, value: impl std::fmt::Display) -> KeyValue {
    KeyValue { key: key.to_owned(), value: value.to_string() }
}

fn daemon(node: &str, status: Option<&Status>) -> DiagnosticStatus {
    let name = format!("{node}: daemon");
    let Some(status) = status else {
        let message = "no daemon serves the instance: start `beo serve`".to_owned();
        return DiagnosticStatus { level: DiagnosticStatus::ERROR, name, message, ..DiagnosticStatus::default() };
    };
    let state = beo_ipc::DaemonState::from_code(status.state);
    let is_well = matches!(state, Some(beo_ipc::DaemonState::Serving | beo_ipc::DaemonState::Reloading));
    let ms = |ns: u64| format!("{:.3}", ns as f64 / 1e6);
    let counts = [
        ("received", status.received),
        ("answered", status.answered),
        ("refused", status.refused),
        ("dropped", status.dropped),
        ("failed", status.failed),
        ("overflowed", status.overflowed),
    ];
    let mut values: Vec<_> = counts.map(|(key, count)| value(key, count)).into();
    values.push(value("model", from_field(&status.model_name)));
    values.push(value("latency p50, ms", ms(status.latency_p50_ns)));
    values.push(value("latency p99, ms", ms(status.latency_p99_ns)));
    DiagnosticStatus {
        level: if is_well { DiagnosticStatus::OK } else { DiagnosticStatus::WARN },
        name,
        message: state.map_or_else(|| "unknown state".to_owned(), |state| format!("{state:?}").to_lowercase()),
        hardware_id: String::new(),
        values,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn diagnostics_tell_the_daemons_state_the_counts_and_the_last_trouble() {
        let health = Health::default();
        health.count(Count::Images);
        health.set(Count::Unpaired, 5);
        let away = health.diagnostics("beo", None);
        assert_eq!((away.status[0].level, away.status[1].level), (DiagnosticStatus::ERROR, DiagnosticStatus::OK));
        let of = |key: &str| away.status[1].values.iter().find(|found| found.key == key).map(|found| found.value.clone());
        assert_eq!(
            (of("images"), of("images without a partner"), of("objects sent")),
            (Some("1".into()), Some("5".into()), Some("0".into()))
        );
        health.trouble("image", &"of another encoding");
        let there = health.diagnostics("beo", Some(&Status { answered: 3, ..Status::EMPTY }));
        assert_eq!((there.status[0].level, there.status[0].message.as_str()), (DiagnosticStatus::OK, "serving"));
        assert_eq!((there.status[1].level, there.status[1].message.as_str()), (DiagnosticStatus::WARN, "image: of another encoding"));
        assert_eq!(there.status[0].values[1], value("answered", 3));
    }
}
