//! Hours of random faults, on request: `tests/soak --minutes M`.

use super::crowd::{Crowd, Fault, resources};
use super::leftovers;
use crate::harness::{Running, instance};
use rand::{RngExt, SeedableRng};
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// Time between two faults.
const CALM: Duration = Duration::from_millis(1500);
/// Time between two observations of one producer, milliseconds.
const EVERY_MS: u64 = 10;
/// A client takes a daemon for dead that misses so many heartbeats of a quarter of a second.
const SILENCE_MS: u64 = 4 * 250;

/// The longest time in which the machine did not let this process do anything, milliseconds: nobody can send or read heartbeats then.
static LONGEST_STOP_MS: AtomicU64 = AtomicU64::new(0);

/// Follows it for as long as the process lives.
fn follow_stops() {
    std::thread::spawn(|| {
        let mut last = Instant::now();
        loop {
            std::thread::sleep(Duration::from_millis(10));
            LONGEST_STOP_MS.fetch_max(last.elapsed().as_millis() as u64, Ordering::Relaxed);
            last = Instant::now();
        }
    });
}

/// Random faults for as long as BEO_SOAK_MINUTES says. The daemon is killed in the first quarter only: its memory is followed from then on.
#[test]
#[ignore = "takes as long as one likes: tests/soak"]
fn soak() {
    use Fault::*;
    let minutes: f64 = std::env::var("BEO_SOAK_MINUTES").ok().and_then(|text| text.parse().ok()).unwrap_or(1.0);
    let seed = std::env::var("BEO_SOAK_SEED").ok().and_then(|text| text.parse().ok()).unwrap_or(6);
    let length = Duration::from_secs_f64(60.0 * minutes);
    let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
    let name = instance();
    follow_stops();
    crate::harness::watchdog::takes_long();
    let mut crowd = Crowd::gather(&name, EVERY_MS);
    let mut listener = std::env::var_os("BEO_SOAK_LISTENER").map(|path| {
        let mut command = Command::new(path);
        command.arg(&name).stdin(Stdio::null());
        let listener = Running::start(command);
        listener.line();
        listener
    });
    println!("soak of {minutes} minutes, seed {seed}, instance {name}, C client: {}", listener.is_some());
    println!("{:>7} {:>30} {:>30} {:>30}", "seconds", "daemon: kB, files, segments", "producer", "reader");
    let (start, mut told) = (Instant::now(), None::<Instant>);
    let mut resident: Vec<[u64; 3]> = Vec::new();
    let mut is_warm = false;
    while start.elapsed() < length {
        let early = start.elapsed() < length / 4;
        // What a daemon takes once, to reload and when it is flooded, belongs to what its memory is compared with.
        if !early && !std::mem::replace(&mut is_warm, true) {
            [RewriteModel, Flood, CutMemory].into_iter().cycle().take(12).for_each(|fault| crowd.fault(&mut random, &[fault]));
        }
        let possible = [KillProducer, KillReader, KillStarting, FreezeProducer, FreezeReader, RewriteModel, Flood, CutMemory, KillDaemon];
        crowd.fault(&mut random, if early { &possible } else { &possible[..8] });
        crowd.pass(CALM.mul_f64(random.random_range(0.2..1.8)));
        // Nobody else reads what it says.
        if let Some(listener) = &listener {
            let lines = listener.stdout.as_ref().unwrap().try_iter().count();
            assert!(lines > 0 || early, "the C client reads nothing any more");
        }
        if told.is_none_or(|told| told.elapsed() > length.div_f64(40.0)) {
            told = Some(Instant::now());
            let figures = crowd.survivors().map(resources);
            let [daemon, producer, reader] = figures.map(|figures| format!("{figures:?}"));
            println!("{:>7.0} {daemon:>30} {producer:>30} {reader:>30}", start.elapsed().as_secs_f64());
            if !early {
                resident.push(figures.map(|(resident, ..)| resident));
            }
        }
    }
    let (faults, resumed) = (crowd.faults.clone(), crowd.resumed.clone());
    let pids = crowd.pids.clone();
    if let Some(listener) = &mut listener {
        // Not SIGINT, which whoever runs in the background of a script ignores unless told otherwise.
        listener.signal(rustix::process::Signal::TERM);
        listener.wait();
    }
    let account = crowd.disperse();
    std::thread::sleep(Duration::from_secs(2));
    let (small, ours): (Vec<_>, Vec<_>) = leftovers::of(&pids).into_iter().partition(|path| leftovers::is_small(path));

    println!("faults: {faults:?}");
    println!("percepts of the next daemon after it said that it serves: longest {:?} of {}", resumed.iter().max(), resumed.len());
    let stopped_ms = LONGEST_STOP_MS.load(Ordering::Relaxed);
    println!(
        "longest time between two heartbeats: {} ms; longest time in which this test itself was stopped: {stopped_ms} ms",
        account.silence_ms
    );
    println!("{account:?}, lost {}", account.lost());
    println!("left by {} processes: {} of ours, {} small files of iceoryx2", pids.len(), ours.len(), small.len());
    let growth = |which: usize| {
        let part = resident.len().div_ceil(5);
        let mean = |samples: &[[u64; 3]]| samples.iter().map(|sample| sample[which]).sum::<u64>() as f64 / samples.len() as f64;
        100.0 * (mean(&resident[resident.len() - part..]) / mean(&resident[..part]) - 1.0)
    };
    let grown = [0, 1, 2].map(growth);
    println!("resident memory, last fifth of the samples after the first quarter against the first fifth, percent: {grown:+.2?}");
    assert!(ours.is_empty(), "{ours:?}");
    assert!(grown.iter().all(|percent| percent.abs() < 2.0), "memory is not flat");
    assert!(account.silence_ms < SILENCE_MS + stopped_ms, "heartbeats were missed");
    assert!(account.refused == 0 || faults.contains_key(&CutMemory), "refused {}", account.refused);
    // Of each producer a ring and what it was just sending, when it or the daemon dies; and, until the daemon's death is noticed, what it
    // goes on sending.
    let deaths = account.producers as i64 + 3 * account.daemons as i64;
    let unnoticed = account.daemons as i64 * 3 * 5000 / EVERY_MS as i64;
    // A refusal that the witness missed is counted twice.
    let twice = account.refused.min(account.missed) as i64;
    assert!((-twice..=17 * deaths + unnoticed).contains(&account.lost()), "lost {}", account.lost());
}
