//! The end beside the daemon: a subscriber, and a producer for each producer of the other end.

use crate::arguments::Near;
use crate::keys::Keys;
use crate::session::{LinkError, open, publisher, zenoh_error};
use crate::trouble::Troubles;
use crate::wire;
use beo_ipc::clock::monotonic_ns;
use beo_ipc::relay::{ReloadReply, forward_reload, to_bytes};
use beo_ipc::{InstanceName, OpenError, Producer, ReconnectError, ReconnectingSubscriber, SubscriberOptions, Waited};
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{TrySendError, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};
use zenoh::Wait as _;
use zenoh::query::Query;

/// How often the loop looks whether it is to end.
const LOOK: Duration = Duration::from_millis(50);
/// Between two looks at the status.
const STATUS: Duration = Duration::from_millis(100);
/// Between two looks after the dead.
const HOUSEKEEPING: Duration = Duration::from_secs(1);
/// A producer that was silent for so long has its place taken by another.
const IDLE: Duration = Duration::from_secs(10);
/// A call for another model is answered in this time, or never.
const RELOAD: Duration = Duration::from_secs(60);
/// Calls that wait while one is answered.
const MOST_CALLS: usize = 4;
/// Producers of the other end at a time; the daemon has places for its own as well.
const MOST_PRODUCERS: usize = 8;

/// Runs until `stop`.
///
/// # Errors
/// [`LinkError`].
pub fn run(arguments: &Near, stop: &AtomicBool) -> Result<(), LinkError> {
    let (keys, troubles) = (Keys::new(&arguments.instance), Arc::new(Troubles::default()));
    let session = open(&arguments.endpoints)?;
    let percepts = publisher(&session, &keys.percept, arguments.drop_percepts)?;
    let completions = publisher(&session, &keys.completion, arguments.drop_completions)?;
    let statuses = publisher(&session, &keys.status, false)?;
    let inlet = Arc::new(Mutex::new(Inlet::new(arguments.instance.clone())));
    let (feeding, complaining) = (inlet.clone(), troubles.clone());
    let _observations = session
        .declare_subscriber(&keys.observation)
        .callback(move |sample| {
            let taken = feeding.lock().unwrap_or_else(PoisonError::into_inner).feed(&sample.payload().to_bytes());
            if let Err(error) = taken {
                complaining.say("observation", &error);
            }
        })
        .wait()
        .map_err(zenoh_error("cannot subscribe to observations"))?;
    let answered = keys.clock.clone();
    let _clock = session
        .declare_queryable(&keys.clock)
        .callback(move |query| drop(query.reply(&answered, monotonic_ns().to_le_bytes()).wait()))
        .wait()
        .map_err(zenoh_error("cannot answer for the clock"))?;
    let (calls, waiting) = sync_channel(MOST_CALLS);
    let _control = session
        .declare_queryable(&keys.control)
        .callback(move |query| {
            if let Err(TrySendError::Full(query) | TrySendError::Disconnected(query)) = calls.try_send(query) {
                reply(&query, &refusal("other calls for a model wait already"));
            }
        })
        .wait()
        .map_err(zenoh_error("cannot answer control calls"))?;
    let called = arguments.instance.clone();
    // It ends with the session, or with the process in the midst of a call.
    std::thread::spawn(move || waiting.iter().for_each(|query| answer_call(&called, &query)));
    let last_status: Arc<Mutex<Option<Vec<u8>>>> = Arc::default();
    let (asked, answered) = (last_status.clone(), keys.status.clone());
    let _status = session
        .declare_queryable(&keys.status)
        .callback(move |query| {
            if let Some(status) = asked.lock().unwrap_or_else(PoisonError::into_inner).clone() {
                drop(query.reply(&answered, status).wait());
            }
        })
        .wait()
        .map_err(zenoh_error("cannot answer for the status"))?;
    eprintln!("beo-link: near end of `{}`", arguments.instance);

    let mut subscriber = None;
    let (mut status_due, mut housekeeping, mut heartbeat_ns) = (Instant::now(), Instant::now(), 0);
    let put = |publisher: &zenoh::pubsub::Publisher<'_>, bytes: Vec<u8>| {
        publisher.put(bytes).wait().map_err(zenoh_error(format!("cannot send {}", publisher.key_expr())))
    };
    while !stop.load(Ordering::Relaxed) {
        let reader = match joined(&mut subscriber, &arguments.instance) {
            Ok(reader) => reader,
            Err(error) => {
                troubles.say("daemon", &error);
                std::thread::sleep(LOOK);
                continue;
            }
        };
        let is_there = reader.wait(Some(LOOK.min(status_due.saturating_duration_since(Instant::now()))))? != Waited::NotRunning;
        while let Some(percept) = reader.take_percept()? {
            // Its completion is there already, and goes first.
            while let Some(completion) = reader.take_completion()? {
                put(&completions, [to_bytes(completion.header()), completion.occupancy(), completion.deviation()].concat())?;
            }
            put(&percepts, to_bytes(&percept).to_vec())?;
        }
        if Instant::now() >= status_due {
            status_due = Instant::now() + STATUS;
            let status = reader.status()?.filter(|_| is_there);
            *last_status.lock().unwrap_or_else(PoisonError::into_inner) = status.map(|status| to_bytes(&status).to_vec());
            if let Some(status) = status.filter(|status| status.heartbeat_ns != heartbeat_ns) {
                heartbeat_ns = status.heartbeat_ns;
                put(&statuses, to_bytes(&status).to_vec())?;
            }
        }
        if Instant::now() >= housekeeping {
            housekeeping = Instant::now() + HOUSEKEEPING;
            inlet.lock().unwrap_or_else(PoisonError::into_inner).maintain();
        }
    }
    session.close().wait().map_err(zenoh_error("cannot close the link"))
}

