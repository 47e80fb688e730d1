//! `beo record`: writes what the daemon is asked and answers into an MCAP file.

use super::connecting::Connecting;
use super::failure::Failure;
use super::narrating::Narrating;
use super::observe::seconds;
use super::stop;
use crate::recording::Recorder;
use beo_ipc::clock::monotonic_ns;
use beo_ipc::text::from_field;
use beo_ipc::{InstanceName, ObservationReader, OpenError, Status, Subscriber, SubscriberOptions};
use clap::Args;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

/// Record what the daemon is asked and answers into an MCAP file, for Foxglove and Rerun
///
/// Topics: /beo/observation (point cloud of what was seen), /beo/completion (its surface, more transparent where unsure) and
/// /beo/completion_points (its filled voxels, as Rerun draws no surfaces), /beo/object (class, pose hypotheses, box),
/// /beo/classes (their probabilities as bars), /beo/pose, /tf, /beo/log, /beo/percept (JSON as `beo watch --json` prints it), /beo/status (JSON
/// as `beo status --json` prints it, once a second), and /beo/picture (depth images of `beo camera` with the objects found). Until it ends, the recording is
/// in OUT.mcap.partial. Ctrl-C ends it properly, and it takes its name; of a recorder that is killed, all but the last second can be recovered
/// from the partial file (`mcap recover`), which no other recording overwrites.
#[derive(Args)]
pub struct Record {
    /// The file to write
    #[arg(value_name = "OUT.mcap")]
    out: PathBuf,
    /// Instance of the daemon
    #[arg(long, default_value_t = InstanceName::default(), value_name = "NAME")]
    instance: InstanceName,
    /// End after this many percepts
    #[arg(long, value_name = "N")]
    count: Option<u64>,
    /// End after this many seconds
    #[arg(long, value_name = "SECONDS")]
    seconds: Option<f64>,
    /// Seconds to wait for a daemon
    #[arg(long, default_value_t = 10.0, value_name = "SECONDS")]
    wait: f64,
}

/// How much of a recording may be lost where this process is killed.
const FLUSH: Duration = Duration::from_secs(1);

impl Record {
    /// Runs the command.
    pub fn run(self) -> Result<(), Failure> {
        let wait = seconds(self.wait)?;
        let length = match self.seconds {
            None => None,
            Some(length) if length > 0.0 => {
                Some(Duration::try_from_secs_f64(length).map_err(|_| Failure::Usage(format!("--seconds {length}: use fewer seconds")))?)
            }
            Some(length) => return Err(Failure::Usage(format!("--seconds {length}: use a number above 0"))),
        };
        let stop = stop::on_signal()?;
        let connecting = Connecting::within(wait, &self.instance, &stop);
        let subscriber = connecting.open(|| Subscriber::open(&self.instance, &SubscriberOptions { completion: true }))?;
        let status = connecting.status(&subscriber)?;
        let observations = match ObservationReader::open(&self.instance) {
            Ok(reader) => Some(reader),
            Err(OpenError::Full { .. }) => {
                warn!("warning: another recorder reads the observations; what was seen is taken from the completions");
                None
            }
            Err(error) => return Err(error.into()),
        };
        let mut recorder = Recorder::create(&self.out, notes(&self.instance, &status))?;
        let mut narrating = Narrating::begin(&self.instance, subscriber, status, &mut recorder)?;
        recorder.flush()?;
        // Whoever starts a producer after this line misses nothing.
        match recorder.path() == self.out {
            true => warn!("recording `{}` to {}", self.instance, self.out.display()),
            false => warn!("recording `{}` to {} until it ends", self.instance, recorder.path().display()),
        }
        let start = Instant::now();
        let mut flushed = Instant::now();
        let is_done = |recorder: &Recorder| {
            self.count.is_some_and(|count| recorder.told().percepts >= count)
                || length.is_some_and(|length| start.elapsed() >= length)
                || stop.load(Ordering::Relaxed)
        };
        while !is_done(&recorder) {
            narrating.wait(Duration::from_millis(50))?;
            take_observations(observations.as_ref(), &mut recorder)?;
            while !is_done(&recorder) && narrating.answer(&mut recorder, observations.is_none())? {
                take_observations(observations.as_ref(), &mut recorder)?;
            }
            narrating.pictures(&mut recorder)?;
            narrating.maintain(&mut recorder)?;
            if flushed.elapsed() > FLUSH {
                observations.iter().for_each(ObservationReader::maintain);
                recorder.flush()?;
                flushed = Instant::now();
            }
        }
        let recorded = recorder.finish()?;
        if let Some(missed) = narrating.missed() {
            warn!("missed {missed}");
        }
        say!(
            "recorded {} percepts, {} completions and {} observations in {:.1} s: {} messages, {:.1} MB in {}",
            recorded.told.percepts,
            recorded.told.completions,
            recorded.told.observations,
            start.elapsed().as_secs_f64(),
            recorded.messages,
            recorded.bytes as f64 / 1e6,
            self.out.display()
        );
        Ok(())
    }
}

/// Records the observations that wait. One that is broken is passed over: the daemon refuses it and says why.
fn take_observations(reader: Option<&ObservationReader>, recorder: &mut Recorder) -> Result<(), Failure> {
    let Some(reader) = reader else { return Ok(()) };
    while let Some(observation) = reader.take_observation()? {
        if let Ok(voxels) = observation.voxels() {
            recorder.observation(observation.header(), voxels, monotonic_ns())?;
        }
    }
    Ok(())
}

fn notes(instance: &InstanceName, status: &Status) -> BTreeMap<String, String> {
    let notes = [
        ("instance", instance.to_string()),
        ("daemon_id", status.daemon_id.to_string()),
        ("model_id", format!("{:016x}", status.model_id)),
        ("model_name", from_field(&status.model_name).to_owned()),
        ("classes", status.class_names().collect::<Vec<_>>().join(",")),
    ];
    notes.into_iter().map(|(name, note)| (name.to_owned(), note)).collect()
}
