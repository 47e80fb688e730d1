//! `beo eval --view table`: made-up household things at rest, seen by depth sensors with their faults, named by the household model.

use crate::harness::{run, text};
use serde_json::Value;
use std::path::Path;
use std::process::Output;

fn model() -> String {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("models/household.safetensors").to_str().unwrap().to_owned()
}

fn eval(shapes: &Path, more: &[&str]) -> Output {
    run([&["eval", shapes.to_str().unwrap(), "--split", "test", "--model", &model(), "--view", "table"], more].concat())
}

#[test]
fn household_things_are_named_as_they_stand_and_as_they_lie_with_the_same_figures_whatever_the_threads() {
    let scratch = tempfile::tempdir().unwrap();
    let (shapes, json) = (scratch.path().join("shapes"), scratch.path().join("o.json"));
    let made =
        ["generate", "household", "--out", shapes.to_str().unwrap(), "--count", "1", "--test", "4", "--seed", "9", "--format", "ply"];
    assert!(run(made).status.success());
    let outcome = |more: &[&str]| -> (Value, String) {
        let arguments = ["--azimuths", "2", "--elevation", "25,60", "--json", json.to_str().unwrap()];
        let output = eval(&shapes, &[&arguments, more].concat());
        assert!(output.status.success(), "{}", text(&output.stderr));
        (serde_json::from_slice(&std::fs::read(&json).unwrap()).unwrap(), text(&output.stdout))
    };
    let (standing, table) = outcome(&["--threads", "1"]);
    assert_eq!(standing, outcome(&["--threads", "3", "--sensors", "mixed", "--resting", "upright", "--units", "m"]).0);
    let queries = standing["queries"].as_u64().unwrap();
    assert_eq!(queries + standing["unseen"].as_u64().unwrap(), 7 * 4 * 2);
    let accuracy = standing["accuracy"].as_f64().unwrap();
    assert!(accuracy > 0.75, "{table}");
    assert!(standing["axis_found"].as_f64().unwrap() > 0.85, "{table}");
    // The accuracy is that of the confusion and that of the table.
    let right = |class: (&String, &Value)| class.1.get(class.0).and_then(Value::as_u64).unwrap_or(0);
    let named = standing["confusion"].as_object().unwrap().iter().map(right).sum::<u64>();
    assert!((named as f64 / queries as f64 - accuracy).abs() < 1e-9);
    assert!(table.contains(&format!("named rightly {:.1} % of {queries}", 100.0 * accuracy)), "{table}");

    let (lying, table) = outcome(&["--resting", "lying"]);
    // Plates come to rest on their faces alone.
    assert!(lying["per_class"].get("can").is_some() && lying["unseen"].as_u64().unwrap() > 0, "{table}");
    assert!(lying["axis_median_deg"].as_f64().unwrap() < 15.0, "{table}");
}

#[test]
fn what_cannot_act_before_a_table_is_an_error() {
    let root = tempfile::tempdir().unwrap();
    for (arguments, problem) in [
        (&["--pose", "yaw"][..], "--pose"),
        (&["--method", "hull"], "--method"),
        (&["--distance", "3"], "--distance"),
        (&["--limit", "3"], "--limit"),
        (&["--find-size"], "--find-size"),
        (&["--elevation", "100"], "--elevation"),
    ] {
        let output = eval(root.path(), arguments);
        assert!(output.status.code() == Some(2) && text(&output.stderr).contains(problem), "{arguments:?}: {}", text(&output.stderr));
    }
    let top = run(["eval", root.path().to_str().unwrap(), "--split", "test", "--model", &model(), "--sensors", "tof"]);
    assert!(top.status.code() == Some(2) && text(&top.stderr).contains("--view table"), "{}", text(&top.stderr));
    let side = run(["eval", root.path().to_str().unwrap(), "--leave-one-out", "--view", "table"]);
    assert!(side.status.code() == Some(2) && text(&side.stderr).contains("--view top or --view side"), "{}", text(&side.stderr));
}
