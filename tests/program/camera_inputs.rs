//! `beo camera` on the same scene in the forms in which people have it: whatever the form, the grids are the same.

use crate::camera::{FOCAL, SIZE, beo_camera, render, usual, write};
use crate::harness::{Running, beo, instance, run, serve, text};
use std::collections::BTreeMap;
use std::path::Path;

const PIXELS: usize = (SIZE[0] * SIZE[1]) as usize;

/// Depth in millimetres and labels 1 and 2 of the usual scene.
fn images() -> (Vec<u16>, Vec<u8>) {
    render(&usual())
}

/// Every file that is written for a folder of frames, with what the program said.
struct Outcome {
    code: Option<i32>,
    said: String,
    errors: String,
    grids: BTreeMap<String, Vec<u8>>,
}

fn replay(folder: &Path, arguments: &[&str]) -> Outcome {
    let out = tempfile::tempdir().unwrap();
    let all = [&["--out", out.path().to_str().unwrap(), "--resolution", "20"], arguments].concat();
    let (code, said, errors) = beo_camera(folder, &all);
    let files = std::fs::read_dir(out.path()).unwrap().map(|entry| entry.unwrap());
    let grids = files.map(|file| (file.file_name().into_string().unwrap(), std::fs::read(file.path()).unwrap())).collect();
    Outcome { code, said, errors, grids }
}

/// The grids of the usual scene as the flat layout has it.
fn twin() -> BTreeMap<String, Vec<u8>> {
    let folder = tempfile::tempdir().unwrap();
    let (depth, labels) = images();
    write(folder.path(), "a", &depth, &labels);
    let grids = replay(folder.path(), &[]).grids;
    assert_eq!(grids.keys().collect::<Vec<_>>(), ["a-1.json", "a-1.npy", "a-2.json", "a-2.npy"]);
    grids
}

/// The grid of the first object, where no other is labelled: what has no label may be what things stand on.
fn twin_of_the_first() -> BTreeMap<String, Vec<u8>> {
    let folder = tempfile::tempdir().unwrap();
    let (depth, labels) = images();
    write(folder.path(), "a", &depth, &labels.iter().map(|label| u8::from(*label == 1)).collect::<Vec<u8>>());
    replay(folder.path(), &[]).grids
}

fn assert_twins(outcome: &Outcome, twin: &BTreeMap<String, Vec<u8>>, what: &str) {
    assert_eq!(outcome.code, Some(0), "{what}: {}{}", outcome.said, outcome.errors);
    assert!(outcome.grids == *twin, "{what}: {:?}\n{}{}", outcome.grids.keys(), outcome.said, outcome.errors);
}

fn png(path: &Path, colour: png::ColorType, depth: png::BitDepth, data: &[u8]) {
    let mut encoder = png::Encoder::new(std::fs::File::create(path).unwrap(), SIZE[0], SIZE[1]);
    encoder.set_color(colour);
    encoder.set_depth(depth);
    if colour == png::ColorType::Indexed {
        encoder.set_palette((0..=255).flat_map(|i| [if i == 0 { 0 } else { 255 - i }, i, 0]).collect::<Vec<u8>>());
    }
    encoder.write_header().unwrap().write_image_data(data).unwrap();
}

/// A NumPy array of the image's size.
fn npy(path: &Path, descr: &str, data: impl IntoIterator<Item = u8>) {
    let header = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': ({}, {}), }}\n", SIZE[1], SIZE[0]);
    let mut bytes = [b"\x93NUMPY\x01\x00", &(header.len() as u16).to_le_bytes()[..], header.as_bytes()].concat();
    bytes.extend(data);
    std::fs::write(path, bytes).unwrap();
}

