//! `beo bench`: that everything is measured that is reported. How long anything takes is not tested.

mod latency;
mod query;
mod scale;
mod transport;

use crate::harness::{PATIENCE, run, segments, text};
use serde_json::Value;
use std::collections::BTreeSet;
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// The output of a benchmark with `--json`.
fn report(arguments: &[&str]) -> Value {
    let output = run(["bench"].iter().chain(arguments).chain(&["--json"]));
    assert!(output.status.success(), "{}", text(&output.stderr));
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    let machine = &report["machine"];
    assert!(machine["cores"].as_u64().unwrap() >= 1 && machine["cpu"].is_string() && report["warnings"].is_array(), "{machine}");
    report
}

/// The percentiles of some times, in order and above zero.
fn percentiles(of: &Value) {
    let values: Vec<f64> = ["p50", "p90", "p99", "p99_9", "p99_99", "max"].iter().map(|p| of[p].as_f64().unwrap()).collect();
    assert!(values.is_sorted() && values[0] > 0.0, "{values:?}");
}

/// Each of these is refused with an exit code and one line that says why.
fn refused(cases: &[(&[&str], i32, &str)]) {
    for (arguments, code, part) in cases {
        let output = run(["bench"].iter().chain(*arguments));
        let message = text(&output.stderr);
        assert_eq!(output.status.code(), Some(*code), "{arguments:?}: {message}");
        assert!(message.contains(part), "{arguments:?}: {message}");
        // The parser of arguments adds its advice.
        assert!(message.lines().count() == 1 || message.starts_with("error: "), "{arguments:?}: {message}");
    }
}

/// Processes whose parent is `pid`.
fn children(pid: u32) -> Vec<u32> {
    let processes = std::fs::read_dir("/proc").unwrap().filter_map(|entry| entry.ok()?.file_name().to_str()?.parse().ok());
    let parent = |process: &u32| {
        let stat = std::fs::read_to_string(format!("/proc/{process}/stat")).ok()?;
        stat.rsplit_once(')')?.1.split_whitespace().nth(1)?.parse::<u32>().ok()
    };
    processes.filter(|process| parent(process) == Some(pid)).collect()
}

/// Shared memory that a process has mapped now.
fn mapped(pid: u32) -> Vec<PathBuf> {
    std::panic::catch_unwind(|| segments(pid)).unwrap_or_default()
}

/// The children of a process, once there are `count` of them and each has mapped shared memory, and that memory.
fn all_mapped(pid: u32, count: usize) -> (Vec<u32>, BTreeSet<PathBuf>) {
    let start = Instant::now();
    loop {
        let found = children(pid);
        if found.len() == count && found.iter().all(|child| !mapped(*child).is_empty()) {
            let files = found.iter().flat_map(|child| mapped(*child)).collect();
            return (found, files);
        }
        assert!(start.elapsed() < PATIENCE, "{found:?}");
        std::thread::sleep(Duration::from_millis(20));
    }
}

/// All these processes have ended and all these files are gone.
fn nothing_left(processes: &[u32], files: &BTreeSet<PathBuf>) {
    assert!(processes.iter().all(|process| !PathBuf::from(format!("/proc/{process}")).exists()), "{processes:?}");
    let left: Vec<_> = files.iter().filter(|file| file.exists()).collect();
    assert!(left.is_empty(), "left in shared memory: {left:?}");
}
