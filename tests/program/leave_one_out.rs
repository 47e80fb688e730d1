//! `beo eval --leave-one-out` on made-up shapes.

use crate::harness::{RESOLUTION, run, shape, text};
use serde_json::Value;
use std::path::{Path, PathBuf};

/// A flat folder of so many chairs.
fn chairs(root: &Path, count: u64) -> PathBuf {
    let folder = root.join("chairs");
    std::fs::create_dir_all(&folder).unwrap();
    (0..count).for_each(|seed| drop(shape(&folder, "chair", seed)));
    folder
}

fn arguments<'a>(folder: &'a Path, resolution: &'a str, more: &[&'a str]) -> Vec<&'a str> {
    [&["eval", "--leave-one-out", folder.to_str().unwrap(), "--resolution", resolution], more].concat()
}

#[test]
fn shapes_are_left_out_with_the_same_errors_whatever_the_threads() {
    let scratch = tempfile::tempdir().unwrap();
    let folder = chairs(scratch.path(), 9);
    let (json, png) = (scratch.path().join("o.json"), scratch.path().join("pictures"));
    let (json, png, resolution) = (json.to_str().unwrap(), png.to_str().unwrap(), RESOLUTION.to_string());
    let outcome = |more: &[&str]| -> (Value, String) {
        let output = run(arguments(&folder, &resolution, &[more, &["--json", json]].concat()));
        assert!(output.status.success(), "{}", text(&output.stderr));
        let mut outcome: Value = serde_json::from_slice(&std::fs::read(json).unwrap()).unwrap();
        for shape in outcome["resolutions"][0]["per_shape"].as_array_mut().unwrap() {
            for time in ["train_s", "query_ms"] {
                assert!(shape.as_object_mut().unwrap().remove(time).unwrap().as_f64().unwrap() > 0.0);
            }
        }
        (outcome, text(&output.stdout))
    };
    let (one, table) = outcome(&["--threads", "1", "--png", png]);
    assert_eq!(one, outcome(&["--threads", "3"]).0);
    let found = &one["resolutions"][0];
    let shapes = found["shapes"].as_u64().unwrap() as usize;
    assert_eq!((&one["view"], found["resolution"].as_u64()), (&"top".into(), Some(RESOLUTION as u64)));
    assert_eq!(found["per_shape"].as_array().map(Vec::len), Some(shapes));
    let first = &found["per_shape"][0];
    assert_eq!((&first["file"], &first["class"]), (&"chairs/chair-0.binvox".into(), &"chairs".into()));
    assert_eq!(first["learned_from"].as_u64(), Some(shapes as u64 - 1));
    // The mean over the shapes is what the table says.
    let all: Vec<f64> = found["per_shape"].as_array().unwrap().iter().map(|s| s["beo"]["iou_unknown"].as_f64().unwrap()).collect();
    let mean = all.iter().sum::<f64>() / shapes as f64;
    assert!((found["summary"]["beo"]["iou_unknown"]["mean"].as_f64().unwrap() - mean).abs() < 1e-9);
    assert!(table.contains(&format!("{mean:.3} ±")), "{table}");
    assert!(found["paired"]["nearest"]["iou_unknown"]["p"].as_f64().is_some_and(|p| p > 0.0 && p <= 1.0));
    for file in [&format!("{RESOLUTION}/chairs-chair-0.png"), "iou_unknown-shapes.png", "l2-shapes.png"] {
        assert!(Path::new(png).join(file).exists(), "{file}");
    }

    let (side, _) = outcome(&["--view", "side", "--limit", "2"]);
    let found = &side["resolutions"][0];
    assert_eq!((&side["view"], found["shapes"].as_u64()), (&"side".into(), Some(2)));
    assert_eq!(
        found["per_shape"][1]["learned_from"].as_u64(),
        Some(shapes as u64 - 1),
        "a sample is left out, all others are learned from"
    );
}

