//! `beo status`: how the daemon does, for people, scripts and Prometheus.

mod health;
mod prometheus;
mod report;

use super::connecting::Connecting;
use super::failure::Failure;
use super::observe::seconds;
use super::stop;
use beo_ipc::clock::monotonic_ns;
use beo_ipc::{InstanceName, Status, Subscriber, SubscriberOptions};
use clap::Args;
use health::Health;
use std::time::Duration;

/// Say how the daemon does
///
/// Exit code 0: it is healthy. 1: it does not run, its heartbeat is late, it failed on the last observation, or it is stopping.
/// Latencies are those of the last minute, from taking an observation to sending its percept.
#[derive(Args)]
pub struct StatusCommand {
    /// Instance of the daemon
    #[arg(long, default_value_t = InstanceName::default(), value_name = "NAME")]
    instance: InstanceName,
    /// Print one JSON object
    #[arg(long, conflicts_with = "prometheus")]
    json: bool,
    /// Print metrics in Prometheus' text format (0.0.4), also of a daemon that does not run
    #[arg(long)]
    prometheus: bool,
    /// Seconds to wait for a daemon
    #[arg(long, default_value_t = 0.0, value_name = "SECONDS")]
    wait: f64,
}

/// How a status is told.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StatusForm {
    /// Some lines for people.
    Text,
    /// One JSON object.
    Json,
    /// Prometheus' text exposition format 0.0.4.
    Prometheus,
}

/// A daemon's status as it is told at `now_ns`. It comes from another process: any numbers and texts can be in it.
pub fn status_report(instance: &InstanceName, status: &Status, form: StatusForm, now_ns: u64) -> String {
    let health = Health::of(status, now_ns);
    match form {
        StatusForm::Text => report::text(instance, status, health, now_ns),
        StatusForm::Json => report::json(instance, status, health, now_ns).to_string(),
        StatusForm::Prometheus => prometheus::text(instance, status, health, now_ns).trim_end().to_owned(),
    }
}

impl StatusCommand {
    /// Runs the command.
    pub fn run(self) -> Result<(), Failure> {
        let wait = seconds(self.wait)?;
        let status = match self.status(wait) {
            Ok(status) => status,
            Err(failure) => {
                if self.prometheus {
                    say!("{}", prometheus::absent(&self.instance).trim_end());
                } else if self.json {
                    say!("{}", serde_json::json!({ "instance": self.instance.as_str(), "running": false, "healthy": false }));
                }
                return Err(failure);
            }
        };
        let now_ns = monotonic_ns();
        let form = match (self.prometheus, self.json) {
            (true, _) => StatusForm::Prometheus,
            (false, true) => StatusForm::Json,
            (false, false) => StatusForm::Text,
        };
        say!("{}", status_report(&self.instance, &status, form, now_ns));
        match Health::of(&status, now_ns).complaint() {
            None => Ok(()),
            Some(complaint) => Err(Failure::Failed(format!("`{}` is not healthy: {complaint}", self.instance))),
        }
    }

    fn status(&self, wait: Duration) -> Result<Status, Failure> {
        let stop = stop::on_signal()?;
        let connecting = Connecting::within(wait, &self.instance, &stop);
        let subscriber = connecting.open(|| Subscriber::open(&self.instance, &SubscriberOptions::default()))?;
        connecting.status(&subscriber)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use beo_ipc::DaemonState;

    /// A daemon that has been up for 100 s and serves.
    pub(super) fn serving() -> Status {
        let mut status = Status {
            pid: 42,
            daemon_id: 7,
            model_id: 0xab,
            started_ns: 1_000_000_000,
            heartbeat_ns: 100_900_000_000,
            heartbeat_interval_ns: 250_000_000,
            received: 110,
            answered: 100,
            dropped: 4,
            refused: 5,
            failed: 1,
            nothing_seen: 2,
            answered_none: 7,
            answer_number: 107,
            overflowed: 3,
            latency_count: 60,
            latency_p50_ns: 1_500_000,
            latency_p90_ns: 2_000_000,
            latency_p99_ns: 3_000_000,
            latency_p999_ns: 4_000_000,
            latency_max_ns: 5_000_000,
            dims: [30; 3],
            class_count: 2,
            reloads: 2,
            reloads_refused: 1,
            model_name: beo_ipc::text::to_field("fur\"ni\\ture\n"),
            ..Status::EMPTY
        };
        status.class_names[0] = beo_ipc::text::to_field("bed");
        status.class_names[1] = beo_ipc::text::to_field("chair");
        status
    }

    pub(super) const NOW_NS: u64 = 101_000_000_000;

    #[test]
    fn health_is_told_from_state_and_heartbeat() {
        let status = serving();
        assert_eq!(Health::of(&status, NOW_NS), Health::Healthy);
        assert_eq!(Health::of(&status, status.heartbeat_ns + 5_000_000_001), Health::Late);
        assert_eq!(Health::of(&Status { heartbeat_interval_ns: 1 << 40, ..status }, status.heartbeat_ns + 5_000_000_001), Health::Healthy);
        let in_state = |state| Health::of(&Status { state, ..status }, NOW_NS);
        assert_eq!(in_state(DaemonState::Reloading.code()), Health::Healthy);
        assert_eq!(in_state(DaemonState::Failing.code()), Health::Failing);
        assert_eq!(in_state(DaemonState::Stopping.code()), Health::Stopping);
        assert_eq!(in_state(99), Health::Failing);
        assert!(Health::Healthy.complaint().is_none());
        assert!([Health::Late, Health::Failing, Health::Stopping].iter().all(|health| health.complaint().is_some()));
    }
}
