//! The loop: wait, receive, answer, heartbeat.

use super::answer::{Answerer, unsupported};
use super::bus_errors::pages_gone;
use super::error::ServeError;
use super::latency::Latencies;
use super::notify::Supervisor;
use super::recipe::Recipe;
use super::reload::{Reload, Reloaded};
use super::sequences::Sequences;
use super::streams::{Streams, Waiting};
use beo_core::grid::ObservationError;
use beo_core::model::Model;
use beo_ipc::clock::monotonic_ns;
use beo_ipc::text::to_field;
use beo_ipc::{DaemonState, InstanceName, ObservationHeader, Percept, PerceptStatus, Refusal, Server, ServerOptions, Status};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Time between two heartbeats.
const HEARTBEAT: Duration = Duration::from_millis(250);
/// Longest sleep: after this long a request to stop is seen even if no signal interrupts the wait.
const LONGEST_WAIT: Duration = Duration::from_millis(50);
/// Time between two rounds of housekeeping.
const HOUSEKEEPING_NS: u64 = 1_000_000_000;
/// Observations that are taken before one is answered: all that can wait at a time, 16 of each of 16 producers. Without a bound, producers
/// that send faster than they are read would keep the daemon reading.
const MOST_AT_ONCE: usize = 256;
/// The time for answering waiting observations when the daemon is to stop; less than the second that is promised, as an answer takes time
/// too.
const DRAIN: Duration = Duration::from_millis(800);

/// The settings of a daemon: instance, model, recipe.
pub struct ServeOptions {
    /// Its instance.
    pub instance: InstanceName,
    /// The model file.
    pub model: PathBuf,
    /// How it answers.
    pub recipe: Recipe,
    /// Whether it looks for observations again and again instead of sleeping until one comes.
    pub poll: bool,
}

/// The requests that signals bring to a daemon.
#[derive(Clone, Debug, Default)]
pub struct Signals {
    /// To end.
    pub stop: Arc<AtomicBool>,
    /// To read the model's file anew; taken back when it is done.
    pub reload: Arc<AtomicBool>,
}

/// A running daemon.
pub struct Daemon {
    server: Server,
    options: ServeOptions,
    answerer: Answerer,
    streams: Streams,
    /// The observations that are being answered.
    taken: Vec<Waiting>,
    sequences: Sequences,
    latencies: Latencies,
    status: Status,
    supervisor: Supervisor,
    reload: Option<Reload>,
    heartbeat_ns: u64,
    housekeeping_ns: u64,
}

impl Daemon {
    /// Sets up the channels of the instance, for the model that the options name, prepared by their recipe. Observations that arrive from
    /// now on are answered once [`Self::run`] runs.
    ///
    /// # Errors
    /// [`ServeError`].
    pub fn open(options: ServeOptions, answerer: Answerer) -> Result<Self, ServeError> {
        let dims = answerer.model().dims();
        let sides = <[usize; 3]>::from(dims).map(|side| side as u32);
        let server = Server::open(&options.instance, &ServerOptions::new(sides))?;
        let status =
            Status { started_ns: monotonic_ns(), heartbeat_interval_ns: HEARTBEAT.as_nanos() as u64, dims: sides, ..Status::EMPTY };
        let mut daemon = Self {
            server,
            options,
            streams: Streams::new(dims),
            taken: Vec::new(),
            sequences: Sequences::new(),
            answerer,
            latencies: Latencies::new(),
            status,
            supervisor: Supervisor::from_environment(),
            reload: None,
            heartbeat_ns: 0,
            housekeeping_ns: 0,
        };
        daemon.name_the_model();
        daemon.publish_status();
        Ok(daemon)
    }

    /// This run's identity.
    pub fn id(&self) -> u64 {
        self.server.daemon_id()
    }

    /// The counters and state so far.
    pub fn status(&self) -> &Status {
        &self.status
    }

    /// The model that it serves.
    pub fn model(&self) -> &Model {
        self.answerer.model()
    }

    /// Serves until told to stop. What waits then is answered as long as there is time, and otherwise refused.
    ///
    /// # Errors
    /// [`ServeError::Wait`].
    pub fn run(&mut self, signals: &Signals) -> Result<(), ServeError> {
        let stop = || signals.stop.load(Ordering::Relaxed);
        self.supervisor.ready(&self.describe());
        while !stop() {
            self.receive();
            while self.answer() {
                if stop() {
                    break;
                }
                self.receive();
                self.keep_up(signals)?;
            }
            self.keep_up(signals)?;
            if self.options.poll {
                // Gives way to whoever shares the core, and returns within a microsecond if nobody does.
                std::thread::yield_now();
            } else if !stop() {
                self.server.wait(LONGEST_WAIT)?;
            }
        }
        self.drain();
        Ok(())
    }

