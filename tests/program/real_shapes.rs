//! ModelNet10, where BEO_MODELNET10 names its folder: trained on `train` alone, measured on `validation`.

use crate::harness::{run, text};
use serde_json::Value;
use std::io::Write;
use std::path::{Path, PathBuf};

/// The folder, or a line that says that the test is skipped.
fn modelnet10() -> Option<PathBuf> {
    let folder = std::env::var_os("BEO_MODELNET10").map(PathBuf::from);
    if folder.is_none() {
        skipped("set BEO_MODELNET10 to the folder of ModelNet10 grids");
    }
    folder
}

/// Says so past the test runner, which shows what a passing test prints to nobody.
pub fn skipped(why: &str) {
    let _ = writeln!(std::io::stderr(), "skipped: {why}");
}

#[test]
fn accuracy_calibration_completion_and_pose_on_modelnet10() {
    let Some(shapes) = modelnet10() else { return };
    let folder = tempfile::tempdir().unwrap();
    let model = folder.path().join("train.safetensors");
    let (shapes, model) = (shapes.to_str().unwrap(), model.to_str().unwrap());
    let trained = run(["train", shapes, "--split", "train", "--out", model]);
    assert!(trained.status.success(), "{}", text(&trained.stderr));
    assert!(std::fs::metadata(model).unwrap().len() <= 30_000_000);

    let outcome = folder.path().join("out.json");
    let methods = "auto,paper,mean";
    let eval = run(["eval", shapes, "--split", "validation", "--model", model, "--method", methods, "--json", outcome.to_str().unwrap()]);
    assert!(eval.status.success(), "{}", text(&eval.stderr));
    println!("{}", text(&eval.stdout));
    let outcome: Value = serde_json::from_str(&std::fs::read_to_string(outcome).unwrap()).unwrap();
    let [auto, paper, mean] = [0, 1, 2].map(|i| &outcome[i]);
    let number = |value: &Value| value.as_f64().unwrap();
    assert_eq!(auto["queries"], 454);
    assert!(number(&auto["accuracy"]) >= 0.80, "{}", auto["accuracy"]);
    assert!(number(&auto["calibration"]["ece"]) <= 0.08, "{}", auto["calibration"]);
    assert!(number(&paper["accuracy"]) >= 0.72, "{}", paper["accuracy"]);
    assert!(number(&mean["accuracy"]) < number(&paper["accuracy"]));
    let completion = &auto["completion"];
    for part in ["unknown", "all"] {
        let (ours, baseline) = (number(&completion[format!("iou_{part}")]), number(&completion[format!("iou_{part}_mean_baseline")]));
        assert!(ours >= baseline + 0.05, "{completion}");
    }
    check_scores_with_numpy(model, shapes);
    check_pose(model, shapes, folder.path());
}

/// Class and pose jointly, and pose against ICP with the class known, on samples of the queries.
fn check_pose(model: &str, shapes: &str, folder: &Path) {
    let outcome = folder.join("pose.json");
    let eval = |arguments: &[&str]| -> Value {
        let common = ["eval", shapes, "--split", "validation", "--model", model, "--json", outcome.to_str().unwrap()];
        let eval = run(common.iter().chain(arguments));
        assert!(eval.status.success(), "{}", text(&eval.stderr));
        println!("{}", text(&eval.stdout));
        serde_json::from_str(&std::fs::read_to_string(&outcome).unwrap()).unwrap()
    };
    let number = |value: &Value| value.as_f64().unwrap();
    for (span, least) in [("180", 0.78), ("360", 0.74)] {
        let yaw = eval(&["--pose", "yaw", "--yaw-span", span]);
        assert!(number(&yaw["accuracy"]) >= least, "{}", yaw["accuracy"]);
        assert!(number(&yaw["pose_error_deg"]["median"]) <= 1.5, "{}", yaw["pose_error_deg"]);
        assert!(number(&yaw["calibration"]["ece"]) <= 0.08, "{}", yaw["calibration"]);
    }
    let known = eval(&["--pose", "yaw", "--yaw-span", "180", "--known-class", "--icp", "--limit", "100"]);
    let median = |value: &Value, kind: &str| number(&value["pose_error_deg"][kind]);
    assert!(median(&known, "median") < median(&known["icp"][1], "median"), "{known:#}");
    let known = eval(&["--pose", "full", "--known-class", "--icp", "--limit", "100"]);
    let (ours, icp) = (median(&known, "symmetry_aware_median"), median(&known["icp"][1], "symmetry_aware_median"));
    assert!(ours < 0.5 * icp && ours < 8.0, "{ours} {icp}");
    let paper = eval(&["--pose", "yaw", "--yaw-span", "180", "--method", "paper", "--limit", "60"]);
    assert!(number(&paper["accuracy"]) >= 0.5, "{}", paper["accuracy"]);
}

/// Class scores of 50 queries by an independent script, where NumPy is installed.
fn check_scores_with_numpy(model: &str, shapes: &str) {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/numpy/check_scores.py");
    let python = std::env::var("BEO_PYTHON").unwrap_or("python3".into());
    let output = std::process::Command::new(&python).arg(script).args([model, env!("CARGO_BIN_EXE_beo"), shapes, "validation"]).output();
    match output {
        Ok(output) if output.status.code() == Some(77) => skipped(text(&output.stdout).trim()),
        Ok(output) => assert!(output.status.success(), "{}{}", text(&output.stdout), text(&output.stderr)),
        Err(error) => skipped(&format!("{python} cannot be started ({error})")),
    }
}