#[test]
fn a_mask_is_one_object_however_it_was_saved() {
    use png::{BitDepth::*, ColorType::*};
    let folder = tempfile::tempdir().unwrap();
    let (depth, labels) = images();
    let twin = twin_of_the_first();
    write(folder.path(), "a", &depth, &labels);
    std::fs::remove_file(folder.path().join("a_label.png")).unwrap();
    let inside: Vec<bool> = labels.iter().map(|label| *label == 1).collect();
    let bytes = |of: &dyn Fn(bool) -> Vec<u8>| inside.iter().flat_map(|inside| of(*inside)).collect::<Vec<u8>>();
    let bits = inside.chunks(8).map(|eight| eight.iter().fold(0, |byte, inside| byte << 1 | u8::from(*inside))).collect();
    let mask = folder.path().join("a_mask.png");
    for (colour, depth, data) in [
        (Grayscale, Eight, bytes(&|inside| vec![255 * u8::from(inside)])),
        (Grayscale, Eight, bytes(&|inside| vec![u8::from(inside)])),
        (Grayscale, One, bits),
        (Grayscale, Sixteen, bytes(&|inside| vec![255 * u8::from(inside); 2])),
        (Indexed, Eight, bytes(&|inside| vec![3 * u8::from(inside)])),
        (Rgb, Eight, bytes(&|inside| vec![0, 200 * u8::from(inside), 0])),
        (Rgba, Eight, bytes(&|inside| vec![90, 0, 0, 255 * u8::from(inside)])),
        (GrayscaleAlpha, Eight, bytes(&|inside| vec![255 * u8::from(inside), 255])),
    ] {
        png(&mask, colour, depth, &data);
        assert_twins(&replay(folder.path(), &[]), &twin, &format!("{colour:?} {depth:?}"));
    }
    // Soft edges and noise: below half of the largest value is nothing, however many the values.
    let soft = inside.iter().enumerate().map(|(i, inside)| if *inside { 200 + (i % 50) as u8 } else { (i % 60) as u8 });
    png(&mask, Grayscale, Eight, &soft.collect::<Vec<u8>>());
    assert_twins(&replay(folder.path(), &[]), &twin, "soft");
    // Nothing in it: the object has its line, and nothing was answered.
    png(&mask, Grayscale, Eight, &[0; PIXELS]);
    let outcome = replay(folder.path(), &[]);
    assert!(outcome.code == Some(1) && outcome.said.contains("a: no grid: object 1 has no pixel"), "{}", outcome.said);
    assert!(outcome.errors.contains("no object of any frame"), "{}", outcome.errors);
}

#[test]
fn labels_have_a_void_value_and_may_be_colours() {
    let folder = tempfile::tempdir().unwrap();
    let (depth, labels) = images();
    let twin = twin();
    // The table's first rows were labelled by nobody.
    let void: Vec<u8> = labels.iter().enumerate().map(|(i, label)| if *label == 0 && i < 4 * 320 { 255 } else { *label }).collect();
    write(folder.path(), "a", &depth, &void);
    assert_twins(&replay(folder.path(), &[]), &twin, "void");
    let outcome = replay(folder.path(), &["--ignore-label", "none"]);
    assert!(outcome.said.contains("object 255") || outcome.grids.contains_key("a-255.npy"), "{}", outcome.said);
    let outcome = replay(folder.path(), &["--ignore-label", "255,2"]);
    assert!(outcome.grids.keys().all(|name| name.starts_with("a-1.")) && outcome.grids.len() == 2, "{:?}", outcome.grids.keys());
    // Colours stand for objects in the order of appearance: the low block is seen first, higher in the image.
    let first = labels.iter().find(|label| **label != 0).copied();
    let colours = labels.iter().flat_map(|label| match Some(*label) {
        Some(0) => [0, 0, 0],
        label if label == first => [200, 10, 10],
        _ => [10, 10, 200],
    });
    png(&folder.path().join("a_label.png"), png::ColorType::Rgb, png::BitDepth::Eight, &colours.collect::<Vec<u8>>());
    let found = replay(folder.path(), &[]);
    let voxels = |grids: &BTreeMap<String, Vec<u8>>| {
        let mut files: Vec<Vec<u8>> = grids.iter().filter(|(name, _)| name.ends_with("npy")).map(|(_, bytes)| bytes.clone()).collect();
        files.sort();
        files
    };
    assert!(found.code == Some(0) && voxels(&found.grids) == voxels(&twin), "{}{}", found.said, found.errors);
}

