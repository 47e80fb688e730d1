//! Grids that are too large to be searched: the basis is read in place, poses are searched on smaller grids that the model keeps.

use crate::harness::{PATIENCE, Running, beo, instance, run, text};
use beo_core::grid::{Dims, Observation, Turn, View, yaw};
use beo_ipc::{InstanceName, ObservationHeader, PoseSearch, Producer, Subscriber, SubscriberOptions, tasks};
use beo_shapes::{furniture, write_binvox};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::time::Instant;

/// Just above what is searched itself.
const SIDE: usize = 72;
/// Shapes of each class.
const SHAPES: u64 = 6;

fn dims() -> Dims {
    Dims::cube(SIDE).unwrap()
}

/// A file of a made-up shape, turned about the vertical.
fn write(path: &Path, class: &str, seed: u64, angle: f64) {
    let object = Turn::new(dims(), &yaw(angle)).occupancy(&furniture::make(class, dims(), seed).unwrap());
    let mut bytes = Vec::new();
    write_binvox(&mut bytes, &object).unwrap();
    std::fs::write(path, bytes).unwrap();
}

/// The messages of training, and the model.
fn trained() -> &'static (String, PathBuf) {
    static MODEL: OnceLock<(tempfile::TempDir, (String, PathBuf))> = OnceLock::new();
    let (_, trained) = MODEL.get_or_init(|| {
        let folder = tempfile::tempdir().unwrap();
        let shapes = folder.path().join("shapes");
        for class in ["chair", "table"] {
            let split = shapes.join(class).join("train");
            std::fs::create_dir_all(&split).unwrap();
            (0..SHAPES).for_each(|seed| write(&split.join(format!("{seed}.binvox")), class, seed, 0.0));
        }
        let out = folder.path().join("large.safetensors");
        let (shapes, side) = (shapes.to_str().unwrap().to_owned(), SIDE.to_string());
        let output = run(["train", &shapes, "--out", out.to_str().unwrap(), "--resolution", &side, "--folds", "2"]);
        assert!(output.status.success(), "{}", text(&output.stderr));
        (folder, (text(&output.stdout), out))
    });
    trained
}

#[test]
fn learning_tells_its_passes_and_the_model_its_grids() {
    let (said, model) = trained();
    for part in ["on a grid of 32: ", "on a grid of 64: ", "on a grid of 72: forming W', 3 times", "writing the model"] {
        assert!(said.contains(part), "`{part}` is not in: {said}");
    }
    let output = run(["bench", "query", "--model", model.to_str().unwrap()]);
    assert_eq!(output.status.code(), Some(2), "{}", text(&output.stderr));
    assert!(text(&output.stderr).contains("`beo bench large`"), "{}", text(&output.stderr));
    // Densities of turned objects are learned where poses are searched.
    assert_eq!(said.matches("learning views from all sides").count(), 2, "{said}");
    let output = run(["inspect", "--verify", model.to_str().unwrap()]);
    let said = text(&output.stdout);
    for part in ["72×72×72", "poses     searched on 32×32×32 and 64×64×64", "% of the grid", "all as written"] {
        assert!(said.contains(part), "`{part}` is not in: {said}");
    }
}

#[test]
fn class_pose_and_completion_of_an_unseen_object() {
    let (_, model) = trained();
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("chair.binvox");
    write(&file, "chair", 100, 0.0);
    let ask = |arguments: &[&str]| {
        let mut all = vec!["perceive", file.to_str().unwrap(), "--model", model.to_str().unwrap(), "--json"];
        all.extend(arguments);
        let output = run(all);
        assert!(output.status.success(), "{}", text(&output.stderr));
        serde_json::from_str::<serde_json::Value>(&text(&output.stdout)).unwrap()
    };
    let known = ask(&[]);
    assert_eq!(known["class"], "chair");
    let filled = known["completion"]["filled"].as_f64().unwrap();
    let truth = furniture::make("chair", dims(), 100).unwrap().count() as f64;
    assert!((0.5..2.0).contains(&(filled / truth)), "{filled} of {truth}");
    // Pages that are given back come again: the answer is the same.
    assert_eq!(ask(&["--memory", "1000"]), known);
    // Over SO(3) half a dozen shapes do not tell the back of another: there one that was learned is turned.
    for (search, seed) in [("yaw", 100), ("full", 3)] {
        write(&file, "chair", seed, 40_f64.to_radians());
        let turned = ask(&["--pose", search]);
        assert_eq!(turned["class"], "chair", "{search}");
        let q: Vec<f64> = turned["hypotheses"][0]["rotation"].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect();
        let rotation = beo_core::grid::from_xyzw([q[0], q[1], q[2], q[3]]);
        let error = rotation.angle_to(&yaw(40_f64.to_radians())).to_degrees();
        assert!(error < 3.0, "{search}: {error}");
    }
}

