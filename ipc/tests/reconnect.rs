//! Clients that outlive the daemon, over real shared memory. The daemon's ends live in the same process here; that a killed daemon is
//! survived is tested with whole programs.

use std::time::{Duration, Instant};

use beo_ipc::{
    InstanceName, ObservationHeader, OpenError, Percept, ReconnectError, ReconnectingProducer, ReconnectingSubscriber, Server,
    ServerOptions, Status, Subscriber, SubscriberOptions, Waited,
};
use rustix::event::{PollFd, PollFlags, Timespec, poll};

const PATIENCE: Duration = Duration::from_secs(60);
const SOON: Option<Duration> = Some(Duration::from_millis(20));

fn instance(test: &str) -> InstanceName {
    InstanceName::new(&format!("reconnect-{test}-{}", std::process::id())).unwrap()
}

fn serve(instance: &InstanceName, side: u32) -> Server {
    let server = Server::open(instance, &ServerOptions::new([side; 3])).unwrap();
    server.publish_status(&Status { heartbeat_interval_ns: 1_000_000_000, model_id: side.into(), ..Status::EMPTY }).unwrap();
    server
}

/// Repeats `step` until it gives something.
fn until<T>(what: &str, mut step: impl FnMut() -> Option<T>) -> T {
    let start = Instant::now();
    loop {
        if let Some(result) = step() {
            return result;
        }
        assert!(start.elapsed() < PATIENCE, "{what}");
    }
}

fn percept(subscriber: &mut ReconnectingSubscriber, server: &Server, sequence: u64) -> Percept {
    server.publish(&Percept { sequence, ..Percept::EMPTY }).unwrap();
    until("no percept", || {
        subscriber.wait(SOON).unwrap();
        std::iter::from_fn(|| subscriber.take_percept().unwrap()).find(|percept| percept.sequence == sequence)
    })
}

#[test]
fn a_wait_of_no_time_returns() {
    let instance = instance("zero");
    let _server = serve(&instance, 16);
    let subscriber = Subscriber::open(&instance, &SubscriberOptions::default()).unwrap();
    assert!(!subscriber.wait(Duration::ZERO).unwrap());
    assert!(!subscriber.wait(Duration::from_nanos(1)).unwrap());
}

#[test]
fn before_the_daemon_runs_there_is_nothing_to_open() {
    let instance = instance("early");
    assert!(ReconnectingSubscriber::open(&instance, &SubscriberOptions::default()).is_err_and(|error| error.is_retryable()));
    assert!(ReconnectingProducer::open(&instance, &ObservationHeader::new([16; 3])).is_err_and(|error| error.is_retryable()));
}

#[test]
fn a_subscriber_lets_a_daemon_with_other_dims_start_and_follows_it() {
    let instance = instance("subscriber");
    let first = serve(&instance, 16);
    let mut subscriber = ReconnectingSubscriber::open(&instance, &SubscriberOptions { completion: true }).unwrap();
    let before = percept(&mut subscriber, &first, 1);
    until("no status", || {
        first.maintain();
        subscriber.status().unwrap().filter(|status| status.model_id == 16)
    });
    drop(first);
    until("it does not notice", || (subscriber.wait(SOON).unwrap() == Waited::NotRunning).then_some(()));
    assert!(!subscriber.is_connected());
    assert_eq!(subscriber.take_percept().unwrap(), None);
    assert!(subscriber.take_completion().unwrap().is_none());
    assert_eq!(subscriber.status().unwrap().unwrap().model_id, 16, "the last status stays");

    // Of 80 voxels a side, fewer completions are kept: other limits.
    let second = serve(&instance, 80);
    until("it does not come back", || (subscriber.wait(SOON).unwrap() == Waited::TimedOut).then_some(()));
    let after = percept(&mut subscriber, &second, 2);
    assert_ne!(before.daemon_id, after.daemon_id);
    until("no status", || {
        second.maintain();
        (subscriber.status().unwrap().unwrap().model_id == 80).then_some(())
    });
}

