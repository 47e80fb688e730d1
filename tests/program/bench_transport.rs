//! `beo bench transport` with two real processes and small grids.

use crate::harness::{run, text};
use serde_json::Value;

#[test]
fn every_hand_over_is_measured_in_every_repeat_and_compared() {
    let folder = tempfile::tempdir().unwrap();
    let chart = folder.path().join("chart.png");
    let arguments = ["bench", "transport", "--sides", "16,8", "--messages", "7", "--repeats", "2", "--json", "--png"];
    let output = run(arguments.into_iter().chain([chart.to_str().unwrap()]));
    assert!(output.status.success(), "{}", text(&output.stderr));
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
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
        let [p50, p90, p99] = ["p50", "p90", "p99"].map(|p| cell["ns"][p].as_f64().unwrap());
        assert!(0.0 < p50 && p50 <= p90 && p90 <= p99, "{cell}");
        assert_eq!(cell["p50_of_repeats_ns"].as_array().unwrap().len(), 2, "{cell}");
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
    for arguments in [["--sides", "7"], ["--sides", "257"], ["--messages", "0"], ["--repeats", "0"]] {
        let output = run(["bench", "transport"].into_iter().chain(arguments));
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
    }
}

#[test]
fn a_reader_without_its_sender_says_so() {
    let plan = r#"{"sides":[8],"messages":1,"repeats":1}"#;
    let output = run(["bench", "transport-reader", "nobody", plan]);
    assert_eq!(output.status.code(), Some(1));
    assert!(text(&output.stderr).contains("cannot connect to the sender"), "{}", text(&output.stderr));
}