#[test]
fn depth_has_codes_a_range_and_a_unit_of_every_type() {
    let folder = tempfile::tempdir().unwrap();
    let (depth, labels) = images();
    // One pixel in a hundred has no reading, in three conventions.
    let holes = |code: u16| depth.iter().enumerate().map(|(i, units)| if i % 100 == 7 { code } else { *units }).collect::<Vec<u16>>();
    write(folder.path(), "a", &holes(0), &labels);
    let twin = replay(folder.path(), &[]).grids;
    for (code, flags) in [(65535, &[][..]), (60000, &[]), (4321, &["--no-reading", "4321"])] {
        write(folder.path(), "a", &holes(code), &labels);
        assert_twins(&replay(folder.path(), flags), &twin, &format!("{code}"));
    }
    let outcome = replay(folder.path(), &["--far", "0.2"]);
    assert!(outcome.code == Some(1) && outcome.said.contains("has 0 depth readings"), "{}", outcome.said);

    // Millimetres in floating-point numbers are no metres: one warning with the flag that mends it, which does.
    std::fs::remove_file(folder.path().join("a_depth.png")).unwrap();
    let file = folder.path().join("a_depth.npy");
    npy(&file, "<f4", holes(0).iter().flat_map(|units| f32::from(*units).to_le_bytes()));
    let outcome = replay(folder.path(), &[]);
    assert_eq!(outcome.errors.matches("--depth-scale 0.001 ").count(), 1, "{}", outcome.errors);
    assert_twins(&replay(folder.path(), &["--depth-scale", "0.001"]), &twin, "float millimetres");
    // The same in 32 bits, whose largest value is no reading.
    npy(&file, "<u4", holes(0).iter().flat_map(|units| if *units == 0 { u32::MAX } else { (*units).into() }.to_le_bytes()));
    assert_twins(&replay(folder.path(), &[]), &twin, "32 bits");
    // Ten times too large.
    npy(&file, "<u4", holes(0).iter().flat_map(|units| (10 * u32::from(*units)).to_le_bytes()));
    let outcome = replay(folder.path(), &[]);
    assert_eq!(outcome.errors.matches("--depth-scale 0.0001 ").count(), 1, "{}", outcome.errors);
    assert_twins(&replay(folder.path(), &["--depth-scale", "0.0001"]), &twin, "tenths of a millimetre");
    let outcome = replay(folder.path(), &["--depth-scale", "0.0001", "--known-side", "117"]);
    assert!(outcome.errors.contains("did you mean --known-side 0.117?"), "{}", outcome.errors);
}

#[test]
fn distances_along_the_ray_are_depths_when_it_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let (depth, labels) = images();
    // In exact numbers, so that rounding plays no part.
    let metres = |along: bool| -> Vec<u8> {
        let scaled = depth.iter().enumerate().map(|(i, units)| {
            let (x, y) = ((i % 320) as f64 - 159.5, (i / 320) as f64 - 119.5);
            let ray = if along { (1.0 + (x * x + y * y) / (FOCAL * FOCAL)).sqrt() } else { 1.0 };
            f64::from(*units) * 0.001 * ray
        });
        scaled.flat_map(f64::to_le_bytes).collect()
    };
    write(folder.path(), "a", &depth, &labels);
    std::fs::remove_file(folder.path().join("a_depth.png")).unwrap();
    let file = folder.path().join("a_depth.npy");
    npy(&file, "<f8", metres(false));
    let twin = replay(folder.path(), &[]).grids;
    npy(&file, "<f8", metres(true));
    let found = replay(folder.path(), &["--depth-along", "ray"]);
    let wrong = replay(folder.path(), &[]);
    // f32 rounds the distance; a voxel at the very edge of a band may differ.
    let differ = |grids: &BTreeMap<String, Vec<u8>>| grids["a-1.npy"].iter().zip(&twin["a-1.npy"]).filter(|(a, b)| a != b).count();
    assert!(
        found.code == Some(0) && differ(&found.grids) < 20 && differ(&wrong.grids) > 100,
        "{} {}",
        differ(&found.grids),
        differ(&wrong.grids)
    );
}

