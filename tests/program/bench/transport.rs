//! `beo bench transport` with two real processes and small grids.

use super::{all_mapped, nothing_left, percentiles, refused, report};
use crate::harness::{Running, beo, run, segments, text};
use rustix::process::Signal;
use serde_json::Value;
use std::io::{Seek, Write};

#[test]
fn every_hand_over_is_measured_in_every_repeat_and_compared() {
    let folder = tempfile::tempdir().unwrap();
    let chart = folder.path().join("chart.png");
    let report = report(&["transport", "--sides", "16,8", "--messages", "7", "--repeats", "2", "--png", chart.to_str().unwrap()]);
    let cells = report["cells"].as_array().unwrap();
    let of = |way: &str, work: &str, wake: &str| {
        let is = |cell: &&Value| cell["way"] == way && cell["work"] == work && cell["wake"] == wake;
        cells.iter().filter(is).map(|cell| cell["bytes"].as_u64().unwrap()).collect::<Vec<_>>()
    };
    for (way, work, wake) in [
        ("ours", "pointer", "polling"),
        ("raw", "pointer", "polling"),
        ("ours", "pointer", "event"),
        ("raw", "pointer", "event"),
        ("ours", "sum", "event"),
        ("raw", "sum", "event"),
        ("socket", "sum", "event"),
        ("pipe", "sum", "event"),
        ("ours", "validate", "event"),
    ] {
        assert_eq!(of(way, work, wake), [512, 4096], "{way} {work} {wake}");
    }
    for cell in cells {
        percentiles(&cell["us"]);
        assert_eq!(cell["p50_of_repeats_us"].as_array().unwrap().len(), 2, "{cell}");
    }
    for ratio in report["ratios"].as_array().unwrap() {
        let values = ratio["by_size"].as_array().unwrap();
        assert!(values.len() == 2 && values.iter().all(|value| value.as_f64().unwrap() > 0.0), "{ratio}");
    }
    assert!(std::fs::read(chart).unwrap().starts_with(b"\x89PNG"));
}

#[test]
fn a_table_is_for_people() {
    let output = run(["bench", "transport", "--sides", "8", "--messages", "2", "--repeats", "1"]);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let table = text(&output.stdout);
    assert!(table.contains("ours: pointer") && table.contains("ratios of medians"), "{table}");
}

#[test]
fn what_cannot_be_measured_is_wrong_usage() {
    refused(&[
        (&["transport", "--sides", "7"], 2, "--sides"),
        (&["transport", "--sides", "257"], 2, "--sides"),
        (&["transport", "--messages", "0"], 2, "--messages"),
        (&["transport", "--repeats", "0"], 2, "--repeats"),
        (&["transport-reader"], 2, "a part of `beo bench transport`"),
    ]);
}

#[test]
fn a_reader_without_its_sender_says_so() {
    let mut plan = tempfile::tempfile().unwrap();
    writeln!(plan, r#"{{"name":"nobody","plan":{{"sides":[8],"messages":1,"repeats":1}}}}"#).unwrap();
    plan.rewind().unwrap();
    let mut command = beo(["bench", "transport-reader"]);
    command.stdin(plan);
    let mut reader = Running::start(command);
    assert_eq!(reader.wait().code(), Some(1));
    let message = reader.message();
    assert!(message.contains("cannot connect to the sender"), "{message}");
}

#[test]
fn ctrl_c_ends_both_processes_and_leaves_nothing_behind() {
    let mut bench = Running::start(beo(["bench", "transport", "--sides", "8", "--messages", "1000000"]));
    let (reader, mut files) = all_mapped(bench.id(), 1);
    files.extend(segments(bench.id()));
    bench.signal(Signal::INT);
    assert_eq!(bench.wait().code(), Some(1));
    let messages: Vec<String> = bench.stderr.take().unwrap().iter().collect();
    assert!(messages.iter().any(|line| line.contains("interrupted")), "{messages:?}");
    nothing_left(&reader, &files);
}
