//! `beo bench latency`: every process is real, every observation is accounted for, and nothing is left behind.

use super::{all_mapped, children, mapped, nothing_left, percentiles, refused};
use crate::harness::{PATIENCE, Running, beo, model, shape};
use rustix::process::Signal;
use serde_json::Value;
use std::collections::BTreeSet;
use std::path::PathBuf;
use std::time::{Duration, Instant};

const STAGES: [&str; 10] = ["due", "laid", "written", "received", "projected", "classified", "posed", "completed", "published", "read"];

fn latency(arguments: &[&str]) -> std::process::Command {
    let model = model().to_str().unwrap();
    beo(["bench", "latency", "--json", "--repeat", "1", "--model", model].iter().chain(arguments))
}

/// Shared memory that the children of a process have mapped now.
fn mapped_by_children(pid: u32) -> BTreeSet<PathBuf> {
    // One that ends meanwhile has nothing mapped.
    children(pid).into_iter().filter(|child| PathBuf::from(format!("/proc/{child}/maps")).exists()).flat_map(mapped).collect()
}

/// Runs to the end, and gives what it printed and the shared memory that its processes had mapped.
fn watched(command: std::process::Command) -> (Value, BTreeSet<PathBuf>) {
    let mut bench = Running::start(command);
    let start = Instant::now();
    let lines = bench.stdout.take().unwrap();
    let (mut output, mut files) = (String::new(), BTreeSet::new());
    loop {
        match lines.recv_timeout(Duration::from_millis(50)) {
            Ok(line) => output.push_str(&line),
            Err(std::sync::mpsc::RecvTimeoutError::Timeout) => files.append(&mut mapped_by_children(bench.id())),
            Err(_) => break,
        }
        assert!(start.elapsed() < PATIENCE, "no end");
    }
    assert!(bench.wait().success(), "{:?}", bench.stderr.take().unwrap().iter().collect::<Vec<_>>());
    (serde_json::from_str(&output).unwrap(), files)
}

fn count(load: &Value, what: &str) -> u64 {
    load["counts"][what].as_u64().unwrap_or_else(|| panic!("{what}: {load}"))
}

/// The properties of every load, whatever the machine.
fn check(report: &Value, load: &Value, readers: usize) {
    assert_eq!(report["stages"], serde_json::json!(STAGES));
    let names: Vec<&str> = load["stages_us"].as_array().unwrap().iter().map(|stage| stage["stage"].as_str().unwrap()).collect();
    assert_eq!(names, STAGES[1..]);
    let stamps: Vec<f64> = STAGES.iter().map(|stage| load["median_observation_us"][stage].as_f64().unwrap()).collect();
    assert!(stamps.is_sorted() && stamps[0] == 0.0 && stamps[9] > 0.0, "{stamps:?}");
    percentiles(&load["latency_us"]);

    let counts = &load["counts"];
    assert_eq!(counts["sums_match"], true, "{counts}");
    for none in ["refused", "repeated", "out_of_order", "incomplete"] {
        assert_eq!(count(load, none), 0, "{none}: {counts}");
    }
    assert_eq!(count(load, "sent"), count(load, "lost") + count(load, "received"));
    assert_eq!(count(load, "received"), count(load, "overtaken") + count(load, "answered"));
    let of = |what: &str| -> Vec<u64> { counts[what].as_array().unwrap().iter().map(|n| n.as_u64().unwrap()).collect() };
    assert_eq!(of("read").len(), readers);
    for (read, missed) in of("read").into_iter().zip(of("missed")) {
        assert_eq!(read + missed, count(load, "answered"));
        assert!(read > 0);
    }
    let timed = load["latency_us"]["count"].as_u64().unwrap();
    assert!(timed > 0 && timed <= of("read").iter().sum::<u64>());
}

