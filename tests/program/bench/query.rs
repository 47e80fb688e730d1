//! `beo bench query` on the small model, and NumPy's answers to its queries.

use super::{percentiles, refused, report};
use crate::harness::{model, shape};
use crate::real_shapes::skipped;
use serde_json::Value;
use std::collections::BTreeSet;

fn query(arguments: &[&str]) -> Value {
    let common = ["query", "--model", model().to_str().unwrap(), "--repeats", "2"];
    report(&[&common, arguments].concat())
}

#[test]
fn every_kind_of_query_is_measured_and_numpy_gives_the_same_answers() {
    let report = query(&["--queries", "10"]);
    let rows = report["rows"].as_array().unwrap();
    let names: BTreeSet<&str> = rows.iter().map(|row| row["name"].as_str().unwrap()).collect();
    assert_eq!((rows.len(), names.len()), (4 * 2 * 3, 4 * 2 * 3));
    for row in rows {
        percentiles(&row["us"]);
        assert!(row["floor"]["bytes"].as_f64().unwrap() > 0.0 && row["over_bandwidth"].as_f64().unwrap() > 0.0, "{row}");
        assert_eq!(row["p50_of_repeats_us"].as_array().unwrap().len(), 2);
    }
    assert!(report["limits"]["gflops"].as_f64().unwrap() > 0.0 && report["limits"]["memory_gb_s"].as_f64().unwrap() > 0.0);
    let peers = report["peers"].as_array().unwrap();
    assert_eq!(peers.iter().filter(|peer| peer["name"].as_str().unwrap().starts_with("ICP")).count(), 2);
    if let Some(why) = report["skipped"].as_array().unwrap().first() {
        skipped(why.as_str().unwrap());
        return;
    }
    let numpy = |what: &str| peers.iter().find(|peer| peer["name"].as_str().unwrap().contains(what)).unwrap();
    let (same, shared) = (numpy("the same algorithm"), numpy("shared basis"));
    assert_eq!(same["same_answers"], true, "{same}");
    assert_eq!((&same["agreement"]["queries"], &same["threads"]), (&10.into(), &report["limits"]["threads"]));
    // Another estimator: what it has in common with ours is that it mostly knows made-up furniture.
    assert!(shared["agreement"]["same_class"].as_u64().unwrap() >= 5, "{shared}");
    assert!(shared["over_ours"].as_f64().unwrap() > 0.0);
}

#[test]
fn own_shapes_are_asked_about_and_peers_are_left_out_on_request_or_when_they_are_missing() {
    let folder = tempfile::tempdir().unwrap();
    let chair = shape(folder.path(), "chair", 77);
    let chair = chair.to_str().unwrap();
    let alone = query(&[chair, "--alone"]);
    assert_eq!((&alone["queries"], alone["peers"].as_array().unwrap().len()), (&1.into(), 0));
    assert!(alone["skipped"][0].as_str().unwrap().contains("--alone"));
    let missing = query(&[chair, "--python", "/nonexistent/python"]);
    assert!(missing["skipped"][0].as_str().unwrap().contains("/nonexistent/python"), "{missing}");
}

#[test]
fn what_cannot_be_asked_is_said_in_a_line() {
    let model = model().to_str().unwrap();
    refused(&[
        (&["query", "--model", model, "--split", "test"], 2, "--split test"),
        (&["query", "--queries", "0"], 2, "--queries"),
        (&["query", "--model", model, "/nonexistent.off"], 1, "/nonexistent.off"),
    ]);
}