    /// Answers what has arrived as long as there is time; the rest is told that there is none.
    fn drain(&mut self) {
        let start = Instant::now();
        set_state(&mut self.status, DaemonState::Stopping);
        self.supervisor.stopping();
        self.publish_status();
        self.receive();
        if let Some(reload) = self.reload.take() {
            reload.abandon(self.status.model_id);
        }
        while start.elapsed() < DRAIN && self.answer() {}
        while let Some(waiting) = self.streams.pop() {
            self.status.refused += 1;
            publish(
                &self.server,
                &Percept {
                    received_ns: waiting.received_ns,
                    model_id: self.status.model_id,
                    status: PerceptStatus::Stopping.code(),
                    explanation: to_field("the daemon stops and had no time left for this observation: send it to the next one"),
                    ..Percept::answering(&waiting.header)
                },
            );
        }
        self.publish_status();
    }

    /// Answers what waits, as much of it as is answered side by side; gives whether anything did.
    fn answer(&mut self) -> bool {
        let Self { answerer, streams, server, status, latencies, reload, taken, .. } = self;
        taken.extend((0..answerer.desks()).map_while(|_| streams.pop()));
        answerer.answer(server, taken, |waiting, percept| {
            let failed = percept.status == PerceptStatus::Internal.code();
            if percept.status == PerceptStatus::Ok.code() {
                status.answered += 1;
                status.answered_none += u64::from(percept.none_probability > 0.5);
            } else {
                status.refused += 1;
                status.nothing_seen += u64::from(percept.status == PerceptStatus::NothingSeen.code());
            }
            if failed {
                status.failed += 1;
                tracing::error!(sequence = percept.sequence, reason = beo_ipc::text::from_field(&percept.explanation), "no answer");
            }
            set_state(status, state_after(failed, reload.is_some()));
            publish(server, &percept);
            let now = monotonic_ns();
            latencies.record(now, now.saturating_sub(waiting.received_ns));
        });
        let any = !taken.is_empty();
        taken.drain(..).for_each(|waiting| streams.recycle(waiting.observation));
        any
    }

    /// Copies what has arrived into the queue; what cannot be answered is refused at once.
    fn receive(&mut self) {
        for _ in 0..MOST_AT_ONCE {
            let gone = pages_gone();
            let observation = match self.server.receive() {
                Ok(Some(observation)) => observation,
                Ok(None) => return,
                // Of a producer that vanished meanwhile; the next one is received all the same.
                Err(error) => {
                    tracing::warn!(%error, "an observation could not be received");
                    return;
                }
            };
            let received_ns = monotonic_ns();
            let (origin, header) = (observation.origin(), observation.header());
            self.status.received += 1;
            self.status.overflowed += self.sequences.missing_before(header.producer_id, header.sequence, received_ns);
            let method = self.options.recipe.query.method;
            let outcome = observation.voxels().and_then(|voxels| match unsupported(header, self.status.dims, method) {
                Some(refusal) => Err(refusal),
                // What was gone when it was copied is zeros, which nobody has sent.
                None => match self.streams.push(origin, header, voxels, received_ns, || pages_gone() == gone) {
                    Ok(Some(displaced)) => Ok(displaced),
                    Ok(None) => Err(Refusal::Cut { payload_len: voxels.len() }),
                    Err(error) => Err(refusal(&error, header)),
                },
            });
            // So is a header that was gone, and what the zeros would be refused for is no fault of its producer's release.
            let outcome = outcome.map_err(|refusal| match pages_gone() == gone {
                true => refusal,
                false => Refusal::Cut { payload_len: self.status.dims.iter().map(|side| *side as usize).product() },
            });
            match outcome {
                Ok(displaced) => self.status.dropped += displaced as u64,
                Err(refusal) => {
                    tracing::warn!(producer = header.producer_id, sequence = header.sequence, %refusal, "an observation was refused");
                    self.status.refused += 1;
                    publish(&self.server, &Percept { received_ns, model_id: self.status.model_id, ..Percept::refusing(header, &refusal) });
                }
            }
        }
    }

    /// Heartbeat, control calls and housekeeping when their time has come.
    fn keep_up(&mut self, signals: &Signals) -> Result<(), ServeError> {
        let status = &self.status;
        self.supervisor.alive(|| describe(&self.answerer, status));
        let now = monotonic_ns();
        if now.saturating_sub(self.heartbeat_ns) >= HEARTBEAT.as_nanos() as u64 {
            self.heartbeat_ns = now;
            self.look_after_the_model(signals);
            self.publish_status();
            if self.options.poll {
                // Wake-ups that nobody waits for would fill their queue.
                self.server.wait(Duration::ZERO)?;
            }
        }
        if now.saturating_sub(self.housekeeping_ns) >= HOUSEKEEPING_NS {
            self.housekeeping_ns = now;
            self.server.maintain();
        }
        Ok(())
    }

