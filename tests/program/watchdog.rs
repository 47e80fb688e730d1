//! Ends the tests when one of them hangs, with its name, so that nobody waits for ever and no process is left.
//!
//! Every test that starts a process is watched from then on until its thread ends. What waits for something has a shorter patience of its own
//! and says what it waited for; this here is for what has none, such as a thread that is joined.

use std::cell::Cell;
use std::collections::{BTreeMap, BTreeSet};
use std::io::Write;
use std::sync::{Mutex, Once, PoisonError};
use std::time::{Duration, Instant};

/// No test takes as long on the slowest machine.
const LONGEST_S: u64 = 900;
/// Shortens it, for the test of this file.
const VARIABLE: &str = "BEO_TEST_LONGEST_S";

/// The tests that run: their names, and since when.
static TESTS: Mutex<BTreeMap<String, Instant>> = Mutex::new(BTreeMap::new());
/// The processes that run.
static PROCESSES: Mutex<BTreeSet<u32>> = Mutex::new(BTreeSet::new());

/// The test of this thread; gone with the thread.
struct Watched(Cell<Option<String>>);

impl Drop for Watched {
    fn drop(&mut self) {
        if let Some(name) = self.0.take() {
            lock(&TESTS).remove(&name);
        }
    }
}

thread_local! {
    static WATCHED: Watched = const { Watched(Cell::new(None)) };
}

fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A process of this test has started: both are watched.
pub fn started(process: u32) {
    lock(&PROCESSES).insert(process);
    let Some(name) = std::thread::current().name().map(str::to_owned) else { return };
    WATCHED.with(|watched| {
        let known = watched.0.take();
        if known.is_none() {
            lock(&TESTS).insert(name.clone(), Instant::now());
        }
        watched.0.set(Some(name));
    });
    static ONCE: Once = Once::new();
    ONCE.call_once(|| drop(std::thread::spawn(watch)));
}

/// A process has ended.
pub fn ended(process: u32) {
    lock(&PROCESSES).remove(&process);
}

/// This test may take as long as it likes.
#[allow(dead_code, reason = "not of the clients")]
pub fn takes_long() {
    WATCHED.with(|watched| {
        let name = watched.0.take();
        if let Some(name) = &name {
            lock(&TESTS).remove(name);
        }
        watched.0.set(name);
    });
}

fn watch() {
    let longest = std::env::var(VARIABLE).ok().and_then(|text| text.parse().ok()).unwrap_or(LONGEST_S);
    loop {
        std::thread::sleep(Duration::from_millis(200));
        let hanging = lock(&TESTS).iter().find(|(_, since)| since.elapsed().as_secs() >= longest).map(|(name, _)| name.clone());
        let Some(name) = hanging else { continue };
        // Not through `eprintln`, which the test harness keeps to itself.
        let _ = writeln!(std::io::stderr(), "test {name} hangs: after {longest} s it is ended, and all others with it");
        for process in lock(&PROCESSES).iter().filter_map(|process| rustix::process::Pid::from_raw(process.cast_signed())) {
            let _ = rustix::process::kill_process(process, rustix::process::Signal::KILL);
        }
        std::process::exit(101);
    }
}

#[cfg(test)]
mod tests {
    use crate::harness::{Running, text};
    use std::process::{Command, Stdio};

    /// Not a test by itself: it waits for ever for a thread, as no test should, if it is asked to.
    #[test]
    fn what_hangs() {
        if std::env::var_os(super::VARIABLE).is_none() {
            return;
        }
        let mut command = Command::new("sleep");
        command.arg("1000000");
        let sleeping = Running::start(command);
        let _ = std::io::Write::write_fmt(&mut std::io::stderr(), format_args!("process {}\n", sleeping.id()));
        let _ = std::thread::spawn(|| std::thread::sleep(std::time::Duration::from_secs(1_000_000))).join();
    }

    #[test]
    fn a_test_that_hangs_is_ended_and_named() {
        let mut command = Command::new(std::env::current_exe().unwrap());
        command.args(["--exact", "harness::watchdog::tests::what_hangs", "--nocapture"]).env(super::VARIABLE, "1").stdin(Stdio::null());
        let output = command.output().unwrap();
        let said = text(&output.stderr);
        assert_eq!(output.status.code(), Some(101), "{said}");
        assert!(said.contains("harness::watchdog::tests::what_hangs hangs"), "{said}");
        let process = said.lines().find_map(|line| line.strip_prefix("process ")).unwrap();
        // Its parent has gone too: whoever takes it over removes it, sooner or later.
        let start = std::time::Instant::now();
        let lives = || std::fs::read_to_string(format!("/proc/{process}/stat")).is_ok_and(|stat| !stat.contains(") Z "));
        while lives() {
            assert!(start.elapsed() < crate::harness::PATIENCE, "process {process} still runs");
            std::thread::sleep(std::time::Duration::from_millis(20));
        }
    }
}
