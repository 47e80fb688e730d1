//! Views of cameras, from shapes to figures: `beo generate`, `train --views camera`, `eval --view camera`.

use crate::harness::{run, small_library, text};
use serde_json::Value;
use std::path::Path;

fn train(folder: &Path, out: &Path, threads: &str) {
    let output = trained(folder, out, &["--threads", threads]);
    assert!(output.status.success(), "{}", text(&output.stderr));
}

fn trained(folder: &Path, out: &Path, more: &[&str]) -> std::process::Output {
    let arguments = ["train", "--resolution", "16", "--least", "5", "--most", "20", "--views", "camera", "--elevations", "35"];
    let all = arguments.iter().chain(more).map(std::ffi::OsStr::new);
    run(all.chain(["--out".as_ref(), out.as_os_str(), folder.as_os_str()]))
}

#[test]
fn cameras_are_learned_whatever_the_threads_and_evaluated_by_elevation_and_views() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let shapes = at("shapes");
    let made = run([
        "generate".as_ref(),
        "furniture".as_ref(),
        "--count".as_ref(),
        "12".as_ref(),
        "--test".as_ref(),
        "2".as_ref(),
        "--resolution".as_ref(),
        "16".as_ref(),
        "--out".as_ref(),
        shapes.as_os_str(),
    ]);
    assert!(made.status.success(), "{}", text(&made.stderr));
    let few = at("few");
    small_library(&few);
    train(&few, &at("one.safetensors"), "1");
    train(&few, &at("two.safetensors"), "2");
    assert!(std::fs::read(at("one.safetensors")).unwrap() == std::fs::read(at("two.safetensors")).unwrap(), "the models differ");

    let model = at("model.safetensors");
    train(&shapes, &model, "2");
    let evaluate = |more: &[&str]| -> Value {
        let json = at("eval.json");
        let pictures = at("pictures");
        let mut arguments =
            vec!["eval".as_ref(), shapes.as_os_str(), "--split".as_ref(), "test".as_ref(), "--view".as_ref(), "camera".as_ref()];
        arguments.extend([
            "--model".as_ref(),
            model.as_os_str(),
            "--json".as_ref(),
            json.as_os_str(),
            "--png".as_ref(),
            pictures.as_os_str(),
        ]);
        arguments.extend(more.iter().map(std::ffi::OsStr::new));
        let output = run(arguments);
        assert!(output.status.success(), "{}", text(&output.stderr));
        serde_json::from_slice(&std::fs::read(json).unwrap()).unwrap()
    };
    let found = evaluate(&["--pose", "yaw", "--find-size", "--azimuths", "2"]);
    assert_eq!((&found["view"], &found["elevation_deg"], &found["queries"]), (&"camera".into(), &30.0.into(), &40.into()));
    let number = |value: &Value| value.as_f64().unwrap();
    assert!(number(&found["accuracy"]) > 0.4, "{}", found["accuracy"]);
    assert!(
        number(&found["placement"]["centre_median"]) < 0.1 && number(&found["placement"]["size_median"]) < 0.15,
        "{}",
        found["placement"]
    );

    let by_elevation = evaluate(&["--elevation", "25,45", "--azimuths", "1"]);
    assert_eq!(by_elevation.as_array().map(Vec::len), Some(2));
    assert!(at("pictures/elevation.png").exists());
    // More views of the same objects hide less.
    let by_views = evaluate(&["--method", "evidence", "--azimuths", "1", "--fuse", "1,4"]);
    let iou = |views: usize| number(&by_views[views]["completion"]["iou_all"]);
    assert!(iou(1) > iou(0), "{} {}", iou(0), iou(1));
    assert!(at("pictures/views.png").exists());
}

#[test]
fn wrong_viewpoints_are_wrong_usage() {
    for (arguments, word) in [
        (&["--view", "camera", "--elevation", "95"][..], "--elevation"),
        (&["--view", "camera", "--azimuths", "0"], "--azimuths"),
        (&["--view", "camera", "--fuse", "65"], "--fuse"),
        (&["--view", "camera", "--distance", "0.5"], "--distance"),
        (&["--view", "camera", "--pose", "full", "--find-size"], "--find-size"),
    ] {
        let output = run(["eval", "nowhere", "--model", "none", "--split", "test"].iter().chain(arguments));
        assert_eq!(output.status.code(), Some(2));
        assert!(text(&output.stderr).contains(word), "{}", text(&output.stderr));
    }
    let output = run(["train", "nowhere", "--out", "/nonexistent/m", "--views", "camera", "--elevations", "99"]);
    assert_eq!(output.status.code(), Some(2));
}

/// A word about the unit in the folder changes nothing by itself.
#[test]
fn sizes_resting_poses_and_sensors_are_learned_only_where_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let shapes = at("shapes");
    let of = shapes.to_str().unwrap();
    let made = run(["generate", "household", "--count", "8", "--test", "1", "--resolution", "16", "--out", of]);
    assert!(made.status.success(), "{}", text(&made.stderr));
    ["bottle", "bowl", "cutlery_box", "mug", "plate"].iter().for_each(|class| std::fs::remove_dir_all(shapes.join(class)).unwrap());
    assert_eq!(std::fs::read_to_string(shapes.join("units.txt")).unwrap(), "m\n");

    let [plain, again, resting] = ["plain", "again", "resting"].map(|name| at(&format!("{name}.safetensors")));
    let unsized_too = trained(&shapes, &plain, &["--units", "none"]);
    assert!(unsized_too.status.success(), "{}", text(&unsized_too.stderr));
    // The folder says its unit, and is believed unless told otherwise.
    let sized = at("sized.safetensors");
    train(&shapes, &sized, "2");
    let asked = ["--units", "folder", "--resting", "rest", "--sensors", "mixed"];
    let output = trained(&shapes, &resting, &asked);
    assert!(output.status.success(), "{}", text(&output.stderr));
    std::fs::remove_file(shapes.join("units.txt")).unwrap();
    train(&shapes, &again, "2");
    let has = |path: &Path, word: &[u8]| std::fs::read(path).unwrap().windows(word.len()).any(|at| at == word);
    assert!(std::fs::read(&plain).unwrap() == std::fs::read(&again).unwrap(), "without a unit the model is the same, whatever says so");
    assert!(has(&sized, b"size_weight"));
    for word in [&b"camera_components"[..], b"size_weight"] {
        assert_eq!((has(&plain, word), has(&resting, word)), (false, true), "{}", text(word));
    }

    let query = shapes.join("box/test/00001.binvox");
    let ask = |model: &Path, view: &str| {
        let [query, model] = [&query, model].map(|path| path.to_str().unwrap());
        run(["perceive", query, "--model", model, "--view", view, "--pose", "rest", "--json"])
    };
    let answer = ask(&resting, "camera");
    assert!(answer.status.success(), "{}", text(&answer.stderr));
    let line: Value = serde_json::from_slice(&answer.stdout).unwrap();
    assert!(line["resting_pose"].is_u64(), "{line}");

    let no_unit = trained(&shapes, &again, &["--units", "folder"]);
    let no_cameras = run(["train", of, "--resting", "rest", "--out", again.to_str().unwrap()]);
    for (output, problem) in [
        (ask(&plain, "camera"), "the model has learned no resting poses"),
        (ask(&resting, "top"), "add --view camera"),
        (no_unit, "units.txt names no unit"),
        (no_cameras, "--resting: cameras are not learned"),
    ] {
        let message = text(&output.stderr);
        assert!(output.status.code() == Some(2) && message.contains(problem), "{message}");
    }
}
