//! The end away from the daemon: plays it for the clients of this machine, as long as its heartbeat comes.

use crate::arguments::Far;
use crate::clocks::{Clocks, Offset};
use crate::keys::Keys;
use crate::session::{LinkError, open, publisher, zenoh_error};
use crate::trouble::Troubles;
use crate::wire;
use beo_ipc::clock::monotonic_ns;
use beo_ipc::relay::{ReloadReply, Stamped, to_bytes};
use beo_ipc::{InstanceName, ObservationHeader, Percept, ReloadCall, Server, ServerOptions, Status};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use zenoh::bytes::ZBytes;
use zenoh::{Session, Wait as _};

/// How often the loop looks whether it is to end.
const LOOK: Duration = Duration::from_millis(50);
/// Between two looks after the dead.
const HOUSEKEEPING: Duration = Duration::from_secs(1);
/// A daemon whose heartbeat did not come for so long, or for four of its intervals where that is longer, is gone.
const SILENCE: Duration = Duration::from_secs(3);
/// Between two round trips for the clock; the first ones follow each other faster.
const TRIP: Duration = Duration::from_secs(1);
const FIRST_TRIPS: u32 = 8;
const FIRST_TRIP: Duration = Duration::from_millis(20);
/// A call for another model is answered in this time, or refused here.
const RELOAD: Duration = Duration::from_secs(60);

/// Runs until `stop`.
///
/// # Errors
/// [`LinkError`].
pub fn run(arguments: &Far, stop: &AtomicBool) -> Result<(), LinkError> {
    let keys = Keys::new(&arguments.instance);
    let played = arguments.played.clone().unwrap_or_else(|| arguments.instance.clone());
    let session = open(&arguments.endpoints)?;
    let shared = Arc::new(Shared::default());
    let subscribe = |key: &str, take: fn(&Shared, &ZBytes)| {
        let shared = shared.clone();
        let subscriber = session.declare_subscriber(key.to_owned()).callback(move |sample| take(&shared, sample.payload())).wait();
        subscriber.map_err(zenoh_error(format!("cannot subscribe to {key}")))
    };
    let _percepts = subscribe(&keys.percept, Shared::percept)?;
    let _completions = subscribe(&keys.completion, Shared::completion)?;
    let _statuses = subscribe(&keys.status, Shared::status)?;
    let observations = publisher(&session, &keys.observation, false)?;
    eprintln!("beo-link: far end of `{}`, played as `{played}`", arguments.instance);
    std::thread::scope(|scope| {
        scope.spawn(|| keep_time(&session, &keys.clock, &shared, stop));
        let outcome = play(&played, &shared, &observations, &mut Calls::new(&session, &keys.control), stop);
        stop.store(true, Ordering::Relaxed);
        outcome
    })?;
    session.close().wait().map_err(zenoh_error("cannot close the link"))
}

/// Asks for the other clock again and again.
fn keep_time(session: &Session, key: &str, shared: &Shared, stop: &AtomicBool) {
    let (mut trips, mut due) = (0, Instant::now());
    while !stop.load(Ordering::Relaxed) {
        if let Some(rest) = due.checked_duration_since(Instant::now()).filter(|rest| !rest.is_zero()) {
            std::thread::sleep(rest.min(LOOK));
            continue;
        }
        let begun_ns = monotonic_ns();
        let reply = session.get(key).timeout(TRIP).wait().ok().and_then(|replies| replies.recv().ok());
        let ended_ns = monotonic_ns();
        let there = reply.and_then(|reply| reply.into_result().ok());
        if let Some(there) = there.and_then(|sample| wire::clock(&sample.payload().to_bytes()).ok()) {
            lock(&shared.clocks).trip(begun_ns, there, ended_ns);
            trips += 1;
        }
        due = Instant::now() + if trips < FIRST_TRIPS { FIRST_TRIP } else { TRIP };
    }
}