#[test]
fn too_little_memory_is_told_before_the_model_is_read() {
    let (_, model) = trained();
    let output = run(["serve", "--model", model.to_str().unwrap(), "--memory", "1", "--instance", &instance()]);
    let message = text(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{message}");
    assert!(message.contains("MB of memory, 1 MB are allowed") && message.trim().lines().count() == 1, "{message}");
}

#[test]
fn a_damaged_level_or_footprint_is_refused() {
    let (_, model) = trained();
    let bytes = std::fs::read(model).unwrap();
    let header = 8 + u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
    let tensors = safetensors::SafeTensors::deserialize(&bytes).unwrap();
    let folder = tempfile::tempdir().unwrap();
    for name in ["level_32", "level_64", "basis_footprint", "basis_gram", "basis"] {
        let at = tensors.tensor(name).unwrap().data().as_ptr() as usize - bytes.as_ptr() as usize;
        assert!(at >= header);
        let mut damaged = bytes.clone();
        damaged[at + 9] ^= 4;
        let path = folder.path().join("damaged.safetensors");
        std::fs::write(&path, &damaged).unwrap();
        let output = run(["inspect", path.to_str().unwrap()]);
        let message = text(&output.stderr);
        assert_eq!(output.status.code(), Some(1), "{name}: {message}");
        assert!(message.contains(&format!("tensor `{name}` does not match its checksum")), "{name}: {message}");
    }
}

#[test]
fn a_daemon_answers_large_grids_in_shared_memory() {
    let (_, model) = trained();
    let name = instance();
    let daemon = Running::start(beo(["serve", "--model", model.to_str().unwrap(), "--instance", &name, "--memory", "500"]));
    assert!(daemon.line().starts_with("serving"));
    let instance = InstanceName::new(&name).unwrap();
    let subscriber = Subscriber::open_within(&instance, &SubscriberOptions { completion: true }, PATIENCE).unwrap();
    let header = ObservationHeader::new([SIDE as u32; 3]);
    let producer = Producer::open_within(&instance, &header, PATIENCE).unwrap();
    let object = furniture::make("table", dims(), 101).unwrap();
    for turned in [0.0, 1.0] {
        let seen: Observation = View::Top.of(&Turn::new(dims(), &yaw(turned)).occupancy(&object));
        let mut loan = producer.loan().unwrap();
        if turned != 0.0 {
            loan.header_mut().pose_search = PoseSearch::Yaw.code();
        }
        seen.write(loan.voxels_mut());
        let sequence = loan.send().unwrap().sequence;
        let start = Instant::now();
        let percept = loop {
            match subscriber.take_percept().unwrap() {
                Some(percept) if percept.sequence == sequence => break percept,
                Some(_) => {}
                None => {
                    assert!(start.elapsed() < PATIENCE, "no answer");
                    subscriber.wait(std::time::Duration::from_millis(50)).unwrap();
                }
            }
        };
        assert_eq!((percept.status, percept.class_index), (0, 1), "{turned}");
        assert_ne!(percept.tasks & tasks::COMPLETION, 0);
        let completion = subscriber.take_completion().unwrap().unwrap();
        assert_eq!(completion.header().sequence, sequence);
        // What was observed stays as it was seen, and is certain.
        for voxel in seen.known().ones() {
            let expected = if seen.filled().contains(voxel) { 255 } else { 0 };
            assert_eq!((completion.occupancy()[voxel], completion.deviation()[voxel]), (expected, 0), "{turned}: voxel {voxel}");
        }
        assert!((0..dims().voxels()).any(|voxel| completion.deviation()[voxel] > 0), "{turned}");
    }
}

#[test]
fn queries_of_a_large_grid_are_timed_beside_a_read_of_the_basis() {
    let (_, model) = trained();
    let folder = tempfile::tempdir().unwrap();
    (100..102).for_each(|seed| write(&folder.path().join(format!("{seed}.binvox")), "chair", seed, 0.0));
    let output =
        run(["bench", "large", folder.path().to_str().unwrap(), "--model", model.to_str().unwrap(), "--repeats", "1", "--known", "--json"]);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let outcome: serde_json::Value = serde_json::from_str(&text(&output.stdout)).unwrap();
    assert_eq!(outcome["dims"], serde_json::json!([SIDE, SIDE, SIDE]));
    let stages = outcome["stages"].as_array().unwrap();
    assert_eq!(stages.len(), 4);
    assert!(stages.iter().all(|stage| stage[1]["count"] == 2), "{outcome}");
    assert!(outcome["ratio"].as_f64().unwrap() > 0.0 && outcome["read_basis"]["count"] == 1, "{outcome}");
}
