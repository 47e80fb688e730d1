//! `beo bench scale`: that it measures what it says. How long anything takes is not tested.

use super::{refused, report};
use crate::harness::{run, text};
use serde_json::Value;

#[test]
fn all_series_are_measured_and_drawn() {
    let folder = tempfile::tempdir().unwrap();
    let outcome = report(&["scale", "--quick", "--png", folder.path().to_str().unwrap()]);
    assert_eq!(outcome["quick"], true);
    let cores = outcome["machine"]["cores"].as_u64().unwrap();
    let series = outcome["series"].as_array().unwrap();
    let sizes = |series: &Value| -> Vec<Vec<f64>> {
        let of_line = |line: &Value| line["points"].as_array().unwrap().iter().map(|p| p[0].as_f64().unwrap()).collect();
        series["lines"].as_array().unwrap().iter().map(of_line).collect()
    };
    let mut expected = vec![
        ("classes", vec![vec![2.0, 4.0]; 3]),
        ("components of a class", vec![vec![3.0, 6.0]; 3]),
        ("voxels along a side", vec![vec![10.0, 14.0]; 3]),
        ("voxels along a side, learning", vec![vec![10.0, 14.0]; 5]),
        ("shapes", vec![vec![25.0, 40.0]; 5]),
        ("share of voxels hidden", vec![vec![0.2, 0.6]; 4]),
        ("subscribers", vec![vec![1.0, 2.0]; 2]),
        ("classes before a camera", vec![vec![2.0, 3.0]; 2]),
        ("voxels along a side before a camera", vec![vec![10.0, 12.0]; 2]),
    ];
    for measured in series.iter().filter(|s| s["name"] != "threads") {
        let (name, of_lines) = expected.remove(0);
        assert_eq!((measured["name"].as_str().unwrap(), sizes(measured)), (name, of_lines));
    }
    assert!(expected.is_empty());
    let threads = series.iter().find(|s| s["name"] == "threads").unwrap();
    assert_eq!(sizes(threads)[0].last(), Some(&(cores as f64)));
    for line in series.iter().flat_map(|s| s["lines"].as_array().unwrap()) {
        let values: Vec<f64> = line["points"].as_array().unwrap().iter().map(|p| p[1].as_f64().unwrap()).collect();
        // Of small models the system may not tell how much memory they take.
        let least = if line["unit"] == "MB" { 0.0 } else { f64::MIN_POSITIVE };
        assert!(values.iter().all(|v| *v >= least), "{line}");
        assert_eq!(line["exponent"].is_f64(), values.iter().filter(|v| **v > 0.0).count() > 1, "{line}");
    }
    for name in
        ["classes", "basis", "resolution", "training", "shapes", "unknown", "threads", "subscribers", "camera-classes", "camera-resolution"]
    {
        assert!(folder.path().join(format!("scale-{name}.png")).metadata().unwrap().len() > 1000, "{name}");
    }
}

#[test]
fn one_series_is_a_table_and_an_unknown_one_is_refused() {
    let output = run(["bench", "scale", "--quick", "--only", "subscribers"]);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let table = text(&output.stdout);
    assert!(table.contains("subscribers (percept and completion of 12×12×12") && table.contains("read by all"), "{table}");
    assert!(!table.contains("resolution"));
    refused(&[(&["scale", "--only", "weather"], 2, "weather")]);
}