/// Plays the daemon, as long as there is one.
fn play(
    instance: &InstanceName,
    shared: &Shared,
    observations: &zenoh::pubsub::Publisher<'_>,
    calls: &mut Calls<'_>,
    stop: &AtomicBool,
) -> Result<(), LinkError> {
    let (mut housekeeping, mut dims) = (Instant::now(), [0; 3]);
    while !stop.load(Ordering::Relaxed) {
        let heard = shared.heard();
        let Some((status, offset)) = heard else {
            if lock(&shared.server).take().is_some() {
                calls.abandon("nothing is heard of the daemon on the other machine");
                eprintln!("beo-link: nothing is heard of the daemon: `{instance}` is played no longer");
            }
            std::thread::sleep(LOOK);
            continue;
        };
        let server = lock(&shared.server).clone().filter(|_| dims == status.dims);
        let Some(server) = server else {
            // What another model needs has other sizes.
            lock(&shared.server).take();
            match Server::open(instance, &ServerOptions::new(status.dims)) {
                Ok(server) => {
                    dims = status.dims;
                    shared.serve(server, &status);
                    eprintln!(
                        "beo-link: `{instance}` is played; the other clock is {:+.6} s ahead, to within {:.0} µs",
                        offset.ahead_ns as f64 / 1e9,
                        offset.error_ns as f64 / 1e3
                    );
                }
                Err(error) => {
                    shared.troubles.say("daemon", &error);
                    std::thread::sleep(HOUSEKEEPING);
                }
            }
            continue;
        };
        server.wait(LOOK)?;
        while let Some(observation) = server.receive()? {
            let voxels = match observation.voxels() {
                Ok(voxels) => voxels,
                Err(refusal) => {
                    // As the daemon would answer.
                    if let Err(error) = server.forward(&refused(&Percept::refusing(observation.header(), &refusal), &status)) {
                        shared.troubles.say("percept", &error);
                    }
                    continue;
                }
            };
            let mut header = *observation.header();
            header.move_stamps(offset.ahead_ns);
            let bytes = [to_bytes(&header), voxels].concat();
            observations.put(bytes).wait().map_err(zenoh_error("cannot send an observation"))?;
        }
        calls.pass_on(&server)?;
        if Instant::now() >= housekeeping {
            housekeeping = Instant::now() + HOUSEKEEPING;
            server.maintain();
        }
    }
    calls.abandon("the link is stopping");
    lock(&shared.server).take();
    Ok(())
}

/// Control calls of this machine's clients, answered by the daemon on the other. One at a time: others wait.
struct Calls<'a> {
    session: &'a Session,
    key: &'a str,
    /// The call under way, and where its answer comes from.
    asked: Option<(ReloadCall, Receiver<ReloadReply>)>,
}

impl<'a> Calls<'a> {
    fn new(session: &'a Session, key: &'a str) -> Self {
        Self { session, key, asked: None }
    }

    /// Asks the daemon about the next call, and answers the one that it has answered.
    fn pass_on(&mut self, server: &Server) -> Result<(), LinkError> {
        if let Some((call, reply)) = self.asked.take() {
            match reply.try_recv() {
                Ok(reply) => call.forward(&reply),
                Err(TryRecvError::Empty) => self.asked = Some((call, reply)),
                Err(TryRecvError::Disconnected) => call.answer(0, Some(UNANSWERED)),
            }
        } else if let Some(call) = server.receive_reload()? {
            let (answer, reply) = channel();
            let request = to_bytes(call.request()).to_vec();
            let (session, key) = (self.session.clone(), self.key.to_owned());
            std::thread::spawn(move || answer.send(ask(&session, &key, request)).ok());
            self.asked = Some((call, reply));
        }
        Ok(())
    }

    /// Answers the call under way in the daemon's place.
    fn abandon(&mut self, why: &str) {
        if let Some((call, _)) = self.asked.take() {
            call.answer(0, Some(why));
        }
    }
}

/// Where the other end gives no answer.
const UNANSWERED: &str = "the other end of the link gave no answer; the model may still be loading there";