/// Passes a control call on to the daemon, and its reply back.
fn answer_call(instance: &InstanceName, query: &Query) {
    let bytes = query.payload().map(|payload| payload.to_bytes().into_owned()).unwrap_or_default();
    let outcome = match wire::reload_request(&bytes) {
        Ok(request) => forward_reload(instance, &request, RELOAD).map_err(|error| error.to_string()),
        Err(error) => Err(error.to_string()),
    };
    reply(query, &outcome.unwrap_or_else(|error| refusal(&error)));
}

/// A refusal of this end's own, which knows no model.
fn refusal(why: &str) -> ReloadReply {
    ReloadReply::new(0, Some(why))
}

fn reply(query: &Query, reply: &ReloadReply) {
    // Who asked and is gone is its own affair.
    drop(query.reply(query.key_expr(), to_bytes(reply)).wait());
}

/// The reader of the daemon, joined if it is not yet.
fn joined<'a>(
    subscriber: &'a mut Option<ReconnectingSubscriber>,
    instance: &InstanceName,
) -> Result<&'a mut ReconnectingSubscriber, ReconnectError> {
    match subscriber {
        Some(reader) => Ok(reader),
        none => {
            let reader = ReconnectingSubscriber::open(instance, &SubscriberOptions { completion: true })?;
            Ok(none.insert(reader))
        }
    }
}

/// Why an observation from afar is passed over.
#[derive(Debug, thiserror::Error)]
enum Passed {
    #[error(transparent)]
    Bad(#[from] wire::BadObservation),
    #[error("{MOST_PRODUCERS} producers of the other end are at work: another has no place before one is silent for {} s", IDLE.as_secs())]
    TooMany,
    #[error(transparent)]
    Open(#[from] OpenError),
    #[error(transparent)]
    Loan(#[from] beo_ipc::LoanError),
    #[error(transparent)]
    Send(#[from] beo_ipc::SendError),
}

/// Gives the daemon what comes from the other end.
struct Inlet {
    instance: InstanceName,
    /// By their producer's number and the size of its grids, with the time of the last observation.
    producers: BTreeMap<(u64, [u32; 3]), (Producer, Instant)>,
}

impl Inlet {
    fn new(instance: InstanceName) -> Self {
        Self { instance, producers: BTreeMap::new() }
    }

    /// An observation: header, then voxels. What a daemon would refuse by its header is passed over, so that nothing is laid out by it.
    fn feed(&mut self, bytes: &[u8]) -> Result<(), Passed> {
        let (header, voxels) = wire::observation(bytes)?;
        let key = (header.producer_id, header.dims);
        // One whose daemon is gone stands in the way of the next daemon.
        if self.producers.get(&key).is_some_and(|(producer, _)| !producer.daemon_runs()) {
            self.producers.remove(&key);
        }
        if !self.producers.contains_key(&key) {
            self.make_room()?;
            let producer = Producer::open(&self.instance, &header)?;
            self.producers.insert(key, (producer, Instant::now()));
        }
        let Some((producer, last)) = self.producers.get_mut(&key) else { return Ok(()) };
        let mut loan = producer.loan()?;
        *loan.header_mut() = header;
        loan.voxels_mut().copy_from_slice(voxels);
        loan.forward()?;
        *last = Instant::now();
        Ok(())
    }

    fn make_room(&mut self) -> Result<(), Passed> {
        if self.producers.len() < MOST_PRODUCERS {
            return Ok(());
        }
        let longest = self.producers.iter().min_by_key(|(_, (_, last))| *last).filter(|(_, (_, last))| last.elapsed() > IDLE);
        let key = *longest.ok_or(Passed::TooMany)?.0;
        self.producers.remove(&key);
        Ok(())
    }

    fn maintain(&mut self) {
        self.producers.retain(|_, (producer, _)| {
            producer.maintain();
            producer.daemon_runs()
        });
    }
}
