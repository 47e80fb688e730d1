//! The daemon's status for people and as JSON.

use super::health::Health;
use beo_ipc::text::from_field;
use beo_ipc::{DaemonState, InstanceName, Status};
use serde_json::{Value, json};

fn state(status: &Status) -> String {
    DaemonState::from_code(status.state).map_or("unknown".into(), |state| format!("{state:?}").to_lowercase())
}

/// Seconds between two stamps.
pub fn seconds(later_ns: u64, earlier_ns: u64) -> f64 {
    later_ns.saturating_sub(earlier_ns) as f64 / 1e9
}

/// Some lines for people.
pub fn text(instance: &InstanceName, status: &Status, health: Health, now_ns: u64) -> String {
    let health = if health == Health::Healthy { "healthy" } else { "not healthy" };
    let [x, y, z] = status.dims;
    let ms = |ns: u64| format!("{:.2} ms", ns as f64 / 1e6);
    let mut lines = vec![
        format!("`{instance}` is {health}: {}, process {}", state(status), status.pid),
        format!("up {}, last heartbeat {:.1} s ago", duration(seconds(now_ns, status.started_ns)), seconds(now_ns, status.heartbeat_ns)),
        format!("model {} ({:016x}): {} classes, {x}×{y}×{z}", from_field(&status.model_name), status.model_id, status.class_count),
        format!(
            "observations: {} taken = {} answered + {} refused + {} dropped + {} waiting; {} lost before they were taken",
            status.received,
            status.answered,
            status.refused,
            status.dropped,
            status.waiting(),
            status.overflowed
        ),
    ];
    if status.failed > 0 {
        lines.push(format!("of the refused, {} were the daemon's own failure", status.failed));
    }
    if status.nothing_seen > 0 {
        lines.push(format!("of the refused, in {} nothing of an object was seen", status.nothing_seen));
    }
    if status.answered_none > 0 {
        lines.push(format!("of the answered, {} are more probably of none of the classes", status.answered_none));
    }
    lines.push(match status.latency_count {
        0 => "no observation in the last minute".into(),
        count => format!(
            "latency of the last minute's {count}: median {}, 90 % {}, 99 % {}, 99.9 % {}, longest {}",
            ms(status.latency_p50_ns),
            ms(status.latency_p90_ns),
            ms(status.latency_p99_ns),
            ms(status.latency_p999_ns),
            ms(status.latency_max_ns)
        ),
    });
    if status.reloads > 0 || status.reloads_refused > 0 {
        lines.push(format!("models taken since the start: {}, refused: {}", status.reloads, status.reloads_refused));
    }
    lines.join("\n")
}

fn duration(seconds: f64) -> String {
    let whole = seconds as u64;
    match whole {
        0..60 => format!("{seconds:.1} s"),
        60..3600 => format!("{} min {} s", whole / 60, whole % 60),
        _ => format!("{} h {} min", whole / 3600, whole / 60 % 60),
    }
}

/// One JSON object.
pub fn json(instance: &InstanceName, status: &Status, health: Health, now_ns: u64) -> Value {
    let us = |ns: u64| ns as f64 / 1e3;
    json!({
        "instance": instance.as_str(),
        "running": true,
        "healthy": health == Health::Healthy,
        "complaint": health.complaint(),
        "state": state(status),
        "pid": status.pid,
        "daemon_id": format!("{:016x}", status.daemon_id),
        "uptime_s": seconds(now_ns, status.started_ns),
        "answer_number": status.answer_number,
        "heartbeat_age_s": seconds(now_ns, status.heartbeat_ns),
        "model": {
            "name": from_field(&status.model_name),
            "id": format!("{:016x}", status.model_id),
            "dims": status.dims,
            "classes": status.class_names().collect::<Vec<_>>(),
            "reloads": status.reloads,
            "reloads_refused": status.reloads_refused,
        },
        "observations": {
            "received": status.received,
            "answered": status.answered,
            "refused": status.refused,
            "failed": status.failed,
            "nothing_seen": status.nothing_seen,
            "answered_none": status.answered_none,
            "dropped": status.dropped,
            "waiting": status.waiting(),
            "overflowed": status.overflowed,
        },
        "latency_us": {
            "count": status.latency_count,
            "p50": us(status.latency_p50_ns),
            "p90": us(status.latency_p90_ns),
            "p99": us(status.latency_p99_ns),
            "p99.9": us(status.latency_p999_ns),
            "max": us(status.latency_max_ns),
        },
    })
}

#[cfg(test)]
mod tests {
    use super::super::tests::{NOW_NS, serving};
    use super::*;

    #[test]
    fn people_read_the_sum_and_the_latencies() {
        let text = text(&InstanceName::default(), &serving(), Health::Healthy, NOW_NS);
        for part in [
            "`default` is healthy: serving, process 42",
            "up 1 min 40 s, last heartbeat 0.1 s ago",
            "(00000000000000ab): 2 classes, 30×30×30",
            "110 taken = 100 answered + 5 refused + 4 dropped + 1 waiting; 3 lost",
            "1 were the daemon's own failure",
            "of the refused, in 2 nothing of an object was seen",
            "of the answered, 7 are more probably of none",
            "last minute's 60: median 1.50 ms, 90 % 2.00 ms, 99 % 3.00 ms, 99.9 % 4.00 ms, longest 5.00 ms",
            "models taken since the start: 2, refused: 1",
        ] {
            assert!(text.contains(part), "{part}\n{text}");
        }
    }

    #[test]
    fn times_are_readable() {
        assert_eq!([0.25, 59.9, 3599.0, 90_000.0].map(duration), ["0.2 s", "59.9 s", "59 min 59 s", "25 h 0 min"]);
    }

    #[test]
    fn programs_read_the_same_numbers() {
        let value = json(&InstanceName::default(), &serving(), Health::Late, NOW_NS);
        assert_eq!((value["healthy"].as_bool(), value["state"].as_str()), (Some(false), Some("serving")));
        assert_eq!(value["model"]["classes"], json!(["bed", "chair"]));
        assert_eq!(value["observations"]["waiting"], 1);
        assert_eq!([&value["observations"]["nothing_seen"], &value["observations"]["answered_none"], &value["answer_number"]], [2, 7, 107]);
        assert_eq!(value["latency_us"]["p99.9"], 4000.0);
    }
}
