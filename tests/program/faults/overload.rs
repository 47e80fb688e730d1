//! Far more observations than can be answered: two producers flood, a third sends at its ease, and one subscriber is frozen throughout.

use super::crowd::resources;
use super::roles::{Actor, Role};
use super::witness::Witness;
use crate::client::{Client, block};
use crate::harness::{PATIENCE, instance, serve};
use beo_ipc::{InstanceName, Percept, PoseSearch};
use rustix::process::Signal;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Streams that wait at the same time.
const STREAMS: u64 = 3;
/// Percepts that are read under overload.
const PERCEPTS: usize = 60;
/// What memory may grow by while it is flooded, kB.
const ALLOWANCE_KB: u64 = 2048;

#[test]
fn under_overload_the_newest_is_answered_all_streams_are_served_alike_and_what_is_dropped_is_counted() {
    let name = instance();
    let daemon = serve(&name);
    let mut witness = Witness::open(&InstanceName::new(&name).unwrap());
    let mut frozen = Actor::start(Role::Reader, &name);
    frozen.process.signal(Signal::STOP);
    let mut producers = [0, 0, 20].map(|every_ms| Actor::start(Role::Producer { every_ms, search: PoseSearch::Full }, &name));
    let ids = producers.each_ref().map(|producer| producer.id);

    // Once all are at it.
    ids.iter().for_each(|id| witness.hears(*id, 3));
    let mut percepts: Vec<Percept> = Vec::new();
    let mut resident = Vec::new();
    while percepts.len() < PERCEPTS {
        percepts.extend(witness.look(Duration::from_millis(20)));
        resident.push(resources(daemon.id()).0);
    }
    frozen.process.signal(Signal::CONT);
    frozen.end();
    let sent: u64 = producers
        .iter_mut()
        .map(|producer| {
            producer.end();
            producer.heard("sent").last().unwrap().parse::<u64>().unwrap()
        })
        .sum();

    // Everything is accounted for, to the last one.
    let start = Instant::now();
    let status = loop {
        drop(witness.look(Duration::from_millis(100)));
        match witness.statuses.values().next() {
            Some(status) if status.received + status.overflowed == sent && status.waiting() == 0 => break *status,
            status => assert!(start.elapsed() < PATIENCE, "sent {sent}, {status:?}"),
        }
    };
    assert_eq!(status.refused, 0);
    assert!(status.overflowed > 0, "no queue was full");
    assert!(sent > 10 * status.answered, "no overload: {sent} sent, {} answered", status.answered);

    // Nobody is starved, and the flood has no more than its share.
    let answers = ids.map(|id| percepts.iter().filter(|percept| percept.producer_id == id).count());
    let spans = ids.map(|id| {
        let mut numbers = percepts.iter().filter(|percept| percept.producer_id == id).map(|percept| percept.sequence);
        let first = numbers.next().unwrap();
        numbers.next_back().unwrap() - first + 1
    });
    println!(
        "answered of two floods and one that sends at its ease: {answers:?} of {spans:?}; {sent} sent in all, {} dropped, {} lost before",
        status.dropped, status.overflowed
    );
    assert!(answers[0].abs_diff(answers[1]) <= 2 + answers[0] / 10, "{answers:?}");
    let due = answers[0].min(spans[2] as usize);
    assert!(answers[2] + 2 + due / 10 >= due, "{answers:?} of {spans:?}");

    // Whoever waits, waits for the query in work and for one of each other stream, not for a queue of its own.
    let longest_query = percepts.windows(2).map(|pair| pair[1].published_ns - pair[0].published_ns).max().unwrap();
    let longest_wait = percepts.iter().map(|percept| percept.published_ns - percept.received_ns).max().unwrap();
    println!("longest time between percepts {} us, longest from taking to answering {} us", longest_query / 1000, longest_wait / 1000);
    assert!(longest_wait <= (STREAMS + 1) * longest_query);

    let (first, last) = (resident[resident.len() / 4], resident[resident.len() - 1]);
    println!("resident: {first} kB, later {last} kB");
    assert!(last < first + ALLOWANCE_KB, "{resident:?}");
}

/// More streams than can wait at a time, each with one observation: a producer that names every grid a new object.
#[test]
fn a_flood_of_objects_starves_no_other_producer() {
    let name = instance();
    let _daemon = serve(&name);
    let [flood, honest] = [(); 2].map(|()| Client::new(&name));
    flood.ask(|_, voxels| block(voxels));
    let flooding = AtomicBool::new(true);
    std::thread::scope(|scope| {
        scope.spawn(|| {
            while flooding.load(Ordering::Relaxed) {
                flood.send(|header, voxels| {
                    header.object_id = header.capture_ns;
                    block(voxels);
                });
            }
        });
        let crowded = honest.status(|status| status.waiting() > 200);
        (0..20).for_each(|_| assert_eq!(honest.ask(|_, voxels| block(voxels)).status, 0));
        honest.status(|status| status.dropped > crowded.dropped);
        flooding.store(false, Ordering::Relaxed);
    });
}