#[test]
fn the_camera_may_be_described_by_ros_kalibr_open3d_realsense_or_a_matrix() {
    let folder = tempfile::tempdir().unwrap();
    let (depth, labels) = images();
    let twin = twin();
    write(folder.path(), "a", &depth, &labels);
    std::fs::remove_file(folder.path().join("camera_info.yaml")).unwrap();
    let frames = folder.path();
    let matrix = format!("{FOCAL} 0 159.5\n0 {FOCAL} 119.5\n0 0 1\n");
    let k = format!("K: [{FOCAL}, 0, 159.5, 0, {FOCAL}, 119.5, 0, 0, 1]\n");
    let ros = format!("height: 240\nwidth: 320\n{k}");
    let realsense = format!(
        "{{\"width\": 320, \"height\": 240, \"ppx\": 159.5, \"ppy\": 119.5, \"fx\": {FOCAL}, \"fy\": {FOCAL}, \"model\": \"distortion.brown_conrady\", \
         \"coeffs\": [0, 0, 0, 0, 0]}}"
    );
    for (name, content) in [
        ("cam_K.txt", matrix),
        ("camera_info.yaml", format!("{ros}distortion_model: plumb_bob\nD: [0, 0, 0, 0, 0, 0, 0, 0]\n")),
        ("camera_info.yaml", format!("{ros}distortion_model: rational_polynomial\nD: [0, 0, 0, 0, 0, 0, 0, 0]\n")),
        (
            "a_camera_info.yaml",
            format!(
                "height: 480\nwidth: 640\nK: [{}, 0, 319.5, 0, {}, 239.5, 0, 0, 1]\nbinning_x: 2\nbinning_y: 2\n",
                2.0 * FOCAL,
                2.0 * FOCAL
            ),
        ),
        (
            "camera_info.yml",
            format!(
                "height: 480\nwidth: 640\nK: [{FOCAL}, 0, 259.5, 0, {FOCAL}, 199.5, 0, 0, 1]\n\
                 roi: {{x_offset: 100, y_offset: 80, height: 240, width: 320}}\n"
            ),
        ),
        (
            "camchain.yaml",
            format!(
                "cam0:\n  camera_model: pinhole\n  intrinsics: [{FOCAL}, {FOCAL}, 159.5, 119.5]\n  distortion_model: radtan\n  distortion_coeffs: [0, 0, 0, 0]\n  resolution: [320, 240]\n"
            ),
        ),
        (
            "camera_intrinsic.json",
            format!("{{\"width\": 320, \"height\": 240, \"intrinsic_matrix\": [{FOCAL}, 0, 0, 0, {FOCAL}, 0, 159.5, 119.5, 1]}}"),
        ),
        ("intrinsics.json", realsense),
    ] {
        std::fs::write(frames.join(name), content).unwrap();
        assert_twins(&replay(frames, &[]), &twin, name);
        std::fs::remove_file(frames.join(name)).unwrap();
    }
    let outcome = replay(frames, &[]);
    assert!(outcome.code == Some(1) && outcome.said.contains("there is no camera in"), "{}", outcome.said);

    // Rectified images beside the camera_info of the raw ones.
    let raw = "height: 240\nwidth: 320\nK: [300, 0, 150, 0, 300, 120, 0, 0, 1]\ndistortion_model: plumb_bob\nD: [-0.28, 0.09, 0.0005, -0.0003, 0.0]\n";
    let p = format!("P: [{FOCAL}, 0, 159.5, 0, 0, {FOCAL}, 119.5, 0, 0, 0, 1, 0]\n");
    std::fs::write(frames.join("camera_info.yaml"), format!("{raw}{p}")).unwrap();
    assert_twins(&replay(frames, &["--rectified"]), &twin, "--rectified");
    assert!(replay(frames, &[]).grids["a-1.npy"] != twin["a-1.npy"]);
    std::fs::write(frames.join("camera_info.yaml"), format!("{}{p}", ros.replace(&k, "K: [0, 0, 0, 0, 0, 0, 0, 0, 0]\n"))).unwrap();
    let outcome = replay(frames, &[]);
    assert!(outcome.code == Some(1) && outcome.said.contains("not calibrated; P is given"), "{}", outcome.said);
    assert_twins(&replay(frames, &["--rectified"]), &twin, "P of a K that is not calibrated");
}

