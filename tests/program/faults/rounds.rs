//! 200 random kills, and what is left of them.

use super::crowd::{Crowd, Fault, resources};
use super::leftovers;
use crate::harness::{PATIENCE, instance, serve};
use rand::{RngExt, SeedableRng};
use std::time::{Duration, Instant};

const SEED: u64 = 6;

#[test]
fn two_hundred_random_kills_leave_nothing_and_cost_the_survivors_nothing() {
    use Fault::*;
    let start = Instant::now();
    let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(SEED);
    let mut crowd = Crowd::gather(&instance(), 5);
    let mut round = |crowd: &mut Crowd, possible: &[Fault]| {
        crowd.fault(&mut random, possible);
        crowd.pass(Duration::from_millis(random.random_range(0..80)));
    };
    for _ in 0..80 {
        round(&mut crowd, &[KillDaemon, KillProducer, KillReader, KillStarting, FreezeProducer, FreezeReader]);
    }
    // Now the daemon survives too: what do 120 deaths cost it?
    let clients = [KillProducer, KillReader, KillStarting, FreezeProducer, FreezeReader];
    for _ in 0..20 {
        round(&mut crowd, &clients);
    }
    crowd.settle();
    let before = crowd.survivors().map(resources);
    for _ in 0..100 {
        round(&mut crowd, &clients);
    }
    let ports = |of: [(u64, usize, usize); 3]| of.map(|(_, descriptors, segments)| (descriptors, segments));
    let waiting = Instant::now();
    let after = loop {
        crowd.settle();
        let after = crowd.survivors().map(resources);
        if ports(after) == ports(before) {
            break after;
        }
        assert!(waiting.elapsed() < PATIENCE, "descriptors and segments: {before:?}, {after:?}");
    };
    println!("daemon, producer, reader (resident kB, descriptors, segments): {before:?}; 100 faults of others later: {after:?}");
    println!("faults: {:?}; resumed after restart: {:?}", crowd.faults, crowd.resumed);
    for (before, after) in before.iter().zip(&after) {
        assert!(after.0 < before.0 + 2048, "resident kB: {before:?}, {after:?}");
    }
    assert_eq!(crowd.faults.values().sum::<u64>(), 200);
    let pids = crowd.pids.clone();
    assert!(leftovers::of(&pids).len() > 10, "the living are found by their names");

    let account = crowd.disperse();
    println!("{account:?}, lost {}", account.lost());
    assert!(account.answered > 1000 && account.refused == 0 && account.lost() >= 0);
    let waiting = Instant::now();
    let left = loop {
        let left = leftovers::of(&pids);
        let (small, ours): (Vec<_>, Vec<_>) = left.into_iter().partition(|path| leftovers::is_small(path));
        if ours.is_empty() {
            break small;
        }
        assert!(waiting.elapsed() < PATIENCE, "left behind: {ours:?}");
        std::thread::sleep(Duration::from_millis(100));
    };
    println!("left by iceoryx2 of {} processes: {} small files {left:?}; all in {:?}", pids.len(), left.len(), start.elapsed());
    // The next daemon, of whatever instance, removes these too.
    let mut next = serve(&instance());
    let waiting = Instant::now();
    while !leftovers::of(&pids).is_empty() {
        assert!(waiting.elapsed() < PATIENCE, "left behind: {:?}", leftovers::of(&pids));
        std::thread::sleep(Duration::from_millis(100));
    }
    next.signal(rustix::process::Signal::INT);
    assert!(next.wait().success());
}
