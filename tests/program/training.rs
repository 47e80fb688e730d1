//! Training by the program: what it reports, and that it always gives the same model.

use crate::harness::{RESOLUTION, library, run, shape, small_library, text};

#[test]
fn the_same_shapes_and_seed_give_the_same_file_whatever_the_threads() {
    let folder = tempfile::tempdir().unwrap();
    let shapes = folder.path().join("shapes");
    small_library(&shapes);
    let train = |out: &str, threads: &str, seed: &str| {
        let out = folder.path().join(out);
        let (shapes, resolution) = (shapes.to_str().unwrap(), RESOLUTION.to_string());
        let output = run([
            "train",
            shapes,
            "--out",
            out.to_str().unwrap(),
            "--resolution",
            &resolution,
            "--least",
            "5",
            "--threads",
            threads,
            "--seed",
            seed,
        ]);
        assert!(output.status.success(), "{}", text(&output.stderr));
        std::fs::read(out).unwrap()
    };
    let one = train("one.safetensors", "1", "0");
    assert_eq!(one, train("three.safetensors", "3", "0"));
    assert_ne!(one, train("other.safetensors", "2", "1"));
}

/// As few shapes of a class as are allowed, and as many components as they span: nothing is left from which to learn the noise.
#[test]
fn four_shapes_of_a_class_are_enough_whatever_the_folds() {
    let folder = tempfile::tempdir().unwrap();
    let shapes = folder.path().join("shapes");
    for class in ["chair", "table", "bed"] {
        let train = shapes.join(class).join("train");
        std::fs::create_dir_all(&train).unwrap();
        (0..4).for_each(|seed| drop(shape(&train, class, seed)));
    }
    let out = folder.path().join("m.safetensors");
    let (shapes, out, resolution) = (shapes.to_str().unwrap(), out.to_str().unwrap(), RESOLUTION.to_string());
    for folds in ["2", "3", "4"] {
        let trained = run(["train", shapes, "--out", out, "--resolution", &resolution, "--folds", folds]);
        assert!(trained.status.success(), "{folds}: {}", text(&trained.stderr));
        let query = format!("{shapes}/chair/train/chair-1.binvox");
        let answer = run(["perceive", &query, "--model", out, "--json"]);
        assert!(answer.status.success(), "{}", text(&answer.stderr));
    }
}

#[test]
fn useless_files_are_named_and_counted_and_do_not_stop_the_training() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path();
    library(root);
    std::fs::write(root.join("chair/train/broken.off"), "no mesh").unwrap();
    std::fs::copy(root.join("table/train/table-3.binvox"), root.join("table/train/twin.binvox")).unwrap();
    let out = root.join("m.safetensors");
    let resolution = RESOLUTION.to_string();
    let train = || run(["train", root.to_str().unwrap(), "--out", out.to_str().unwrap(), "--resolution", &resolution, "--least", "5"]);
    let output = train();
    let message = text(&output.stderr);
    assert!(output.status.success(), "{message}");
    assert!(message.contains("chair/train/broken.off: unreadable"), "{message}");
    assert!(message.contains("table/train/twin.binvox: the same shape as table/train/table-3.binvox"), "{message}");
    // At this resolution the generator repeats itself now and then: those are duplicates too.
    let duplicates = message.lines().filter(|line| line.contains("the same shape as")).count();
    let summary = format!("skipped {} of 122 files: 1 unreadable, 0 empty or nearly so, {duplicates} duplicates", duplicates + 1);
    assert!(message.contains(&summary), "{message}");

    // A class with too few shapes is fatal.
    let poor = root.join("lamp/train");
    std::fs::create_dir_all(&poor).unwrap();
    shape(&poor, "chair", 77);
    let output = train();
    assert_eq!(output.status.code(), Some(1));
    let message = text(&output.stderr);
    assert!(message.lines().last().unwrap().contains("lamp"), "{message}");
}

/// Nothing but files in a folder: one class, named after the folder.
#[test]
fn a_flat_folder_is_learned_as_one_class() {
    let folder = tempfile::tempdir().unwrap();
    let chairs = folder.path().join("chair");
    std::fs::create_dir_all(&chairs).unwrap();
    (0..8).for_each(|seed| drop(shape(&chairs, "chair", seed)));
    let out = folder.path().join("m.safetensors");
    let (chairs, out, resolution) = (chairs.to_str().unwrap(), out.to_str().unwrap(), RESOLUTION.to_string());
    let train = |more: &[&str]| run(["train", chairs, "--out", out, "--resolution", &resolution].iter().chain(more));
    let refused = train(&["--split", "train"]);
    assert_eq!(refused.status.code(), Some(1));
    let message = text(&refused.stderr);
    assert!(message.contains("chair is a folder of shapes without splits") && message.lines().count() == 1, "{message}");

    let trained = train(&[]);
    assert!(trained.status.success(), "{}", text(&trained.stderr));
    let inspected = text(&run(["inspect", out]).stdout);
    assert!(inspected.contains("8 shapes in 1 classes, no splits"), "{inspected}");
    let eval = |dir: &str| run(["eval", dir, "--model", out]);
    let measured = eval(chairs);
    assert!(measured.status.success(), "{}", text(&measured.stderr));
    let parent = folder.path().join("all");
    library(&parent);
    let refused = eval(parent.to_str().unwrap());
    assert_eq!(refused.status.code(), Some(2));
    assert!(text(&refused.stderr).contains("with --split: train"), "{}", text(&refused.stderr));
}