#[test]
fn every_load_is_measured_through_all_stages_and_leaves_nothing_behind() {
    let folder = tempfile::tempdir().unwrap();
    let pictures = folder.path().join("pictures");
    let (report, files) = watched(latency(&["--seconds", "1", "--subscribers", "2", "--png", pictures.to_str().unwrap()]));
    assert_eq!(report["benchmark"], "latency");
    assert!(report["machine"]["cores"].as_u64().unwrap() >= 1 && report["machine"]["cpu"].is_string());
    let loads = report["loads"].as_array().unwrap();
    assert_eq!(
        loads.iter().map(|load| load["load"].as_str().unwrap()).collect::<Vec<_>>(),
        ["flat-out", "30hz", "8x30hz", "burst", "camera"]
    );
    loads.iter().for_each(|load| check(&report, load, 2));
    // Half a second of warm-up and one second: what is due does not depend on how fast it is served.
    assert_eq!(loads[1..].iter().map(|load| count(load, "sent")).collect::<Vec<_>>(), [45, 360, 96, 270]);
    assert_eq!(loads[1..].iter().map(|load| count(load, "warm_up")).collect::<Vec<_>>(), [15, 120, 32, 90]);
    // Only a depth image takes time until its grids are laid; frames are counted once for each reader's six objects.
    let laid: Vec<bool> = loads.iter().map(|load| load["stages_us"][0]["p50"].as_f64().unwrap() > 0.0).collect();
    assert_eq!(laid, [false, false, false, false, true]);
    let frames = &loads[4]["frame_to_grids_us"];
    assert!(frames["count"].as_u64().is_some_and(|count| (1..=30).contains(&count)) && frames["p50"].as_f64() > Some(0.0), "{frames}");
    assert!(loads[0]["frame_to_grids_us"].is_null());
    for picture in ["latency.png", "stages.png"] {
        assert!(std::fs::read(pictures.join(picture)).unwrap().starts_with(b"\x89PNG"));
    }
    assert!(!files.is_empty(), "its processes were seen while they ran");
    nothing_left(&[], &files);
}

#[test]
fn polling_and_tracking_are_measured_too() {
    let folder = tempfile::tempdir().unwrap();
    let file = shape(folder.path(), "chair", 500);
    let arguments = ["--seconds", "1", "--load", "30hz,flat-out,30hz", "--wake", "polling", "--pose", "track", file.to_str().unwrap()];
    let (report, _) = watched(latency(&arguments));
    let loads = report["loads"].as_array().unwrap();
    assert_eq!(loads.iter().map(|load| load["load"].as_str().unwrap()).collect::<Vec<_>>(), ["30hz", "flat-out"]);
    loads.iter().for_each(|load| check(&report, load, 1));
    assert_eq!((&report["settings"]["wake"], &report["settings"]["pose"]), (&"polling".into(), &"track".into()));
}

#[test]
fn ctrl_c_ends_every_process_and_leaves_nothing_behind() {
    let mut bench = Running::start(latency(&["--load", "30hz", "--seconds", "100"]));
    // Daemon, reader and producer.
    let (processes, files) = all_mapped(bench.id(), 3);
    bench.signal(Signal::INT);
    assert_eq!(bench.wait().code(), Some(1));
    let messages: Vec<String> = bench.stderr.take().unwrap().iter().collect();
    assert!(messages.iter().any(|line| line.contains("interrupted")), "{messages:?}");
    nothing_left(&processes, &files);
}

#[test]
fn what_cannot_be_measured_is_refused_in_one_line() {
    refused(&[
        (&["latency", "--seconds", "0"], 2, "--seconds 0"),
        (&["latency", "--seconds", "nan"], 2, "--seconds"),
        (&["latency", "--subscribers", "0"], 2, "--subscribers 0"),
        (&["latency", "--subscribers", "16"], 2, "1 to 15"),
        (&["latency", "--repeat", "0"], 2, "--repeat 0"),
        (&["latency", "--load", "camera", "--objects", "21"], 2, "--objects 21: use 1 to 20"),
        (&["latency", "--load", "camera", "--rate", "nan"], 2, "--rate"),
        (&["latency", "--load", "30hz", "--objects", "6"], 2, "of the load `camera`"),
        (&["latency", "--load", "60hz"], 2, "60hz"),
        (&["latency", "--model", "absent.safetensors"], 1, "absent.safetensors"),
        (&["latency-reader"], 2, "a part of `beo bench latency`"),
        (&["latency-producer"], 2, "a part of `beo bench latency`"),
    ]);
}