/// Asks the other end with a reload request; its reply, or this end's own refusal.
fn ask(session: &Session, key: &str, request: Vec<u8>) -> ReloadReply {
    let reply = session.get(key).payload(request).timeout(RELOAD).wait().ok().and_then(|replies| replies.recv().ok());
    let reply = reply.and_then(|reply| reply.into_result().ok());
    match reply.map(|sample| wire::reload_reply(&sample.payload().to_bytes())) {
        Some(Ok(reply)) => reply,
        Some(Err(error)) => ReloadReply::new(0, Some(&error.to_string())),
        None => ReloadReply::new(0, Some(UNANSWERED)),
    }
}

/// A refusal of this end's own, in the daemon's name; it takes none of the daemon's numbers.
fn refused(percept: &Percept, status: &Status) -> Percept {
    Percept { daemon_id: status.daemon_id, model_id: status.model_id, published_ns: monotonic_ns(), ..*percept }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    // A thread that panicked while it held it left whole values.
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The state that the threads share.
#[derive(Default)]
struct Shared {
    server: Mutex<Option<Arc<Server>>>,
    clocks: Mutex<Clocks>,
    /// The last status, and when it came.
    last: Mutex<Option<(Status, Instant)>>,
    troubles: Troubles,
}

impl Shared {
    fn offset(&self) -> Option<Offset> {
        lock(&self.clocks).at(monotonic_ns())
    }

    /// The daemon's status, as it stands in the message, and what lies between the clocks, as long as it is heard of.
    fn heard(&self) -> Option<(Status, Offset)> {
        let (status, at) = (*lock(&self.last))?;
        let patience = SILENCE.max(Duration::from_nanos(status.heartbeat_interval_ns.saturating_mul(4)));
        (at.elapsed() < patience).then_some((status, self.offset()?))
    }

    fn serve(&self, server: Server, status: &Status) {
        let server = Arc::new(server);
        self.pass_status(&server, status);
        *lock(&self.server) = Some(server);
    }

    fn pass_status(&self, server: &Server, status: &Status) {
        let Some(offset) = self.offset() else { return };
        let mut here = *status;
        here.move_stamps(-offset.ahead_ns);
        if let Err(error) = server.forward_status(&here) {
            self.troubles.say("status", &error);
        }
    }

    /// The server that this end runs for the other machine's daemon, and the offset, nanoseconds, to add to that machine's stamps.
    fn playing(&self) -> Option<(Arc<Server>, i64)> {
        let offset = self.offset()?;
        Some((lock(&self.server).clone()?, -offset.ahead_ns))
    }

    fn percept(&self, payload: &ZBytes) {
        let mut percept = match wire::percept(&payload.to_bytes()) {
            Ok(percept) => percept,
            Err(error) => return self.troubles.say("percept", &error),
        };
        let Some((server, offset_ns)) = self.playing() else { return };
        percept.move_stamps(offset_ns);
        if let Err(error) = server.forward(&percept) {
            self.troubles.say("percept", &error);
        }
    }

    fn completion(&self, payload: &ZBytes) {
        let bytes = payload.to_bytes();
        let (mut header, occupancy, deviation) = match wire::completion(&bytes) {
            Ok(completion) => completion,
            Err(error) => return self.troubles.say("completion", &error),
        };
        let Some((server, offset_ns)) = self.playing() else { return };
        header.move_stamps(offset_ns);
        match server.loan_completion(&ObservationHeader::new(header.dims)) {
            Ok(mut loan) => {
                *loan.header_mut() = header;
                let (first, second) = loan.occupancy_and_deviation_mut();
                first.copy_from_slice(occupancy);
                second.copy_from_slice(deviation);
                if let Err(error) = loan.forward() {
                    self.troubles.say("completion", &error);
                }
            }
            Err(error) => self.troubles.say("completion", &error),
        }
    }

    fn status(&self, payload: &ZBytes) {
        let status = match wire::status(&payload.to_bytes()) {
            Ok(status) => status,
            Err(error) => return self.troubles.say("status", &error),
        };
        *lock(&self.last) = Some((status, Instant::now()));
        if let Some(server) = lock(&self.server).clone() {
            self.pass_status(&server, &status);
        }
    }
}
