//! `beo watch`: prints what the daemon perceives.

use super::answers::{as_json, as_text, as_value, completion_of};
use super::connecting::Connecting;
use super::failure::Failure;
use super::observe::seconds;
use super::pictures::{PictureArguments, Shown};
use super::stop;
use beo_ipc::clock::monotonic_ns;
use beo_ipc::{InstanceName, Subscriber, SubscriberOptions};
use clap::{ArgAction, Args};
use std::sync::atomic::Ordering;
use std::sync::mpsc::channel;
use std::time::{Duration, Instant};

/// Print what the daemon perceives
#[derive(Args)]
pub struct Watch {
    /// Instance of the daemon
    #[arg(long, default_value_t = InstanceName::default(), value_name = "NAME")]
    instance: InstanceName,
    /// Print one JSON object a line
    #[arg(long)]
    json: bool,
    /// End after this many percepts
    #[arg(long, value_name = "N")]
    count: Option<u64>,
    /// Pass over what was published before this began; if false, it is shown and marked as such
    #[arg(long, value_name = "BOOL", default_value_t = true, num_args = 0..=1, require_equals = true, default_missing_value = "true", action = ArgAction::Set)]
    since_start: bool,
    #[command(flatten)]
    pictures: PictureArguments,
    /// Seconds to wait for a daemon
    #[arg(long, default_value_t = 10.0, value_name = "SECONDS")]
    wait: f64,
}

/// Says how many percepts came faster than they were read, those that were `told` before apart.
fn say_missed(told: &mut u64, subscriber: &Subscriber) {
    let missed = subscriber.missed();
    if missed > *told {
        warn!("missed {} percepts, which came faster than they were read", missed - *told);
        *told = missed;
    }
}

impl Watch {
    /// Runs the command.
    pub fn run(self) -> Result<(), Failure> {
        let started_ns = monotonic_ns();
        let wait = seconds(self.wait)?;
        self.pictures.prepare()?;
        let stop = stop::on_signal()?;
        let connecting = Connecting::within(wait, &self.instance, &stop);
        let subscriber = connecting.open(|| Subscriber::open(&self.instance, &SubscriberOptions { completion: true }))?;
        let mut status = connecting.status(&subscriber)?;
        // Whoever starts a producer after this line misses nothing.
        warn!("watching `{}`", self.instance);
        // Drawing takes longer than a percept, so it is done in another thread.
        let (drawings, drawn) = channel::<Shown>();
        let wanted = self.pictures.clone();
        let artist = std::thread::spawn(move || drawn.iter().try_for_each(|shown| shown.save(&wanted)));
        let (mut shown, mut told) = (0, 0);
        let mut housekeeping = Instant::now();
        while self.count.is_none_or(|count| shown < count) && !stop.load(Ordering::Relaxed) {
            subscriber.wait(Duration::from_millis(50))?;
            while self.count.is_none_or(|count| shown < count) {
                let Some(percept) = subscriber.take_percept()? else { break };
                let read_ns = monotonic_ns();
                // A daemon keeps its last percept for whoever comes later: nothing of it may still be true.
                let age_s = started_ns.saturating_sub(percept.published_ns) as f64 / 1e9;
                let is_old = percept.published_ns < started_ns;
                if is_old && self.since_start {
                    continue;
                }
                let completion = completion_of(&subscriber, &percept)?;
                if percept.model_id != status.model_id {
                    status = subscriber.status()?.unwrap_or(status);
                }
                let line = match (self.json, is_old) {
                    (true, false) => as_json(&percept, &completion, &status, read_ns),
                    (true, true) => {
                        let mut line = as_value(&percept, &completion, &status, read_ns);
                        line["published_before_start_s"] = age_s.into();
                        line.to_string()
                    }
                    (false, false) => as_text(&percept, &completion, &status, read_ns),
                    (false, true) => {
                        format!("{} (published {age_s:.1} s before the start)", as_text(&percept, &completion, &status, read_ns))
                    }
                };
                say!("{line}");
                if let Some(completion) = completion.as_ref().filter(|_| self.pictures.is_wanted())
                    && drawings.send(Shown::of_answer(shown + 1, &percept, completion, &status)?).is_err()
                {
                    break; // a picture could not be written: the thread's own error is reported below
                }
                shown += 1;
            }
            if housekeeping.elapsed() > Duration::from_secs(1) {
                say_missed(&mut told, &subscriber);
                subscriber.maintain();
                housekeeping = Instant::now();
            }
            if artist.is_finished() {
                break;
            }
        }
        say_missed(&mut told, &subscriber);
        drop(drawings);
        artist.join().unwrap_or_else(|_| Err(Failure::Failed("drawing failed".into())))
    }
}
