//! SIGKILL and SIGSTOP of each kind of process at each kind of moment. The others go on, new ones can join, nothing is torn or stale.

use super::roles::{Actor, Role};
use super::witness::Witness;
use crate::harness::{PATIENCE, instance, serve};
use beo_ipc::{InstanceName, PoseSearch};
use rustix::process::Signal;
use std::time::{Duration, Instant};

const STEADY: Role = Role::Producer { every_ms: 5, search: PoseSearch::Known };
const FLOOD: Role = Role::Producer { every_ms: 0, search: PoseSearch::Full };

/// More kills of a kind than there are places for its like: places are given back.
const KILLS: usize = beo_ipc::limits::MAX_PRODUCERS + 2;

/// The counters of the daemon, at rest, add up.
fn counters_add_up(witness: &mut Witness) {
    let daemon = witness.daemon().unwrap();
    let start = Instant::now();
    loop {
        drop(witness.look(Duration::from_millis(100)));
        let status = witness.statuses.get(&daemon).copied();
        if status.is_some_and(|s| s.answered > 0 && s.waiting() == 0) {
            return;
        }
        assert!(start.elapsed() < PATIENCE, "{status:?}");
    }
}

#[test]
fn producers_killed_before_while_and_after_writing_take_nobody_with_them() {
    let name = instance();
    let _daemon = serve(&name);
    let mut witness = Witness::open(&InstanceName::new(&name).unwrap());
    let mut steady = Actor::start(STEADY, &name);
    for kill in 0..KILLS {
        let mut killed = match kill % 3 {
            0 => Actor::start(Role::Opener, &name),
            1 => {
                let holder = Actor::start(Role::Holder, &name);
                holder.hear("holding");
                holder
            }
            _ => {
                let sender = Actor::start(Role::Sender, &name);
                sender.hear("sent");
                sender
            }
        };
        killed.kill();
        witness.hears(steady.id, 5);
        // What was written and not sent is never answered.
        assert!(kill % 3 == 2 || witness.newest(killed.id) == 0);
    }
    let mut next = Actor::start(STEADY, &name);
    witness.hears(next.id, 5);
    next.end();
    steady.end();
    counters_add_up(&mut witness);
}

#[test]
fn subscribers_killed_idle_and_holding_samples_take_nobody_with_them() {
    let name = instance();
    let _daemon = serve(&name);
    let mut witness = Witness::open(&InstanceName::new(&name).unwrap());
    let mut steady = Actor::start(STEADY, &name);
    for kill in 0..KILLS {
        let mut killed = if kill % 2 == 0 {
            Actor::start(Role::Idler, &name)
        } else {
            let hoarder = Actor::start(Role::Hoarder, &name);
            hoarder.hear("holding");
            hoarder
        };
        killed.kill();
        witness.hears(steady.id, 5);
    }
    let mut next = Actor::start(Role::Reader, &name);
    next.hear("read");
    next.end();
    steady.end();
    counters_add_up(&mut witness);
}

/// Kills the daemon under a load, starts the next, and returns how long the witness was without percepts beyond that.
fn restart_under(load: Role, rounds: usize) -> Vec<Duration> {
    let name = instance();
    let mut daemon = serve(&name);
    let mut witness = Witness::open(&InstanceName::new(&name).unwrap());
    let mut reader = Actor::start(Role::Reader, &name);
    let mut producer = Actor::start(load, &name);
    let mut resumed = Vec::new();
    for _ in 0..rounds {
        witness.hears(producer.id, 5);
        let before = witness.daemon();
        daemon.signal(Signal::KILL);
        daemon.wait();
        daemon = serve(&name);
        let start = Instant::now();
        witness.until("percepts of the next daemon", |percept| Some(percept.daemon_id) != before);
        resumed.push(start.elapsed());
        drop(reader.heard("read"));
        reader.hear("read");
    }
    producer.end();
    reader.end();
    counters_add_up(&mut witness);
    resumed
}

#[test]
fn clients_resume_with_the_next_daemon_when_one_is_killed_idle_or_in_the_middle_of_a_query() {
    for (what, load) in [("idle most of the time", STEADY), ("always in a query", FLOOD)] {
        let resumed = restart_under(load, 3);
        println!("daemon killed, {what}: percepts of the next one read after it said that it serves: {resumed:?}");
    }
}

#[test]
fn frozen_clients_delay_nobody_and_go_on_when_they_thaw() {
    let name = instance();
    let _daemon = serve(&name);
    let mut witness = Witness::open(&InstanceName::new(&name).unwrap());
    let mut steady = Actor::start(STEADY, &name);
    for _ in 0..3 {
        let mut reader = Actor::start(Role::Reader, &name);
        let mut producer = Actor::start(STEADY, &name);
        reader.hear("read");
        witness.hears(producer.id, 3);
        [&reader, &producer].iter().for_each(|frozen| frozen.process.signal(Signal::STOP));
        // Longer than any buffer.
        witness.hears(steady.id, 200);
        let mut next = Actor::start(Role::Reader, &name);
        next.hear("read");
        [&reader, &producer].iter().for_each(|frozen| frozen.process.signal(Signal::CONT));
        drop(reader.heard("read"));
        reader.hear("read");
        witness.hears(producer.id, 3);
        [&mut reader, &mut producer, &mut next].into_iter().for_each(Actor::end);
    }
    steady.end();
    counters_add_up(&mut witness);
}

#[test]
fn instances_side_by_side_do_not_see_each_others_data() {
    let names = [instance(), instance()];
    let _daemons = [serve(&names[0]), serve(&names[1])];
    let mut witnesses = [0, 1].map(|n| Witness::open(&InstanceName::new(&names[n]).unwrap()));
    let mut producers = [0, 1].map(|n| Actor::start(STEADY, &names[n]));
    for _ in 0..5 {
        for n in [0, 1] {
            let own = producers[n].id;
            witnesses[n].until("percepts of its own instance", |percept| {
                assert_eq!(percept.producer_id, own);
                true
            });
        }
    }
    assert_ne!(witnesses[0].daemon(), witnesses[1].daemon());
    // The end of one is nothing to the other.
    producers[0].kill();
    witnesses[1].hears(producers[1].id, 5);
    producers[1].end();
}
