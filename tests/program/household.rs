//! Made-up household things: what `beo generate` writes is learned from, and `beo demo` circles them with processes of its own.

use crate::harness::{RESOLUTION, run, text};
use beo::frames::{FolderOptions, FrameFolder};
use beo_shapes::{household, parse_binvox, parse_ply};
use std::path::Path;

fn generate(out: &Path, more: &[&str]) -> std::process::Output {
    let mut arguments = vec!["generate", "household", "--out", out.to_str().unwrap()];
    arguments.extend(more);
    run(arguments)
}

fn files(folder: &Path) -> Vec<String> {
    let mut names: Vec<_> = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

#[test]
fn generated_shapes_are_those_of_the_seed_and_in_their_places() {
    let folder = tempfile::tempdir().unwrap();
    let [one, same, other, meshes] = ["one", "same", "other", "meshes"].map(|name| folder.path().join(name));
    let size = ["--count", "2", "--test", "1", "--resolution", "16"];
    for (out, seed) in [(&one, "4"), (&same, "4"), (&other, "5")] {
        let output = generate(out, &[&size[..], &["--seed", seed]].concat());
        assert!(output.status.success(), "{}", text(&output.stderr));
        assert!(text(&output.stdout).contains("21 shapes of 7 classes"), "{}", text(&output.stdout));
    }
    for class in household::CLASSES {
        assert_eq!(files(&one.join(class).join("train")), ["00001.binvox", "00002.binvox"]);
        let read = |root: &Path, name: &str| std::fs::read(root.join(class).join(name)).unwrap();
        let all = ["train/00001.binvox", "train/00002.binvox", "test/00001.binvox"];
        assert!(all.iter().all(|name| read(&one, name) == read(&same, name)));
        assert!(all.iter().any(|name| read(&one, name) != read(&other, name)), "{class}");
        assert_eq!(parse_binvox(&read(&one, all[0])).unwrap().dims(), beo_core::grid::Dims::cube(16).unwrap());
    }
    // Meshes are in metres: what is learned from them is what is learned from the voxels.
    assert!(generate(&meshes, &["--count", "1", "--seed", "4", "--format", "ply"]).status.success());
    let mesh = parse_ply(&std::fs::read(meshes.join("mug/train/00001.ply")).unwrap()).unwrap();
    let height = mesh.bounds()[1].z - mesh.bounds()[0].z;
    assert!((0.07..0.12).contains(&height), "{height} m");
    let dims = beo_core::grid::Dims::cube(16).unwrap();
    let voxels = beo_shapes::voxelise(&mesh, dims, beo_shapes::longest_side(dims));
    let written = parse_binvox(&std::fs::read(one.join("mug/train/00001.binvox")).unwrap()).unwrap();
    // Coordinates are written to a tenth of a micrometre, so that a surface may touch another voxel.
    assert!(voxels.overlap(&written) as f64 > 0.99 * written.count() as f64);
}

#[test]
fn shapes_are_not_mixed_with_those_of_an_earlier_run() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("shapes");
    assert!(generate(&out, &["--count", "1", "--resolution", "16"]).status.success());
    let again = generate(&out, &["--count", "1", "--resolution", "16"]);
    assert_eq!(again.status.code(), Some(1));
    assert!(text(&again.stderr).contains("bottle/train is not empty"), "{}", text(&again.stderr));
    for (arguments, problem) in [
        (["--count", "0"], "--count 0"),
        (["--count", "100001"], "--count 100001"),
        (["--resolution", "7"], "8 to 256"),
        (["--format", "obj"], "binvox, ply"),
    ] {
        let output = generate(&folder.path().join("none"), &arguments);
        assert_eq!(output.status.code(), Some(2));
        assert!(text(&output.stderr).contains(problem), "{}", text(&output.stderr));
    }
    let furniture = run(["generate", "furniture", "--out", out.to_str().unwrap(), "--format", "ply"]);
    assert_eq!(furniture.status.code(), Some(2));
    assert!(!folder.path().join("none").exists());
}

#[test]
fn the_demo_perceives_every_view_and_leaves_frames_that_can_be_replayed() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (shapes, model, pictures) = (path("shapes"), path("model.safetensors"), path("demo"));
    let resolution = RESOLUTION.to_string();
    assert!(generate(Path::new(&shapes), &["--count", "14", "--resolution", &resolution]).status.success());
    let trained = run(["train", &shapes, "--out", &model, "--resolution", &resolution, "--least", "5"]);
    assert!(trained.status.success(), "{}", text(&trained.stderr));
    let output = run(["demo", "--model", &model, "--png", &pictures, "--objects", "box,can", "--views", "2"]);
    let said = text(&output.stdout);
    assert!(output.status.success(), "{said}{}", text(&output.stderr));
    assert_eq!(said.lines().filter(|line| line.contains(" mm (") && line.contains("from ")).count(), 4, "{said}");
    assert!(said.contains("of 4 views named as they were made"), "{said}");
    let names = files(Path::new(&pictures));
    for number in 1..=4 {
        let of = |end: &str| names.iter().filter(|name| name.starts_with(&format!("{number:04}-")) && name.ends_with(end)).count();
        assert_eq!((of("-depth.png"), of(".png")), (1, 2), "{names:?}");
    }
    // The frames are those of any camera.
    let frames = FrameFolder::open(&Path::new(&pictures).join("frames"), FolderOptions::default()).unwrap();
    assert_eq!(frames.count(), 4);
    for index in 0..4 {
        let captured = frames.read(index).unwrap();
        let frame = captured.frame();
        assert!(frame.intrinsics().is_distorted());
        assert_eq!(frame.objects(Some(1)), [if index < 2 { 2 } else { 3 }]);
        let readings: Vec<f64> = (0..frame.labels().len()).filter_map(|pixel| frame.depth(pixel)).collect();
        assert!(readings.len() > 100_000 && readings.iter().all(|z| (0.35..1.6).contains(z)));
    }
    let replayed = run(["camera", &path("demo/frames"), "--support-label", "1", "--out", &path("grids")]);
    assert!(replayed.status.success(), "{}", text(&replayed.stderr));
    assert!(text(&replayed.stdout).contains("4 grids written"), "{}", text(&replayed.stdout));
}