#[test]
fn several_classes_each_learn_from_their_own() {
    let scratch = tempfile::tempdir().unwrap();
    for class in ["chair", "table"] {
        let folder = scratch.path().join(class).join("train");
        std::fs::create_dir_all(&folder).unwrap();
        (0..6).for_each(|seed| drop(shape(&folder, class, seed)));
    }
    let json = scratch.path().join("o.json");
    let resolution = RESOLUTION.to_string();
    let output = run(arguments(scratch.path(), &resolution, &["--json", json.to_str().unwrap(), "--limit", "4"]));
    assert!(output.status.success(), "{}", text(&output.stderr));
    let outcome: Value = serde_json::from_slice(&std::fs::read(json).unwrap()).unwrap();
    let shapes = outcome["resolutions"][0]["per_shape"].as_array().unwrap();
    assert_eq!(shapes.len(), 4);
    for shape in shapes {
        let class = shape["class"].as_str().unwrap();
        assert!(shape["learned_from"].as_u64().unwrap() <= 5);
        for file in ["file", "nearest_file", "nearest_by_oracle_file"] {
            assert!(shape[file].as_str().unwrap().starts_with(class), "{shape}");
        }
    }
}

#[test]
fn what_cannot_be_left_out_is_one_line() {
    let scratch = tempfile::tempdir().unwrap();
    let folder = chairs(scratch.path(), 4);
    let resolution = RESOLUTION.to_string();
    let fails = |arguments: &[&str], code: i32, words: &[&str]| {
        let output = run(arguments);
        let message = text(&output.stderr);
        assert_eq!(output.status.code(), Some(code), "{arguments:?}: {message}");
        for word in words {
            assert!(message.contains(word), "{arguments:?}: {message}");
        }
    };
    fails(&arguments(&folder, &resolution, &[]), 1, &["class `chairs` has 4 usable shapes of 4 files, at least 5 are needed"]);
    let folder = chairs(scratch.path(), 9);
    let root = folder.to_str().unwrap();
    for (resolution, more, words) in [
        ("7", &[][..], &["--resolution 7", "8 to 256"][..]),
        ("30,300", &[], &["--resolution 300", "8 to 256"]),
        ("30", &["--limit", "0"], &["--limit 0"]),
        ("30,40", &["--longest", "20"], &["--longest", "one --resolution"]),
        ("30", &["--longest", "31"], &["--longest 31"]),
        ("30", &["--view", "camera"], &["--view top", "--view side"]),
        ("30", &["--model", "m"], &["--model", "--leave-one-out"]),
        ("30", &["--pose", "yaw"], &["--pose", "--leave-one-out"]),
        ("30", &["--fuse", "2"], &["--fuse", "--leave-one-out"]),
    ] {
        fails(&arguments(&folder, resolution, more), 2, words);
    }
    fails(&["eval", root], 2, &["--model"]);
    fails(&["eval", root, "--model", "m", "--resolution", "30"], 2, &["--leave-one-out"]);
    fails(&["eval", root, "--model", "m", "--view", "side"], 2, &["--view side", "--leave-one-out"]);
    fails(&arguments(&folder, &resolution, &["--json", "/nonexistent/o.json"]), 1, &["/nonexistent/o.json"]);
    // Voxel files have one resolution; one of another kind is not passed over.
    fails(&arguments(&folder, "31", &[]), 1, &["--resample"]);
    let other = crate::harness::dims();
    let small = beo_core::grid::Dims::cube(other.x() - 1).unwrap();
    let mut bytes = Vec::new();
    beo_shapes::write_binvox(&mut bytes, &beo_shapes::furniture::make("chair", small, 1).unwrap()).unwrap();
    std::fs::write(folder.join("small.binvox"), bytes).unwrap();
    fails(&arguments(&folder, &resolution, &[]), 1, &["chairs/small.binvox", "--resample"]);
}
