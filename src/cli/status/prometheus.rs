//! The daemon's status in Prometheus' text exposition format 0.0.4.

use super::health::Health;
use super::report::seconds;
use beo_ipc::text::from_field;
use beo_ipc::{InstanceName, Status};
use std::fmt::Write as _;

/// Metrics of one instance.
struct Metrics<'a> {
    instance: &'a InstanceName,
    text: String,
}

impl Metrics<'_> {
    fn describe(&mut self, name: &str, kind: &str, help: &str) {
        // Writing to a String does not fail.
        let _ = writeln!(self.text, "# HELP beo_{name} {help}\n# TYPE beo_{name} {kind}");
    }

    fn sample(&mut self, name: &str, labels: &[(&str, &str)], value: f64) {
        let labels: String = labels.iter().map(|(label, value)| format!(",{label}=\"{}\"", escaped(value))).collect();
        let _ = writeln!(self.text, "beo_{name}{{instance=\"{}\"{labels}}} {value}", self.instance);
    }

    fn one(&mut self, name: &str, kind: &str, help: &str, value: f64) {
        self.describe(name, kind, help);
        self.sample(name, &[], value);
    }
}

/// A label's value: backslash, quote and line feed are escaped.
fn escaped(value: &str) -> String {
    value.replace('\\', "\\\\").replace('"', "\\\"").replace('\n', "\\n")
}

/// The metrics of a daemon that does not run.
pub fn absent(instance: &InstanceName) -> String {
    let mut metrics = Metrics { instance, text: String::new() };
    up(&mut metrics, false);
    metrics.text
}

fn up(metrics: &mut Metrics, up: bool) {
    metrics.one("up", "gauge", "1 if the daemon runs and sends its status.", f64::from(u8::from(up)));
}

/// All metrics of a daemon.
pub fn text(instance: &InstanceName, status: &Status, health: Health, now_ns: u64) -> String {
    let mut m = Metrics { instance, text: String::new() };
    up(&mut m, true);
    m.one("healthy", "gauge", "1 if `beo status` exits with 0.", f64::from(u8::from(health == Health::Healthy)));
    m.describe("info", "gauge", "The process and the model that it serves; always 1.");
    let (pid, id) = (status.pid.to_string(), format!("{:016x}", status.model_id));
    m.sample("info", &[("pid", &pid), ("model", from_field(&status.model_name)), ("model_id", &id)], 1.0);
    m.one("uptime_seconds", "gauge", "Time since the daemon started.", seconds(now_ns, status.started_ns));
    m.one("heartbeat_age_seconds", "gauge", "Time since the last heartbeat.", seconds(now_ns, status.heartbeat_ns));
    m.one("classes", "gauge", "Classes of the model.", f64::from(status.class_count));
    let counters = [
        ("received", "taken by the daemon: answered, refused, dropped or waiting", status.received),
        ("answered", "answered", status.answered),
        ("refused", "answered with a reason why they could not be", status.refused),
        ("failed", "refused by the daemon's own failure", status.failed),
        ("nothing_seen", "refused as nothing of an object was seen", status.nothing_seen),
        ("answered_none", "answered as more probably of none of the classes", status.answered_none),
        ("dropped", "given up for newer ones", status.dropped),
        ("overflowed", "lost in their producer's queue before the daemon took them", status.overflowed),
    ];
    for (name, help, value) in counters {
        m.one(&format!("observations_{name}_total"), "counter", &format!("Observations that were {help}."), value as f64);
    }
    m.one("percepts_total", "counter", "Percepts sent.", status.answer_number as f64);
    m.one("observations_waiting", "gauge", "Observations that wait for an answer.", status.waiting() as f64);
    m.describe("latency_seconds", "gauge", "From taking an observation to sending its percept, over the last minute.");
    let latencies = [
        ("0.5", status.latency_p50_ns),
        ("0.9", status.latency_p90_ns),
        ("0.99", status.latency_p99_ns),
        ("0.999", status.latency_p999_ns),
        ("1", status.latency_max_ns),
    ];
    for (quantile, ns) in latencies {
        m.sample("latency_seconds", &[("quantile", quantile)], ns as f64 / 1e9);
    }
    m.one("latency_observations", "gauge", "Observations of the last minute, of which the latencies are.", status.latency_count as f64);
    m.one("model_reloads_total", "counter", "Models that took the place of the one before.", f64::from(status.reloads));
    m.one("model_reloads_refused_total", "counter", "Models that were refused.", f64::from(status.reloads_refused));
    m.text
}

#[cfg(test)]
mod tests {
    use super::super::tests::{NOW_NS, serving};
    use super::*;

    #[test]
    fn every_sample_is_described_once_and_labels_are_escaped() {
        let text = text(&InstanceName::default(), &serving(), Health::Healthy, NOW_NS);
        let mut described = std::collections::HashSet::new();
        for line in text.lines() {
            match line.strip_prefix("# TYPE ") {
                Some(rest) => {
                    let (name, kind) = rest.split_once(' ').unwrap();
                    assert!(described.insert(name) && ["gauge", "counter"].contains(&kind), "{line}");
                    assert_eq!(name.ends_with("_total"), kind == "counter", "{line}");
                }
                None if line.starts_with("# HELP ") => {}
                None => {
                    assert!(described.contains(line.split('{').next().unwrap()), "{line}");
                    assert!(line.rsplit(' ').next().unwrap().parse::<f64>().is_ok(), "{line}");
                }
            }
        }
        for line in [
            "beo_up{instance=\"default\"} 1",
            "beo_info{instance=\"default\",pid=\"42\",model=\"fur\\\"ni\\\\ture\\n\",model_id=\"00000000000000ab\"} 1",
            "beo_observations_received_total{instance=\"default\"} 110",
            "beo_observations_waiting{instance=\"default\"} 1",
            "beo_latency_seconds{instance=\"default\",quantile=\"0.5\"} 0.0015",
            "beo_uptime_seconds{instance=\"default\"} 100",
        ] {
            assert!(text.lines().any(|found| found == line), "{line}\n{text}");
        }
        assert_eq!(absent(&InstanceName::default()).lines().last(), Some("beo_up{instance=\"default\"} 0"));
    }
}