#[test]
fn one_descriptor_announces_percepts_of_daemon_after_daemon() {
    let instance = instance("descriptor");
    let mut server = serve(&instance, 16);
    let mut subscriber = ReconnectingSubscriber::open(&instance, &SubscriberOptions::default()).unwrap();
    let descriptor = subscriber.file_descriptor().unwrap().try_clone_to_owned().unwrap();
    for run in 1..=2 {
        until("not connected", || {
            subscriber.wait(Some(Duration::ZERO)).unwrap();
            subscriber.is_connected().then_some(())
        });
        server.publish(&Percept { sequence: run, ..Percept::EMPTY }).unwrap();
        until("the descriptor is silent", || {
            let timeout = Timespec { tv_sec: 60, tv_nsec: 0 };
            assert_eq!(poll(&mut [PollFd::new(&descriptor, PollFlags::IN)], Some(&timeout)).unwrap(), 1);
            // It may also have been the timer.
            (subscriber.wait(Some(Duration::ZERO)).unwrap() == Waited::Sent).then_some(())
        });
        assert_eq!(subscriber.take_percept().unwrap().unwrap().sequence, run);
        // Nothing is left to announce but the next look: the descriptor is quiet until the timer fires.
        until("the descriptor is never quiet", || {
            subscriber.wait(Some(Duration::ZERO)).unwrap();
            (poll(&mut [PollFd::new(&descriptor, PollFlags::IN)], Some(&Timespec::default())).unwrap() == 0).then_some(())
        });
        drop(server);
        until("it does not notice", || (subscriber.wait(SOON).unwrap() == Waited::NotRunning).then_some(()));
        server = serve(&instance, 16);
    }
}

#[test]
fn a_producer_goes_on_counting_under_its_id_at_the_next_daemon() {
    let instance = instance("producer");
    let first = serve(&instance, 16);
    let mut producer = ReconnectingProducer::open(&instance, &ObservationHeader::new([16; 3])).unwrap();
    for sequence in 1..=2 {
        assert_eq!(producer.loan().unwrap().send().unwrap().sequence, sequence);
    }
    drop(first);
    let error = producer.loan().unwrap_err();
    assert!(matches!(error, ReconnectError::Open(OpenError::NotRunning { .. })), "{error}");
    let second = serve(&instance, 80);
    let sent = until("it does not come back", || producer.loan().ok()).send().unwrap();
    assert_eq!((sent.sequence, sent.readers), (3, 1));
    let observation = until("nothing arrives", || second.receive().unwrap());
    assert_eq!((observation.header().producer_id, observation.header().sequence), (producer.id(), 3));
}

/// A reader that does not keep up sees how many it has lost, over restarts of the daemon too.
#[test]
fn readers_count_what_they_miss() {
    let instance = instance("gaps");
    let first = serve(&instance, 16);
    let plain = Subscriber::open(&instance, &SubscriberOptions::default()).unwrap();
    let mut reconnecting = ReconnectingSubscriber::open(&instance, &SubscriberOptions::default()).unwrap();
    let publish = |server: &Server, count: u64| (0..count).for_each(|_| server.publish(&Percept::EMPTY).unwrap());
    let all = |take: &dyn Fn() -> Option<Percept>| std::iter::from_fn(take).count() as u64;
    publish(&first, 1);
    assert_eq!((all(&|| plain.take_percept().unwrap()), plain.missed()), (1, 0));
    assert_eq!((all(&|| reconnecting.take_percept().unwrap()), reconnecting.missed()), (1, 0));
    publish(&first, 100);
    let (kept, missed) = (all(&|| plain.take_percept().unwrap()), plain.missed());
    assert!(missed > 0 && kept + missed == 100, "{kept} kept, {missed} missed");
    let kept = all(&|| reconnecting.take_percept().unwrap());
    assert_eq!(reconnecting.missed(), 100 - kept);
    let before = reconnecting.missed();
    drop((plain, first));
    until("it does not notice", || (reconnecting.wait(SOON).unwrap() == Waited::NotRunning).then_some(()));
    // Seven come before it is there again, of which the last is kept for it.
    let second = serve(&instance, 80);
    publish(&second, 7);
    until("it does not come back", || {
        reconnecting.wait(SOON).unwrap();
        second.maintain();
        reconnecting.take_percept().unwrap()
    });
    assert_eq!(reconnecting.missed() - before, 6);
}
