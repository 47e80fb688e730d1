//! The daemon is killed under clients that wait, and another one is started.

use crate::examples::Examples;
use crate::harness::{RESOLUTION, instance, model, serve};
use crate::toolchain::{await_message, finish};
use rustix::process::Signal;

fn sequence(line: &str) -> u64 {
    line.strip_prefix('#')
        .and_then(|rest| rest.split(' ').next())
        .and_then(|number| number.parse().ok())
        .unwrap_or_else(|| panic!("{line}"))
}

fn clients_survive_the_kill_of_the_daemon(examples: &Examples) {
    const HEARD: usize = 30;
    let name = instance();
    let mut daemon = serve(&name);
    let listener = (examples.start)("listen", &[&name, &HEARD.to_string()]);
    await_message(&listener, "listening");
    // For as long as the listener hears, however slow the machine.
    let camera = (examples.start)("camera", &[&name, "1000000", &RESOLUTION.to_string()]);
    let mut before: Vec<String> = (0..3).map(|_| listener.line()).collect();
    daemon.signal(Signal::KILL);
    daemon.wait();
    // Of percepts that were still on their way only those already printed are sure to come; then the listener notices.
    await_message(&listener, "waiting for the daemon");
    before.extend(listener.stdout.as_ref().unwrap().try_iter());
    let _next = serve(&name);
    let after = finish(listener);
    assert_eq!(before.len() + after.len(), HEARD);
    assert!(after.len() > 10, "most come from the second daemon: {}", after.len());
    let numbers: Vec<u64> = before.iter().chain(&after).map(|line| sequence(line)).collect();
    assert!(numbers.windows(2).all(|pair| pair[0] < pair[1]), "the camera goes on counting: {numbers:?}");
    assert!(after.iter().all(|line| line.contains(" %, rotation (")), "{after:?}");
    let sent: Vec<String> = camera.stdout.as_ref().unwrap().try_iter().collect();
    let last = format!("sent observation {}", numbers[HEARD - 1]);
    assert!(sent.contains(&last), "{last} is not among {} lines", sent.len());
}

#[test]
fn c_clients_survive_the_kill_of_the_daemon() {
    clients_survive_the_kill_of_the_daemon(&Examples::c());
}

#[test]
fn rust_clients_survive_the_kill_of_the_daemon() {
    clients_survive_the_kill_of_the_daemon(&Examples::rust());
}

#[test]
fn who_comes_before_the_daemon_waits_for_it() {
    // Learned first: clients wait ten seconds for a daemon.
    model();
    for examples in std::iter::once(Examples::c()).chain(Examples::cpp()) {
        let name = instance();
        let listener = (examples.start)("listen", &[&name, "1"]);
        let _daemon = serve(&name);
        await_message(&listener, "listening");
        finish((examples.start)("camera", &[&name, "1", &RESOLUTION.to_string()]));
        assert_eq!(sequence(&finish(listener)[0]), 1);
    }
}