    /// Begins to load another model when asked to, and takes the one that has been loaded. One at a time: other calls wait.
    fn look_after_the_model(&mut self, signals: &Signals) {
        if let Some(reload) = self.reload.take_if(|reload| reload.is_finished()) {
            self.take(reload.finish());
        }
        if self.reload.is_some() {
            return;
        }
        let served = self.options.model.clone();
        let (path, call) = if signals.reload.swap(false, Ordering::Relaxed) {
            (served, None)
        } else {
            let call = match self.server.receive_reload() {
                Ok(Some(call)) => call,
                Ok(None) => return,
                Err(error) => return tracing::warn!(%error, "a control call could not be received"),
            };
            match call.model() {
                Ok(path) => (path.unwrap_or(served), Some(call)),
                Err(reason) => return call.answer(self.status.model_id, Some(&reason)),
            }
        };
        tracing::info!(model = %path.display(), "reloading");
        self.supervisor.reloading();
        if self.status.state == DaemonState::Serving.code() {
            set_state(&mut self.status, DaemonState::Reloading);
        }
        self.reload = Some(Reload::start(&self.options.recipe, path, self.model().dims(), call));
    }

    fn take(&mut self, reloaded: Reloaded) {
        let refusal = match reloaded.outcome {
            Ok(answerer) => {
                let before = std::mem::replace(&mut self.answerer, answerer);
                // Giving back what it held takes milliseconds: not between two observations. If no thread can be had, it happens here.
                let _ = std::thread::Builder::new().name("beo-release".into()).spawn(move || drop(before));
                self.options.model = reloaded.path;
                self.status.reloads += 1;
                self.name_the_model();
                tracing::info!(model = %self.options.model.display(), id = self.status.model_id, "reloaded");
                None
            }
            Err(reason) => {
                self.status.reloads_refused += 1;
                let served = self.answerer.model_name();
                tracing::warn!(%reason, "another model was refused; `{served}` goes on");
                Some(reason)
            }
        };
        if self.status.state == DaemonState::Reloading.code() {
            set_state(&mut self.status, DaemonState::Serving);
        }
        self.supervisor.ready(&self.describe());
        if let Some(call) = reloaded.call {
            call.answer(self.status.model_id, refusal.as_deref());
        }
    }

    /// Writes the model that answers into the status.
    fn name_the_model(&mut self) {
        let model = self.answerer.model();
        self.status.model_id = model.id;
        self.status.model_name = to_field(self.answerer.model_name());
        self.status.class_count = model.classes.len() as u32;
        self.status.class_names = Status::EMPTY.class_names;
        for (field, name) in self.status.class_names.iter_mut().zip(model.class_names()) {
            *field = to_field(name);
        }
    }

    fn publish_status(&mut self) {
        let latency = self.latencies.summary(monotonic_ns());
        let status = &mut self.status;
        (status.latency_count, status.latency_max_ns) = (latency.count, latency.max);
        (status.latency_p50_ns, status.latency_p90_ns) = (latency.p50, latency.p90);
        (status.latency_p99_ns, status.latency_p999_ns) = (latency.p99, latency.p999);
        if let Err(error) = self.server.publish_status(status) {
            tracing::warn!(%error, "the status could not be sent");
        }
    }

    fn describe(&self) -> String {
        describe(&self.answerer, &self.status)
    }
}

fn publish(server: &Server, percept: &Percept) {
    if let Err(error) = server.publish(percept) {
        tracing::warn!(%error, sequence = percept.sequence, "a percept could not be sent");
    }
}

/// A daemon that stops does nothing else any more.
fn set_state(status: &mut Status, state: DaemonState) {
    if status.state != DaemonState::Stopping.code() {
        status.state = state.code();
    }
}

/// The state after an answer, which `failed` or not.
fn state_after(failed: bool, is_reloading: bool) -> DaemonState {
    match (failed, is_reloading) {
        (true, _) => DaemonState::Failing,
        (false, true) => DaemonState::Reloading,
        (false, false) => DaemonState::Serving,
    }
}

/// One line for the service manager.
fn describe(answerer: &Answerer, status: &Status) -> String {
    let Status { received, answered, refused, dropped, overflowed, .. } = status;
    let name = answerer.model_name().replace(char::is_control, " ");
    format!(
        "serving {name}; observations: {received} taken, {answered} answered, {refused} refused, {dropped} dropped, {overflowed} lost before"
    )
}

fn refusal(error: &ObservationError, header: &ObservationHeader) -> Refusal {
    match error {
        ObservationError::Code { voxel: [i, j, k], code } => {
            let [_, ny, nz] = header.dims.map(|side| side as usize);
            Refusal::BadVoxel { index: (i * ny + j) * nz + k, value: *code }
        }
        ObservationError::Length { found, .. } => Refusal::WrongLength { dims: header.dims, payload_len: *found },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_daemon_that_fails_says_so_until_it_answers_again() {
        assert_eq!([true, false].map(|is_reloading| state_after(true, is_reloading)), [DaemonState::Failing; 2]);
        assert_eq!(state_after(false, true), DaemonState::Reloading);
        assert_eq!(state_after(false, false), DaemonState::Serving);
    }
}