#[test]
fn foundationpose_s_and_bop_s_folders_are_read_and_hidden_instances_named() {
    let folder = tempfile::tempdir().unwrap();
    let (depth, labels) = images();
    let twin = twin();
    let big: Vec<u8> = depth.iter().flat_map(|units| units.to_be_bytes()).collect();
    let mask = |label: u8| labels.iter().map(|other| 255 * u8::from(*other == label)).collect::<Vec<u8>>();
    let save = |name: &str, data: &[u8]| {
        let path = folder.path().join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        let bits = if data.len() == PIXELS { png::BitDepth::Eight } else { png::BitDepth::Sixteen };
        png(&path, png::ColorType::Grayscale, bits, data);
    };
    save("fp/depth/a.png", &big);
    save("fp/depth/b.png", &big);
    save("fp/masks/a.png", &mask(1));
    std::fs::write(folder.path().join("fp/cam_K.txt"), format!("{FOCAL} 0 159.5\n0 {FOCAL} 119.5\n0 0 1\n")).unwrap();
    let outcome = replay(&folder.path().join("fp"), &[]);
    assert!(outcome.code == Some(0) && outcome.grids == twin_of_the_first(), "{}{}", outcome.said, outcome.errors);

    save("bop/depth/000000.png", &big);
    for (instance, label) in [(0, 1), (1, 2), (2, 9)] {
        save(&format!("bop/mask/000000_00000{instance}.png"), &mask(label));
    }
    std::fs::write(
        folder.path().join("bop/scene_camera.json"),
        format!("{{\"000000\": {{\"cam_K\": [{FOCAL}, 0, 159.5, 0, {FOCAL}, 119.5, 0, 0, 1], \"depth_scale\": 1.0}}}}"),
    )
    .unwrap();
    let outcome = replay(&folder.path().join("bop"), &[]);
    assert!(outcome.code == Some(0) && outcome.said.contains("000000: no grid: object 3 has no pixel"), "{}", outcome.said);
    for label in [1, 2] {
        assert!(outcome.grids[&format!("000000-{label}.npy")] == twin[&format!("a-{label}.npy")]);
    }
}

#[test]
fn a_watcher_passes_over_what_was_published_before_it_came() {
    let folder = tempfile::tempdir().unwrap();
    let (depth, labels) = images();
    write(folder.path(), "a", &depth, &labels);
    let name = instance();
    let _daemon = serve(&name);
    let play = || run(["camera", folder.path().to_str().unwrap(), "--instance", &name]);
    assert!(play().status.success());
    // One that wants it gets it, and is told that it is old.
    let marked = run(["watch", "--instance", &name, "--json", "--count", "1", "--since-start=false"]);
    let line: serde_json::Value = serde_json::from_str(&text(&marked.stdout)).unwrap();
    assert!(line["published_before_start_s"].as_f64().unwrap() > 0.0, "{line}");
    let before = line["producer_id"].clone();
    let mut watcher = Running::start(beo(["watch", "--instance", &name, "--json", "--count", "2"]));
    assert!(watcher.message().starts_with("watching"));
    let output = play();
    assert!(output.status.success(), "{}", text(&output.stderr));
    for _ in 0..2 {
        let line: serde_json::Value = serde_json::from_str(&watcher.line()).unwrap();
        assert!(line.get("published_before_start_s").is_none() && line["producer_id"] != before, "{line}");
    }
    assert!(watcher.wait().success());
}
