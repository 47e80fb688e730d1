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

/// Percepts that are read under overload.
const PERCEPTS: usize = 60;
/// The most that memory may grow by while it is flooded, kB.
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

    // Nobody is starved, and the flood has no more than its share: while an observation waits, each other stream is answered once at most.
    // That holds however long the machine lets a producer sleep.
    let answers = ids.map(|id| percepts.iter().filter(|percept| percept.producer_id == id).count());
    println!(
        "answered of two floods and one that sends at its ease: {answers:?}; {sent} sent in all, {} dropped, {} lost before",
        status.dropped, status.overflowed
    );
    assert!(answers.iter().all(|answers| *answers > 0), "{answers:?}");
    for waited in &percepts {
        for other in ids.into_iter().filter(|id| *id != waited.producer_id) {
            let meanwhile = waited.received_ns + 1..waited.published_ns;
            let before = percepts.iter().filter(|p| p.producer_id == other && meanwhile.contains(&p.published_ns)).count();
            assert!(before <= 1, "{before} of {other} were answered while one of {} waited", waited.producer_id);
        }
    }

    let (first, last) = (resident[resident.len() / 4], resident[resident.len() - 1]);
    println!("resident: {first} kB, later {last} kB");
    assert!(last < first + ALLOWANCE_KB, "{resident:?}");
}

/// Ends a flood, also when the test fails: its thread is waited for.
struct EndsFlood<'a>(&'a AtomicBool);

impl Drop for EndsFlood<'_> {
    fn drop(&mut self) {
        self.0.store(false, Ordering::Relaxed);
    }
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
        let _ends = EndsFlood(&flooding);
        scope.spawn(|| {
            while flooding.load(Ordering::Relaxed) {
                flood.send(|header, voxels| {
                    // A search takes far longer than a grid takes to be sent, on any machine.
                    (header.object_id, header.pose_search) = (header.capture_ns, PoseSearch::Full.code());
                    block(voxels);
                });
            }
        });
        let crowded = honest.status(|status| status.waiting() > 200);
        (0..20).for_each(|_| assert_eq!(honest.ask(|_, voxels| block(voxels)).status, 0));
        honest.status(|status| status.dropped > crowded.dropped);
    });
}
